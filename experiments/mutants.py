"""Do the tests notice? Small faults put into the core one at a time, drawn at random, and the default tests run on each.

A fault is a sign turned round, two things taken for one another (min and max, sine and cosine, an index) or a constant 20 %
off, in a line that computes. It is caught when a test fails; the tests of the module's own folder run first. Every fault has a
copy of the repository to itself. What survives has to be looked at: it may change nothing.

    python -m experiments.mutants [--quick]
"""

import ast
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

import tyro

from experiments.common import write

ROOT = Path(__file__).parent.parent
PARTS = {  # of the core: where faults go, and the tests that run first
    "leg": (("leg/*", "gait/*", "numerics", "rotations"), ("leg", "gait", "test_numerics.py")),
    "terrain": (("terrain/*",), ("terrain",)),
    "swing": (("swing/*",), ("swing",)),
    "planning": (("foothold/*", "posture/*", "route/*", "series/*", "walk/*"), ("foothold", "posture", "route", "walk")),
    "sim": (("sim/*", "control/*"), ("sim", "control")),
    "search": (("search/*", "batch"), ("search", "test_batch*.py")),
}
SWAPS = {"minimum": "maximum", "min": "max", "sin": "cos", "any": "all", "argmin": "argmax", "floor": "ceil"}
SWAPS |= {b: a for a, b in SWAPS.items()}
SIGNS = {ast.Add: "-", ast.Sub: "+", ast.Mult: "/", ast.Div: "*"}
ORDERS = {ast.Lt: ">", ast.Gt: "<", ast.LtE: ">", ast.GtE: "<", ast.BitAnd: "|", ast.BitOr: "&"}


class Fault(NamedTuple):
    """One fault: what stands in a file between two offsets, and what takes its place."""

    part: str
    file: str
    line: int
    start: int
    end: int
    old: str
    new: str


def faults_of(part: str, file: Path) -> Iterator[Fault]:
    """All faults that a module can be given, outside of its docstrings, annotations and defaults."""
    source = file.read_text()
    starts = [0]
    for line in source.splitlines(keepends=True):
        starts.append(starts[-1] + len(line.encode()))
    where = lambda line, column: starts[line - 1] + column  # noqa: E731

    def fault(line, start, end, new):
        return Fault(part, str(file.relative_to(ROOT)), line, start, end, source.encode()[start:end].decode(), new)

    for node in _computing(ast.parse(source)):
        if isinstance(node, ast.BinOp) and type(node.op) in SIGNS | ORDERS:
            start, end = where(node.left.end_lineno, node.left.end_col_offset), where(node.right.lineno, node.right.col_offset)
            between = source.encode()[start:end].decode()
            old = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.BitAnd: "&", ast.BitOr: "|"}[type(node.op)]
            if between.count(old) == 1:
                new = between.replace(old, (SIGNS | ORDERS)[type(node.op)])
                yield fault(node.lineno, start, end, new)
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
            start = where(node.lineno, node.col_offset)
            yield fault(node.lineno, start, start + 1, "+")
        elif isinstance(node, ast.Compare) and len(node.ops) == 1 and type(node.ops[0]) in ORDERS:
            start = where(node.left.end_lineno, node.left.end_col_offset)
            end = where(node.comparators[0].lineno, node.comparators[0].col_offset)
            yield fault(node.lineno, start, end, f" {ORDERS[type(node.ops[0])]} ")
        elif isinstance(node, ast.Constant) and type(node.value) is float and node.value not in (0.0, 1.0):
            start, end = where(node.lineno, node.col_offset), where(node.end_lineno, node.end_col_offset)
            yield fault(node.lineno, start, end, repr(1.2 * node.value))
        elif isinstance(node, ast.Attribute) and node.attr in SWAPS:
            end = where(node.end_lineno, node.end_col_offset)
            yield fault(node.lineno, end - len(node.attr), end, SWAPS[node.attr])
        elif isinstance(node, ast.Subscript) and isinstance(node.slice, ast.Constant) and node.slice.value in (0, 1, 2):
            start = where(node.slice.lineno, node.slice.col_offset)
            yield fault(node.lineno, start, start + 1, str((node.slice.value + 1) % 3))


