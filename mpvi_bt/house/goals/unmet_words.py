"""The part of a goal that does not hold, in words: "two cans of soda are not in the trash can"."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, replace

from mpvi_bt.ground.errors import with_article
from mpvi_bt.ground.words.phrases import plural
from mpvi_bt.house.goals.formula import All, Exactly, Formula, Literal, Not, Pairs, Some, Truth, holds, literals

_RELATIONS = {
    "inside": "in",
    "contains": "in",
    "ontop": "on",
    "nextto": "next to",
    "attached": "attached to",
    "covered": "covered with",
    "filled": "filled with",
    "saturated": "soaked with",
    "toggled_on": "turned on",
    "on_fire": "on fire",
    "real": "there",
}
_NUMBERS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")


@dataclass(frozen=True)
class _Lack:
    """A literal that is not as the goal wants it.

    Attributes:
        thing: Which thing it is about.
        relation: In words.
        other: The other thing; "" for none.
        wanted: Whether the goal wants it to hold; else it must not hold.
        free: Things that others of their kind may take the place of.
    """

    thing: str
    relation: str
    other: str
    wanted: bool = True
    free: frozenset[str] = frozenset()


class UnmetWords:
    """Words for conditions of a goal that do not hold.

    Args:
        truth: Whether a literal holds.
        noun: What a thing is called, without an article.
        things: All that there are or will be.
    """

    def __init__(self, truth: Truth, noun: Callable[[str], str], things: Collection[str]) -> None:
        self._truth, self._noun = truth, noun
        self._nouns = Counter(map(noun, things))

    def sentences(self, conditions: Iterable[Formula]) -> list[str]:
        """What does not hold; things that lack the same are counted in one sentence."""
        found: dict[tuple[str, str], dict[str, None]] = {}
        lacks = [lack for condition in conditions for lack in self._lacks(condition)]
        missing = {lack.thing for lack in lacks if isinstance(lack, _Lack) and lack.relation == "there" and lack.wanted}
        for lack in lacks:
            if isinstance(lack, str):
                found[lack, ""] = {}
            elif lack.thing in missing and lack.relation != "there":
                continue  # where it is not is plain then
            elif lack.thing in lack.free:
                any_of = f"{'no' if lack.wanted else 'every'} {self._noun(lack.thing)}"
                found[any_of, f"is {self._rest(lack)}"] = {}
            else:
                found.setdefault(("not " if lack.wanted else "", self._rest(lack)), {})[lack.thing] = None
        return [self._sentence(*said, [*things]) for said, things in found.items()]

    def _sentence(self, before: str, after: str, things: Sequence[str]) -> str:
        if not things:
            return f"{before} {after}".strip()
        counted = Counter(map(self._noun, things))
        each = [f"the {n}" if many == self._nouns[n] == 1 else _number(many, n) for n, many in counted.items()]
        joined = " and ".join([", ".join(each[:-1]), each[-1]] if each[1:] else each)
        return f"{joined} {_is(len(things), *counted)} {before}{after}"

    def _lacks(self, formula: Formula) -> list[_Lack | str]:
        """What of a formula does not hold; of several ways to make it hold, what the nearest lacks."""
        if holds(formula, self._truth):
            return []
        if (either := _either(formula)) is not None:
            return [either]
        match formula:
            case Not(Literal() as literal):
                return [replace(_lack(literal), wanted=False)]
            case All(children):
                return [lack for child in children for lack in self._lacks(child)]
            case Some(children) if children:
                return self._nearest(children)
            case Exactly(count, children) if all(each := [_either(child) for child in children]):
                things = {lack.thing for lack in each if lack is not None}
                if each[0] is not None and len(things) == len(each):
                    now, noun = sum(holds(child, self._truth) for child in children), self._noun(each[0].thing)
                    be = f"{_is(now, noun)} {self._rest(each[0])}"
                    return [f"{_number(now, noun)} {be}, and the goal wants {_count(count)}"]
            case Pairs(count, ((Literal() as first, *_), *_) as rows):
                true = [[holds(cell, self._truth) for cell in row] for row in rows]
                left = count - min(sum(map(any, true)), sum(map(any, zip(*true, strict=True))))
                lack = _lack(first)
                noun, own = self._noun(lack.thing), "its own" if left == 1 else "their own"
                other = with_article(self._noun(lack.other))
                return [f"{_number(left, noun)} {_is(left, noun)} not {lack.relation} {other} of {own}"]
        return [f"this does not hold: {formula}"]

    def _nearest(self, children: Sequence[Formula]) -> list[_Lack | str]:
        each = [self._lacks(child) for child in children]
        there = [frozenset(thing for literal in literals(child) for thing in literal.args) for child in children]
        free = frozenset().union(*there) - there[0].intersection(*there)
        return [lack if isinstance(lack, str) else replace(lack, free=free) for lack in min(each, key=len)]

    def _rest(self, lack: _Lack) -> str:
        """The end of a sentence."""
        if not lack.other:
            return f"still {lack.relation}" if lack.relation == "there" and not lack.wanted else lack.relation
        noun = self._noun(lack.other)
        if lack.relation.endswith("with"):  # a substance
            return f"{lack.relation} {noun}"
        if noun == self._noun(lack.thing):
            return f"{lack.relation} another {noun}"
        if lack.other in lack.free:
            return f"{lack.relation} {with_article(noun)}"
        return f"{lack.relation} {'the' if self._nouns[noun] == 1 else 'a certain'} {noun}"


def _either(formula: Formula) -> _Lack | None:
    """What a literal, or one of several about the same things, would be if it does not hold; None: it is neither."""
    if isinstance(formula, Literal):
        return _lack(formula)
    if not isinstance(formula, Some) or not all(isinstance(child, Literal) for child in formula.children):
        return None
    each = [_lack(literal) for literal in literals(formula)]
    ways = [lack.relation for lack in each]
    if len({(lack.thing, lack.other) for lack in each}) != 1:
        return None
    return replace(each[0], relation=" or ".join(filter(None, [", ".join(ways[:-1]), ways[-1]])))


def _lack(literal: Literal) -> _Lack:
    first, *others = literal.args
    if literal.predicate == "contains":
        first, others = others[0], [first]
    relation = _RELATIONS.get(literal.predicate, literal.predicate.replace("_", " "))
    return _Lack(first, relation, others[0] if others else "")


def _number(count: int, noun: str) -> str:
    return f"{_count(count)} {noun if count < 2 else plural(noun)}"


def _count(count: int) -> str:
    return _NUMBERS[count] if count < len(_NUMBERS) else str(count)


def _is(count: int, *nouns: str) -> str:
    return "are" if count > 1 or all(plural(noun) == noun for noun in nouns) else "is"
