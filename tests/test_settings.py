"""Settings: what is written is read back equal; what is wrong is refused in one sentence that helps."""

import dataclasses
import os
from pathlib import Path
from typing import Literal

import pytest

from jaxleg.conventions import InputError
from jaxleg.settings import build, check, dump, from_command_line, load, setting, to_table


@dataclasses.dataclass(frozen=True)
class Rock:
    size: float = setting(0.1, above=0.0, below=1.0, unit="m", help="edge of the cube")


@dataclasses.dataclass(frozen=True)
class Search:
    starts: int = setting(8, min=1, max=64, help="random starts")
    span: tuple[float, float] = setting((0.0, 1.0), min=-2.0)
    weights: tuple[int, ...] = setting((1, 2))
    method: Literal["adam", "sgd"] = setting("adam")
    cost: str = setting("power", choices=("power", "torque"))
    tolerance: float | None = setting(None, above=0.0)
    fast: bool = setting(True)

    def __post_init__(self) -> None:
        if self.span[0] > self.span[1]:
            raise ValueError(f"span is {list(self.span)}, but must rise")


@dataclasses.dataclass(frozen=True)
class Rate:
    rate: float = setting(1.0)


@dataclasses.dataclass(frozen=True)
class Study:
    name: str = setting()
    search: Search = setting(Search())
    rocks: tuple[Rock, ...] = setting(())
    robots: dict[str, Rock] = setting({})
    extra: Rock | None = setting(None)


FULL = Study(
    name='a "study" é\n',
    search=Search(3, (-1e-30, 0.1 + 0.2), (), "sgd", "torque", 1.2345678901234567e-37, False),
    rocks=(Rock(0.25), Rock()),
    robots={"lean": Rock(0.5), "a.b c": Rock()},
    extra=Rock(0.75),
)

# text of the file, what the sentence must hold besides the file's name
BAD_FILES = [
    ("name = ", ["not valid TOML", "line 1"]),
    ('name = "a"\nname = "b"', ["not valid TOML", "line 2"]),
    ('name = "a"\nsearch = {starts = 1\nx = 2', ["not valid TOML", "line 2"]),
    ("x = " + "[" * 5000, ["not valid TOML"]),
    ('naem = "a"', ["naem", '"a"', "did you mean name?"]),
    ('name = "a"\nzzz = 1', ["zzz", "= 1", "name, search, rocks, robots, extra"]),
    ('name = "a"\nsearch.stars = 9', ["search.stars", "9", "did you mean search.starts?"]),
    ('name = "a"\nrobots.lean.sise = 2', ["robots.lean.sise", "2", "robots.lean.size?"]),
    ("", ["name", "missing", "a text"]),
    ("name = 3", ["name", "3", "a text"]),
    ("name = 1979-05-27", ["name", '"1979-05-27"', "a text"]),
    ('name = "a"\nsearch = 3', ["search", "3", "a table with the keys starts, span"]),
    ('name = "a"\nsearch.starts = 0', ["search.starts", "is 0,", "an integer, at least 1, at most 64"]),
    ('name = "a"\nsearch.starts = 65', ["search.starts", "is 65,", "at most 64"]),
    ('name = "a"\nsearch.starts = 2.0', ["search.starts", "2.0", "an integer"]),
    ('name = "a"\nsearch.starts = true', ["search.starts", "true", "an integer"]),
    ('name = "a"\nsearch.starts = "many"', ["search.starts", '"many"', "an integer"]),
    ('name = "a"\nsearch.fast = 1', ["search.fast", "1", "true or false"]),
    ('name = "a"\nsearch.span = 1.0', ["search.span", "1.0", "a list of 2, each a number, at least -2.0"]),
    ('name = "a"\nsearch.span = [1.0]', ["search.span", "[1.0]", "a list of 2"]),
    ('name = "a"\nsearch.span = [0, "x"]', ["search.span[1]", '"x"', "a number"]),
    ('name = "a"\nsearch.span = [-3, 0]', ["search.span[0]", "-3", "at least -2.0"]),
    ('name = "a"\nsearch.span = [1, 0]', ["search", "span is [1.0, 0.0]", "must rise"]),
    ('name = "a"\nsearch.weights = [1, 2.5]', ["search.weights[1]", "2.5", "an integer"]),
    ('name = "a"\nsearch.method = "lbfgs"', ["search.method", '"lbfgs"', '["adam", "sgd"]']),
    ('name = "a"\nsearch.cost = "x"', ["search.cost", '"x"', '["power", "torque"]']),
    ('name = "a"\nsearch.tolerance = 0', ["search.tolerance", "0", "a number, above 0.0"]),
    ('name = "a"\nsearch.tolerance = nan', ["search.tolerance", "nan", "a number"]),
    ('name = "a"\nsearch.tolerance = inf', ["search.tolerance", "inf", "a number"]),
    ('name = "a"\nsearch.tolerance = true', ["search.tolerance", "true", "a number"]),
    (f'name = "a"\nsearch.tolerance = 1{"0" * 400}', ["search.tolerance", "000...", "a number"]),
    ('name = "a"\nrocks = 3', ["rocks", "3", "a list, each a table with the keys size"]),
    ('name = "a"\n[[rocks]]\n[[rocks]]\nsize = 1', ["rocks[1].size", "a number [m], above 0.0, below 1.0"]),
    ('name = "a"\nrobots = []', ["robots", "[]", "a table of names, each a table with the keys size"]),
    ('name = "a"\nrobots.lean.size = 0.0', ["robots.lean.size", "0.0", "above 0.0"]),
    ('name = "a"\nextra.size = -1', ["extra.size", "-1", "above 0.0"]),
]


