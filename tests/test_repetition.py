"""The house stays small: no function stands twice, public functions are short, and modules do not import in a circle."""

import ast
import collections
import graphlib
import statistics
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
LONG = 8  # lines of a body from which on it must not stand again


def trees(*folders: str) -> dict[Path, ast.Module]:
    paths = sorted(path for folder in folders for path in (ROOT / folder).rglob("*.py"))
    return {path: ast.parse(path.read_text()) for path in paths}


def body_of(function: ast.FunctionDef) -> list[ast.stmt]:
    """Its statements without the docstring."""
    return function.body[ast.get_docstring(function) is not None :]


def lines_of(function: ast.FunctionDef) -> int:
    body = body_of(function)
    return body[-1].end_lineno - body[0].lineno + 1 if body else 0


def functions(tree: ast.AST) -> list[ast.FunctionDef]:
    return [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]


class Plain(ast.NodeTransformer):
    """Names become the place of their first use; docstrings and annotations go. Constants and attributes stay."""

    def __init__(self):
        self.places: dict[str, str] = {}

    def place(self, name: str) -> str:
        return self.places.setdefault(name, str(len(self.places)))

    def visit_FunctionDef(self, node):
        body = [self.visit(child) for child in body_of(node)]
        return ast.Tuple([ast.Constant(self.place(node.name)), self.visit(node.args), *body], ast.Load())

    def visit_arg(self, node):
        return ast.arg(self.place(node.arg))

    def visit_Name(self, node):
        return ast.Name(self.place(node.id), node.ctx)

    def visit_AnnAssign(self, node):
        return ast.Assign([self.visit(node.target)], self.visit(node.value) if node.value else None)


def form(function: ast.FunctionDef) -> str:
    """What two functions have in common that differ in names only; the function's own name and its decorators play no part."""
    plain = Plain()
    arguments = plain.visit(function.args)
    return ast.dump(ast.Tuple([arguments, *map(plain.visit, body_of(function))], ast.Load()))


def twins(found: dict[Path, ast.Module]) -> list[list[str]]:
    places = collections.defaultdict(list)
    for path, tree in found.items():
        for function in functions(tree):
            if lines_of(function) >= LONG:
                places[form(function)].append(f"{path.name}:{function.lineno} {function.name}")
    return [names for names in places.values() if len(names) > 1]


def test_no_function_stands_twice():
    assert twins(trees("jaxleg", "experiments")) == []


ONCE = '''
def first(xs: list, key: int = 1) -> list:
    """Words."""
    total: int = 0
    for x in xs:
        if x > key:
            total += x
        else:
            total -= 1
    print(total)
    return xs
'''
AGAIN = (
    ONCE.replace("first", "second").replace("total", "kept").replace("xs", "values").replace('"""Words."""', '"""Others."""')
)


@pytest.mark.parametrize(
    ("other", "same"), [(AGAIN, True), (AGAIN.replace("-= 1", "-= 2"), False), (AGAIN.replace("x > k", "k > x"), False)]
)
def test_twins_are_told_by_more_than_names(other, same):
    assert bool(twins({Path("a.py"): ast.parse(ONCE), Path("b.py"): ast.parse(other)})) is same


def test_public_functions_are_short():
    """As DESIGN asks: leaves of a house. Methods count; what is private or nested is part of what it serves."""
    scopes = [
        scope for tree in trees("jaxleg").values() for scope in ast.walk(tree) if isinstance(scope, (ast.Module, ast.ClassDef))
    ]
    public = [node for scope in scopes for node in scope.body if isinstance(node, ast.FunctionDef) and node.name[0] != "_"]
    lengths = [lines_of(function) for function in public]
    assert statistics.median(lengths) <= 8
    assert statistics.quantiles(lengths, n=10)[-1] <= 20


def module_of(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


def imports(tree: ast.AST, modules: set[str]) -> set[str]:
    """Modules of ours that this one imports, wherever in it: one that a function imports late hides a circle only."""
    names = [name.name for node in ast.walk(tree) if isinstance(node, ast.Import) for name in node.names]
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module:
            inner = [f"{node.module}.{name.name}" for name in node.names]
            names += [name if name in modules else node.module for name in inner]
    return modules.intersection(names)


def test_modules_do_not_import_in_a_circle():
    found = {module_of(path): tree for path, tree in trees("jaxleg").items()}
    graph = {name: imports(tree, set(found)) for name, tree in found.items()}
    graphlib.TopologicalSorter(graph).prepare()  # raises CycleError with the circle
