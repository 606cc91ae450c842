"""BDDL problems: ours (tasks/problems/), or else from the installed `bddl` distribution's data files.

Ours restate what the challenge changed after the last release of the distribution. The package itself is never
imported: that is slow, and scoring with it is wrong (qscore.py). The parser keeps upstream's quirks, because scores
must agree: of a goal only its first formula counts (what stands beside the `and` is dropped), and stray words between
the sections, such as a backslash, mean nothing.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache, cached_property
from importlib import metadata
from pathlib import Path

from mpvi_bt import paths
from mpvi_bt.errors import UnknownName, UserError
from mpvi_bt.goals.formula import All, Exactly, Formula, Literal, Not, Pairs, Some

Expression = str | list["Expression"]

_ACTIVITY = re.compile(r"bddl/activity_definitions/([^/]+)/problem0\.bddl$")
_MAX_CHARS = 200_000
_MAX_DEPTH = 50
AGENT = "agent.n.01"


@dataclass(frozen=True)
class Fact:
    """A literal that the :init section states, or denies."""

    literal: Literal
    positive: bool = True


@dataclass(frozen=True)
class Problem:
    """One BDDL problem.

    Attributes:
        name: Activity name, such as "picking_up_trash".
        objects: Object name to synset, in the order of the file; no wildcards.
        wildcards: Synset to the room in which every further fixture of that kind is meant (`cabinet.n.01_*`).
        init: Facts of the start, without those of the wildcards.
        goal_source: The goal as nested lists, its first formula only.
    """

    name: str
    objects: Mapping[str, str]
    wildcards: Mapping[str, str]
    init: tuple[Fact, ...]
    goal_source: Expression

    def expanded(self, counts: Mapping[str, int]) -> Problem:
        """The problem with wildcards written out.

        Args:
            counts: How many things of a wildcard's synset its room has in all, the named ones included. Fewer than are
                named, or a missing synset, adds none.
        """
        objects, init = dict(self.objects), list(self.init)
        for synset, room in self.wildcards.items():
            named = sum(kind == synset for kind in self.objects.values())
            for number in range(named + 1, counts.get(synset, 0) + 1):
                objects[f"{synset}_{number}"] = synset
                init.append(Fact(Literal("inroom", (f"{synset}_{number}", room))))
        return replace(self, objects=objects, wildcards={}, init=tuple(init))

    @cached_property
    def conditions(self) -> tuple[Formula, ...]:
        """The goal's conditions, grounded over `objects`; all must hold."""
        source = self.goal_source
        parts = source[1:] if isinstance(source, list) and source and source[0] == "and" else [source]
        return tuple(_Grounding(self).formula(part, {}) for part in parts)

    @property
    def goal(self) -> Formula:
        """The whole goal, grounded over `objects`."""
        return All(self.conditions)

    @cached_property
    def rooms(self) -> dict[str, str]:
        """Fixture or floor to the room that :init says it is in."""
        return {f.literal.args[0]: f.literal.args[1] for f in self.init if f.literal.predicate == "inroom"}

    @property
    def agent_support(self) -> str | None:
        """The floor or lawn that the robot starts on, or None if :init does not say."""
        for fact in self.init:
            if self.objects.get(fact.literal.args[0]) == AGENT and fact.literal.predicate == "ontop":
                return fact.literal.args[1]
        return None

    @property
    def agent_room(self) -> str | None:
        """The room that the robot starts in, or None if :init does not say."""
        return None if self.agent_support is None else self.rooms.get(self.agent_support)

    @property
    def future(self) -> frozenset[str]:
        """Objects that do not exist at the start (they come from slicing, cooking)."""
        return frozenset(f.literal.args[0] for f in self.init if f.literal.predicate == "future")

    @property
    def movables(self) -> tuple[str, ...]:
        """Objects that an instance places: all but fixtures, floors, the robot and what does not exist yet."""
        return tuple(o for o, s in self.objects.items() if s != AGENT and o not in self.rooms and o not in self.future)


def activities() -> dict[str, Path]:
    """Every activity and its problem file: a root's tasks/problems/*.bddl, or else the `bddl` distribution's.

    Raises:
        UserError: The distribution is not installed; or as `paths.roots`.
    """
    known = dict(_distributed())
    for root in reversed(paths.roots()):  # the first root's wins
        known.update((file.stem, file) for file in sorted((root / "tasks" / "problems").glob("*.bddl")))
    return known


