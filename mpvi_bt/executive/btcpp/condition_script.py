"""Conditions in BehaviorTree.CPP's script, such as "cups > 2 && !done", as tests of keys.

The grammar is that of its `script_parser.cpp`: "||" binds weakest, then "&&", comparisons, which may be chained, and
"!". What computes has no equal here.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Any

from mpvi_bt.executive.behaviors.parameters import Value
from mpvi_bt.executive.btcpp.script import LITERAL, literal_value

_TOKEN = re.compile(rf"\s*(?:({LITERAL})|(&&|\|\||[=!<>]=|[<>!()]))")
_FIELDS = {
    "==": ("equals",),
    "!=": ("not_equals",),
    ">=": ("at_least",),
    "<=": ("at_most",),
    ">": ("at_least", "not_equals"),
    "<": ("at_most", "not_equals"),
}
_NOT = {"==": "!=", "!=": "==", ">=": "<", "<": ">=", "<=": ">", ">": "<="}
_TURNED = {"==": "==", "!=": "!=", ">=": "<=", "<=": ">=", ">": "<", "<": ">"}
MAX_DEPTH = 30  # Our choice: of parentheses and "!"; a person's script has three


@dataclass
class ScriptTest:
    """What a script asks.

    Attributes:
        test: The parameters of a test; {} of a condition with parts.
        every: Whether all of the parts must hold, or one.
        parts: Other conditions.
        bare: Keys that stand alone, such as "done": they must be true.
    """

    test: dict[str, Any] = field(default_factory=dict)
    every: bool = True
    parts: list[ScriptTest] = field(default_factory=list)
    bare: list[str] = field(default_factory=list)


def read_condition(code: str) -> ScriptTest | None:
    """What a script asks; None if it does anything else."""
    parser = _ConditionParser(code)
    try:
        found = parser.either(False, 0)
    except ValueError:
        return None
    found.bare = parser.bare
    return found if parser.token == "" else None


class _ConditionParser:
    """Reads a condition token by token; ValueError if it is none. With `no`, its contrary is meant."""

    def __init__(self, code: str) -> None:
        self.code, self.at, self.token, self.literal = code, 0, "", False
        self.bare: list[str] = []
        self.next()

    def next(self) -> str:
        """The token at hand; then the next one is."""
        token = self.token
        found = _TOKEN.match(self.code, self.at)
        if found is None and self.code[self.at :].strip():
            raise ValueError("no token")
        self.at = found.end() if found else len(self.code)
        self.token, self.literal = ((found[1] or found[2]), found[1] is not None) if found else ("", False)
        return token

    def either(self, no: bool, depth: int) -> ScriptTest:
        parts = [self.both(no, depth)]
        while self.token == "||":
            self.next()
            parts.append(self.both(no, depth))
        return _joined(parts, every=no)

    def both(self, no: bool, depth: int) -> ScriptTest:
        parts = [self.comparison(no, depth)]
        while self.token == "&&":
            self.next()
            parts.append(self.comparison(no, depth))
        return _joined(parts, every=not no)

    def comparison(self, no: bool, depth: int) -> ScriptTest:
        if depth > MAX_DEPTH:
            raise ValueError("too deep")
        if self.token == "!":
            self.next()
            return self.prefix(not no, depth + 1)
        if self.token == "(":
            return self.prefix(no, depth)
        left = self.operand()
        if self.token not in _FIELDS:
            return self.alone(left, no)
        parts = []
        while self.token in _FIELDS:
            sign = self.next()
            right = self.operand()
            parts.append(_test(left, _NOT[sign] if no else sign, right))
            left = right
        return _joined(parts, every=not no)

    def prefix(self, no: bool, depth: int) -> ScriptTest:
        """What stands behind a "!", or in parentheses; neither may be compared."""
        if self.token == "!":
            return self.comparison(no, depth)
        if self.token != "(":
            return self.alone(self.operand(), no)
        self.next()
        found = self.either(no, depth + 1)
        if self.next() != ")" or self.token in _FIELDS:
            raise ValueError("no ')'")
        return found

    def operand(self) -> str:
        if not self.literal:
            raise ValueError("no operand")
        return self.next()

    def alone(self, key: str, no: bool) -> ScriptTest:
        if not _is_key(key) or self.token in _FIELDS:
            raise ValueError("no key")
        self.bare.append(key)
        return ScriptTest({"key": key, "equals": not no})


def _test(left: str, sign: str, right: str) -> ScriptTest:
    if not _is_key(left):
        left, sign, right = right, _TURNED[sign], left
    if not _is_key(left):
        raise ValueError("no key")
    value: Value = literal_value(right)
    if sign not in ("==", "!=") and (isinstance(value, str | bool)):
        raise ValueError("no number")
    return ScriptTest({"key": left, **dict.fromkeys(_FIELDS[sign], value)})


def _is_key(literal: str) -> bool:
    return literal[0].isalpha() and literal not in ("true", "false")


def _joined(parts: list[ScriptTest], every: bool) -> ScriptTest:
    """Several conditions as one; tests of one key that must all hold are one test."""
    if len(parts) == 1:
        return parts[0]
    found: list[ScriptTest] = []
    for part in parts:
        same = [one for one in found if every and part.test and _together(one.test, part.test)]
        if same:
            same[-1].test |= part.test
        else:
            found.append(part)
    return found[0] if len(found) == 1 else ScriptTest(every=every, parts=found)


def _together(one: dict[str, Any], other: dict[str, Any]) -> bool:
    """Whether two tests can be one: of the same key, without asking for the same thing twice."""
    return one.get("key") == other["key"] and one.keys() & other.keys() == {"key"}
