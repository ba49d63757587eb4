"""Kept programs: used without being traced again, and only by what they were traced of."""

import dataclasses
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_array_equal

from jaxleg.batch import over_lanes
from jaxleg.programs import Kept, of_method
from jaxleg.search.free import free_lab
from jaxleg.search.lanes import Lab
from jaxleg.sim.contact import Ground
from jaxleg.swing.planner import shortest
from jaxleg.swing.routing import taut_string
from jaxleg.terrain import HeightMap

X = np.arange(6.0)


class Elsewhere(NamedTuple):
    x: np.ndarray


def scaled(factor, where):
    """Lanes of (factor x, nothing at all): what the function is does not show in its name."""
    return over_lanes(lambda x: (factor * jnp.asarray(jax.tree.leaves(x)[0]), jnp.zeros(0)), 2, where=where)


def test_a_kept_program_is_not_traced_again(tmp_path):
    where = Kept(tmp_path, "scaled")
    assert_array_equal(scaled(2.0, where)(X)[0], 2.0 * X)
    (file,) = tmp_path.glob("*.program")
    assert_array_equal(scaled(3.0, where)(X)[0], 2.0 * X)  # the file's
    assert_array_equal(scaled(3.0, where._replace(name="other"))(X)[0], 3.0 * X)
    assert_array_equal(scaled(4.0, where)(np.float32(X))[0], 4.0 * X)  # other types
    with jax.default_matmul_precision("bfloat16"):
        assert_array_equal(scaled(5.0, where)(X)[0], 5.0 * X)
    assert len(list(tmp_path.glob("*.program"))) == 4
    file.write_bytes(file.read_bytes()[:-30])
    assert_array_equal(scaled(6.0, where)(X)[0], 6.0 * X)  # cut off: traced anew, and whole again
    assert_array_equal(scaled(7.0, where)(X)[0], 6.0 * X)


def test_a_folder_that_cannot_be_written_is_no_hindrance(tmp_path):
    (tmp_path / "file").touch()
    assert_array_equal(scaled(2.0, Kept(tmp_path / "file" / "below", "scaled"))(X)[0], 2.0 * X)


def test_other_sources_are_other_programs(tmp_path, monkeypatch):
    where = Kept(tmp_path, "scaled")
    scaled(2.0, where)(X)
    monkeypatch.setattr("jaxleg.programs._sources", lambda: "changed")
    assert_array_equal(scaled(3.0, where)(X)[0], 3.0 * X)


def test_what_comes_from_elsewhere_is_traced_as_ever(tmp_path):
    """A class of the user's own may compute anything, and its source is not in a name; the package's own is."""
    where = Kept(tmp_path, "scaled")
    for factor in (2.0, 3.0):
        assert_array_equal(scaled(factor, where)(Elsewhere(X))[0], factor * X)
        assert_array_equal(scaled(factor, where)({"a": (Elsewhere(X),)})[0], factor * X)
    assert not list(tmp_path.glob("*"))
    ground = HeightMap(np.ones((6, 2, 2)), np.zeros((6, 2)), np.ones(6))
    assert_array_equal(scaled(2.0, where)(ground)[0], scaled(3.0, where)(ground)[0])


def test_a_function_from_elsewhere_in_a_structure_is_traced_as_ever(tmp_path):
    """What is static may be a function, told by nothing but its place in memory."""
    planners = [dataclasses.replace(shortest(), route=route) for route in (taut_string, lambda view: None)]
    rows = [jax.tree.map(lambda x: jnp.broadcast_to(x, 6), planner) for planner in planners]
    for factor in (2.0, 3.0):
        for row, seen in zip(rows, (2.0, factor)):
            assert_array_equal(scaled(factor, Kept(tmp_path, "scaled"))(row)[0], seen * jax.tree.leaves(row)[0])


class OtherLab(Lab):
    pass


@pytest.mark.parametrize(
    "changes",
    [
        {"move": ("gait.step_length",)},
        {"ground": Ground(friction=0.7)},
        {"steps": 3},
        {"counted": (0.0, 0.9)},
        {"rows": 64},
    ],
)
def test_a_lab_is_in_the_name_of_its_programs(pegasus, tmp_path, changes):
    lab = Lab(pegasus, ("gait.skew",), Ground(), (8, 8), 2, 1, "net", programs=tmp_path)
    again = dataclasses.replace(lab, robot=jax.tree.map(jnp.array, pegasus))
    twice, once = "".join(["gait.", "skew"]), "".join(["gait.", "skew"])  # no one object
    names = [of_method(dataclasses.replace(lab, move=(twice, x)), "plans") for x in (twice, once)]
    assert names[0] == names[1]
    other = dataclasses.replace(lab, **changes)
    heavier = dataclasses.replace(lab, robot=dataclasses.replace(pegasus, trunk_mass=pegasus.trunk_mass + 1e-6))
    names = [of_method(x, "plans").name for x in (lab, other, heavier, free_lab(lab, None), free_lab(lab, 1))]
    assert len({*names, of_method(lab, "models").name}) == 6
    assert of_method(again, "plans") == of_method(lab, "plans")
    assert of_method(dataclasses.replace(lab, programs=None), "plans") is None
    assert of_method(OtherLab(**vars(lab)), "plans") is None
