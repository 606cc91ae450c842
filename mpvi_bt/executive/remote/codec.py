"""Messages as openpi writes them: msgpack, in which a numpy array is a map with its bytes, dtype and shape.

Nothing that was received is trusted: an array is built only if its dtype is plain numbers or text and its bytes are
exactly as many as its shape says, so that unpacking never needs more memory than a small multiple of the message.
"""

from __future__ import annotations

import math
import re
import threading
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import msgpack
import numpy as np

from mpvi_bt.ground.errors import BadMessage, shown, with_article

MAX_BYTES = 64 << 20  # of one message; three pictures of 720x720 with depth take 14 MB
MOST_ITEMS = 1 << 16  # of all lists and mappings of a message: an item takes up to 80 times the bytes that say it
_MAX_DIMENSIONS = 16
# Truth values, integers and floats of up to 64 bits, bytes, text. openpi also lets longer floats and dates through, of
# arrays only: it cannot pack their scalars.
_DTYPE = re.compile(r"[<>=|]?(?:b1|[iu][1248]|f[248]|[SU][1-9][0-9]{0,8})")
_SCALARS: Mapping[str, tuple[type, ...]] = {"b": (bool,), "i": (int,), "u": (int,), "f": (float, int)}
_OF_THREAD = threading.local()
_ARRAY, _SCALAR, _DATA, _KIND, _SHAPE = b"__ndarray__", b"__npgeneric__", b"data", b"dtype", b"shape"


def pack(value: Any) -> bytes:
    """A message: None, bool, int, float, str, bytes, lists, mappings with text for keys, numpy arrays and scalars.

    Raises:
        TypeError: There is something else in it, such as an array of objects or of complex numbers.
    """
    try:
        return bytes(_packer().pack(value))
    except (ValueError, OverflowError) as error:  # nested too deeply, or an integer of more than 64 bits
        raise TypeError(f"cannot be packed: {error}") from None


def unpack(message: bytes, most_bytes: int = MAX_BYTES) -> Any:
    """The value of a message. Arrays are read-only views of it.

    Raises:
        BadMessage: It is longer than `most_bytes`, has more than `MOST_ITEMS`, is not msgpack, or has an array that
            no one should build.
    """
    if len(message) > most_bytes:
        raise BadMessage(f"a message of {len(message)} bytes; {most_bytes} are allowed")
    items = 0

    def counted(value: Any) -> Any:
        nonlocal items
        items += 1 + len(value)
        if items > MOST_ITEMS:
            raise BadMessage(f"a message of more than {MOST_ITEMS} items")
        return value

    try:
        return msgpack.unpackb(
            message,
            object_hook=lambda value: _decoded(counted(value)),
            list_hook=counted,
            ext_hook=_refuse_extension,
            max_array_len=MOST_ITEMS,
            max_map_len=MOST_ITEMS,
        )
    except BadMessage:
        raise
    except (ValueError, TypeError, OverflowError, RecursionError, msgpack.UnpackException) as error:
        raise BadMessage(f"not a msgpack message: {_line(error)}") from None


def _packer() -> msgpack.Packer:
    """One for each thread: its buffer stays as large as the largest message, which saves most of the time."""
    if not hasattr(_OF_THREAD, "packer"):
        _OF_THREAD.packer = msgpack.Packer(default=_encoded)
    return _OF_THREAD.packer


def _encoded(value: Any) -> Any:
    if not isinstance(value, np.ndarray | np.generic):
        raise TypeError(f"{with_article(type(value).__name__)} cannot be packed")
    if not _DTYPE.fullmatch(value.dtype.str):
        raise TypeError(f"an array of dtype {value.dtype} cannot be packed: numbers and text can")
    if isinstance(value, np.ndarray):
        return {_ARRAY: True, _DATA: value.tobytes(), _KIND: value.dtype.str, _SHAPE: value.shape}
    return {_SCALAR: True, _DATA: value.item(), _KIND: value.dtype.str}


def _decoded(value: dict[Any, Any]) -> Any:
    if _ARRAY in value:
        return array_of(value.get(_DATA), value.get(_KIND), value.get(_SHAPE))
    if _SCALAR in value:
        return _scalar(value.get(_DATA), _dtype(value.get(_KIND)))
    return value


def _dtype(given: Any) -> np.dtype[Any]:
    if not (isinstance(given, str) and _DTYPE.fullmatch(given)):
        raise BadMessage(f"an array of dtype {shown(given)}: numbers and text are allowed")
    try:
        return np.dtype(given)
    except (ValueError, TypeError):  # text that is longer than numpy can have
        raise BadMessage(f"an array of the unknown dtype {shown(given)}") from None


def array_of(data: Any, kind: Any, shape: Any) -> np.ndarray[Any, Any]:
    """The array that a message describes, a read-only view of its bytes.

    Args:
        data: Its bytes.
        kind: Its dtype, such as "<f4".
        shape: Its shape.

    Raises:
        BadMessage: It is none that anyone should build.
    """
    dtype = _dtype(kind)
    if not isinstance(data, bytes):
        raise BadMessage(f"an array whose data are {shown(data)}, not bytes")
    if not (isinstance(shape, Sequence) and all(type(n) is int and n >= 0 for n in shape)):
        raise BadMessage(f"an array of shape {shown(shape)}: a list of counts is wanted")
    # Counted in Python's integers, which do not wrap; a dimension of 0 must not hide that others are absurd.
    if len(shape) > _MAX_DIMENSIONS or math.prod(max(n, 1) for n in shape) > MAX_BYTES:
        raise BadMessage("an array with too many dimensions or elements")
    if math.prod(shape) * dtype.itemsize != len(data):
        raise BadMessage(f"an array of shape {tuple(shape)} and dtype {dtype} with {len(data)} bytes")
    return np.ndarray(shape=tuple(shape), dtype=dtype, buffer=data)


def _scalar(data: Any, dtype: np.dtype[Any]) -> Any:
    if type(data) not in _SCALARS.get(dtype.kind, ()):
        raise BadMessage(f"a scalar of dtype {dtype} that is {shown(data)}")
    make: Callable[[Any], Any] = dtype.type
    with np.errstate(over="ignore"):  # a float becomes infinite
        return make(data)  # OverflowError where an integer does not fit


def _refuse_extension(code: int, data: bytes) -> Any:
    raise BadMessage(f"a msgpack extension (type {code}, {len(data)} bytes)")


def _line(error: BaseException) -> str:
    return " ".join(f"{type(error).__name__}: {error}".split())[:200]
