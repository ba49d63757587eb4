"""The reader of archives: every way in which a file is not one of plain arrays ends in one sentence."""

import io
import os
import pickle
import zipfile

import numpy as np
import pytest
from numpy.lib import format as npy

from jaxleg.conventions import InputError
from jaxleg.npz import LARGEST, LONGEST, Layout, read_npz, write_npz

LAYOUTS = {"a": Layout(("n", 2)), "b": Layout(("n",), "booleans", optional=True), "c": Layout((), "a text", optional=True)}
VALUE = np.arange(6.0).reshape(3, 2)


def npy_bytes(array) -> bytes:
    stream = io.BytesIO()
    npy.write_array(stream, np.asarray(array))
    return stream.getvalue()


def archived(path, data: bytes, name: str = "a.npy", method: int = zipfile.ZIP_DEFLATED):
    with zipfile.ZipFile(path, "w", method) as archive:
        archive.writestr(name, data)
    return path


def declared(text: str, data: bytes = b"", version: bytes = b"\x01\x00") -> bytes:
    """An array's file with a header of these words."""
    return b"\x93NUMPY" + version + (len(text) + 1).to_bytes(2, "little") + text.encode("latin1") + b"\n" + data


def header(shape: str, descr: str = "'<f8'") -> str:
    return f"{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}, }}"


def refusal(path) -> str:
    with pytest.raises(InputError) as caught:
        read_npz(path, LAYOUTS, "there is none")
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert "\n" not in message
    return message.removeprefix(f"{path}: ")


@pytest.mark.parametrize("dtype", ["<f8", ">f4", "f2", "g", "i1", ">u2", "i8"])
@pytest.mark.parametrize("order", ["C", "F"])
def test_numbers_of_any_width_and_order_are_read_as_float64(tmp_path, dtype, order):
    np.savez(tmp_path / "x.npz", a=np.asarray(VALUE, dtype, order=order), other=np.array([None], object))
    value = read_npz(tmp_path / "x.npz", LAYOUTS, "")["a"]
    assert value.dtype == np.float64
    np.testing.assert_array_equal(value, VALUE)


def test_what_is_written_is_read_back(tmp_path):
    write_npz(tmp_path / "x", {"a": VALUE, "b": [True, False, True], "c": "text \u00e9"})
    read = read_npz(tmp_path / "x", LAYOUTS, "")
    np.testing.assert_array_equal(read["a"], VALUE)
    assert read["b"].tolist() == [True, False, True]
    assert read["c"] == "text \u00e9"


def test_what_is_no_archive(tmp_path):
    np.save(tmp_path / "array.npy", VALUE)
    (tmp_path / "pickle.npz").write_bytes(pickle.dumps({"a": VALUE}))
    (tmp_path / "empty.npz").write_bytes(b"")
    (tmp_path / "short.npz").write_bytes(b"PK\x05\x06" + bytes(17))
    for name in ("array.npy", "pickle.npz", "empty.npz", "short.npz"):
        assert refusal(tmp_path / name) == "cannot be read: it is not a .npz file of plain arrays"
    os.mkfifo(tmp_path / "pipe")
    for name in (tmp_path / "pipe", "/dev/null", "/dev/zero"):
        assert refusal(name) == "cannot be read: it is a device or a pipe"
    assert refusal(tmp_path) == "cannot be read: it is a folder"
    assert refusal(tmp_path / "none.npz") == "cannot be read: No such file or directory"
    assert refusal(tmp_path / "array.npy" / "x") == "cannot be read: Not a directory"


def test_every_truncation_of_an_archive(tmp_path):
    write_npz(tmp_path / "good", {"a": VALUE})
    whole = (tmp_path / "good").read_bytes()
    for length in range(len(whole)):
        (tmp_path / "bad").write_bytes(whole[:length])
        assert refusal(tmp_path / "bad") == "cannot be read: it is not a .npz file of plain arrays"


@pytest.mark.parametrize("method", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])
def test_every_changed_byte_of_an_archive_is_refused_or_changes_nothing(tmp_path, method):
    """The checksum is compared: no changed number is ever returned."""
    whole = archived(tmp_path / "good", npy_bytes(VALUE), method=method).read_bytes()
    refused = 0
    for place in range(len(whole)):
        for mask in (0x01, 0x80, 0xFF):
            (tmp_path / "bad").write_bytes(whole[:place] + bytes([whole[place] ^ mask]) + whole[place + 1 :])
            try:
                read = read_npz(tmp_path / "bad", LAYOUTS, "")
            except InputError:
                refused += 1
            else:
                np.testing.assert_array_equal(read["a"], VALUE)
    assert refused > len(whole)


