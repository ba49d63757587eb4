"""What a replay tells: nothing of a walk that goes nowhere, only of steps that were made, in both engines."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxleg.sim import replay as replay_module
from jaxleg.sim.follow import Followed
from jaxleg.sim.meters import no_tally, read
from jaxleg.sim.referee_feedback import follow_all
from jaxleg.sim.replay import replay_mjx, replay_mujoco
from jaxleg.terrain import Grid, flat
from jaxleg.walk.plan_file import PlanFile
from jaxleg.walk.reference import reference
from jaxleg.walk.standing import up_down
from tests.crawls import gait

GROUND = flat(Grid(60, 40, 0.04, (-1.2, -0.8)))
FIGURES = {"energy_per_metre", "power", "cost_of_transport", "distance", "time", "margin", "slip", "fell", "finished", "left"}


@jax.jit
def standing(robot):
    return reference(robot, up_down(robot, gait(), GROUND, 0.46, 0.46, 0.05), (2, 2))


def plan(pegasus, steps=0, **changes):
    """A plan of no step: six moves up and down that stay at one height, 0.3 s."""
    track = jax.tree.map(np.asarray, standing(pegasus))
    params = {"friction": 0.8, "tick": 0.0025, "steps": steps, "power": "positive"}
    fields = {"robot": pegasus, "terrain": GROUND, "reference": track._replace(**changes), "params": params, "samples": 4}
    fields |= {"footholds": track.foot_pos[:1], "goal": np.zeros(2), "datum": np.zeros(3)}
    return PlanFile(**{name: fields[name] for name in PlanFile._fields})


@pytest.mark.parametrize("engine", [replay_mjx, replay_mujoco])
def test_a_walk_that_goes_nowhere_has_no_cost_of_transport(pegasus, engine):
    result, frames = engine(plan(pegasus), 0.1)
    assert result.keys() >= FIGURES
    assert result["finished"]
    assert not result["fell"]
    assert result["distance"] < 2.0 * float(pegasus.foot_radius)
    assert np.isnan(result["cost_of_transport"])
    assert np.isnan(list(result["energy_per_metre"].values())).all()
    assert np.isnan(result.get("landing_worst", np.nan))
    assert result["time"] == pytest.approx(0.3, abs=0.005)
    assert np.isfinite(frames).all()
    assert {type(x) for x in result.values()} <= {str, float, bool, dict}


def test_a_plan_sampled_finer_than_the_referees_tick_is_followed_to_its_end(pegasus):
    """Samples 1.3 ms apart, ticks of 4 ms that go on by one sample each."""
    fine = jax.tree.map(np.asarray, reference(pegasus, up_down(pegasus, gait(), GROUND, 0.45, 0.47, 0.4), (300, 300)))
    coarse = jax.tree.map(lambda x: x[::8], fine)
    assert np.diff(fine.time).max() < 0.002
    energies = []
    for track in (fine, coarse):
        watched = follow_all(pegasus, [GROUND], [track], 0.8)
        assert watched.over.all()
        energies.append(watched.verdict.energy.joule[0])
    assert energies[0] == pytest.approx(energies[1], rel=0.01)
    file = plan(pegasus)._replace(reference=fine)
    assert replay_mujoco(file, 0.1)[0]["finished"]


@pytest.mark.parametrize("engine", [replay_mjx, replay_mujoco])
def test_a_plan_that_cannot_be_computed_is_a_fall_whose_figures_are_plain_numbers(pegasus, engine):
    result, frames = engine(plan(pegasus, steps=3, joint_torque=np.full((13, 4, 3), np.nan)), 0.1)
    assert result["fell"]
    assert not result["finished"]
    assert np.isnan(result.get("landing_worst", np.nan))
    assert frames.ndim == 2
    assert {type(x) for x in result.values()} <= {str, float, bool, dict}


@pytest.mark.parametrize(("reached", "worst"), [(12, 0.09), (11, 0.04), (4, 0.01), (3, np.nan)])
def test_only_steps_that_were_made_are_judged(pegasus, monkeypatch, reached, worst):
    """Three steps of four samples that land 1, 4 and 9 cm off; the walk ends at some sample."""
    file = plan(pegasus, steps=3)

    def film(*_):
        zero = read(no_tally(float), jnp.array(True))
        feet = file.reference.foot_pos[:1] + np.array([0.01, 0.04, 0.09])[:, None, None] * [1.0, 0.0, 0.0]
        ended = jnp.asarray(reached)
        return Followed(zero, jnp.asarray(feet), jnp.zeros((3, 7)), ended, ended == 12), jnp.zeros((2, 19))

    monkeypatch.setattr(replay_module, "film", film)
    result, _ = replay_mjx(file, 0.1)
    np.testing.assert_allclose(result["landing_worst"], worst, atol=1e-12)
    assert result["finished"] == (reached == 12)


def test_no_plans_are_no_verdicts(pegasus):
    seen = follow_all(pegasus, [], [], 0.8)
    assert {len(x) for x in jax.tree.leaves(seen)} == {0}
