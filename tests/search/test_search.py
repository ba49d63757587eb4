"""A tiny search of three kinds, in float32 as users run it: who wins and why, and killed after any stage it goes on to the
same answer."""

import csv
import dataclasses
import json
import shutil
from pathlib import Path

import jax
import numpy as np
import pytest

from jaxleg.cli.search import run_study
from jaxleg.conventions import GRAVITY
from jaxleg.robot import RobotFile, build_robot
from jaxleg.search import run as runs
from jaxleg.search import training, verify
from jaxleg.search.config import Randomise, Study, robot_path
from jaxleg.search.contestants import CONTESTANTS, STAGES, bounds, short_name
from jaxleg.search.run_folder import RunFolder
from jaxleg.search.sites import make_sites
from jaxleg.search.study import run
from jaxleg.settings import dump, load
from jaxleg.viz import study as pictures
from jaxleg.viz.terminal import randomised_lines

CONFIG = Path(__file__).parents[2] / "configs/quickstart.toml"
SHORT = dict(starts=2, lanes=2, steps=4, polish_steps=1, polish_lanes=4, proxy_gaits=8, referee_terrains=3)
SHORT |= dict(resamples=100)


def short() -> Study:
    """The quickstart in short."""
    study = load(Study, CONFIG)
    return dataclasses.replace(
        study,
        robot="robot.toml",
        terrains=dataclasses.replace(study.terrains, train=30, held_out=6),
        search=dataclasses.replace(study.search, **SHORT),
        simulation=dataclasses.replace(study.simulation, chunk=2),
    )


STUDY, ROBOT = short(), load(RobotFile, robot_path(load(Study, CONFIG), CONFIG))
MASS = 35.2  # of Pegasus [kg]


class Killed(BaseException):
    """Where a kill strikes."""


@pytest.fixture(scope="module", autouse=True)
def single(optimised):
    """float32, as users run it; conftest.py asks for float64."""
    jax.config.update("jax_enable_x64", False)
    jax.config.update("jax_default_matmul_precision", "highest")
    yield
    jax.config.update("jax_default_matmul_precision", None)
    jax.config.update("jax_enable_x64", True)


@pytest.fixture(scope="module")
def robot(single):
    return build_robot(ROBOT)


@pytest.fixture(scope="module", autouse=True, params=["proxy", pytest.param("simulation", marks=pytest.mark.slow)])
def gradients(request, single, robot):
    """Where the polish takes its gradients from: the simulation's take a minute to compile. All runs share lab and terrains."""
    lab = runs.make_lab(STUDY, robot)
    for name in ("models", "_plans", "simulate_gradients"):
        vars(lab)[name] = unoptimised(getattr(lab, name))

    def by_proxy(*lanes):
        return *lab.simulate_lanes(*lanes), lab.models(*lanes, np.zeros_like(lanes[0])).slope

    if request.param == "proxy":
        vars(lab)["simulate_gradients"] = by_proxy
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(runs, "make_lab", lambda *_: lab)
        for module in (training, verify):
            patch.setattr(module, "make_sites", sites_once({}))
        yield request.param


BY_PROXY = pytest.mark.parametrize("gradients", ["proxy"], indirect=True, scope="module")  # alike wherever gradients come from


def unoptimised(function):
    """The function, compiled soon: it runs for less time than its compilation would take."""

    def call(*lanes, **options):
        jax.config.update("jax_disable_most_optimizations", True)
        try:
            return function(*lanes, **options)
        finally:
            jax.config.update("jax_disable_most_optimizations", False)

    return call


def sites_once(made):
    """`make_sites`, which remembers what it `made`: a resume spends most of its time on terrains."""

    def make(*study, **held_out):
        which = repr((study, held_out))
        if which not in made:
            made[which] = unoptimised(make_sites)(*study, **held_out)
        return made[which]

    return make


def search(path, robot, resume, study=STUDY, saves=None):
    """The result and best gaits of a run, killed after so many saves (None: never); its saves are counted."""
    folder = RunFolder.open(path, {"config": study, "robot": ROBOT}, resume, {"jax": "any"})
    done, keep = [], folder.save

    def save(stage, tree):
        keep(stage, tree)
        done.append(stage)
        if len(done) == saves:
            raise Killed

    folder.save = save
    try:
        result, chosen = run(study, runs.make_lab(study, robot), folder, lambda *_: None)
        folder.write_result(result)
        return json.loads(folder.result.read_text()) | {"timing": None}, chosen, done
    finally:
        folder.close()


@pytest.fixture(scope="module")
def whole(tmp_path_factory, gradients):
    return tmp_path_factory.mktemp("whole") / "run"


@pytest.fixture(scope="module")
def answer(whole, robot, gradients):
    return search(whole, robot, resume=False)


