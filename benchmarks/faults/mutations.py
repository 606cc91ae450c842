"""Ways to break a file: its bytes, its lines, its data."""

from __future__ import annotations

import io
import json
import random
import re
import zipfile
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import yaml

Broken = tuple[str, bytes]  # what was done, and what came of it
_NUMBER = re.compile(rb"(?<![\w.])-?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w.])")
_WORD = re.compile(rb"[A-Za-z_][\w.]*")
NUMBERS: list[Any] = [
    float("nan"), float("inf"), -float("inf"), 1e308, -1e308, 1e-308, 0, -1, 1, 2**31, 2**63, -(2**63), 10**30, 0.5,
]  # fmt: skip
VALUES: list[Any] = [
    None, True, False, "", " ", "x", [], {}, [[]], {"": None}, [None], 0, 1.5, "null", "\u202e", "a\nb", "x" * 5000,
    {"a": {"b": {"c": 1}}}, list(range(300)), "0", "../../etc/passwd", "$nobody", "-", "\U0001f600", "!!python/none",
]  # fmt: skip
_ODD_WORDS = [
    b"nan",
    b"inf",
    b"-1",
    b"1e999",
    b"",
    b"()",
    b")",
    b"(",
    b"?x",
    b"-",
    b"<!--",
    b"&x;",
    b"\xff",
    b"x" * 3000,
]


def _at(data: bytes, draw: random.Random) -> int:
    return draw.randrange(len(data) + 1)


def bits(data: bytes, draw: random.Random) -> Broken:
    """One to eight bits turned round."""
    broken = bytearray(data)
    for _ in range(draw.randint(1, 8)):
        broken[draw.randrange(len(data))] ^= 1 << draw.randrange(8)
    return "bits flipped", bytes(broken)


def cut(data: bytes, draw: random.Random) -> Broken:
    """The beginning alone."""
    return "cut short", data[: _at(data, draw)]


def inserted(data: bytes, draw: random.Random) -> Broken:
    """Bytes that do not belong there."""
    at = _at(data, draw)
    odd = draw.choice([draw.randbytes(draw.randint(1, 20)), b"\0", b"\t", b'"', b"{", b"[", b"]", b"}", b": ", b"- ",
    b"#",
                       b"&a ", b"*a ", b"\xef\xbb\xbf", b"\xe2\x80\xa8", b"%", b"|", b">", b"!!binary "])  # fmt: skip
    return "bytes inserted", data[:at] + odd + data[at:]


def zeros(data: bytes, draw: random.Random) -> Broken:
    """A block of zeros, as a disk leaves that was not synced."""
    at, length = _at(data, draw), draw.randint(1, 4096)
    return "a block of zeros", data[:at] + bytes(min(length, len(data) - at)) + data[at + length :]


def encoded(data: bytes, draw: random.Random) -> Broken:
    """The same text in another encoding."""
    text = data.decode("utf-8", "replace").replace("e", "\u00e9", 3)
    return "another encoding", text.encode(
        draw.choice(["utf-16", "utf-16-be", "utf-32", "latin-1", "cp037"]), "replace"
    )


def _lines(data: bytes) -> list[bytes]:
    return data.splitlines(keepends=True) or [b""]


def doubled(data: bytes, draw: random.Random) -> Broken:
    """A line twice, or a few lines."""
    lines = _lines(data)
    i, n = draw.randrange(len(lines)), draw.choice([1, 1, 1, 3, 50])
    return "a line doubled", b"".join(lines[: i + 1] + lines[i : i + 1] * n + lines[i + 1 :])


def removed(data: bytes, draw: random.Random) -> Broken:
    """A line gone, or a few lines."""
    lines = _lines(data)
    i = draw.randrange(len(lines))
    return "a line removed", b"".join(lines[:i] + lines[i + draw.choice([1, 1, 1, 2, 5]) :])


def swapped(data: bytes, draw: random.Random) -> Broken:
    """Two lines that changed places."""
    lines = _lines(data)
    i, j = draw.randrange(len(lines)), draw.randrange(len(lines))
    lines[i], lines[j] = lines[j], lines[i]
    return "lines swapped", b"".join(lines)


def indented(data: bytes, draw: random.Random) -> Broken:
    """A line that stands elsewhere."""
    lines = _lines(data)
    i = draw.randrange(len(lines))
    lines[i] = draw.choice([b" ", b"  ", b"\t", b"    "]) + lines[i] if draw.random() < 0.7 else lines[i].lstrip()
    return "a line moved sideways", b"".join(lines)


def number(data: bytes, draw: random.Random) -> Broken:
    """Another number in the place of one."""
    found = list(_NUMBER.finditer(data))
    if not found:
        return bits(data, draw)
    at = draw.choice(found)
    value = draw.choice([*NUMBERS, ".nan", ".inf", "1e999", "0x10", "1_000", "1,5", "\u0663", "--1", "9" * 400])
    return "another number", data[: at.start()] + str(value).encode() + data[at.end() :]


def word(data: bytes, draw: random.Random) -> Broken:
    """Another word in the place of one: odd, or one of the file's own."""
    found = list(_WORD.finditer(data))
    if not found:
        return bits(data, draw)
    at, other = draw.choice(found), draw.choice(found)
    return "another word", data[: at.start()] + draw.choice([*_ODD_WORDS, other[0], other[0]]) + data[at.end() :]


