"""Does the energy proxy tell gaits apart as simulation does? Random feasible gaits on flat and rough ground, no refit.

Spearman's rank correlation of energy per metre, cosine of the gradients (parameters scaled by their range), bias. Exit status 1
where all gaits together miss `CLAIM`.

    python -m experiments.check_proxy [--quick]
"""

import sys
from pathlib import Path

import jax
import numpy as np
import tyro
from matplotlib.figure import Figure

from experiments.common import setup, training, write
from jaxleg.search import agreement
from jaxleg.search.contestants import bounds
from jaxleg.search.lanes import Lab
from jaxleg.search.training import Lanes
from jaxleg.viz.style import save

CLAIM = {"spearman": 0.95, "gradient_cosine": 0.95, "gradient_cosine_p10": 0.9}  # at least
BIAS = 0.05  # at most


def main(gaits: int = 104, out: Path | None = None, quick: bool = False) -> bool:
    """Compare on `gaits` random gaits, half of them on flat ground (32 with `quick`); returns whether the proxy is true."""
    study, lab = setup()
    count = (32 if quick else gaits) // 2
    parts, cosines = [], []
    for kind in ("flat", "rough"):
        span = bounds(study, kind, "best")
        vectors, lanes = agreement.random_gaits(lab, jax.random.key(1), training(study, lab, kind), span, count)
        parts.append(agreement.compare(lab, vectors, lanes))
        cosines.append(of_gradients(lab, vectors, lanes, span[:, 1] - span[:, 0])[parts[-1].usable])
    data = jax.tree.map(lambda *x: np.concatenate(x), *parts)
    rows = {"all": (data, np.concatenate(cosines))} | dict(zip(("flat", "rough"), zip(parts, cosines)))
    result = {name: agreement.agreement(part) | told(cosine) for name, (part, cosine) in rows.items()}
    for name, row in result.items():
        print(f"{name:6s}", "  ".join(f"{key} {value:.4f}" for key, value in row.items()))
    write("check_proxy", out, result)
    draw(parts, (out or Path("runs/check_proxy")) / "proxy.png")
    seen = result["all"]
    holds = seen["gaits"] > 0 and all(seen[name] >= least for name, least in CLAIM.items()) and abs(seen["bias"]) <= BIAS
    print("claim holds" if holds else f"claim missed: {CLAIM}, bias within {BIAS}")
    return holds


def of_gradients(lab: Lab, vectors: np.ndarray, lanes: Lanes, width: np.ndarray) -> np.ndarray:
    """Cosine between the gradients of proxy and simulation at each gait, the numbers in widths of their ranges."""
    _, ours = lab.proxy_gradients(vectors, lanes.site, lanes.setting)
    _, _, theirs = lab.simulate_gradients(vectors, lanes.site, lanes.setting)
    ours, theirs = ours * width, theirs * width
    return np.sum(ours * theirs, axis=1) / (np.linalg.norm(ours, axis=1) * np.linalg.norm(theirs, axis=1))


def told(cosine: np.ndarray) -> dict[str, float]:
    """Median and 10th percentile of the gradients' cosine."""
    return {"gradient_cosine": float(np.median(cosine)), "gradient_cosine_p10": float(np.percentile(cosine, 10))}


def draw(parts: list[agreement.Agreement], path: Path) -> None:
    """Proxy against simulation, a point a gait."""
    figure = Figure(figsize=(5, 5), layout="constrained")
    axes = figure.subplots()
    for part, name, mark in zip(parts, ("flat", "rough"), "os"):
        axes.plot(part.simulated[part.usable], part.proxy[part.usable], mark, ms=4, label=name, alpha=0.8)
    low, high = axes.get_xlim()
    axes.plot([low, high], [low, high], "k:", lw=1, label="equal")
    axes.set(xlabel="simulated [J/m]", ylabel="proxy [J/m]")
    axes.legend(frameon=False)
    save(figure, path)


if __name__ == "__main__":
    sys.exit(0 if tyro.cli(main) else 1)
