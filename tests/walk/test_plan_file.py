"""Plan files: what is read is what was written, and nothing that is spoiled is used."""

import dataclasses
import json
from pathlib import Path

import jax
import numpy as np
import pytest

from jaxleg.conventions import InputError
from jaxleg.robot import Robot
from jaxleg.robot.file import Motor, RobotFile, build_robot
from jaxleg.settings import load
from jaxleg.terrain.files import load_map
from jaxleg.walk.plan_check import LAYOUTS, ROBOT
from jaxleg.walk.plan_file import load_plan
from tests.plans import EACH, PARAMS, SHIFT, TRUNK, arrays_of, save_standing, standing, with_params


@pytest.fixture(scope="module")
def good(pegasus, tmp_path_factory):
    return arrays_of(save_standing(tmp_path_factory.mktemp("plan") / "plan.npz", pegasus))


def refusal(folder, arrays) -> str:
    """The sentence with which a plan of these arrays is refused."""
    np.savez(folder / "bad.npz", **arrays)
    with pytest.raises(InputError) as caught:
        load_plan(folder / "bad.npz")
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith(f"{folder / 'bad.npz'}: ")
    return str(caught.value)


def test_a_plan_comes_back_as_it_was(tmp_path, pegasus):
    datum = np.array([388096.0, 3948992.0, 4032.0])
    elevation = np.zeros((60, 50))
    elevation[3, 4] = np.nan
    file = load_plan(save_standing(tmp_path / "plan", pegasus, elevation, datum))
    jax.tree.map(np.testing.assert_array_equal, file.reference, standing(pegasus))
    for mine, given in zip(jax.tree.leaves(file.robot), jax.tree.leaves(pegasus), strict=True):
        np.testing.assert_array_equal(mine, given)
    np.testing.assert_array_equal(file.terrain.elevation, elevation)
    np.testing.assert_array_equal(file.datum, datum)
    np.testing.assert_array_equal(file.footholds, standing(pegasus).foot_pos[[0, EACH]])
    np.testing.assert_array_equal(file.goal, TRUNK[:2])
    assert file.params == PARAMS
    assert file.samples == EACH


def test_a_foot_counts_as_in_contact_that_bears_more_than_half_of_what_it_will(tmp_path, pegasus):
    walk = standing(pegasus)
    walk.contact[3] = [1.0, 0.45, 0.0, 0.55]
    saved = arrays_of(save_standing(tmp_path / "plan.npz", pegasus, walk=walk))
    np.testing.assert_array_equal(saved["contact"][3], [True, False, False, True])
    np.testing.assert_array_equal(saved["load"], walk.contact)


def test_the_map_of_a_plan_is_a_map_file_too(tmp_path, pegasus):
    datum = np.array([388096.0, 3948992.0, 4032.0])
    again = load_map(save_standing(tmp_path / "plan.npz", pegasus, datum=datum))
    np.testing.assert_array_equal(again.datum, datum)
    np.testing.assert_array_equal(again.terrain.elevation, np.zeros((60, 50)))


def test_only_the_valid_samples_are_used(tmp_path, pegasus, good):
    """Two samples more than the walk has."""
    rows = EACH + SHIFT + 1
    longer = {key: np.concatenate([value, value[-2:]]) if value.shape[:1] == (rows,) else value for key, value in good.items()}
    longer |= {"time": np.append(good["time"], [1.1, 1.2]), "valid": np.arange(rows + 2) < rows}
    np.savez(tmp_path / "longer.npz", **longer)
    jax.tree.map(np.testing.assert_array_equal, load_plan(tmp_path / "longer.npz").reference, standing(pegasus))


def test_nothing_is_written_that_nobody_knows(good):
    """Statuses of footholds and swings were constant zeros."""
    assert {"foothold_status", "swing_status"} & set(good) == set()


def test_a_robot_whose_file_is_within_its_limits_is_within_a_plans(pegasus):
    """Motors, gears and controllers at both ends, and links of almost no weight."""
    file = load(RobotFile, Path(__file__).parents[2] / "configs/robots/pegasus.toml")
    motor = {field.name: field.metadata for field in dataclasses.fields(Motor)}
    for end in ("min", "max"):
        changed = {name: rule[end] for name, rule in motor.items() if rule.get(end) is not None}
        robot = build_robot(dataclasses.replace(file, motor=dataclasses.replace(file.motor, **changed)))
        for name, rule in ROBOT.items():
            values = np.asarray(getattr(robot, name))
            assert rule.low <= values.min() <= values.max() <= rule.high, name


