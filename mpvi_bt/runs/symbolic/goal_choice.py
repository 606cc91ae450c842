"""Which literals of a goal a plan brings about: of alternatives, those that cost least."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

from mpvi_bt.house.goals.formula import All, Exactly, Formula, Literal, Not, Pairs, Some

Wanted = dict[Literal, bool]
Cost = Callable[[Literal, bool], float]

IMPOSSIBLE = 1e6
_PLACED = ("inside", "ontop", "touching")
_SAME = {"filled": "contains", "contains": "filled"}  # what is not to be so cannot be so by the other word either


def choose_literals(formula: Formula, cost: Cost, chosen: Mapping[Literal, bool] | None = None) -> Wanted:
    """The literals that make a formula true, and whether each is to be true, the cheapest alternatives.

    Our choice: alternatives are weighed one by one, in the order of the goal, beside what is chosen already. A thing
    lies in one place only, so a choice that contradicts an earlier one is impossible.

    Args:
        formula: A goal, grounded.
        cost: Of a literal that is to be true, or false; 0 for one that is so from the start.
        chosen: What is wanted already.
    """
    wanted: Wanted = dict(chosen or {})
    _add(formula, True, cost, wanted)
    return wanted


def _add(formula: Formula, positive: bool, cost: Cost, wanted: Wanted) -> float:
    """Want a formula to be true, or false. Returns what that costs."""
    match formula:
        case Literal():
            return _literal(formula, positive, cost, wanted)
        case Not(child):
            return _add(child, not positive, cost, wanted)
        case All(children) | Some(children) if isinstance(formula, All) == positive:
            return sum(_add(child, positive, cost, wanted) for child in children)
        case All(children) | Some(children):
            return _cheapest([(child, positive) for child in children], cost, wanted)
        case Exactly(count, children):
            left = list(children)
            total = sum(_take(left, cost, wanted) for _ in range(count))
            return total + sum(_add(child, False, cost, wanted) for child in left)
        case Pairs(count, rows):
            return _pairs(count, [list(row) for row in rows], cost, wanted)


def _literal(literal: Literal, positive: bool, cost: Cost, wanted: Wanted) -> float:
    if wanted.get(literal) == positive:
        return 0.0
    other = Literal(_SAME.get(literal.predicate, ""), literal.args)
    clash = literal in wanted or wanted.get(other, positive) != positive or (positive and _elsewhere(literal, wanted))
    wanted.setdefault(literal, positive)
    return IMPOSSIBLE if clash else cost(literal, positive) + _crowding(literal, positive, wanted)


def _elsewhere(literal: Literal, wanted: Wanted) -> bool:
    """Whether the thing is wanted at another place."""
    thing = literal.args[0]
    return literal.predicate in _PLACED and any(
        so and other.predicate == literal.predicate and other.args[0] == thing and other != literal
        for other, so in wanted.items()
    )


def _crowding(literal: Literal, positive: bool, wanted: Wanted) -> float:
    """What makes a container that is to take something else already a worse choice, for things of another kind."""
    if not positive or literal.predicate != "inside":
        return 0.0
    kind = literal.args[0].rpartition("_")[0]
    others = {w.args[0].rpartition("_")[0] for w, so in wanted.items() if so and w.args[1:] == literal.args[1:]}
    return 0.25 * len(others - {kind})


def _cheapest(alternatives: Iterable[tuple[Formula, bool]], cost: Cost, wanted: Wanted) -> float:
    tried: list[tuple[float, int, Wanted]] = []
    for child, positive in alternatives:
        copy = dict(wanted)
        tried.append((_add(child, positive, cost, copy), len(tried), copy))
    if not tried:
        return IMPOSSIBLE
    total, _, copy = min(tried, key=lambda t: t[:2])
    wanted.update(copy)
    return total


def _take(left: list[Formula], cost: Cost, wanted: Wanted) -> float:
    """Want the cheapest of some formulas, and take it off the list."""
    trials = [(_add(child, True, cost, dict(wanted)), i) for i, child in enumerate(left)]
    if not trials:
        return IMPOSSIBLE
    return _add(left.pop(min(trials)[1]), True, cost, wanted)


def _pairs(count: int, rows: list[list[Formula]], cost: Cost, wanted: Wanted) -> float:
    """Pair rows off with columns, the cheapest pair first."""
    total, free = 0.0, set(range(len(rows[0]) if rows else 0))
    undone = set(range(len(rows)))
    for _ in range(count):
        trials = [(_add(rows[r][c], True, cost, dict(wanted)), r, c) for r in sorted(undone) for c in sorted(free)]
        if not trials:
            return total + IMPOSSIBLE
        _, row, column = min(trials)
        total += _add(rows[row][column], True, cost, wanted)
        undone.discard(row)
        free.discard(column)
    return total
