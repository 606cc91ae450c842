"""Writes a goal's quantifiers out over the objects, and finds what is wrong with the goal on the way."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from mpvi_bt.ground.errors import shown, with_article
from mpvi_bt.house.goals.expressions import CONNECTIVES, Expression, Form, Word, written
from mpvi_bt.house.goals.findings import Findings
from mpvi_bt.house.goals.formula import All, Exactly, Formula, Literal, Not, Pairs, Some
from mpvi_bt.house.goals.vocabulary import ANY, BddlVocabulary

MAX_PARTS = 100_000  # of a goal that is written out
_ANYTHING = "?"  # stands for a variable where there is nothing that it could be, so that what follows is looked at
_NO_NAMES: Mapping[str, str] = {}
NO_LITERAL = Literal("", ("", ""))  # in the place of what is none
Names = Mapping[str, str]

_FORMS = {  # what follows the connective
    "not": "(not formula)",
    "imply": "(imply formula formula)",
    "forall": "(forall (?variable - synset) formula)",
    "exists": "(exists (?variable - synset) formula)",
    "forn": "(forn (2) (?variable - synset) formula)",
    "forpairs": "(forpairs (?variable - synset) (?variable - synset) formula)",
    "fornpairs": "(fornpairs (2) (?variable - synset) (?variable - synset) formula)",
}


class Grounding:
    """Makes formulas of expressions.

    Args:
        objects: Name to synset.
        wildcards: Synsets of which a room may have more than `objects`.
        findings: Take in what is wrong; in its place stands a formula that asks for nothing.
        known: The predicates that there are.
    """

    def __init__(
        self, objects: Mapping[str, str], wildcards: Collection[str], findings: Findings, known: BddlVocabulary = ANY
    ) -> None:
        self.objects, self.wildcards, self.findings, self.known = objects, wildcards, findings, known
        self.synsets = {*objects.values(), *wildcards}
        self.count = 0

    def conditions(self, goal: Expression) -> tuple[Formula, ...]:
        """The conditions of a goal, all of which must hold."""
        formula = self.formula(goal, _NO_NAMES)
        return formula.children if isinstance(formula, All) and goal[:1] == ["and"] else (formula,)

    def formula(self, source: Expression, names: Names) -> Formula:
        """The formula of `source`, with variables named by `names`. Raises FileProblems if it would be too large."""
        self.count += 1
        if self.count > MAX_PARTS:
            self.findings.stop(source.place, "too-large", f"more than {MAX_PARTS} parts, quantifiers written out")
        match source:
            case ["not", child]:
                return Not(self.formula(child, names))
            case ["and" | "or" as joined, *children]:
                if not children:
                    self.findings.problem(source.place, "empty-formula", f"an empty {joined!r}: put formulas into it")
                parts = tuple(self.formula(child, names) for child in children)
                return All(parts) if joined == "and" else Some(parts)
            case ["imply", premise, conclusion]:
                return Some((Not(self.formula(premise, names)), self.formula(conclusion, names)))
            case ["forall", over, body]:
                return All(self._each(over, body, names))
            case ["exists", over, body]:
                text = f"some {self._range(over)[1]}: {written(body, names)}"
                return Some(self._each(over, body, names), text)
            case ["forn", number, over, body]:
                each = self._each(over, body, names)
                count = self._count(number, over)
                text = f"exactly {count} {self._range(over)[1]}: {written(body, names)}"
                return Exactly(count, each, text)
            case ["forpairs", first, second, body]:
                rows = self._table(first, second, body, names)
                return Pairs(min(len(rows), len(rows[0]) if rows else 0), rows, f"in pairs: {written(body, names)}")
            case ["fornpairs", number, first, second, body]:
                count = self._count(number, first, second)
                rows = self._table(first, second, body, names)
                return Pairs(count, rows, f"in {count} pairs: {written(body, names)}")
            case [Word() as head, *_] if head in CONNECTIVES:
                message = f"{_quoted(source)} is no formula: write {_FORMS[head]}"
                self.findings.problem(source.place, "no-formula", message)
                return All(())
        return self.literal(source, names)

    def literal(self, source: Expression, names: Names = _NO_NAMES, starred: bool = False) -> Literal:
        """A predicate of things, or of a thing and a room. `starred`: "shelf.n.01_*" is one of them."""
        predicates = self.known.predicates
        head = source[0] if isinstance(source, Form) and source else None
        if isinstance(head, Word) and predicates is not None and head not in predicates:
            self.findings.unknown(head.place, "predicate", head, (*predicates, *(("not",) if starred else CONNECTIVES)))
            return NO_LITERAL
        words = [word for word in source[1:] if isinstance(word, Word)] if isinstance(source, Form) else []
        if not isinstance(head, Word) or len(words) < max(len(source) - 1, 1):
            self.findings.problem(source.place, "no-formula", f"{_quoted(source)} is no (predicate object ...)")
            return NO_LITERAL
        if predicates is not None and len(words) != predicates[head]:
            one = predicates[head] == 1
            takes = "one object" if one else "a thing and a room" if head == "inroom" else "two objects"
            self.findings.problem(source.place, "arguments", f"{_quoted(source)}: {head} takes {takes}")
        room = words.pop() if head == "inroom" and len(words) == 2 else None
        things = tuple(self._object(word, names, starred) for word in words)
        if room is None:
            return Literal(str(head), things)
        if self.known.rooms is not None and room not in self.known.rooms:
            self.findings.unknown(room.place, "room", room, self.known.rooms)
        return Literal(str(head), (*things, str(room)))

    def _each(self, over: Expression, body: Expression, names: Names) -> tuple[Formula, ...]:
        variable, synset = self._range(over)
        things = self._things(synset)
        if not things:
            self.formula(body, {**names, variable: _ANYTHING})
        return tuple(self.formula(body, {**names, variable: thing}) for thing in things)

    def _table(
        self, first: Expression, second: Expression, body: Expression, names: Names
    ) -> tuple[tuple[Formula, ...], ...]:
        (row, row_kind), (column, column_kind) = self._range(first), self._range(second)
        rows, columns = self._things(row_kind), self._things(column_kind)
        if not (rows and columns):
            self.formula(body, {**names, row: _ANYTHING, column: _ANYTHING})
        return tuple(tuple(self.formula(body, {**names, row: a, column: b}) for b in columns if a != b) for a in rows)

    def _range(self, over: Expression) -> tuple[str, str]:
        """The variable and the synset of a quantifier; "" for one that is not there, or wrong."""
        match over:
            case [Word() as variable, "-", Word() as synset]:
                if synset not in self.synsets:
                    self._unlisted(synset)
                return variable.lstrip("?"), str(synset)
            case _:
                message = f"{_quoted(over)} in :goal is no (?variable - synset), such as (?cup - cup.n.01)"
                self.findings.problem(over.place, "no-range", message)
        return (over[0].lstrip("?") if isinstance(over, Form) and over and isinstance(over[0], Word) else ""), ""

    def _unlisted(self, synset: Word) -> None:
        """Note a synset without objects: a misspelled or a valid one."""
        if synset in (self.known.synsets or ()):
            listed = tuple(sorted(self.synsets))
            message = f"no object is {with_article(synset)}; :objects has {', '.join(listed)}"
            self.findings.problem(synset.place, "unknown-synset", message, known=listed)
        else:
            self.findings.unknown(synset.place, "synset", synset, self.synsets)

    def _object(self, word: Word, names: Names, starred: bool) -> str:
        name = word.lstrip("?")
        if name in names:
            return names[name]
        if name not in self.objects and not (starred and name.removesuffix("_*") in self.wildcards):
            self.findings.unknown(word.place, "object", name, {*self.objects, *names})
        return str(name)

    def _count(self, number: Expression, *over: Expression) -> int:
        """How many there must be, of those that quantifiers range over."""
        match number:
            case [Word() as word] if word.isdecimal() and len(word) < 7:
                count = int(word)
            case _:
                given = number[0] if isinstance(number, Form) and len(number) == 1 else number
                message = f"{_quoted(given)} in :goal is no whole number, which is written (2)"
                self.findings.problem(number.place, "no-number", message)
                return 0
        for one in over:
            synset = self._range(one)[1]
            there = len(self._things(synset))
            if synset in self.synsets and synset not in self.wildcards and count > there:
                message = f"{count} of {synset}, of which :objects has {there}: that can never be"
                self.findings.problem(number.place, "out-of-range", message)
        return count

    def _things(self, synset: str) -> list[str]:
        return [thing for thing, kind in self.objects.items() if kind == synset]


def _quoted(expression: Expression) -> str:
    return shown(written(expression))
