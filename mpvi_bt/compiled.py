"""Loops over arrays, compiled by numba and kept beside their file or, where that is read-only, in the user's cache."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any


def compiled(function: Any, *signatures: Any) -> Any:
    """The function as numba compiles it: for these types of arguments at once, without any on its first call.

    Never a ufunc of numba's: its loop and its wrapper are kept in two files, and two processes that compile at the
    same time leave a pair that crashes every later process.
    """
    import numba

    types = list(signatures) or None
    try:
        return numba.njit(types, cache=True, error_model="numpy")(function)
    except RuntimeError:  # no folder that can be written: compile anew in each process
        return numba.njit(types, error_model="numpy")(function)


def compiled_later(function: Callable[..., Any]) -> Callable[..., Any]:
    """The same without loading numba before the first call; it takes positional arguments only."""
    kernel = cache(lambda: compiled(function))
    return lambda *arguments: kernel()(*arguments)
