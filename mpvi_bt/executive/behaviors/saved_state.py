"""Checked reading of a node's saved state: the file may be damaged, or written by hand."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def count(state: Mapping[str, Any], key: str, below: int = 10**9) -> int:
    """The whole number at a key, 0 if there is none. Raises ValueError if it is none, negative or not below a limit."""
    value = state.get(key, 0)
    if type(value) is not int or not 0 <= value < below:
        raise ValueError(f"{key!r} should be a whole number from 0 to {below - 1}, not {value!r:.40}")
    return value


def number(state: Mapping[str, Any], key: str, least: float = 0.0) -> float:
    """The number at a key, 0 if there is none. Raises ValueError if it is none, not finite or too small."""
    value = state.get(key, 0.0)
    if isinstance(value, bool) or not isinstance(value, int | float) or not least <= value < _MOST:
        raise ValueError(f"{key!r} should be a number{' from 0' if least == 0 else ''}, not {value!r:.40}")
    return float(value)


_MOST = 1e15
