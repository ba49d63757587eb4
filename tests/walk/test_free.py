"""The free form of a walk: what is added where, what is tied to what, and what stays as it was."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxleg.conventions import LEG_SIDE
from jaxleg.gait.order import SHIFT
from jaxleg.posture.collision import Sizes, robot_obstacles
from jaxleg.search.config import Kind, Study
from jaxleg.search.contestants import baseline, contestant
from jaxleg.search.free import free_lab
from jaxleg.search.lanes import CYCLES, settings_of
from jaxleg.search.run import make_lab
from jaxleg.terrain import Grid
from jaxleg.terrain.site import Site
from jaxleg.walk.choices import no_choice
from jaxleg.walk.free import count_of, gathered, names_of, spread, tie

GRID = Grid(112, 52, 0.02, (-0.9, -0.51))
STUDY = Study(kinds={"flat": Kind()})
MIRROR = np.array([1.0, -1.0, 1.0, 1.0, -1.0, -1.0])  # of (x, y, z, pitch, roll, yaw)


@pytest.fixture(scope="module")
def lab(pegasus):
    return make_lab(STUDY, pegasus)


@pytest.fixture(scope="module")
def sites(pegasus):
    """Level ground, and a plane that rises ahead and to the left."""
    x, y = np.meshgrid(GRID.resolution * np.arange(GRID.nx), GRID.resolution * np.arange(GRID.ny), indexing="ij")

    def site(elevation):
        terrain = GRID.map(jnp.asarray(elevation))
        return Site(terrain, np.ones((GRID.nx, GRID.ny), bool), robot_obstacles(Sizes.of(pegasus), terrain, GRID.resolution))

    return site(0.0 * x), site(0.05 * x + 0.1 * y)


@pytest.fixture(scope="module")
def mirrored(lab):
    """The lab of a mirrored form, and the function that builds a walk of the paper's gait with its numbers on a site."""
    setting, ten = settings_of(contestant(STUDY, "flat", "paper")), jnp.asarray(baseline(STUDY, "flat", "paper"))
    own, choice = free_lab(lab, 1, True, move=lab.move), no_choice(CYCLES, ten.dtype)
    return own, jax.jit(lambda numbers, site: own.walk(jnp.concatenate([ten, numbers]), site, choice, setting))


def drawn(lab, seed=0):
    """Numbers at random in half of their bounds."""
    low, high = lab.bounds.T
    return low + (high - low) * np.random.default_rng(seed).uniform(0.25, 0.75, len(low))


def test_nothing_added_is_the_walk_as_it_was_planned(lab, sites, mirrored):
    own, walk = mirrored
    setting, ten = settings_of(contestant(STUDY, "flat", "paper")), jnp.asarray(baseline(STUDY, "flat", "paper"))
    planned = jax.jit(lambda site: lab.walk(ten, site, no_choice(CYCLES, ten.dtype), setting))(sites[1])
    same = walk(np.zeros(len(own.bounds)), sites[1])
    for a, b in zip(jax.tree.leaves(planned), jax.tree.leaves(same), strict=True):
        np.testing.assert_allclose(b, a, rtol=1e-12, atol=1e-12)


def test_a_mirrored_form_is_its_own_mirror_image_half_a_cycle_later(mirrored, sites):
    own, walk = mirrored
    made = walk(drawn(own), sites[0])
    phases, half = made.phases, 3
    ahead = 0.5 * float(made.gait.step_length)
    for name in ("trunk_from", "trunk_to"):
        pose = np.asarray(getattr(phases, name))
        image = MIRROR * pose[:-half] + np.array([ahead, 0, 0, 0, 0, 0])
        np.testing.assert_allclose(pose[half:], image, atol=1e-9)
    for x in (phases.duration, phases.flight.apex, phases.flight.lift):
        np.testing.assert_allclose(x[half:], x[:-half], atol=1e-12)
    feet = np.asarray(phases.feet_to)
    np.testing.assert_allclose(feet[half:, [1, 0, 3, 2]], feet[:-half] * [1, -1, 1] + [ahead, 0, 0], atol=1e-9)


def test_the_trunk_goes_on_from_where_it_has_come_to(mirrored, sites):
    own, walk = mirrored
    phases = walk(drawn(own), sites[1]).phases
    np.testing.assert_allclose(phases.trunk_from[1:], phases.trunk_to[:-1], atol=1e-12)
    np.testing.assert_allclose(phases.start[1:], (phases.start + phases.duration)[:-1], rtol=1e-12)


def test_times_are_shared_out_anew_and_their_sum_stays(mirrored, sites):
    own, walk = mirrored
    numbers, names = np.zeros(len(own.bounds)), np.array(names_of(own.tie))
    numbers[names == "time"] = np.log([1.0, 2.0, 3.0])
    before, after = (np.asarray(walk(x, sites[1]).phases.duration) for x in (np.zeros_like(numbers), numbers))
    assert after.sum() == pytest.approx(before.sum())
    np.testing.assert_allclose(after / after[0], before / before[0] * np.tile([1, 2, 3], 4), rtol=1e-9)


def test_feet_go_aside_over_the_ground(mirrored, sites):
    """Outwards by one number for the front feet and one for the hind ones, on the plane under them."""
    own, walk = mirrored
    numbers, names = np.zeros(len(own.bounds)), np.array(names_of(own.tie))
    numbers[names == "aside"] = 0.03, 0.05
    before, after = (np.asarray(walk(x, sites[1]).footholds) for x in (np.zeros_like(numbers), numbers))
    moved = after - before
    np.testing.assert_allclose(moved[..., 0], 0.0, atol=1e-6)
    np.testing.assert_allclose(moved[..., 1], [np.array(LEG_SIDE) * [0.03, 0.03, 0.05, 0.05]] * (CYCLES + 1), atol=1e-6)
    np.testing.assert_allclose(moved[..., 2], 0.1 * moved[..., 1], atol=1e-6)


@pytest.mark.parametrize(("form", "numbers"), [((1, True), 27), ((2, False), 54), ((None, False), 104)])
def test_how_many_numbers_a_form_has(lab, form, numbers):
    """Six of the trunk a border, a duration a phase, apex and lift a swing; and two feet mirrored, or four."""
    ties = free_lab(lab, *form).tie
    assert count_of(ties) == numbers
    assert len(names_of(ties)) == numbers
    assert "" not in names_of(ties)


def test_every_number_stands_somewhere_and_a_shift_flies_nowhere():
    legs = (SHIFT, 3, 1, SHIFT, 2, 0)
    ties = tie(legs, 2, 3, True)
    vector = jnp.arange(1.0, count_of(ties) + 1.0)
    free = spread(ties, vector)
    seen = np.abs(np.concatenate([np.ravel(x) for x in free]))
    assert set(seen) == {0.0, *np.asarray(vector)}
    for x in (free.apex, free.lift):
        np.testing.assert_array_equal(np.asarray(x)[[0, 3]], 0.0)
    np.testing.assert_allclose(free.trunk[3:6], np.asarray(free.trunk[:3]) * MIRROR)
    np.testing.assert_allclose(free.trunk[6], free.trunk[0])


def test_a_mirrored_form_is_one_of_the_forms_whose_half_cycles_have_their_own():
    legs = (SHIFT, 3, 1, SHIFT, 2, 0)
    few, many = tie(legs, 2, 3, True), tie(legs, 2)
    free = spread(few, jnp.asarray(np.random.default_rng(4).normal(size=count_of(few))))
    again = spread(many, jnp.asarray(gathered(many, free)))
    for a, b in zip(free, again, strict=True):
        np.testing.assert_allclose(b, a)
