"""Messages between policies and their servers: round trips, foreign bytes, and openpi's own codec."""

from __future__ import annotations

import subprocess
import tracemalloc
from typing import Any

import msgpack
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from mpvi_bt.executive.remote.codec import MAX_BYTES, pack, unpack
from mpvi_bt.ground.errors import BadMessage
from tests.openpi_env import openpi_python

DTYPES = st.sampled_from(["|b1", "|i1", "<i2", ">i4", "<i8", "|u1", "<u2", ">u8", "<f2", "<f4", ">f8", "<U5", "|S3"])
ARRAYS = DTYPES.flatmap(
    lambda dtype: hnp.arrays(dtype, hnp.array_shapes(min_dims=0, max_dims=4, min_side=0, max_side=4))
)
SCALARS = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-(2**63), 2**64 - 1),
    st.floats(),
    st.text(),
    st.binary(),
    st.floats(width=32).map(np.float32),
    st.integers(0, 255).map(np.uint8),
    st.booleans().map(np.bool_),
)
VALUES = st.recursive(
    st.one_of(SCALARS, ARRAYS),
    lambda inner: st.one_of(st.lists(inner, max_size=4), st.dictionaries(st.text(max_size=8), inner, max_size=4)),
    max_leaves=12,
)


def same(a: Any, b: Any) -> bool:
    """Whether two values are equal in kind, dtype, shape and every bit."""
    if isinstance(a, np.ndarray):
        return isinstance(b, np.ndarray) and (a.dtype, a.shape, a.tobytes()) == (b.dtype, b.shape, b.tobytes())
    if isinstance(a, dict):
        return isinstance(b, dict) and a.keys() == b.keys() and all(same(a[key], b[key]) for key in a)
    if isinstance(a, list):
        return isinstance(b, list) and len(a) == len(b) and all(map(same, a, b))
    return type(a) is type(b) and (a == b or (a != a and b != b))


@given(VALUES)
def test_what_is_packed_is_unpacked(value: Any) -> None:
    """Values come back equal bit by bit, arrays in their dtype, shape and byte order."""
    assert same(value, unpack(pack(value)))


@given(st.binary(max_size=300))
@example(b"")
@example(b"\xc1")
@example(b"\x91" * 100_000)
@example(b"\xdd\xff\xff\xff\xff")
@example(b"\xc6\xff\xff\xff\xff")
@example(msgpack.packb(msgpack.ExtType(5, b"x")))
@example(msgpack.packb({1: 2}))
@example(b"\xa2\xff\xff")
def test_any_bytes_are_a_message_or_refused(message: bytes) -> None:
    """Random bytes raise BadMessage, with one short line, or are a message; nothing else."""
    try:
        unpack(message)
    except BadMessage as error:
        assert "\n" not in str(error)
        assert len(str(error)) < 400


KINDS = st.sampled_from(["|u1", "<f4", "|O", "|V8", "<c16", "<f16", "<M8[s]", "i4,f8", "x", "<U0", "|S999999999", ""])


@given(
    data=st.one_of(st.binary(max_size=40), st.integers(-(2**63), 2**64 - 1), st.floats(), st.text(), st.none()),
    dtype=st.one_of(KINDS, st.none(), st.binary(max_size=4), st.booleans()),
    shape=st.one_of(st.lists(st.integers(-2, 2**64 - 1), max_size=20), st.booleans(), st.none(), st.text(max_size=3)),
    key=st.sampled_from([b"__ndarray__", b"__npgeneric__"]),
)
@example(data=b"", dtype="<U999999999", shape=[0], key=b"__ndarray__")
@example(data=b"abc", dtype="|u1", shape=[2], key=b"__ndarray__")
@example(data=b"abc", dtype="<u2", shape=[2], key=b"__ndarray__")
@example(data=b"", dtype="|u1", shape=[0, 2**50, 2**50], key=b"__ndarray__")
@example(data=b"", dtype="|u1", shape=[2**32, 2**32], key=b"__ndarray__")
@example(data=b"", dtype="<U0", shape=[2**62], key=b"__ndarray__")
@example(data=300, dtype="|u1", shape=[], key=b"__npgeneric__")
@example(data=2**63, dtype="<i8", shape=[], key=b"__npgeneric__")
@example(data=True, dtype="<i8", shape=[True], key=b"__npgeneric__")
def test_no_array_is_built_that_is_not_there(data: Any, dtype: Any, shape: Any, key: bytes) -> None:
    """Whatever a message says of an array, it is one of its very bytes, of numbers or text, or it is refused."""
    message = msgpack.packb({key: True, b"data": data, b"dtype": dtype, b"shape": shape})
    try:
        value = unpack(message)
    except BadMessage:
        return
    assert value.dtype.kind in "biufSU"
    assert key == b"__npgeneric__" or value.nbytes == len(data)


@pytest.mark.parametrize("missing", [b"data", b"dtype", b"shape"])
def test_an_array_has_all_its_parts(missing: bytes) -> None:
    """A map that says that it is an array, but lacks a part of one, is refused."""
    parts = {b"__ndarray__": True, b"data": b"ab", b"dtype": "|u1", b"shape": [2]}
    assert unpack(msgpack.packb(parts)).tolist() == [97, 98]
    del parts[missing]
    with pytest.raises(BadMessage):
        unpack(msgpack.packb(parts))