@BY_PROXY
def test_a_run_killed_after_every_single_save_of_a_kind_reaches_the_same_answer(answer, whole, tmp_path, robot):
    """Bit by bit; no stage is worked out twice. Rough ground's stages and the proxy's are taken out of the finished run."""
    result, chosen, stages = answer
    # by kind: baseline, two rounds of descent (rough ground: three), polished, held-out, referee; and proxy
    assert len(set(stages)) == 3 * 6 + 2
    own = [stage for stage in stages if stage.startswith("rough/") or stage == "proxy"]
    shutil.copytree(whole, tmp_path / "run")
    for folder in (tmp_path / "run" / "checkpoints").iterdir():
        if folder.name.startswith(("rough", "proxy")):
            shutil.rmtree(folder)
    for _ in own:
        with pytest.raises(Killed):
            search(tmp_path / "run", robot, resume=True, saves=1)
    again, best, later = search(tmp_path / "run", robot, resume=True)
    assert later == []
    assert again == result
    for kind in chosen:
        np.testing.assert_array_equal(best[kind], chosen[kind], strict=True)


@BY_PROXY
def test_a_run_killed_at_its_first_save_is_there_to_resume(tmp_path, robot):
    with pytest.raises(Killed):
        search(tmp_path / "run", robot, resume=False, saves=1)
    with pytest.raises(Killed):
        search(tmp_path / "run", robot, resume=True, saves=1)
    assert len(list((tmp_path / "run" / "checkpoints").iterdir())) == 2  # another stage, not the first again


SAVES = {"flat": 0.4, "rough": 0.4, "stairs": 0.25}  # at least, against traditional
BASELINES = {"flat": (1023, 789, 722), "rough": (1049, 805, 740), "stairs": (1182, 1007, 993)}  # J/m on these terrains


@pytest.mark.parametrize("kind", BASELINES)
def test_contestants_rank_as_they_must(answer, kind):
    """In rounds of four steps the search that moves everything beats those that move less, the traditional gait and the
    paper's own, in both engines; implied and the paper's own need less than traditional only by giving up half of the stability
    margin."""
    result, _, _ = answer
    energy = {name: result[name][kind]["energy_per_metre"]["positive"]["mean"] for name in CONTESTANTS}
    np.testing.assert_allclose([energy[name] for name in ("traditional", "implied", "paper")], BASELINES[kind], rtol=2e-3)
    assert energy["best"] < min(energy["best_i"], energy["best_ii"])
    assert max(energy["best_i"], energy["best_ii"]) < energy["traditional"]
    for engine in ("simulation", "mujoco"):
        assert SAVES[kind] < result["saving"][engine]["best"][kind]["positive"]["mean"] < SAVES[kind] + 0.15
        assert result["saving_vs_paper"][engine]["best"][kind]["positive"]["mean"] > 0.05
    margin = {name: result[name][kind]["min_stability_margin"] for name in CONTESTANTS}
    assert max(margin["implied"], margin["paper"]) < 0.6 * margin["traditional"]
    assert min(margin["best_i"], margin["best_ii"], margin["best"]) > margin["traditional"]


@pytest.mark.parametrize("name", CONTESTANTS)
def test_contestants_keep_what_binds_them_all(answer, name):
    """Speed, knee bend, no falls in either engine; bounds hold what a search may not move."""
    result, chosen, _ = answer
    for kind, table in STUDY.kinds.items():
        seen = result[name][kind]
        assert seen["speed"] == pytest.approx(STUDY.speed, rel=0.01)
        assert seen["min_knee_bend_deg"] > table.least_knee_bend_deg - 0.2
        assert (seen["falls"], seen["infeasible"], result["referee"][name][kind]["falls"]) == (0, 0, 0)
        assert seen["cost_of_transport"] == pytest.approx(seen["energy_per_metre"]["positive"]["mean"] / (MASS * GRAVITY))
        if name in STAGES:
            span, vector = bounds(STUDY, kind, name), chosen[kind][STAGES.index(name)]
            assert np.all((vector >= span[:, 0] - 1e-6) & (vector <= span[:, 1] + 1e-6))
            assert [seen["params"][short_name(leaf)] for leaf in STUDY.search.move] == pytest.approx(list(vector))


def test_what_binds_is_told(answer):
    """The margin is kept at the traditional gait's, so it binds; nothing beyond it does in so short a search."""
    result, _, _ = answer
    for kind in STUDY.kinds:
        assert "margin" in result["active_constraints"]["best"][kind]
        assert not {"torque", "joint_range", "search_reach", "knee_clear"} & set(result["active_constraints"]["best"][kind])
    assert "knee_bend" in result["active_constraints"]["best"]["stairs"]


def test_every_descent_goes_down(answer, whole):
    with (whole / "history.csv").open() as file:
        rows = list(csv.DictReader(file))
    for kind in STUDY.kinds:
        for stage in STAGES:
            own = [row for row in rows if (row["kind"], row["stage"]) == (kind, stage)]
            for terrains in {row["terrains"] for row in own}:
                means = [float(row["mean"]) for row in own if row["terrains"] == terrains]
                assert means == sorted(means, reverse=True)
            assert [int(row["step"]) for row in own] == sorted({int(row["step"]) for row in own})
            assert all(float(row["best"]) <= float(row["mean"]) for row in own)


