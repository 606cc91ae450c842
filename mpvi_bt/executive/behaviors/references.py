"""`$name` in the texts of a tree: a parameter of its file, filled in at reading, or a blackboard key of the run."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from mpvi_bt.executive.behaviors.parameters import Value, as_text

_REFERENCE = re.compile(r"\$(?:\$|([a-z][a-z0-9_]*)|\{([a-z][a-z0-9_]*)\})")
_DOLLAR = re.compile(rf"{_REFERENCE.pattern}|\$")


def whole(value: object) -> str | None:
    """The name, if `value` is one reference and nothing else."""
    found = _REFERENCE.fullmatch(value) if isinstance(value, str) else None
    return (found[1] or found[2]) if found else None


def names_in(text: str) -> list[str]:
    """The names that a text refers to, in order."""
    if "$" not in text:
        return []
    return [name for found in _REFERENCE.finditer(text) if (name := found[1] or found[2])]


def fill(value: Any, values: Mapping[str, Value]) -> Any:
    """`value` with the references to `values` in its texts, at any depth, filled in; others stay as they are.

    A text that is one reference becomes the value itself, a number too. What is filled in may itself refer to the
    blackboard; it says the same beside any other text.
    """
    if isinstance(value, dict):
        return {key: fill(inner, values) for key, inner in value.items()}
    if isinstance(value, list):
        return [fill(inner, values) for inner in value]
    if not isinstance(value, str) or "$" not in value:
        return value
    if (name := whole(value)) is not None and name in values:
        return values[name]
    return _REFERENCE.sub(lambda m: _beside(values[n]) if (n := m[1] or m[2]) in values else m.group(), value)


def _beside(value: Value) -> str:
    """A value as a part of a longer text: `$cup` as `${cup}`, and a dollar sign that refers to nothing as `$$`."""
    return _DOLLAR.sub(lambda m: f"${{{m[1] or m[2]}}}" if m[1] or m[2] else "$$", as_text(value))


def resolve(text: str, values: Mapping[str, Value]) -> str:
    """The text for use: every reference filled in, `$$` a dollar sign.

    Raises:
        KeyError: A name has no value.
    """
    if "$" not in text:
        return text
    return _REFERENCE.sub(lambda m: as_text(values[n]) if (n := m[1] or m[2]) else "$", text)


def escaped(text: str) -> str:
    """The text as a tree has to say it, so that it refers to nothing."""
    return text.replace("$", "$$")


def unescaped(text: str) -> str:
    """The text with `$$` as a dollar sign, and references as they are."""
    return _REFERENCE.sub(lambda m: m.group() if m[1] or m[2] else "$", text)
