"""What a result says of randomised lanes: savings pair by pair in both engines, who fell, and within which ranges."""

import numpy as np
import pytest

from jaxleg.search import randomised as module
from jaxleg.search.config import Kind, Randomise, Search, Study
from jaxleg.search.contestants import CONTESTANTS
from jaxleg.search.randomised import randomised
from tests.search.test_contest import contest
from tests.stand_ins import StandInLab, StandInRun


def test_a_randomised_contest_is_told_by_engine(monkeypatch):
    """`best` needs 0.6 of `traditional`'s energy in simulation, 0.7 in C MuJoCo; it falls on one lane of three there."""
    study = Study({"flat": Kind(), "rough": Kind("rough")}, search=Search(resamples=50), randomise=Randomise(lanes=6, com=0.03))
    shares = {"simulation": 0.6, "mujoco": 0.7}
    fell = np.zeros((len(CONTESTANTS), 3), bool)
    fell[-1, 0] = True

    def walked(state, kind, best):
        assert best == list(study.kinds).index(kind)
        energy = {engine: np.full((len(CONTESTANTS), 3), 1000.0) for engine in shares}
        for engine, share in shares.items():
            energy[engine][-1] *= share
        return contest(energy["simulation"]), contest(energy["mujoco"], fell)

    monkeypatch.setattr(module, "walked", walked)
    told = randomised(StandInRun(study, StandInLab()), {kind: np.array(i) for i, kind in enumerate(study.kinds)})
    for kind in study.kinds:
        for engine, share in shares.items():
            assert told["saving"][engine]["best"][kind]["net"]["mean"] == pytest.approx(1.0 - share)
            falls = {name: told["failed"][engine][name][kind]["falls"] for name in CONTESTANTS}
            assert falls == dict.fromkeys(CONTESTANTS, 0) | {"best": int(engine == "mujoco")}
            assert told["failed"][engine]["best"][kind]["lanes"] == 3
    assert told["ranges"]["com"] == 0.03
    assert told["ranges"]["map_filter"] == 2.0