def test_the_proxy_is_honest(answer):
    proxy = answer[0]["proxy"]
    assert proxy["gaits"] == 8
    assert proxy["spearman"] > 0.8
    assert abs(proxy["bias"]) < 0.04


@BY_PROXY
def test_a_finished_run_can_be_resumed(answer, whole, robot):
    result, _, _ = answer
    again, _, saved = search(whole, robot, resume=True)
    assert again == result
    assert saved == []


@BY_PROXY
def test_copies_of_one_terrain_count_once(answer):
    result, _, _ = answer
    assert result["terrains"]["by_kind"]["held_out"] == {"flat": 1, "rough": 2, "stairs": 2}
    assert result["terrains"]["held_out"] == 5
    assert result["best"]["flat"]["lanes"] == 1
    assert result["best"]["flat"]["energy_per_metre"]["net"]["ci95"] is None


@BY_PROXY
@pytest.mark.parametrize("number", [0, 1])
def test_few_or_no_terrains_for_the_referee(answer, whole, tmp_path, robot, number):
    """The finished run once more, only the referee's stages anew."""
    study = dataclasses.replace(STUDY, search=dataclasses.replace(STUDY.search, referee_terrains=number))
    shutil.copytree(whole, tmp_path / "run")
    dump(study, tmp_path / "run" / "config.toml")
    for stage in (tmp_path / "run" / "checkpoints").glob("*referee"):
        shutil.rmtree(stage)
    result, _, saved = search(tmp_path / "run", robot, resume=True, study=study)
    assert len(saved) == 3
    assert result["terrains"]["by_kind"]["referee"] == {"flat": number, "rough": 0, "stairs": 0}
    assert result["saving"]["mujoco"]["best"]["rough"]["net"] == {"mean": None, "ci95": None}
    assert result["best"] == answer[0]["best"]


@BY_PROXY
@pytest.mark.slow
def test_randomised_lanes_are_walked_after_a_finished_run(answer, whole, tmp_path, robot):
    """The other stages are found; a resume finds these too. Without any range, on as many lanes, rough ground and stairs give
    what the held-out contest gives."""
    nothing = Randomise(lanes=6, mass=0.0, com=0.0, friction=(0.8, 0.8), gains=0.0, map_noise=0.0, map_filter=0.0)
    study = dataclasses.replace(STUDY, randomise=nothing)
    shutil.copytree(whole, tmp_path / "run")
    dump(study, tmp_path / "run" / "config.toml")
    result, _, saved = search(tmp_path / "run", robot, resume=True, study=study)
    assert len(saved) == 3 * 2  # by kind, in simulation and in C MuJoCo
    again, _, saved = search(tmp_path / "run", robot, resume=True, study=study)
    assert (again, saved) == (result, [])
    seen = result.pop("randomised")
    assert result == answer[0]
    assert seen["ranges"] == json.loads(json.dumps(dataclasses.asdict(nothing)))
    for key in ("saving", "saving_vs_implied", "saving_vs_paper"):
        for engine, kinds in {"simulation": ("rough", "stairs"), "mujoco": ("rough", "stairs")}.items():
            for kind in kinds:
                here, there = (table[key][engine]["best"][kind]["net"]["mean"] for table in (seen, result))
                assert here == pytest.approx(there, abs=1e-4)
    assert seen["failed"]["simulation"]["best"]["flat"] == {"lanes": 2, "falls": 0, "infeasible": 0}
    assert seen["failed"]["mujoco"]["paper"]["flat"] == {"lanes": 1, "falls": 0, "infeasible": 0}
    lines = randomised_lines(result | {"randomised": seen})
    assert [line.partition(",")[0] for line in lines] == list(STUDY.kinds)
    assert all("0 of 4 lanes fell" in line for line in lines)


@BY_PROXY
def test_pictures_that_fail_lose_no_result(answer, whole, tmp_path, robot, monkeypatch, capsys):
    """They come last, each by itself; what failed is said, and the exit status is that of the result."""
    path = tmp_path / "run"
    shutil.copytree(whole, path)
    monkeypatch.setattr(pictures, "study_pictures", lambda *_: {"bad.png": fail, "good.png": lambda file: file.touch()})
    assert run_study(STUDY, robot, ROBOT, path, resume=True) == 0
    assert json.loads((path / "result.json").read_text()) | {"timing": None} == answer[0]
    assert load(Study, path / "best.toml").kinds["flat"].gait.workspace.high == pytest.approx(answer[1]["flat"][-1][0])
    assert (path / "figures" / "good.png").exists()
    assert "bad.png: no ink" in "".join(capsys.readouterr().out.split("\n"))


def fail(path):
    raise RuntimeError("no ink")
