"""The cost map: its formula, its headings, what is refused."""

import jax
import numpy as np
import pytest

from jaxleg.conventions import InputError
from jaxleg.settings import build, dump, load
from jaxleg.terrain import HeightMap
from jaxleg.terrain.body_cost import body_features, traversable
from jaxleg.terrain.cost_map import CostSettings, combined, cost_weights

SIZE, SHAPE = 0.04, (18, 18)
SETTINGS = CostSettings(step_threshold=0.15, lambda_body=0.3, lambda_feet=0.7)


def make(elevation):
    return HeightMap(elevation, np.zeros(2, elevation.dtype), np.array(SIZE, elevation.dtype))


@pytest.fixture(scope="module")
def compute(costs):
    """The cost map of an elevation."""
    return lambda elevation: jax.device_get(costs(elevation, cost_weights(SETTINGS))[1])


def ground(seed=0):
    rng = np.random.default_rng(seed)
    elevation = np.cumsum(np.cumsum(0.01 * rng.normal(size=SHAPE), axis=0), axis=1) / 3.0
    elevation[11:14, 3:7] += 0.3
    elevation[:3, :4] = np.nan
    return elevation


def test_total_is_the_weighted_sum_where_the_body_can_be_and_its_feet_have_ground(compute, windows):
    cost = compute(ground())
    total, possible = cost.total, np.isfinite(cost.body) & np.isfinite(cost.feet)
    assert 0.2 < possible.mean() < 0.9
    assert np.all((total[possible] >= 0.0) & (total[possible] <= 1.0))
    expected = 0.3 * cost.body + 0.7 * cost.feet
    np.testing.assert_allclose(total, np.where(possible, expected, np.inf), rtol=1e-12)
    features = jax.jit(body_features, static_argnums=(1, 2))(make(ground()), SIZE, windows.body)
    np.testing.assert_array_equal(np.isfinite(cost.body), jax.jit(traversable)(features, cost_weights(SETTINGS).body))


def test_all_of_one_share_does_not_make_the_impossible_possible():
    total = jax.jit(combined)
    body, feet = np.full((4, 4), np.inf), np.full((8, 4, 4), 0.5)
    assert np.all(np.isinf(np.asarray(total(body, feet, 0.0))))
    assert np.all(np.isinf(np.asarray(total(np.zeros((4, 4)), np.inf * feet, 1.0))))


def test_a_quarter_turn_of_the_map_turns_the_headings(compute):
    straight = compute(ground()).total
    turned = compute(np.rot90(ground()).copy()).total  # x becomes y: the map turns by 90 deg
    turned = np.rot90(turned, -1, axes=(1, 2))
    for k in range(8):
        assert np.isfinite(straight[k]).any()
        assert not np.allclose(straight[k], straight[k - 2])
    same = [np.allclose(turned[(k + s) % 8], straight[k], rtol=1e-9) for s in (2, -2) for k in range(8)]
    assert same == [True] * 8 + [False] * 8


def test_an_unseen_map_is_no_way(compute):
    assert np.all(np.isinf(compute(np.full(SHAPE, np.nan)).total))


def test_settings_come_back_from_a_file(tmp_path):
    dump(SETTINGS, tmp_path / "cost.toml")
    assert load(CostSettings, tmp_path / "cost.toml") == SETTINGS


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"body_weights": [0.5, 0.5, 0.5]}, r"squares of body_weights, \[0.5, 0.5, 0.5\], sum to 0.75, but must sum to 1"),
        ({"lambda_body": 0.9}, "lambda_body and lambda_feet, 0.9 and 0.5, must sum to 1"),
        ({"foot_weights": {"RF": [0.5] * 8}}, "foot_weights: RF: weights sum to 4, but must sum to 1"),
        ({"windows": {"body": {"roughness": "lots"}}}, "roughness is .lots., but must be a text, one of"),
    ],
)
def test_what_does_not_normalise_is_refused_in_a_sentence(table, message):
    with pytest.raises(InputError, match=rf"^x.toml: .*{message}"):
        build(CostSettings, table, "x.toml")


def test_weights_sum_to_one_exactly_however_they_are_written():
    weights = cost_weights(CostSettings(body_weights=(0.6667, 0.6667, 0.3333)))
    np.testing.assert_allclose(np.sum(np.asarray(weights.body.weight) ** 2), 1.0, rtol=1e-12)
    np.testing.assert_allclose(np.sum(np.asarray(weights.feet.weight), axis=1), 1.0, rtol=1e-12)
