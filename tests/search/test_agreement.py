import numpy as np

from jaxleg.search.agreement import Agreement, agreement


def sample(usable):
    rng = np.random.default_rng(0)
    simulated = rng.uniform(500.0, 1000.0, 40)
    proxy = simulated + rng.normal(0.0, 30.0, 40)
    return Agreement(proxy, simulated, ~usable, usable)


def test_by_hand():
    usable = np.arange(40) % 7 > 0
    data = sample(usable)
    seen = agreement(data)
    assert (seen["gaits"], seen["falls"]) == (usable.sum(), (~usable).sum())
    places = [[sum(other < x for other in values[usable]) for x in values[usable]] for values in (data.proxy, data.simulated)]
    apart, n = sum((a - b) ** 2 for a, b in zip(*places)), usable.sum()
    assert np.isclose(seen["spearman"], 1.0 - 6.0 * apart / (n * (n**2 - 1)))
    assert np.isclose(seen["bias"], np.mean((data.proxy / data.simulated)[usable]) - 1.0)


def test_nothing_to_compare_is_said_and_not_an_error():
    seen = agreement(sample(np.zeros(40, bool)))
    assert seen == {"gaits": 0, "falls": 40, "spearman": None, "bias": None}
