"""Walking on plain ground (paper A, Fig. 10a and Table I): what do the paper's parameters save, and ours?

python -m experiments.plain_ground [--quick]
"""

from pathlib import Path

import tyro

from experiments.table_one import finish, result, table


def main(out: Path | None = None, quick: bool = False) -> None:
    """Three gait cycles of every contestant in simulation; `quick` searches our parameters more briefly."""
    seen = table("flat", quick)
    finish("plain_ground", out, seen, result(seen))


if __name__ == "__main__":
    tyro.cli(main)