@pytest.mark.parametrize(
    "value",
    [
        np.array([object()]),
        np.zeros(2, "i4,f8"),
        np.zeros(2, complex),
        np.complex64(1j),
        np.datetime64("2026-01-01"),
        {1, 2},
        object(),
        2**64,
    ],
    ids=lambda value: type(value).__name__,
)
def test_what_has_no_place_in_a_message_is_not_packed(value: Any) -> None:
    """Objects, records, complex numbers and dates raise TypeError when they are packed, not where they arrive."""
    with pytest.raises(TypeError, match="packed"):
        pack({"state": value})
    circle: list[Any] = []
    circle.append(circle)
    with pytest.raises(TypeError):
        pack(circle)


def test_a_failed_message_leaves_nothing_behind() -> None:
    """What could not be packed is not the beginning of the next message."""
    with pytest.raises(TypeError):
        pack({"a": np.zeros(5), "b": [1, 2, object()]})
    assert unpack(pack({"c": 3})) == {"c": 3}


def test_a_message_has_a_largest_size() -> None:
    """One that is longer is refused before it is looked at."""
    with pytest.raises(BadMessage, match="101 bytes"):
        unpack(bytes(101), most_bytes=100)
    assert MAX_BYTES < 1 << 27


BOMBS = {
    "empty lists": b"\xdd\x00\x08\x00\x00" + b"\x90" * (1 << 19),
    "empty mappings": b"\xdd\x00\x08\x00\x00" + b"\x80" * (1 << 19),
    "lists of empty lists": b"\xdc\x20\x00" + (b"\xdc\x00\x40" + b"\x90" * 64) * (1 << 13),
    "numbers": b"\xdd\x00\x08\x00\x00" + b"\xcd\x01\x01" * (1 << 19),
    "keys": b"\xdf\x00\x02\x00\x00" + b"".join(b"\xa4%04x\xc0" % n for n in range(1 << 16)) * 2,
    "lists in lists that never come": b"\xdd\x00\x80\x00\x00" * 300,
}


@pytest.mark.parametrize("name", BOMBS)
def test_a_small_message_is_no_large_value(name: str) -> None:
    """However many items it says that it has, it is refused before they take the memory."""
    tracemalloc.start()
    try:
        with pytest.raises(BadMessage):
            unpack(BOMBS[name])
        assert tracemalloc.get_traced_memory()[1] < 12_000_000
    finally:
        tracemalloc.stop()


def test_a_message_may_have_as_many_items_as_a_house() -> None:
    """What a camera sees, and what thousands of things are called, is no bomb."""
    called = {f"thing.n.01_{n}": ["thing", "object", "piece of a house"] for n in range(5000)}
    assert unpack(pack(called)) == called


def test_what_was_received_cannot_be_written_to() -> None:
    """Arrays are views of the message, so they are read-only."""
    assert not unpack(pack(np.zeros(3))).flags.writeable


PICTURES = {
    "observation": {"rgb": np.arange(2 * 3 * 3, dtype=np.uint8).reshape(2, 3, 3), "depth": np.ones((2, 3), ">f4")},
    "state": np.linspace(-1, 1, 23),
    "half": np.arange(3, dtype=np.float16),
    "nothing": np.zeros((0, 23), np.float32),
    "point": np.array(3.5),
    "mask": np.array([True, False]),
    "names": np.array(["häuser", "b"]),
    "bytes": np.array([b"ab", b"c"]),
    "scalars": [np.float32(0.1), np.int64(-7), np.bool_(True), np.uint8(200)],
    "plain": [None, True, -1, 2**63, 0.1, "prompt \u2603", b"\x00\xff", {"deep": [[]]}],
}
ECHO = """
import sys
from openpi_client import msgpack_numpy
message = sys.stdin.buffer.read()
value = msgpack_numpy.unpackb(message)
sys.stdout.buffer.write(msgpack_numpy.packb(value))
"""


@pytest.mark.rare
@pytest.mark.slow
def test_openpi_reads_what_we_write_and_we_what_it_writes() -> None:
    """The codec of the published client hands every value back unchanged, in the very same bytes."""
    ours = pack(PICTURES)
    done = subprocess.run([openpi_python(), "-c", ECHO], input=ours, capture_output=True, check=True, timeout=60)
    assert same(PICTURES, unpack(done.stdout))
    assert done.stdout == ours


REFUSES = """
import numpy as np
from openpi_client import msgpack_numpy
for value in (np.array([object()]), np.zeros(2, "i4,f8"), np.zeros(2, complex), np.complex64(1j)):
    try:
        msgpack_numpy.packb(value)
    except ValueError:
        print("refused")
"""


@pytest.mark.rare
@pytest.mark.slow
def test_openpi_refuses_what_we_refuse() -> None:
    """Objects, records and complex numbers are no more packed by the published client than by us."""
    done = subprocess.run([openpi_python(), "-c", REFUSES], capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout.split() == ["refused"] * 4
