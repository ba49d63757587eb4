"""Does a search that is killed, run twice at once or stopped by a full disk come to the same answer?

The quickstart in short, three kinds, float32, in processes of its own on two devices. Killed with SIGKILL at random moments
and resumed until it is done; two processes at once on one folder; folders on a disk (a tmpfs, which takes root) that fills up.
Every result.json must equal that of a run left alone, timings apart; every refusal is one sentence and exit status 2.

    python -m experiments.check_resume          30 kills, 10 pairs, 10 full disks
"""

import contextlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import tyro

from experiments.common import CONFIG, write
from jaxleg.cli import configure_jax

SHORT = {
    "terrains.train": 12, "terrains.held-out": 6, "search.steps": 3, "search.starts": 2, "search.lanes": 2,
    "search.polish-steps": 1, "search.polish-lanes": 4,
    "search.proxy-gaits": 8, "search.referee-terrains": 3, "simulation.chunk": 8,
}  # fmt: skip
OPTIONS = [word for key, value in SHORT.items() for word in (f"--{key}", str(value))]
ROOM = (4, 80)  # left on a disk that fills up [kB]


def main(out: Path | None = None, quick: bool = False, seed: int = 0) -> bool:
    """Run all three; returns whether all is as it must be. `quick`: 3 kills, 2 pairs, 2 disks."""
    rng, kills, few = np.random.default_rng(seed), 3 if quick else 30, 2 if quick else 10
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        began = time.perf_counter()
        answer = finish(folder / "alone")
        whole = time.perf_counter() - began
        began = time.perf_counter()
        assert finish(folder / "again") == answer, "two runs left alone differ"
        whole = min(whole, time.perf_counter() - began)
        result = {
            "seconds": whole,
            "kills": killed(folder, answer, rng, kills, whole),
            "pairs": at_once(folder, rng, few),
            "disks": full_disks(folder, answer, rng, few),
        }
    configure_jax()
    write("check_resume", out, result)
    return all(row.get("all_well", True) for row in result.values() if isinstance(row, dict))


def begin(path: Path) -> subprocess.Popen:
    """A search in a folder, resumed if it holds a run."""
    resume = ["--resume"] if (path / "config.toml").exists() else []
    command = [sys.executable, "-m", "jaxleg.cli", "search", str(CONFIG), "--out", str(path), *resume, *OPTIONS]
    environment = os.environ | {"JAX_NUM_CPU_DEVICES": "2", "JAX_PLATFORMS": "cpu"}
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment)


def finish(path: Path) -> dict[str, Any]:
    """The result of a search that is left alone, timings apart."""
    _, error = (process := begin(path)).communicate()
    if process.returncode not in (0, 1):
        raise RuntimeError(f"{path}: exit status {process.returncode}: {error[-500:]}")
    return json.loads((path / "result.json").read_text()) | {"timing": None}


def killed(folder: Path, answer: dict, rng: np.random.Generator, count: int, whole: float) -> dict[str, Any]:
    """SIGKILL at random moments, in each folder until the search is done before it."""
    at, equal, runs = [], [], 0
    while len(at) < count:
        path = folder / f"killed{runs}"
        runs += 1
        while len(at) < count:
            process = begin(path)
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.communicate(timeout=rng.uniform(0.0, whole))
            if process.poll() is not None:
                break
            process.kill()
            process.communicate()
            at.append(last_stage(path))
            print(f"kill {len(at)} of {count}: {at[-1]}", flush=True)
        equal.append(finish(path) == answer)
    well = all(equal)
    print(f"{count} kills over {runs} searches, all to the same result.json: {well}; killed after {dict(Counter(at))}")
    return {"kills": count, "searches": runs, "equal": sum(equal), "after": Counter(at), "all_well": well}


def last_stage(path: Path) -> str:
    """The checkpoint written last."""
    stages = sorted((path / "checkpoints").glob("*"), key=lambda x: x.stat().st_mtime)
    return stages[-1].name.replace("%2F", "/") if stages else "nothing saved" if path.exists() else "no folder"


def at_once(folder: Path, rng: np.random.Generator, count: int) -> dict[str, Any]:
    """Two processes on one folder, new or begun: one goes on, the other is refused."""
    refused, sentences = 0, Counter()
    for i in range(count):
        path = folder / f"pair{i}"
        if i % 2:  # a search begun before
            shutil.copytree(folder / "alone", path)
        first = begin(path)
        time.sleep(rng.uniform(0.0, 0.5))
        second, losers = begin(path), []
        while not losers:
            losers = [process for process in (first, second) if process.poll() is not None]
            time.sleep(0.05)
        error = losers[0].stderr.read().strip()
        refused += losers[0].returncode == 2 and "\n" not in error and len(losers) == 1
        sentences[error.partition(": ")[2].replace(str(path), "FOLDER")] += 1
        for process in (first, second):
            process.kill()
            process.communicate()
    print(f"{refused} of {count} pairs: one refused in one sentence: {dict(sentences)}")
    return {"pairs": count, "refused": refused, "sentences": sentences, "all_well": refused == count}


def begun(done: Path, path: Path, rng: np.random.Generator) -> None:
    """A search that has come to a random stage: a finished one without what was saved later."""
    shutil.copytree(done, path)
    stages = sorted((done / "checkpoints").glob("*"), key=lambda x: x.stat().st_mtime)
    for stage in stages[rng.integers(0, len(stages)) :]:
        shutil.rmtree(path / "checkpoints" / stage.name)
    for name in ("result.json", "best.toml"):
        (path / name).unlink()
    shutil.rmtree(path / "figures")


def full_disks(folder: Path, answer: dict, rng: np.random.Generator, count: int) -> dict[str, Any]:
    """A disk that fills up at some stage: one sentence; with more room the search goes on."""
    if os.geteuid():
        print("full disks: skipped, only root may mount one")
        return {"skipped": "only root may mount a tmpfs"}
    sentence, equal, after = 0, [], Counter()
    for i in range(count):
        disk = folder / f"disk{i}"
        disk.mkdir()
        subprocess.run(["mount", "-t", "tmpfs", "-o", "size=64m", "tmpfs", str(disk)], check=True)
        try:
            begun(folder / "alone", disk / "run", rng)
            state = os.statvfs(disk)
            full = (state.f_blocks - state.f_bfree) * state.f_frsize // 1024 + rng.integers(*ROOM)
            subprocess.run(["mount", "-o", f"remount,size={full}k", str(disk)], check=True)
            _, error = (process := begin(disk / "run")).communicate()
            after[last_stage(disk / "run")] += 1
            sentence += process.returncode == 2 and error.strip().count("\n") == 0
            print(f"disk {i}: {process.returncode} {error.strip()[-200:]}", flush=True)
            subprocess.run(["mount", "-o", "remount,size=64m", str(disk)], check=True)
            equal.append(finish(disk / "run") == answer)
        finally:
            subprocess.run(["umount", str(disk)], check=True)
    well = all(equal) and sentence == count
    print(f"{sentence} of {count} full disks told in one sentence, {sum(equal)} resumed to the same result.json")
    return {"disks": count, "sentences": sentence, "equal": sum(equal), "after": after, "all_well": well}


if __name__ == "__main__":
    sys.exit(0 if tyro.cli(main) else 1)
