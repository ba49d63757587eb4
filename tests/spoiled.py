"""Spoiled archives of maps and plans, made from good ones by a seed: (what was done, the file's bytes)."""

import io
import json
import pickle
import zipfile
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.lib import format as npy

from tests.plans import PARAMS

Spoiled = Iterator[tuple[str, bytes]]
VALUES = (np.nan, np.inf, -np.inf, 0.0, -1.0, 1e30, -1e30, 1e308, 1e-300, 1e9, -9999.0, -32768.0, -3.4e38, 255.0, 0.5, 7.0)
DTYPES = ("f2", ">f4", "f8", "g", "i1", ">i8", "u1", "u8", "?", "c16", "m8[s]", "M8[s]", "S4", "U4", "V8", "O")
HEADERS = (
    "({}, {})",
    "(-4, 4)",
    "()",
    "(0, 9)",
    "({}00000, 9)",
    "(10000000000, 10000000000)",
    "(4.0, 4)",
    "(4, 4",
    "(True, 4)",
)
DESCRIPTIONS = ("'<f8'", "'|O'", "'<M8[s]'", "[('a', '<f8', (9999999, 9999))]", "'<U999999999'", "'x'", "None", "'<f8'" * 3000)
FLAGS = (0x01, 0x08, 0x20, 0x40, 0x41, 0xFF)


def npy_bytes(array: Any) -> bytes:
    """An array as a `.npy` file, pickled where it must be."""
    stream = io.BytesIO()
    npy.write_array(stream, np.asarray(array))
    return stream.getvalue()