def deep(data: bytes, draw: random.Random) -> Broken:
    """Nesting without end in the place of a number or a word."""
    n = draw.choice([70, 250, 1000, 20_000, 200_000])
    opened, closed = draw.choice([(b"[", b"]"), (b'{"a":', b"}"), (b"(and ", b")"), (b"<a>", b"</a>"), (b"- ", b"")])
    found = list(_NUMBER.finditer(data)) or list(_WORD.finditer(data))
    start, end = draw.choice(found).span() if found else (0, 0)
    return "deep nesting", data[:start] + opened * n + b"1" + closed * n + data[end:]


def aliases(data: bytes, draw: random.Random) -> Broken:
    """A small text of which YAML would make a large one."""
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, 12)]
    return "aliases of aliases", data + b"\n" + "\n".join(lines).encode() + b"\n"


TEXT = [bits, cut, inserted, zeros, encoded, doubled, removed, swapped, indented, number, word, deep]
BYTES = [bits, cut, inserted, zeros, lambda data, draw: ("a block doubled", data + data[_at(data, draw) :])]


# ------------------------------------------------------------------------------------------------- of the data


def places(data: Any, at: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Where everything in plain data stands."""
    yield at
    for key, inner in data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ():
        yield from places(inner, (*at, key))


def _within(data: Any, at: tuple[Any, ...]) -> Any:
    for key in at:
        data = data[key]
    return data


def spoiled(data: Any, draw: random.Random) -> tuple[str, Any]:
    """Plain data with one thing changed; what was done, and the data."""
    data = json.loads(json.dumps(data, default=str))
    spots = [at for at in places(data) if at]
    if not spots:
        return "another value", draw.choice(VALUES)
    at = draw.choice(spots)
    around, key = _within(data, at[:-1]), at[-1]
    what = draw.choice(["renamed", "value", "value", "number", "gone", "more", "wrapped", "many"])
    if what == "renamed" and isinstance(around, dict):
        old = {**around}
        around.clear()
        around.update({(f"{k}_renamed" if k == key else k): v for k, v in old.items()})
        return "a key renamed" + " at the top" * (len(at) == 1), data
    if what == "more" and isinstance(around, dict):
        around["of_nobody"] = draw.choice(VALUES)
        return "a key too many" + " at the top" * (len(at) == 1), data
    if what == "gone":
        del around[key]
        return "a value removed", data
    if what == "number":
        numbers = [a for a in spots if isinstance(_within(data, a), int | float) and _within(data, a) is not True]
        at = draw.choice(numbers or [at])
        _within(data, at[:-1])[at[-1]] = draw.choice(NUMBERS)
        return "another number", data
    if what == "wrapped":
        around[key] = draw.choice([[around[key]], {"of": around[key]}, str(around[key])])
        return "a value wrapped", data
    if what == "many" and isinstance(around, list):
        around.extend([around[key]] * draw.choice([1, 10, 2000]))
        return "values repeated", data
    around[key] = draw.choice(VALUES)
    return "a value of another type", data


def of_json(data: bytes, draw: random.Random) -> Broken:
    """JSON with one thing changed in what it says."""
    what, value = spoiled(json.loads(data), draw)
    return what, json.dumps(value, indent=draw.choice([None, 1])).encode()


def of_yaml(data: bytes, draw: random.Random) -> Broken:
    """YAML with one thing changed in what it says."""
    what, value = spoiled(yaml.safe_load(data), draw)
    return what, yaml.safe_dump(value, sort_keys=False, allow_unicode=True).encode()


def of_lines(data: bytes, draw: random.Random) -> Broken:
    """One JSON object of a file of one a line, with one thing changed in what it says."""
    lines = data.splitlines(keepends=True)
    i = draw.randrange(len(lines))
    what, value = spoiled(json.loads(lines[i]), draw)
    lines[i] = json.dumps(value).encode() + b"\n"
    return what, b"".join(lines)


def of_arrays(data: bytes, draw: random.Random) -> Broken:
    """An archive of arrays with one of them changed."""
    with np.load(io.BytesIO(data), allow_pickle=False) as kept:
        arrays: dict[str, Any] = dict(kept)
    name = draw.choice(list(arrays))
    old = arrays[name]
    what = draw.choice(["gone", "nan", "shape", "dtype", "objects", "empty", "raw"])
    if what == "gone":
        del arrays[name]
    elif what == "nan" and old.dtype.kind == "f" and old.size:
        arrays[name] = np.where(
            np.arange(old.size).reshape(old.shape) == old.size // 2, draw.choice([np.nan, np.inf]), old
        )
    elif what == "shape":
        arrays[name] = old[None] if old.ndim == 0 or draw.random() < 0.5 else old[:-1]
    elif what == "dtype":
        arrays[name] = np.full(old.shape, "x")
    elif what == "objects":
        arrays[name] = np.array([{"a": 1}], dtype=object)
    else:
        arrays[name] = np.zeros((0,))
    file = io.BytesIO()
    np.savez(file, **arrays)
    if what == "raw":  # something that is no array
        with zipfile.ZipFile(file, "a") as archive:
            archive.writestr(f"{name}.npy", draw.randbytes(draw.randint(0, 300)))
    return f"an array: {what}", file.getvalue()


Mutation = Callable[[bytes, random.Random], Broken]