def test_every_field_of_a_robot_is_checked():
    assert set(ROBOT) == {field.name for field in dataclasses.fields(Robot)}


@pytest.mark.parametrize("key", LAYOUTS)
def test_a_key_that_is_missing_or_of_another_kind_is_refused(tmp_path, good, key):
    assert f"{key} is missing; is this a plan" in refusal(tmp_path, {k: v for k, v in good.items() if k != key})
    for value in (good[key][None], good[key].astype("S8"), np.full(good[key].shape, None)):
        assert f"{key} has shape" in refusal(tmp_path, good | {key: value})


@pytest.mark.parametrize("key", [key for key in LAYOUTS if key not in ("valid", "params", "elevation")])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e30])
def test_a_number_that_is_none_is_refused(tmp_path, good, key, value):
    spoiled = np.array(good[key], float)
    spoiled.flat[-1] = value
    message = refusal(tmp_path, good | {key: spoiled})
    assert f": {key} is " in message
    assert "must be" in message


@pytest.mark.parametrize("key", [key for key in LAYOUTS if "T" in LAYOUTS[key].shape or "K" in LAYOUTS[key].shape])
def test_lengths_must_agree(tmp_path, good, key):
    assert "must be" in refusal(tmp_path, good | {key: good[key][:-1]}) or key == "footholds"


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"friction": 0}, ["params: friction is 0", "at least 0.1"]),
        ({"friction": "high"}, ["friction", '"high"', "number"]),
        ({"friction": None}, ["friction is missing"]),
        ({"friction": float("nan")}, ["friction is nan"]),
        ({"samples_a_step": 0}, ["samples_a_step is 0"]),
        ({"samples_a_step": 16.0}, ["samples_a_step is 16.0", "integer"]),
        ({"samples_a_step": True}, ["samples_a_step is true", "integer"]),
        ({"samples_a_step": 12}, ["25 times", "1 steps of 12 samples"]),
        ({"samples_a_step": 24}, ["25 times", "1 steps of 24 samples"]),
        ({"tick": 0}, ["tick is 0", "at least 0.0005"]),
        ({"tick": 1e-9}, ["tick is 1e-09", "at least 0.0005"]),
        ({"tick": 100}, ["tick is 100", "at most 0.004"]),
        ({"tick": [0.0025]}, ["tick is [0.0025]", "number"]),
        ({"steps": 2}, ["footholds has 2 stances", "params.steps is 2", "needs 3"]),
        ({"steps": -1}, ["steps is -1", "at least 0"]),
        ({"steps": 10**400}, ["steps is 1000", "integer"]),
        ({"power": "gross"}, ["power", "gross", "net"]),
        ({"power": None}, ["power is missing"]),
    ],
)
def test_params_that_cannot_be(tmp_path, good, changes, words):
    message = refusal(tmp_path, with_params(good, **changes))
    assert [word for word in words if word not in message] == []


@pytest.mark.parametrize("text", ["", "{", "[1]", "null", "3", "[" * 100_000, "\ud800", '{"steps": ' + "9" * 5000 + "}"])
def test_params_that_are_no_table(tmp_path, good, text):
    assert ": params is " in refusal(tmp_path, good | {"params": np.array(text)})


def changed(good, key, place, value):
    array = np.array(good[key])
    array[place] = value
    return {key: array}