@cache
def _distributed() -> dict[str, Path]:
    """The problem files of the `bddl` distribution. Listing its thousands of files takes a tenth of a second."""
    try:
        distribution = metadata.distribution("bddl")
    except metadata.PackageNotFoundError:
        raise UserError("the distribution 'bddl', which holds the goals, is not installed: pip install bddl") from None
    found = ((_ACTIVITY.search(str(file)), file) for file in distribution.files or ())
    return {match[1]: Path(str(distribution.locate_file(file))) for match, file in found if match}


def load_problem(activity: str) -> Problem:
    """Read an activity's problem. Raises UnknownName, or UserError if the file is no BDDL."""
    known = activities()
    if activity not in known:
        raise UnknownName("activity", activity, known)
    return parse_problem(known[activity].read_text(encoding="utf-8"), activity)


def parse_problem(text: str, name: str) -> Problem:
    """Parse the text of a BDDL problem. Raises UserError naming the activity and the line."""
    define = next((e for e in _expressions(text, name) if isinstance(e, list) and e[:1] == ["define"]), None)
    if define is None:
        raise UserError(f"{name}: no (define ...) in the problem")
    sections: dict[str, list[Expression]] = {}
    for part in define:
        if isinstance(part, list) and part and isinstance(part[0], str):
            sections[part[0]] = part[1:]
    missing = [s for s in (":objects", ":init", ":goal") if s not in sections]
    if missing or not sections[":goal"]:
        raise UserError(f"{name}: the problem has no {', '.join(missing) or ':goal formula'}")
    objects, starred = _objects(sections[":objects"], name)
    facts = [_fact(item, name) for item in sections[":init"]]
    wildcards = dict.fromkeys(starred, "")
    for fact in facts:
        synset = fact.literal.args[0].removesuffix("_*")
        if fact.literal.predicate == "inroom" and synset in wildcards and fact.literal.args[0].endswith("_*"):
            wildcards[synset] = fact.literal.args[1]
    for fact in facts:
        if (thing := fact.literal.args[0]) not in objects and thing.removesuffix("_*") not in starred:
            raise UnknownName("object", thing, objects, where=f"{name}: :init")
    init = tuple(f for f in facts if not any(a.endswith("_*") for a in f.literal.args))
    problem = Problem(name, objects, wildcards, init, sections[":goal"][0])
    _ = problem.conditions  # grounding finds unknown names now, not at the end of an episode
    return problem


def _expressions(text: str, name: str) -> list[Expression]:
    """Nested lists of the words between parentheses."""
    if len(text) > _MAX_CHARS:
        raise UserError(f"{name}: the problem has {len(text)} characters, more than {_MAX_CHARS}")
    stack: list[list[Expression]] = [[]]
    for number, line in enumerate(text.splitlines(), 1):
        for token in re.findall(r"[()]|[^\s()]+", line.split(";")[0]):
            if token == "(":
                stack.append([])
            elif token != ")":
                stack[-1].append(token.lower() if token.startswith(":") else token)
            elif len(stack) == 1:
                raise UserError(f"{name}:{number}: ')' closes nothing")
            else:
                done = stack.pop()
                stack[-1].append(done)
            if len(stack) > _MAX_DEPTH:
                raise UserError(f"{name}:{number}: parentheses nest deeper than {_MAX_DEPTH}")
    if len(stack) > 1:
        raise UserError(f"{name}: {len(stack) - 1} '(' without ')'")
    return stack[0]


def _objects(words: list[Expression], name: str) -> tuple[dict[str, str], list[str]]:
    """Object to synset, and the synsets that have a wildcard."""
    objects: dict[str, str] = {}
    starred: list[str] = []
    waiting: list[str] = []
    following = iter(words)
    for word in following:
        if not isinstance(word, str):
            raise UserError(f"{name}: :objects wants 'name ... - synset', not a list")
        if word != "-":
            waiting.append(word)
            continue
        synset = next(following, None)
        if not isinstance(synset, str):
            raise UserError(f"{name}: :objects ends after '-'")
        for item in waiting:
            if item.endswith("_*"):
                starred.append(synset)
            elif item in objects:
                raise UserError(f"{name}: object {item!r} is declared twice")
            else:
                objects[item] = synset
        waiting = []
    if waiting:
        raise UserError(f"{name}: objects without a synset: {', '.join(waiting)}")
    return objects, starred


