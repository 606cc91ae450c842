"""Compiled phrases, matched in time linear in the text.

A phrase becomes an acyclic graph. At a position of the text a node has several successors, the best one first; they are
tried depth first, and no node twice at one position: a failure there is final, because the end of a slot does not
depend on its beginning. So a match takes at most nodes times letters steps, however many parts are optional (the rule
of RE2's bit-state matcher).
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

from mpvi_bt.ground.errors import UnknownName

Slot = Literal["object", "container", "surface", "target", "source", "tool", "hand", "to_hand", "state", "direction"]
SLOTS: tuple[Slot, ...] = get_args(Slot)
_WORDS = {
    "hand": ("left", "right"),
    "to_hand": ("left", "right"),
    "state": ("on", "off"),
    "direction": ("left", "right", "forward", "backward", "away", "aside"),
}
LISTED = {word for words in _WORDS.values() for word in words}
_TOKEN = re.compile(r"\{(\w*)(?::([\w\s|-]+))?\}|[\[\]()|]|[^\[\](){}|]+|.")
_CLOSES = {"(": ")", "[": "]"}

_ITS_ARTICLE = re.compile(r"(?:an?|the|its|your|my)\s+", re.IGNORECASE)  # no thing alone: not "the" button, a button

# What names a thing begins with no preposition ("in the chair"), has none of motion in it ("box across the table") and
# ends in no word that belongs to the verb ("door open").
_BEFORE = re.compile(
    r"(?:in|into|inside|within|on|onto|upon|off|out|of|from|to|towards?|at|by|with|using|under|underneath|beneath|"
    r"below|over|above|across|along|against|behind|between|beside|near|next|through|up|down|away|and|then)(?:\s|$)",
    re.IGNORECASE,
)
_WITHIN = re.compile(r"\s(?:into|onto|off|out|towards?|across|through|until)\s", re.IGNORECASE)
_AFTER = re.compile(r"\s(?:in|into|on|onto|off|out|up|down|over|away|back|open|shut|closed|upside)\Z", re.IGNORECASE)
_LONGEST_AFTER = len(" upside")
# Where something comes from or goes to is no side of itself, nor a side of nothing.
_SIDE = re.compile(r"its\s|(?:the\s+)?(?:left|right|side|front)(?:\s+side)?(?:$|\s+(?:of|with|using)\s)", re.IGNORECASE)
_PLACES = ("source", "surface", "container")

Ways = list[tuple["_Node", int]]  # each a node, and the place in the text where it goes on


class _Node:
    """A step of a phrase; this one is its end, and fits nothing more."""

    def ways(self, text: str, at: int) -> Ways:
        """How to go on from a place in a text, the best way first."""
        return []


@dataclass(eq=False)
class _Literal(_Node):
    """A text as it stands, in lower case."""

    literal: str
    then: _Node

    def ways(self, text: str, at: int) -> Ways:
        end = at + len(self.literal)
        return [(self.then, end)] if text[at:end].lower() == self.literal else []


class _Fork(_Node):
    """Alternatives; of those that are a text only the ones with the right first letter are looked at."""

    def __init__(self, nodes: Sequence[_Node]) -> None:
        letters = {node.literal[0] for node in nodes if isinstance(node, _Literal)}
        self._others = [node for node in nodes if not isinstance(node, _Literal)]
        self._by_letter = {
            letter: [n for n in nodes if not isinstance(n, _Literal) or n.literal[0] == letter] for letter in letters
        }

    def ways(self, text: str, at: int) -> Ways:
        found: Ways = []
        for node in self._by_letter.get(text[at : at + 1].lower(), self._others):
            found += node.ways(text, at) if isinstance(node, _Literal) else [(node, at)]
        return found


@dataclass(eq=False)
class _OwnWords(_Node):
    """A slot that has words of its own."""

    slot: str
    then: _Node

    def ways(self, text: str, at: int) -> Ways:
        return [way for word in _WORDS[self.slot] for way in _Literal(word, self.then).ways(text, at)]


@dataclass(eq=False)
class _Within(_Node):
    """Between two letters of the words that name a thing.

    Attributes:
        slot: That the words fill.
        endings: One of them must be the last word; none: any may.
        then: What follows.
    """

    slot: str
    endings: tuple[str, ...]
    then: _Node

    def ways(self, text: str, at: int) -> Ways:
        found: Ways = []
        if self.endings:
            found = self.ended(text, at + 1) if text[at : at + 1].isspace() else []
        elif not text[at - 1].isspace() and not _AFTER.search(text, max(0, at - _LONGEST_AFTER), at):
            found = [(self.then, at)]
        return [*found, (self, at + 1)] if at < len(text) and not _WITHIN.match(text, at) else found

    def ended(self, text: str, at: int) -> Ways:
        """Behind an ending that stands at a place."""
        return [way for word in self.endings for way in _Literal(word, self.then).ways(text, at)]


@dataclass(eq=False)
class _Thing(_Node):
    """Before the words that name a thing."""

    within: _Within

    @property
    def slot(self) -> str:
        """That the words fill."""
        return self.within.slot

    def ways(self, text: str, at: int) -> Ways:
        if _BEFORE.match(text, at) or (self.slot in _PLACES and _SIDE.match(text, at)):
            return []
        if article := _ITS_ARTICLE.match(text, at):
            at = article.end()
        if at == len(text) or text[at].isspace():
            return []
        return [(self.within, at + 1), *self.within.ended(text, at)]


@dataclass(frozen=True)
class Pattern:
    """A phrase, read.

    Attributes:
        slots: Those in it, in order.
    """

    slots: tuple[str, ...]
    _first: _Node
    _last: _Node

    def match(self, text: str) -> dict[str, str] | None:
        """The words of each slot that a text fills, or None if it does not fit, whole, in whatever case.

        Args:
            text: Words with single spaces between them.
        """
        seen: set[tuple[_Node, int]] = set()
        left: list[_Path] = [(self._first, 0, None)]
        while left:
            node, at, _ = path = left.pop()
            if node is self._last and at == len(text):
                return _filled(text, path)
            if (node, at) not in seen:
                seen.add((node, at))
                left += [(*way, path) for way in reversed(node.ways(text, at))]
        return None


_Path = tuple[_Node, int, "_Path | None"]  # a node, the place where it was come to, and how


def _filled(text: str, path: _Path) -> dict[str, str]:
    """The words of each slot along a way through a phrase."""
    words: dict[str, str] = {}
    end, before = path[1], path[2]
    while before is not None:
        node, at, before = before
        if isinstance(node, _Thing | _OwnWords):
            words[node.slot] = text[at:end]
        if not isinstance(node, _Within):
            end = at
    return words


def pattern(phrase: str) -> Pattern:
    """What a phrase fits.

    Raises:
        ValueError: An unknown slot, one slot twice, or brackets or braces that do not close.
    """
    slots: list[str] = []
    group = _Group("")
    around: list[_Group] = []
    for token in _TOKEN.finditer(" ".join(phrase.split())):
        text, slot = token.group(), token.group(1)
        if slot is not None:
            if slot not in SLOTS:
                raise ValueError(str(UnknownName("slot", slot, SLOTS)))
            if slot in slots:
                raise ValueError(f"slot {slot!r} twice in one phrase")
            slots.append(slot)
            group.alternatives[-1].append((slot, tuple(word.strip() for word in (token.group(2) or "").split("|"))))
        elif text in "{}":
            raise ValueError(f"a {text!r} without its other half; a slot is written {{object}}")
        elif text == "|":
            group.alternatives.append([])
        elif text in _CLOSES:
            around.append(group)
            group = _Group(text)
        elif text in _CLOSES.values():
            if _CLOSES.get(group.opening) != text:
                raise ValueError(_UNMATCHED)
            around[-1].alternatives[-1].append(group)
            group = around.pop()
        else:
            group.alternatives[-1].append(text.lower())
    if around:
        raise ValueError(_UNMATCHED)
    last = _Node()
    return Pattern(tuple(slots), group.node(last), last)


_UNMATCHED = "brackets that do not match; known: (a|b), [may be left out], {slot}"


class _Group:
    """What stands between brackets, as it is read.

    Attributes:
        opening: "(", "[" or, of the whole phrase, "".
        alternatives: Each of texts, slots with their endings, and groups.
    """

    def __init__(self, opening: str) -> None:
        self.opening = opening
        self.alternatives: list[list[str | tuple[str, tuple[str, ...]] | _Group]] = [[]]

    def node(self, then: _Node) -> _Node:
        """Its first node, if `then` follows it."""
        nodes = []
        for items in self.alternatives:
            node = then
            for item in reversed(items):
                if isinstance(item, str):
                    node = _Literal(item, node)
                elif isinstance(item, _Group):
                    node = item.node(node)
                elif item[0] in _WORDS:
                    node = _OwnWords(item[0], node)
                else:
                    node = _Thing(_Within(item[0], tuple(filter(None, item[1])), node))
            nodes.append(node)
        if self.opening == "[":
            nodes.append(then)
        return nodes[0] if len(nodes) == 1 else _Fork(nodes)