def packed(members: Mapping[str, Any], method: int = zipfile.ZIP_DEFLATED) -> bytes:
    """Arrays, or what stands in their place as bytes, as an archive."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", method, compresslevel=1) as archive:
        for key, value in members.items():
            archive.writestr(f"{key}.npy", value if isinstance(value, bytes) else npy_bytes(value))
    return stream.getvalue()


def declared(shape: str, description: str = "'<f8'", data: bytes = b"") -> bytes:
    """A `.npy` file of which the header says so."""
    text = f"{{'descr': {description}, 'fortran_order': False, 'shape': {shape}, }}\n".encode("latin1")
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text + data


def bytes_spoiled(rng: np.random.Generator, good: Mapping[str, Any], count: int) -> Spoiled:
    """Bits turned round, ends and middles lost, parts that stand twice; packed and not."""
    for k in range(count):
        data = bytearray(packed(good, (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)[k % 2]))
        at, other = sorted(rng.integers(0, len(data), 2).tolist())
        if k % 8 == 0:
            yield f"cut at {at}", bytes(data[:at])
        elif k % 8 == 1:
            yield f"without {at} to {other}", bytes(data[:at] + data[other:])
        elif k % 8 == 2:
            yield f"{at} to {other} twice", bytes(data[:other] + data[at:])
        else:
            places = rng.integers(0, len(data), 1 + k % 5)
            data = np.frombuffer(bytes(data), np.uint8).copy()
            data[places] ^= rng.integers(1, 256, len(places)).astype(np.uint8)
            yield f"bytes {places.tolist()} changed", data.tobytes()


def packing_spoiled(good: Mapping[str, Any], key: str) -> Spoiled:
    """Headers that declare what is not there, packing that nobody asked for, bombs."""
    rest = {name: value for name, value in good.items() if name != key}
    for shape in HEADERS:
        text = shape.format(*np.shape(good[key]), 0, 0)
        yield f"{key} declared {shape}", packed(good | {key: declared(text, data=bytes(800))})
    for text in DESCRIPTIONS:
        yield f"{key} declared {text[:30]}", packed(good | {key: declared("(4, 4)", text, bytes(800))})
    yield f"{key} a pickle", packed(good | {key: pickle.dumps(good[key])})
    nested = np.array([[{"a": [np.array([None], object)]}] * 4] * 4, object)
    yield f"{key} a pickle of pickles", packed(good | {key: nested})
    for name, data in {"zeros": bytes(400_000_000), "brackets": b"(" * 1_000_000}.items():
        yield f"{key} a bomb of {name}", packed(good | {key: declared("(7000, 7000)", data=data)})
    yield f"{key} with a bomb behind it", packed(good | {key: npy_bytes(good[key]) + bytes(400_000_000)})
    yield f"{key} of many cells", packed(good | {key: declared("(4900, 4900)", data=bytes(4900 * 4900 * 8))})
    yield f"{key} of many small cells", packed(good | {key: declared("(9000, 9000)", "'|u1'", bytes(81_000_000))})
    for method in (zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA):
        yield f"packed by method {method}", packed(good, method)
    for flag in FLAGS:
        yield f"flag {flag}", marked(packed(good), 6, flag)
    for method in (0, 1, 9, 12, 14, 97, 255):
        yield f"called method {method}", marked(packed(good), 8, method)
    yield f"{key} bytes", packed(rest | {key: b""})
    yield "an array alone", npy_bytes(good[key])
    yield "a pickle alone", pickle.dumps(dict(good))
    yield "nothing", b""


def marked(data: bytes, place: int, value: int) -> bytes:
    """An archive with a byte of the headers of all its members set: at `place` in the local ones, two later in the table."""
    changed = bytearray(data)
    for mark, shift in ((b"PK\x03\x04", 0), (b"PK\x01\x02", 2)):
        at = changed.find(mark)
        while at >= 0:
            changed[at + place + shift] = value
            at = changed.find(mark, at + 4)
    return bytes(changed)


def values_spoiled(rng: np.random.Generator, good: Mapping[str, Any], keys: list[str], each: int) -> Spoiled:
    """Keys that are missing, of another shape, kind or order, with numbers that cannot be; `each` of these a key."""
    for key in keys:
        value = np.asarray(good[key])
        yield f"{key} missing", packed({name: other for name, other in good.items() if name != key})
        for how, array in reshaped(value).items():
            yield f"{key} {how}", packed(good | {key: array})
        for dtype in rng.choice(DTYPES, each, replace=False):
            yield f"{key} as {dtype}", packed(good | {key: recast(value, str(dtype))})
        if value.dtype.kind != "U":
            for number in rng.choice(VALUES, each, replace=False):
                one = np.array(value, float)
                one.flat[rng.integers(max(one.size, 1))] = number
                yield f"{key} with {number}", packed(good | {key: one})
                yield f"{key} all {number}", packed(good | {key: np.full(value.shape, number)})
            for factor in (-1.0, 1e-3, 0.5, 1.01, 2.0, 1e6):
                yield f"{key} times {factor}", packed(good | {key: factor * np.asarray(value, float)})
            yield f"{key} in another order", packed(good | {key: rng.permutation(value.ravel()).reshape(value.shape)})


def reshaped(value: np.ndarray) -> dict[str, np.ndarray]:
    """The same or nearly the same numbers in other shapes."""
    return {
        "nested": value[None],
        "flat": value.ravel(),
        "transposed": value.T,
        "empty": value.ravel()[:0],
        "shorter": value[:-1] if value.ndim else value[None][:0],
        "longer": np.concatenate([value, value[-1:]]) if value.ndim else np.stack([value, value]),
    }


def recast(value: np.ndarray, dtype: str) -> np.ndarray:
    """The same in another type; where there is no way, zeros of it."""
    try:
        with np.errstate(all="ignore"):
            return value.astype(dtype)
    except (TypeError, ValueError):
        return np.zeros(value.shape, dtype)


def maps(seed: int) -> Spoiled:
    """Spoiled maps of 24 x 20 cells, one of them unseen."""
    rng = np.random.default_rng(seed)
    elevation = np.cumsum(rng.normal(0.0, 0.02, (24, 20)), axis=0)
    elevation[5, 7] = np.nan
    good = {"elevation": elevation, "resolution": np.array(0.04), "origin_xy": np.array([388096.0, 3948996.0])}
    yield from bytes_spoiled(rng, good, 150)
    yield from packing_spoiled(good, "elevation")
    yield from values_spoiled(rng, good, list(good), 10)


def plans(seed: int, good: Mapping[str, Any], keys: list[str]) -> Spoiled:
    """Spoiled plans."""
    rng = np.random.default_rng(seed)
    yield from bytes_spoiled(rng, good, 150)
    yield from packing_spoiled(good, "elevation")
    yield from values_spoiled(rng, good, keys, 3)
    for key in PARAMS:
        for value in (None, 0, -1, 1, 1e-9, 100, 1e30, 10**400, float("nan"), float("inf"), "x", [], {}, True, 0.003, 17):
            params = PARAMS | {key: value}
            yield f"params {key} {str(value)[:20]}", packed(good | {"params": np.array(json.dumps(params))})
        yield (
            f"params without {key}",
            packed(good | {"params": np.array(json.dumps({k: v for k, v in PARAMS.items() if k != key}))}),
        )
    for text in ("", "{", "[]", "null", "nan", '"x"', "[" * 100_000, "\ud800", "{}" * 10, "9" * 10_000, "x" * 2_000_000):
        yield f"params {text[:10]}", packed(good | {"params": np.array(text)})
