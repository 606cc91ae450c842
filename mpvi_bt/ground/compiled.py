"""Array loops compiled by numba, with a cache beside their file or, if that is read-only, in the user's cache."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any


@dataclass
class Compiling:
    """What compiling took in this process: some 20 s at the first run on a machine, then nothing.

    Attributes:
        seconds: Wall time so far [s].
        told: Is called once, when the first loop begins to be compiled; None: nobody is told.
    """

    seconds: float = 0.0
    told: Callable[[], None] | None = None

    def clock(self) -> float:
        """A monotonic clock [s] for measurements; it stands still during compilation."""
        return time.perf_counter() - self.seconds


compiling = Compiling()


@cache
def _listen() -> None:
    """Have numba say when it compiles."""
    from numba.core import event

    register: Any = event.register  # has no types

    class Listener(event.Listener):
        """Counts what the outermost of nested compilations takes."""

        def __init__(self) -> None:
            self._depth, self._began = 0, 0.0

        def on_start(self, event: object) -> None:
            if self._depth == 0:
                self._began = time.perf_counter()
                if compiling.told is not None:
                    told, compiling.told = compiling.told, None
                    told()
            self._depth += 1

        def on_end(self, event: object) -> None:
            self._depth -= 1
            if self._depth == 0:
                compiling.seconds += time.perf_counter() - self._began

    register("numba:compile", Listener())


def compiled(function: Any, *signatures: Any) -> Any:
    """The function as numba compiles it: for these types of arguments at once, without any on its first call.

    Never a ufunc of numba's: its loop and its wrapper are kept in two files, and two processes that compile at the
    same time leave a pair that crashes every later process.
    """
    import numba

    _listen()
    types = list(signatures) or None
    try:
        return numba.njit(types, cache=True, error_model="numpy")(function)
    except RuntimeError:  # no folder that can be written: compile anew in each process
        return numba.njit(types, error_model="numpy")(function)


def compiled_later(function: Callable[..., Any]) -> Callable[..., Any]:
    """The same without loading numba before the first call; it takes positional arguments only."""
    kernel = cache(lambda: compiled(function))
    return lambda *arguments: kernel()(*arguments)