def refusal(call, *args) -> str:
    with pytest.raises(InputError) as caught:
        call(*args)
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize(("text", "parts"), BAD_FILES, ids=[f"{i}-{parts[0]}" for i, (_, parts) in enumerate(BAD_FILES)])
def test_bad_file(tmp_path: Path, text: str, parts: list[str]) -> None:
    path = tmp_path / "study.toml"
    path.write_text(text)
    message = refusal(load, Study, path)
    assert message.startswith(f"{path}: ")
    assert [part for part in parts if part not in message] == []


def test_unreadable_file(tmp_path: Path) -> None:
    (tmp_path / "latin.toml").write_bytes(b'name = "\xe9"')
    assert refusal(load, Study, tmp_path / "no.toml") == f"{tmp_path}/no.toml: cannot be read: No such file or directory"
    assert "it is a folder" in refusal(load, Study, tmp_path)
    os.mkfifo(tmp_path / "pipe.toml")
    assert "a device or a pipe" in refusal(load, Study, tmp_path / "pipe.toml")  # it would wait for ever
    (tmp_path / "long.toml").write_text("x = 1\n" * 300_000)
    assert "longer than 1000000 characters" in refusal(load, Study, tmp_path / "long.toml")
    assert "cannot be read: 'utf-8' codec" in refusal(load, Study, tmp_path / "latin.toml")


@pytest.mark.parametrize("study", [FULL, Study(name="plain")])
def test_round_trip(tmp_path: Path, study: Study) -> None:
    dump(study, tmp_path / "study.toml")
    assert load(Study, tmp_path / "study.toml") == study
    assert build(Study, to_table(study), "test") == study
    assert [path.name for path in tmp_path.iterdir()] == ["study.toml"]


def test_integers_become_floats_and_lists_tuples() -> None:
    study = build(Study, {"name": "a", "search": {"span": [0, 2]}}, "test")
    assert study.search.span == (0.0, 2.0)
    assert [type(end) for end in study.search.span] == [float, float]
    assert "tolerance" not in to_table(study)["search"]


def test_mutable_default_is_not_shared() -> None:
    first = Study(name="a")
    first.robots["lean"] = Rock()
    assert Study(name="b").robots == {}


def test_dump_refuses_what_it_cannot_write(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    assert refusal(dump, FULL, tmp_path / "file" / "a.toml").endswith("a.toml: cannot be written: Not a directory")
    assert "cannot be written" in refusal(dump, Study(name="\udcff"), tmp_path / "a.toml")


def test_check_looks_at_instances_made_by_code() -> None:
    bad = dataclasses.replace(FULL, robots={"lean": Rock(2.0)})
    assert refusal(check, bad, "here").startswith("here: robots.lean.size is 2.0, but must be a number [m]")
    assert check(FULL, "here") == FULL


def test_command_line_overrides() -> None:
    args = "--search.starts 5 --search.no-fast --robots.lean.size 0.125 --extra.size 0.5 --search.tolerance None"
    study = from_command_line(Study, dataclasses.replace(FULL, search=Search()), args.split(), "jaxleg")
    search = Search(starts=5, fast=False)
    robots = {**FULL.robots, "lean": Rock(0.125)}
    assert study == dataclasses.replace(FULL, search=search, robots=robots, extra=Rock(0.5))


@pytest.mark.parametrize(
    ("args", "parts"),
    [
        ("--search.starts 0", ["search.starts is 0,", "at least 1, at most 64"]),
        ("--search.tolerance nan", ["search.tolerance is nan,", "above 0.0"]),
        ("--search.cost x", ["search.cost", '"x"', "one of"]),
        ("--rocks.1.size 3", ["rocks[1].size is 3.0,", "below 1.0"]),
    ],
)
def test_command_line_out_of_limits(args: str, parts: list[str]) -> None:
    message = refusal(from_command_line, Study, dataclasses.replace(FULL), args.split(), "jaxleg")
    assert message.startswith("command line: ")
    assert [part for part in parts if part not in message] == []


@pytest.mark.parametrize(
    ("args", "code", "parts"),
    [
        ("--search.starts x", 2, ["--search.starts", "'x'"]),
        ("--search.method lbfgs", 2, ["--search.method", "lbfgs", "adam"]),
        ("--search.stars 3", 2, ["--search.stars"]),
        ("--search.span 1", 2, ["--search.span"]),
        ("--search.span 1 0", 2, ["span is [1.0, 0.0]", "must rise"]),
        ("stray", 2, ["stray"]),
        ("--help", 0, ["edge of the cube [m]", "above 0.0", "at least 1"]),
    ],
)
def test_command_line_exits(capsys: pytest.CaptureFixture, args: str, code: int, parts: list[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        from_command_line(Study, FULL, args.split(), "jaxleg study")
    said = capsys.readouterr()
    assert caught.value.code == code
    assert [part for part in parts if part not in (said.err if code else said.out)] == []
    assert "Traceback" not in said.err + said.out


@pytest.mark.parametrize("value", ["1e-300", "-1e-40", "1e200"])
def test_numbers_that_single_precision_cannot_hold(tmp_path: Path, value: str) -> None:
    (tmp_path / "a.toml").write_text(f"rate = {value}\n")
    with pytest.raises(InputError, match=r"a.toml: rate is .* single precision"):
        load(Rate, tmp_path / "a.toml")


def test_byte_order_mark(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_bytes(b"\xef\xbb\xbfrate = 2.0\n")
    assert load(Rate, tmp_path / "a.toml") == Rate(2.0)


def test_keys_nested_thousands_deep(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text("rate." + ".".join("a" * 5000) + " = 1\n")
    with pytest.raises(InputError, match=r"a.toml: rate is .*, but must be a number") as caught:
        load(Rate, tmp_path / "a.toml")
    assert len(str(caught.value)) < 300
