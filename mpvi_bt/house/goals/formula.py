"""Grounded goal formulas: literals over named objects, joined by BDDL's connectives.

Quantifiers are gone by the time a formula is here: `problem.py` writes them out over the problem's objects.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Literal:
    """One predicate of named things, such as inside(can__of__soda.n.01_1, ashcan.n.01_1)."""

    predicate: str
    args: tuple[str, ...]

    def __str__(self) -> str:
        return f"{self.predicate}({', '.join(self.args)})"


# Predicates of a thing and a substance, which is no thing itself: dust.n.01_1 stands for all dust.
OF_SUBSTANCE = ("covered", "filled", "contains", "saturated", "insource")


@dataclass(frozen=True)
class Fact:
    """A literal that the :init section of a problem states, or denies."""

    literal: Literal
    positive: bool = True


@dataclass(frozen=True)
class Not:
    """The negation of a formula."""

    child: Formula

    def __str__(self) -> str:
        return f"not {self.child}"


@dataclass(frozen=True)
class All:
    """Every child holds: `and`, `forall`."""

    children: tuple[Formula, ...]
    text: str = field(default="", compare=False)

    def __str__(self) -> str:
        return self.text or " and ".join(map(str, self.children))


@dataclass(frozen=True)
class Some:
    """At least one child holds: `or`, `exists`."""

    children: tuple[Formula, ...]
    text: str = field(default="", compare=False)

    def __str__(self) -> str:
        return self.text or " or ".join(map(str, self.children))


@dataclass(frozen=True)
class Exactly:
    """Exactly `count` children hold: `forn`."""

    count: int
    children: tuple[Formula, ...]
    text: str = field(default="", compare=False)

    def __str__(self) -> str:
        return self.text


@dataclass(frozen=True)
class Pairs:
    """`count` rows are paired off with as many columns: `forpairs`, `fornpairs`.

    BDDL's truth is weaker than a matching: `count` rows hold in some column, and `count` columns in some row. A thing
    is never paired with itself, and where both sides share a category BDDL counts a row's columns by position with
    that thing left out; both quirks are kept so that scores agree with the official evaluator's.
    """

    count: int
    rows: tuple[tuple[Formula, ...], ...]
    text: str = field(default="", compare=False)

    def __str__(self) -> str:
        return self.text


Formula = Literal | Not | All | Some | Exactly | Pairs
Truth = Callable[[Literal], bool]


def holds(formula: Formula, truth: Truth) -> bool:
    """Whether the formula is true, given the truth of each literal."""
    match formula:
        case Literal():
            return truth(formula)
        case Not(child):
            return not holds(child, truth)
        case All(children):
            return all(holds(child, truth) for child in children)
        case Some(children):
            return any(holds(child, truth) for child in children)
        case Exactly(count, children):
            return sum(holds(child, truth) for child in children) == count
        case Pairs(count, rows):
            return _paired([[holds(cell, truth) for cell in row] for row in rows], count)


def can_hold(formula: Formula, possible: Truth) -> bool:
    """Whether the formula can be true in some world; literals that are not `possible` are never true."""
    return _may_be(formula, possible)[0]


def _may_be(formula: Formula, possible: Truth) -> tuple[bool, bool]:
    """Whether the formula may be true, and whether it may be false, each literal for itself."""
    match formula:
        case Literal():
            return possible(formula), True
        case Not(child):
            may_be_true, may_be_false = _may_be(child, possible)
            return may_be_false, may_be_true
        case All(children):
            each = [_may_be(child, possible) for child in children]
            return all(true for true, _ in each), any(false for _, false in each)
        case Some(children):
            each = [_may_be(child, possible) for child in children]
            return any(true for true, _ in each), all(false for _, false in each)
        case Exactly(count, children):
            each = [_may_be(child, possible) for child in children]
            least, most = sum(not false for _, false in each), sum(true for true, _ in each)
            return least <= count <= most, not least == count == most
        case Pairs(count, rows):
            table = [[_may_be(cell, possible) for cell in row] for row in rows]
            might = [[may_be_true for may_be_true, _ in row] for row in table]
            must = [[not may_be_false for _, may_be_false in row] for row in table]
            return _paired(might, count), not _paired(must, count)


def _paired(table: list[list[bool]], count: int) -> bool:
    """`Pairs`, of the truths of its cells."""
    return sum(map(any, table)) >= count and sum(map(any, zip(*table, strict=True))) >= count


def without(formula: Formula, predicates: Collection[str]) -> Formula | None:
    """A formula without the literals of some predicates; None if nothing is left."""
    match formula:
        case Literal(predicate):
            return None if predicate in predicates else formula
        case Not(child):
            return Not(inner) if (inner := without(child, predicates)) is not None else None
        case All(children) | Some(children):
            parts = [part for child in children if (part := without(child, predicates)) is not None]
            return type(formula)(tuple(parts), formula.text) if parts else None
    return None if any(literal.predicate in predicates for literal in literals(formula)) else formula


def literals(formula: Formula) -> Iterator[Literal]:
    """Every literal in the formula, in order, repeats included."""
    return (literal for literal, _ in signed(formula))


def signed(formula: Formula, positive: bool = True) -> Iterator[tuple[Literal, bool]]:
    """Every literal in the formula, in order, repeats included, and whether the formula wants it true."""
    match formula:
        case Literal():
            yield formula, positive
        case Not(child):
            yield from signed(child, not positive)
        case All(children) | Some(children) | Exactly(_, children):
            for child in children:
                yield from signed(child, positive)
        case Pairs(_, rows):
            for row in rows:
                for cell in row:
                    yield from signed(cell, positive)
