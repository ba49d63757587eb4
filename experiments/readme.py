"""The README's numbers out of results: docs/README.in.md, filled in from docs/results/NAME.json, is README.md.

A result is the `result.json` of a whole run of an experiment (or of `jaxleg search`), under the name of the experiment.

    python -m experiments.readme --take runs    take the results of whole runs found there, then write README.md
    python -m experiments.readme                write README.md
    python -m experiments.readme --check        exit status 1 if README.md is not what would be written
"""

import json
import statistics
import sys
from pathlib import Path
from typing import Any

import jinja2
import tyro

from jaxleg.files import write_json
from jaxleg.leg.energy import CONVENTIONS

ROOT = Path(__file__).parent.parent
README, TEMPLATE, RESULTS = ROOT / "README.md", ROOT / "docs" / "README.in.md", ROOT / "docs" / "results"
LONGEST = 50  # entries of a list that is taken as it is


def main(check: bool = False, take: Path | None = None) -> bool:
    """Write README.md, or with `check` only say whether it is up to date; `take` a folder of runs first."""
    if take:
        taken = [copy(file) for file in sorted(take.glob("*/result.json")) if not json.loads(file.read_text()).get("quick")]
        print(f"taken: {', '.join(taken) or 'nothing, no whole run was found'}")
    text = render()
    if check:
        same = README.read_text() == text
        print("README.md is up to date" if same else "README.md differs from what `python -m experiments.readme` writes")
        return same
    README.write_text(text)
    return True


def copy(file: Path) -> str:
    """Take one run's result under its folder's name; a list of more than `LONGEST` entries as its length and ranges."""
    RESULTS.mkdir(exist_ok=True)
    write_json(RESULTS / f"{file.parent.name}.json", shortened(json.loads(file.read_text())))
    return file.parent.name


def shortened(value: Any) -> Any:
    """A result with each long list as its `count` and, by the keys of its entries, the least and greatest number."""
    if isinstance(value, dict):
        return {name: shortened(entry) for name, entry in value.items()}
    if isinstance(value, list):
        return [shortened(entry) for entry in value] if len(value) <= LONGEST else {"count": len(value), "range": span(value)}
    return value


def span(entries: list) -> Any:
    """The least and greatest of a list's numbers, table by table; None where there are none."""
    if entries and all(isinstance(entry, dict) for entry in entries):
        return {name: span([entry[name] for entry in entries if name in entry]) for name in entries[0]}
    numbers = [entry for entry in entries if isinstance(entry, (int, float))]
    return [min(numbers), max(numbers)] if numbers else None


def render() -> str:
    """The README; a number without a result is an error."""
    loader = jinja2.FileSystemLoader(ROOT)
    world = jinja2.Environment(loader=loader, undefined=jinja2.StrictUndefined, keep_trailing_newline=True, trim_blocks=True)
    world.filters |= {"f": fixed, "pc": percent, "e": lambda x: f"{x:.1e}".replace("e-0", "e-").replace("e+0", "e")}
    world.filters["median"] = statistics.median
    world.globals |= {"savings": savings, "row": row}
    results = {file.stem: load(file) for file in sorted(RESULTS.glob("*.json"))}
    return world.get_template(str(TEMPLATE.relative_to(ROOT))).render(**results)


def load(file: Path) -> Any:
    """A result with its keys as attributes."""
    return json.loads(file.read_text(), object_hook=lambda table: Table(table))


class Table(dict):
    """A table whose keys may be written as attributes."""

    def __getattr__(self, name: str) -> Any:
        try:
            return self[name]
        except KeyError:
            raise AttributeError(name) from None


def fixed(value: float, digits: int = 0) -> str:
    """A number with so many digits after the point."""
    return f"{value:.{digits}f}"


def percent(value: float, digits: int = 1) -> str:
    """A share in per cent, without the sign."""
    return f"{100.0 * value:.{digits}f}"


def savings(table: dict, name: str, kind: str) -> str:
    """A contestant's savings in per cent, by convention; nothing for a baseline."""
    if name not in table:
        return ""
    return " / ".join(percent(table[name][kind][convention]["mean"]) for convention in CONVENTIONS)


def row(rows: list[dict], **entries: Any) -> dict:
    """The one row of a table with these entries."""
    (found,) = (r for r in rows if entries.items() <= r.items())
    return found


if __name__ == "__main__":
    sys.exit(0 if tyro.cli(main) else 1)
