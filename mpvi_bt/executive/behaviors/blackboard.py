"""References to blackboard keys in parameters, and the types of their values."""

from __future__ import annotations

from collections.abc import Mapping

from mpvi_bt.executive.behaviors.parameters import Value, as_text
from mpvi_bt.executive.behaviors.references import resolve, whole

Board = Mapping[str, Value]


class NoValue(Exception):
    """A parameter refers to a key without a value; in the tick of a leaf, the leaf fails."""

    def __init__(self, key: str) -> None:
        self.key = key
        super().__init__(f"the blackboard has no value for {key!r}")


def text_of(text: str, board: Board) -> str:
    """A text with its references to keys filled in. Raises NoValue."""
    try:
        return resolve(text, board)
    except KeyError as missing:
        raise NoValue(missing.args[0]) from None


def value_of(value: Value, board: Board) -> Value:
    """As `text_of`, but a text that is only a reference becomes the key's value, also a number. Raises NoValue."""
    if not isinstance(value, str) or "$" not in value:
        return value
    key = whole(value)
    if key is None:
        return text_of(value, board)
    if key not in board:
        raise NoValue(key)
    return board[key]


class Expectation:
    """A key, and the expected value: all given conditions must hold; with none, any value will do.

    Args:
        key: Of the blackboard.
        equals, not_equals: true, 1 and "1" are three different values; 1 and 1.0 are one.
        at_least, at_most: Of numbers only.
    """

    def __init__(
        self,
        key: str,
        equals: Value | None = None,
        not_equals: Value | None = None,
        at_least: float | None = None,
        at_most: float | None = None,
    ) -> None:
        self.key = key
        wanted = (("=", equals), ("!=", not_equals), (">=", at_least), ("<=", at_most))
        self._wanted = [(sign, value) for sign, value in wanted if value is not None]

    def unmet(self, board: Board) -> tuple[str, str] | None:
        """Why it does not hold, or None if it does.

        Returns:
            A reason code and evidence such as "cups is 1, not >= 3". The code is "" if the value is simply another
            one, "no_value" or "wrong_type" if there is nothing to compare.
        """
        value = board.get(self.key)
        if value is None:
            return "no_value" if self._wanted else "", f"{self.key} has no value"
        for sign, wanted in self._wanted:
            try:
                other = value_of(wanted, board)
            except NoValue as missing:
                return "no_value", str(missing)
            if sign in ("=", "!="):
                met = _same(value, other) == (sign == "=")
            elif isinstance(value, str | bool):
                return "wrong_type", f"{self.key} is {_shown(value)}, not a number that could be {sign} {_shown(other)}"
            else:
                met = value >= other if sign == ">=" else value <= other  # type: ignore[operator]
            if not met:
                return "", f"{self.key} is {_shown(value)}, not {sign.lstrip('=')} {_shown(other)}".replace("  ", " ")
        return None


def _same(value: Value, other: Value) -> bool:
    return value == other and isinstance(value, bool) == isinstance(other, bool)


def _shown(value: Value) -> str:
    return f'"{value}"' if isinstance(value, str) else as_text(value)