@pytest.mark.parametrize(
    ("key", "place", "value", "words"),
    [
        ("time", 3, 0.0, ["time goes from", "to 0 s after sample 2", "must rise"]),
        ("time", slice(None), 0.5, ["time begins at 0.5"]),
        ("time", -1, 100.0, ["time goes from", "to 100 s", "at most 60"]),
        ("time", -1, 1e5, ["time is 100000 at [24]", "from 0 to 86400"]),
        ("valid", 3, False, ["valid is true 24 times"]),
        ("valid", slice(1, None), False, ["valid is true 1 times"]),
        ("valid", -1, False, []),
        ("valid", slice(16, None), False, ["valid is true 16 times", "1 steps of 16"]),
        ("base_quat", (5, 0), 0.5, ["base_quat is [0.5", "length 1"]),
        ("base_quat", 5, [-1.0, 0.0, 0.0, 0.0], ["base_quat turns", "after sample 4"]),
        ("load", (2, 3), 1.5, ["load is 1.5 at [2, 3]", "from 0 to 1"]),
        ("load", (2, 3), -0.5, ["load is -0.5 at [2, 3]"]),
        ("elevation", (2, 3), -9999.0, ["elevation is -9999 m in 1 cells"]),
        ("elevation", (2, 3), np.inf, ["elevation is infinite"]),
        ("elevation", slice(None), np.nan, ["elevation is NaN in all"]),
        ("resolution", (), 0.0, ["resolution is 0"]),
        ("robot/trunk_mass", (), 0.0, ["robot/trunk_mass is 0", "from 0.01"]),
        ("robot/trunk_mass", (), -2.4, ["robot/trunk_mass is -2.4"]),
        ("robot/link_mass", (1, 2), 1e-300, ["robot/link_mass is 1e-300 at [1, 2]"]),
        ("robot/torque_limit", (1, 2), 0.0, ["robot/torque_limit is 0 at [1, 2]"]),
        ("robot/joint_range", (1, 2), [1.0, 0.5], ["robot/joint_range of RF, joint 2, goes from 1 to 0.5"]),
        ("robot/joint_axis", (1, 2), [0.0, 0.5, 0.0], ["robot/joint_axis must have length 1"]),
        ("robot/link_inertia", (1, 2), [1.0, 0.1, 0.1], ["robot/link_inertia has a moment"]),
        ("robot/trunk_inertia", slice(None), [0.1, 0.1, 1.0], ["robot/trunk_inertia has a moment"]),
        ("robot/link_offset", (0, 1), 0.0, ["robot/link_offset must be at least 0.01 m long"]),
        ("robot/knee_sign", (), 0.5, ["robot/knee_sign is 0.5"]),
        ("robot/gear_ratio", (), 1e200, ["robot/gear_ratio is 1e+200"]),
    ],
)
def test_numbers_that_do_not_fit_together(tmp_path, good, key, place, value, words):
    changes = good | changed(good, key, place, value)
    if not words:
        np.savez(tmp_path / "good.npz", **changes)
        assert len(load_plan(tmp_path / "good.npz").reference.time) == EACH + SHIFT
        return
    message = refusal(tmp_path, changes)
    assert [word for word in words if word not in message] == []


@pytest.mark.parametrize("turn", [(0.0, 0.0, 0.0), (0.1, -0.08, 0.3), (-0.05, 0.1, -0.2)])
def test_the_feet_are_where_the_angles_put_them(tmp_path, pegasus, good, turn):
    """The numbers come from the inverse kinematics; a joint off by 0.05 rad moves the foot by more than a centimetre."""
    reference = standing(pegasus, turn)
    pose = {"joint_pos": reference.joint_pos, "base_quat": reference.trunk_quat, "foot_pos": reference.foot_pos}
    pose = {key: np.asarray(value) for key, value in pose.items()}
    np.savez(tmp_path / "good.npz", **(good | pose))
    load_plan(tmp_path / "good.npz")
    bent = good | pose | changed(pose, "joint_pos", (7, 2, 1), pose["joint_pos"][7, 2, 1] + 0.05)
    assert "foot_pos of LH at 7 is 0.0" in refusal(tmp_path, bent)
    for key, value in (("base_pos", good["base_pos"] + 0.02), ("robot/hip_position", 1.1 * good["robot/hip_position"])):
        assert "foot_pos of LF at 0 is" in refusal(tmp_path, good | pose | {key: value})
    moved = changed(good, "footholds", (1, 3, 0), 0.8)
    assert "footholds of RH at 1 is 0.06 m from foot_pos as the step begins" in refusal(tmp_path, good | pose | moved)


def test_time_must_rise_in_the_precision_it_is_used_in(tmp_path, good):
    """After 20 minutes float32 has steps of 0.12 ms; the last two samples are 0.01 ms apart."""
    time = np.linspace(0.0, 1400.0, EACH + SHIFT + 1)
    time[-1] = time[-2] + 1e-5
    np.savez(tmp_path / "plan.npz", **(good | {"time": time}))
    load_plan(tmp_path / "plan.npz")
    with jax.enable_x64(False):
        assert "time goes from" in refusal(tmp_path, good | {"time": time})


def test_more_samples_than_ticks_are_refused(tmp_path, good):
    message = refusal(tmp_path, good | {"time": 0.05 * good["time"]})
    assert "time has 24 samples in 0.05 s, more than its ticks of 0.0025 s" in message


def test_params_hold_more_than_a_replay_needs(tmp_path, good):
    np.savez(tmp_path / "plan.npz", **with_params(good, navigation={"pace": {"tick": 1.0}}, author="me"))
    assert load_plan(tmp_path / "plan.npz").params["author"] == "me"
    assert json.loads(str(good["params"])) == PARAMS