def _fact(item: Expression, name: str) -> Fact:
    positive = True
    if isinstance(item, list) and len(item) == 2 and item[0] == "not":
        positive, item = False, item[1]
    if not isinstance(item, list) or len(item) < 2 or not all(isinstance(word, str) for word in item):
        raise UserError(f"{name}: {_source(item)!r} in :init is no (predicate object ...)")
    words = [str(word) for word in item]
    return Fact(Literal(words[0], tuple(words[1:])), positive)


class _Grounding:
    """Writes a goal's quantifiers out over the objects."""

    def __init__(self, problem: Problem) -> None:
        self.name, self.objects = problem.name, problem.objects
        self.synsets = Counter(problem.objects.values())

    def formula(self, source: Expression, names: Mapping[str, str]) -> Formula:
        """The formula of `source`, with variables named by `names`."""
        match source:
            case ["not", child]:
                return Not(self.formula(child, names))
            case ["and", *children]:
                return All(tuple(self.formula(child, names) for child in children))
            case ["or", *children]:
                return Some(tuple(self.formula(child, names) for child in children))
            case ["imply", premise, conclusion]:
                return Some((Not(self.formula(premise, names)), self.formula(conclusion, names)))
            case ["forall", over, body]:
                return All(self._each(over, body, names))
            case ["exists", over, body]:
                return Some(self._each(over, body, names), f"some {self._range(over)[1]}: {_source(body, names)}")
            case ["forn", [count], over, body]:
                text = f"exactly {count} {self._range(over)[1]}: {_source(body, names)}"
                return Exactly(self._count(count), self._each(over, body, names), text)
            case ["forpairs", first, second, body]:
                rows = self._table(first, second, body, names)
                return Pairs(min(len(rows), len(rows[0])), rows, f"in pairs: {_source(body, names)}")
            case ["fornpairs", [count], first, second, body]:
                rows = self._table(first, second, body, names)
                return Pairs(self._count(count), rows, f"in {count} pairs: {_source(body, names)}")
            case [str(predicate), *words] if words and all(isinstance(word, str) for word in words):
                return Literal(predicate, tuple(self._object(str(word), names) for word in words))
        raise UserError(f"{self.name}: {_source(source)!r} in :goal is no formula")

    def _each(self, over: Expression, body: Expression, names: Mapping[str, str]) -> tuple[Formula, ...]:
        variable, synset = self._range(over)
        return tuple(self.formula(body, {**names, variable: thing}) for thing in self._things(synset))

    def _table(
        self, first: Expression, second: Expression, body: Expression, names: Mapping[str, str]
    ) -> tuple[tuple[Formula, ...], ...]:
        (row, row_kind), (column, column_kind) = self._range(first), self._range(second)
        return tuple(
            tuple(self.formula(body, {**names, row: a, column: b}) for b in self._things(column_kind) if a != b)
            for a in self._things(row_kind)
        )

    def _range(self, over: Expression) -> tuple[str, str]:
        match over:
            case [str(variable), "-", str(synset)] if synset in self.synsets:
                return variable.lstrip("?"), synset
            case [str(_), "-", str(synset)]:
                raise UnknownName("synset", synset, self.synsets, where=f"{self.name}: :goal")
        raise UserError(f"{self.name}: {_source(over)!r} in :goal is no (?variable - synset)")

    def _things(self, synset: str) -> Iterator[str]:
        return (thing for thing, kind in self.objects.items() if kind == synset)

    def _object(self, word: str, names: Mapping[str, str]) -> str:
        word = word.lstrip("?")
        if word in names:
            return names[word]
        if word not in self.objects:
            raise UnknownName("object", word, self.objects, where=f"{self.name}: :goal")
        return word

    def _count(self, word: Expression) -> int:
        if not isinstance(word, str) or not word.isdigit():
            raise UserError(f"{self.name}: {_source(word)!r} in :goal is no whole number")
        return int(word)


def _source(expression: Expression, names: Mapping[str, str] | None = None) -> str:
    """The expression as written, without question marks, and with the variables that `names` binds replaced."""
    if isinstance(expression, str):
        word = expression.lstrip("?")
        return (names or {}).get(word, word)
    return f"({' '.join(_source(part, names) for part in expression)})"