def flagged(path, flag: int = 0, method: int | None = None):
    """An archive whose two headers of its member have a flag or a method that its data do not have."""
    data = bytearray(archived(path, npy_bytes(VALUE)).read_bytes())
    for start, flags in ((data.index(b"PK\x03\x04"), 6), (data.index(b"PK\x01\x02"), 8)):
        data[start + flags] |= flag
        if method is not None:
            data[start + flags + 2] = method
    path.write_bytes(data)
    return path


def test_archives_that_are_packed_otherwise(tmp_path):
    assert refusal(flagged(tmp_path / "x", flag=0x01)) == "a is encrypted"
    for method in (zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA):
        assert "a is compressed by method" in refusal(archived(tmp_path / "x", npy_bytes(VALUE), method=method))
    assert refusal(flagged(tmp_path / "x", method=97)) == "a is compressed by method 97, which numpy does not write"
    assert refusal(flagged(tmp_path / "x", method=0)) == "a cannot be read: it is damaged or holds no plain array"
    assert refusal(flagged(tmp_path / "x", flag=0x20)) == "a cannot be read: it is damaged or holds no plain array"


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_an_array_that_is_there_twice(tmp_path):
    with zipfile.ZipFile(tmp_path / "x", "w") as archive:
        archive.writestr("a.npy", npy_bytes(VALUE))
        archive.writestr("a.npy", npy_bytes(VALUE + 1.0))
    assert refusal(tmp_path / "x") == "a is there more than once"


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "cannot be read"),
        (b"text", "cannot be read"),
        (declared(header("(3, 2)")), "cannot be read"),  # no data
        (declared(header("(3, 2)"), bytes(48) + b"more"), "cannot be read"),
        (declared(header("(3, 2)"), bytes(48), b"\x03\x00"), "cannot be read"),
        (declared(header("(3, 2)"), bytes(48), b"\x09\x00"), "cannot be read"),
        (declared(header("(-3, 2)")), "cannot be read"),
        (declared(header("(3.0, 2)")), "cannot be read"),
        (declared(header("(3, 2")), "cannot be read"),
        (declared("{}"), "cannot be read"),
        (declared("(" * 5000), "cannot be read"),
        (declared("-" * 9000 + "1"), "cannot be read"),
        (declared(" " * 20000), "cannot be read"),
        (declared("\x00\xff"), "cannot be read"),
        (declared(header("(3, 2)", "'nonsense'")), "cannot be read"),
        (declared(header("(3, 2)", "[('x', '<f8', (100000, 100000, 100000))]")), "a "),
        (declared(header("(1000000, 1000000)")), "must be numbers in 2 dimensions, (n, 2)"),
        (declared(header("(1000000000000, 2)")), f"more than {LARGEST} numbers in the whole file"),
        (declared(header(f"({10**400}, 2)")), "more than"),
        (declared(header("(3, 2)", "'|O'"), pickle.dumps(VALUE)), "object"),
    ],
    ids=range(20),
)
def test_headers_and_data_that_cannot_be(tmp_path, data, words):
    assert words in refusal(archived(tmp_path / "x", data))


@pytest.mark.parametrize("dtype", ["m8[s]", "M8[s]", complex, bool, object, "S3", "U3", "V8", [("x", float)]])
def test_what_is_no_number_is_said_by_its_type(tmp_path, dtype):
    np.savez(tmp_path / "x.npz", a=np.zeros((3, 2), dtype))
    assert "but must be numbers in 2 dimensions, (n, 2)" in refusal(tmp_path / "x.npz")


def test_lengths_that_must_agree(tmp_path):
    write_npz(tmp_path / "x", {"a": VALUE, "b": np.ones(4, bool)})
    assert refusal(tmp_path / "x") == "b has shape (4,) of bool, but must be booleans in 1 dimension, (3)"


def test_texts_that_cannot_be(tmp_path):
    for name, data in (
        ("code", declared(header("()", "'<U1'"), b"\xff\xff\xff\x7f")),
        ("long", npy_bytes("x" * (LONGEST + 1))),
    ):
        with zipfile.ZipFile(tmp_path / name, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("a.npy", npy_bytes(VALUE))
            archive.writestr("c.npy", data)
    assert refusal(tmp_path / "code").startswith("c cannot be read")
    assert f"more than {LONGEST} characters" in refusal(tmp_path / "long")


def test_a_table_of_contents_that_is_a_bomb(tmp_path):
    with zipfile.ZipFile(tmp_path / "x", "w") as archive:
        archive.writestr("a.npy", npy_bytes(VALUE))
        for k in range(20_000):
            archive.writestr(f"{k:020d}", b"")
    assert refusal(tmp_path / "x") == "cannot be read: it is not a .npz file of plain arrays"


def test_a_key_that_is_missing(tmp_path):
    write_npz(tmp_path / "x", {"b": [True]})
    assert refusal(tmp_path / "x") == "a is missing; there is none"
