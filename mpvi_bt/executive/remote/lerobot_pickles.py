"""Messages of LeRobot's asynchronous inference, which are pickles: written and read without LeRobot and torch.

What is read is never loaded by name: a chunk of actions has stand-ins for the four names that it may have, and every
other name, or anything else that no chunk has, is refused.
"""

from __future__ import annotations

import io
import pickle
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from mpvi_bt.executive.remote.codec import array_of
from mpvi_bt.executive.remote.connection import one_line
from mpvi_bt.ground.errors import BadMessage, shown
from mpvi_bt.ground.geometry.solids import Array

HOME = "lerobot.async_inference.helpers"  # of its classes, from 0.4 on
_DTYPES = {"FloatStorage": "<f4", "DoubleStorage": "<f8", "HalfStorage": "<f2"}  # torch's name to numpy's
_PARTS = 5  # pickles before the numbers of a tensor: magic number, version, platform, storage, its key


def written(name: str, attributes: Mapping[str, Any]) -> bytes:
    """The pickle of an object of a class of LeRobot's, which need not be here.

    Args:
        name: Of the class.
        attributes: Of the object: numbers, texts, lists, mappings, arrays.
    """
    state = pickle.dumps(dict(attributes), protocol=3)[2:-1]  # without its beginning and its end
    made = b"c" + f"{HOME}\n{name}\n".encode() + b")\x81"  # the class, called without arguments
    return b"\x80\x03" + made + state + b"b."


def read_chunk(message: bytes) -> tuple[int, Array]:
    """The step that a chunk begins at, and its (H, n) rows.

    Raises:
        BadMessage: It is no list of `TimedAction`, each a row of as many numbers.
    """
    try:
        given = _Actions(io.BytesIO(message)).load()
    except BadMessage:
        raise
    except Exception as error:  # whatever a pickle may do to its reader
        raise BadMessage(f"not a pickle of actions: {one_line(f'{type(error).__name__}: {error}')}") from None
    if not isinstance(given, list) or not given or not all(isinstance(one, _TimedAction) for one in given):
        raise BadMessage(f"{shown(given)}, not a list of TimedAction")
    rows = [one.said.get("action") for one in given]
    if not all(isinstance(row, np.ndarray) for row in rows) or len({row.shape for row in rows if row is not None}) != 1:
        raise BadMessage("actions that are no rows of as many numbers")
    first = given[0].said.get("timestep")
    return first if type(first) is int else -1, np.array(rows)


class _TimedAction:
    """Stands for LeRobot's."""

    def __setstate__(self, state: Any) -> None:
        self.said: dict[str, Any] = state if isinstance(state, dict) else {}


class _Call:
    """Stands for a function; a pickle can do nothing else to it."""

    __slots__ = ("_function",)

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function

    def __call__(self, *args: Any) -> Any:
        return self._function(*args)

    def __setstate__(self, state: Any) -> None:
        raise BadMessage("a pickle that changes a function")


# The reader in Python: the one in C takes memory for an index that a pickle names, however large it is.
class _Reader(pickle._Unpickler):
    known: Mapping[tuple[str, str], Any] = {}

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) not in self.known:
            raise BadMessage(f"a pickle with the name {shown(f'{module}.{name}')}, which is not loaded")
        return self.known[module, name]


class _Storage(_Reader):
    """Reads what torch writes of a storage: its type and length."""

    known = {("torch", name): dtype for name, dtype in _DTYPES.items()}

    def persistent_load(self, pid: Any) -> Any:
        return pid


def _storage(data: Any) -> np.ndarray[Any, Any]:
    """(n,) the numbers of a storage, as torch has saved them."""
    if not isinstance(data, bytes):
        raise BadMessage("a tensor whose storage is not bytes")
    file = io.BytesIO(data)
    _, _, platform, about, _ = (_Storage(file).load() for _ in range(_PARTS))
    if platform.get("little_endian") is not True:
        raise BadMessage("a tensor of a machine with another order of bytes")
    _, dtype, _, _, count, *_ = about
    if int.from_bytes(file.read(8), "little") != count:
        raise BadMessage("a tensor whose storage has another length than it says")
    return array_of(data[file.tell() :], dtype, (count,))


def _tensor(storage: Any, offset: Any, shape: Any, strides: Any, *more: Any) -> Array:
    """(n,) a row of a storage."""
    if not isinstance(storage, np.ndarray):
        raise BadMessage("a tensor without a storage")
    *ones, count = shape
    stride = strides[-1]
    if set(ones) - {1} or not all(type(n) is int and n >= 0 for n in (offset, count, stride)) or not count * stride:
        raise BadMessage(f"an action of shape {shown(shape)}, not (n,)")
    if offset + (count - 1) * stride >= len(storage):
        raise BadMessage("a tensor that is larger than its storage")
    return storage[offset : offset + (count - 1) * stride + 1 : stride].astype(float)


class _Actions(_Reader):
    """Reads a list of `TimedAction`."""

    known = {
        (HOME, "TimedAction"): _TimedAction,
        ("torch._utils", "_rebuild_tensor_v2"): _Call(_tensor),
        ("torch.storage", "_load_from_bytes"): _Call(_storage),
        ("collections", "OrderedDict"): _Call(lambda *args: {}),
    }