def _computing(module: ast.Module) -> Iterator[ast.AST]:
    """The nodes that compute something: not annotations, defaults, decorators and the like."""
    for top in ast.walk(module):
        if isinstance(top, ast.FunctionDef):
            for statement in top.body:
                if not isinstance(statement, ast.FunctionDef | ast.Raise | ast.Expr):
                    yield from (x for x in ast.walk(statement) if not isinstance(x, ast.FunctionDef))


def draw(count: int, seed: int) -> list[Fault]:
    """`count` faults, in equal shares on the parts, each part's drawn from all of its lines; no line twice."""
    chance, chosen = random.Random(seed), []
    for index, (part, (patterns, _)) in enumerate(PARTS.items()):
        files = sorted({file for pattern in patterns for file in (ROOT / "jaxleg").glob(f"{pattern}.py")})
        every = {(x.file, x.start): x for file in files for x in faults_of(part, file)}
        pool, lines = list(every.values()), set()
        chance.shuffle(pool)
        share = count // len(PARTS) + (index < count % len(PARTS))
        for fault in pool:
            if share and (fault.file, fault.line) not in lines:
                lines.add((fault.file, fault.line))
                chosen.append(fault)
                share -= 1
    return chosen


def caught_by(fault: Fault, limit: float) -> dict:
    """Run the default tests on a copy of the repository with the fault in it, until one fails."""
    began = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "jaxleg"
        ignore = shutil.ignore_patterns(".git", ".venv", "runs", "docs", "__pycache__", ".*_cache")
        shutil.copytree(ROOT, copy, ignore=ignore)
        (copy.parent / "shared").symlink_to(ROOT.parent / "shared")
        text = (copy / fault.file).read_bytes()
        (copy / fault.file).write_bytes(text[: fault.start] + fault.new.encode() + text[fault.end :])
        first = sorted(str(x.relative_to(copy)) for pattern in PARTS[fault.part][1] for x in (copy / "tests").glob(pattern))
        name = Path(fault.file).stem
        first.sort(key=lambda x: name not in x)
        for tests in (first, ["tests", *(f"--ignore={x}" for x in first)]):
            verdict = _first_failure(copy, tests, limit)
            if verdict:
                break
    seconds = round(time.perf_counter() - began)
    print(f"{fault.file}:{fault.line}  {fault.old!r} -> {fault.new!r}  {verdict or 'SURVIVED'}  {seconds} s", flush=True)
    return fault._asdict() | {"caught_by": verdict, "seconds": seconds}


def _first_failure(copy: Path, tests: list[str], limit: float) -> str:
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-n0", "--no-header", "-p", "no:cacheprovider", *tests]
    try:
        done = subprocess.run(command, cwd=copy, capture_output=True, text=True, timeout=limit, check=False)
    except subprocess.TimeoutExpired:
        return "time limit"
    lines = [x for x in done.stdout.splitlines() if x.startswith(("FAILED", "ERROR"))]
    if done.returncode == 0:
        return ""
    return lines[0].split(" - ")[0].partition(" ")[2] if lines else f"status {done.returncode}"


def main(count: int = 84, seed: int = 0, workers: int = 2, out: Path | None = None, quick: bool = False) -> bool:
    """Try `count` faults (3 with `quick`), `workers` at a time; returns whether 85 % of them are caught."""
    faults = draw(6 if quick else count, seed)[:: 2 if quick else 1]
    with ThreadPoolExecutor(workers) as pool:
        rows = list(pool.map(lambda fault: caught_by(fault, 1200.0), faults))
    table = {}
    for part in PARTS:
        own = [row for row in rows if row["part"] == part]
        table[part] = {"faults": len(own), "caught": sum(bool(row["caught_by"]) for row in own)}
        print(f"{part:10s} {table[part]['caught']} of {table[part]['faults']}")
    caught = sum(bool(row["caught_by"]) for row in rows)
    print(f"caught: {caught} of {len(rows)}")
    write("mutants", out, {"faults": rows, "parts": table, "caught": caught, "share": caught / len(rows), "seed": seed})
    return caught >= 0.85 * len(rows)


if __name__ == "__main__":
    sys.exit(0 if tyro.cli(main) else 1)
