"""BehaviorTree.CPP's scripts, as far as `set`, `test` and `condition` need them, both ways.

Their script throws where a key has no value or holds another type, and takes 1 and 1.0000001 for equal. So a script is
written only for keys that have a value from the start (the tree's `blackboard:`) and keep its type, and equality only
of texts, truth values and whole numbers; otherwise the node is one of ours, and does what it does here.
"""

from __future__ import annotations

import re
from typing import Any

from mpvi_bt.executive.behaviors import references
from mpvi_bt.executive.behaviors.parameters import Assignment, Comparison, Value
from mpvi_bt.executive.btcpp.mapping import is_pointer, number_text
from mpvi_bt.executive.tree.spec import TreeSpec

Type = str  # "boolean", "integer", "number" or "text"

_KEYWORDS = ("true", "false")
_SIGNS = {"equals": "==", "not_equals": "!=", "at_least": ">=", "at_most": "<="}
LITERAL = r"-?\s*[0-9]+(?:\.[0-9]+)?(?:[eE][-+]?[0-9]+)?|'[^']*'|[a-z][a-z0-9_]*"
_STATEMENT = re.compile(rf"\s*([a-z][a-z0-9_]*)\s*(:=|=|\+=|-=)\s*({LITERAL})\s*(?:;\s*|$)")
_TEXT = re.compile("'[^']*'")
_IDENTIFIER = re.compile(r"(?<![\w@])[A-Za-z_@]\w*")
_SET = re.compile(rf"({_IDENTIFIER.pattern})\s*(?::=|[-+*/]?=(?!=))")


class KeyValues:
    """What the keys hold, as far as the tree tells.

    Attributes:
        types: Of keys that have a value from the start and never one of another type.
    """

    def __init__(self, tree: TreeSpec) -> None:
        self.types: dict[str, Type] = {
            key: _type(value) for key, value in tree.blackboard.items() if key not in _KEYWORDS
        }
        writers = [placed.spec for placed in tree.nodes if placed.spec.type.writes]
        before: dict[str, Type] = {}
        while before != self.types:  # a key may be set from one that turns out to change its type
            before = dict(self.types)
            for spec in writers:
                given = spec.parameters if isinstance(spec.parameters, Assignment) else None
                for name in spec.type.writes:
                    self._write(getattr(spec.parameters, name), self._type_set(given) if given else None)

    def type(self, value: Value) -> Type | None:
        """Of a value; of the key's, if it is a reference."""
        if isinstance(value, str) and "$" in value:
            return self.types.get(references.whole(value) or "")
        return _type(value)

    def _type_set(self, given: Assignment) -> Type | None:
        if given.add is None:
            return None if given.value is None else self.type(given.value)
        return _type(given.add)

    def _write(self, key: str, kind: Type | None) -> None:
        joined = _joined(self.types[key], kind) if key in self.types else None
        if joined is None:
            self.types.pop(key, None)
        else:
            self.types[key] = joined


def comparison_code(given: Comparison, board: KeyValues) -> str | None:
    """The script of a comparison, such as "cups >= 3"; None if none does the same."""
    held = board.types.get(given.key)
    parts = []
    for name, sign in _SIGNS.items():
        wanted = getattr(given, name)
        if wanted is None:
            continue
        ordered = name in ("at_least", "at_most")
        if (ordered and held not in ("integer", "number")) or (not ordered and held in (None, "number")):
            return None
        if not ordered and board.type(wanted) != held:
            return None
        literal = _literal(wanted)
        if literal is None:
            return None
        parts.append(f"{given.key} {sign} {literal}")
    return " && ".join(parts) or None


def assignment(given: Assignment, board: KeyValues) -> tuple[str, dict[str, str]] | None:
    """Their node that does an assignment, and its ports; None if none does the same."""
    held = board.types.get(given.key)
    if held is None:
        return None
    if given.add is not None:
        sign = "-" if given.add < 0 else "+"
        return "Script", {"code": f"{given.key} {sign}= {number_text(abs(given.add))}"}
    if isinstance(given.value, str) and "$" in given.value:
        name = references.whole(given.value)
        return ("SetBlackboard", {"value": f"{{{name}}}", "output_key": given.key}) if name else None
    assert given.value is not None  # the model sees to that
    return first_value(given.key, given.value, held)


def first_value(key: str, value: Value, held: Type | None) -> tuple[str, dict[str, str]] | None:
    """BehaviorTree.CPP's node to set a key to a literal value, a dollar sign too; None if there is none."""
    if isinstance(value, str):
        return None if is_pointer(value) else ("SetBlackboard", {"value": value, "output_key": key})
    # 0.0, not 0: else the entry would be one of whole numbers for good
    literal = repr(float(value)) if held == "number" else number_text(value)
    return "Script", {"code": f"{key} := {literal}"}


def read_assignments(code: str) -> list[dict[str, Any]] | None:
    """The parameters of the assignments that a script makes; None if it does anything else."""
    found: list[dict[str, Any]] = []
    at = 0
    while match := _STATEMENT.match(code, at):
        key, sign, literal = match.groups()
        value = literal_value(literal)
        if sign in (":=", "="):
            found.append({"key": key, "value": value})
        elif isinstance(value, int | float) and not isinstance(value, bool):
            found.append({"key": key, "add": -value if sign == "-=" else value})
        else:
            return None
        at = match.end()
    return found if found and at == len(code) else None


def keys_of(code: str) -> set[str]:
    """The keys that a script names."""
    return {name for name in _IDENTIFIER.findall(_TEXT.sub("", code)) if name not in _KEYWORDS}


def keys_set(code: str) -> set[str]:
    """The keys that a script sets."""
    return set(_SET.findall(_TEXT.sub("", code)))


def escaped(text: str) -> str:
    """A text of theirs, in which a dollar sign means nothing, as one of ours."""
    return text.replace("$", "$$") if references.names_in(text) or "$$" in text else text


def _literal(value: Value) -> str | None:
    if not isinstance(value, str):
        return number_text(value)
    if name := references.whole(value):
        return name
    return None if "'" in value or "$" in value else f"'{value}'"


def literal_value(literal: str) -> Value:
    """A number, a truth value, a text in quotes, or a key as a reference."""
    if literal in _KEYWORDS:
        return literal == "true"
    if literal[0] == "'":
        return escaped(literal[1:-1])
    if literal[0].isalpha():
        return f"${literal}"
    number = literal.replace(" ", "")
    return int(number) if number.lstrip("-").isdigit() else float(number)


def _type(value: Value) -> Type:
    if isinstance(value, bool):
        return "boolean"
    if isinstance(value, str):
        return "text"
    return "integer" if float(value).is_integer() and abs(value) < 2**53 else "number"


def _joined(one: Type, other: Type | None) -> Type | None:
    """The type of what may be of either."""
    if one == other:
        return one
    return "number" if {one, other} == {"integer", "number"} else None
