"""The q-score, exactly and without listing the ways in which a goal can be reached.

A goal option is one set of literals that makes the goal true: a conjunction takes an option of every child, a
disjunction of any one. BEHAVIOR's q is 1 if the goal is true at the end, else

    max over options of  #(literals false at the start and true at the end) / #(literals of the option).

Options multiply (1.7 million for storing_food), so the official package keeps 20 of them and scores seven of the fifty
tasks too low. We keep, for every part of the formula, only the highest count for each option length: a product of
options adds lengths and counts, a union takes the maximum, pairs are matched by dynamic programming over column sets.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Sequence
from functools import reduce
from typing import Protocol, TypeVar

from mpvi_bt.ground.errors import UserError
from mpvi_bt.house.goals.formula import All, Exactly, Formula, Literal, Not, Pairs, Some, Truth, holds

T = TypeVar("T")
Table = dict[int, int]  # option length -> most credited literals in an option of that length
Options = frozenset[tuple[tuple[Literal, bool], ...]]

MAX_LISTED = 100_000


class Algebra(Protocol[T]):
    """What is kept of a formula's options while they are combined."""

    def literal(self, literal: Literal, positive: bool) -> T:
        """The one option of a literal, or of its negation."""
        ...

    def product(self, parts: Iterable[T]) -> T:
        """An option of every part together."""
        ...

    def union(self, parts: Iterable[T]) -> T:
        """An option of any one part."""
        ...


def fold(formula: Formula, algebra: Algebra[T], positive: bool = True) -> T:
    """Combine the options of a formula (of its negation, unless `positive`).

    Raises:
        UserError: A negated `forn` or `forpairs`, whose options BDDL does not define.
    """
    match formula:
        case Literal():
            return algebra.literal(formula, positive)
        case Not(child):
            return fold(child, algebra, not positive)
        case All(children) | Some(children):
            parts = [fold(child, algebra, positive) for child in children]
            return algebra.product(parts) if isinstance(formula, All) == positive else algebra.union(parts)
        case Exactly() | Pairs() if not positive:
            raise UserError(
                f"the goal negates {str(formula)!r}: only literals, and, or, forall and exists can be negated"
            )
        case Exactly(count, children):
            return _choices([fold(child, algebra) for child in children], count, algebra)
        case Pairs(count, rows):
            cells = [[fold(cell, algebra) for cell in row] for row in rows]
            return _matchings(cells, count, algebra)
        case _:
            raise AssertionError(formula)


def _choices(parts: Sequence[T], count: int, algebra: Algebra[T]) -> T:
    """Union over all ways to choose `count` parts: those of so many of the parts so far, by how many these are."""
    reached = {0: algebra.product(())}
    for part in parts:
        for chosen in range(min(len(reached), count), 0, -1):
            more = algebra.product((reached[chosen - 1], part))
            reached[chosen] = algebra.union((reached[chosen], more)) if chosen in reached else more
    return reached[count] if count in reached else algebra.union(())


def _matchings(cells: Sequence[Sequence[T]], count: int, algebra: Algebra[T]) -> T:
    """Union over all ways to pair `count` rows with as many different columns.

    `reached` maps (columns used, as a bit mask) to the options of the rows so far.
    """
    reached: dict[int, T] = {0: algebra.product(())}
    for row in cells:
        grown: dict[int, list[T]] = {used: [options] for used, options in reached.items()}  # this row left out
        for used, options in reached.items():
            if used.bit_count() == count:
                continue
            for column, cell in enumerate(row):
                if not used >> column & 1:
                    grown.setdefault(used | 1 << column, []).append(algebra.product((options, cell)))
        reached = {used: algebra.union(parts) for used, parts in grown.items()}
    return algebra.union(options for used, options in reached.items() if used.bit_count() == count)


class _Best:
    """Keeps the highest count for each option length."""

    def __init__(self, credit: Callable[[Literal, bool], bool]) -> None:
        self.credit = credit

    def literal(self, literal: Literal, positive: bool) -> Table:
        return {1: int(self.credit(literal, positive))}

    def product(self, parts: Iterable[Table]) -> Table:
        return reduce(self._times, parts, {0: 0})

    def union(self, parts: Iterable[Table]) -> Table:
        best: Table = {}
        for part in parts:
            for length, count in part.items():
                best[length] = max(count, best.get(length, 0))
        return best

    @staticmethod
    def _times(a: Table, b: Table) -> Table:
        out: Table = {}
        for (m, x), (n, y) in itertools.product(a.items(), b.items()):
            out[m + n] = max(x + y, out.get(m + n, 0))
        return out


class _Listed:
    """Keeps every option, those that contradict themselves dropped, as BDDL does."""

    def literal(self, literal: Literal, positive: bool) -> Options:
        return frozenset({((literal, positive),)})

    def product(self, parts: Iterable[Options]) -> Options:
        return reduce(self._times, parts, frozenset({()}))

    def union(self, parts: Iterable[Options]) -> Options:
        return self._bounded(frozenset().union(*parts))

    def _times(self, a: Options, b: Options) -> Options:
        if len(a) * len(b) > MAX_LISTED:
            raise _too_many()
        return frozenset(tuple(sorted(x + y, key=repr)) for x in a for y in b if _consistent(x + y))

    @staticmethod
    def _bounded(options: Options) -> Options:
        if len(options) > MAX_LISTED:
            raise _too_many()
        return options


def _too_many() -> UserError:
    return UserError(f"the goal names a literal both plain and negated and has more than {MAX_LISTED} options")


def _consistent(option: tuple[tuple[Literal, bool], ...]) -> bool:
    return not any((literal, not positive) in option for literal, positive in option)


class _Signs:
    """Notes the signs under which each literal occurs."""

    def __init__(self) -> None:
        self.signs: dict[Literal, set[bool]] = {}

    def literal(self, literal: Literal, positive: bool) -> None:
        self.signs.setdefault(literal, set()).add(positive)

    def product(self, parts: Iterable[None]) -> None:
        list(parts)

    def union(self, parts: Iterable[None]) -> None:
        list(parts)


def best_fraction(goal: Formula, credit: Callable[[Literal, bool], bool]) -> float:
    """Highest share of credited literals over the goal's options, 0..1; 0 if it has none.

    Args:
        goal: The whole goal.
        credit: Whether a literal counts; the second argument is False where the option wants it false.

    Raises:
        UserError: As `fold`; or the goal has a literal under both signs (none of the fifty tasks has) and its options
            are too many to list.
    """
    signs = _Signs()
    fold(goal, signs)
    if all(len(found) == 1 for found in signs.signs.values()):
        table = fold(goal, _Best(credit))
        return max((count / length for length, count in table.items() if length), default=0.0)
    # An option that contradicts itself is none, which a table of lengths cannot tell.
    options = fold(goal, _Listed())
    return max((sum(credit(*signed) for signed in option) / len(option) for option in options if option), default=0.0)


def qscore(goal: Formula, start: Truth, end: Truth) -> float:
    """BEHAVIOR's official q, 0..1: higher is better (its evaluator's TaskMetric, over every option).

    What held at the start earns nothing, but stays in the denominator.
    """
    if holds(goal, end):
        return 1.0
    return best_fraction(goal, lambda literal, positive: start(literal) != positive and end(literal) == positive)


def fraction(goal: Formula, end: Truth) -> float:
    """Share of the literals that hold at the end, in the best option, 0..1: higher is better (Paper, Metrics).

    Unlike the official q it credits what held from the start.
    """
    if holds(goal, end):
        return 1.0
    return best_fraction(goal, lambda literal, positive: end(literal) == positive)
