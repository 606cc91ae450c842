"""The grammar of completion criteria for checkers without a language model."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal

from mpvi_bt.ground.robot.protocol import Side
from mpvi_bt.ground.words.phrases import normalize, singular, whole

MOST_CHARACTERS = 300
_NUMBERS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")
_HAND = r"(?:(?P<side>left|right) )?(?:robot )?(?:gripper|hand)s?"
_IN = r"(?:inside of|inside|within|into|in)"
_ON = r"(?:on top of|on|onto|upon)"
_SIDE_OF = r"to (?:the )?(?:left|right|side) of"
_BESIDE = rf"(?:right )?(?:next to|beside|near|close to|alongside|adjacent to|in front of|behind|{_SIDE_OF})"
_UNDER = r"(?:underneath|under|below|beneath)"
_BE = r"(?:is|are)(?: now| still| currently)?"
_PUT = r"(?:placed |put |lying |standing |resting )?"
_HOLD = r"(?:is holding|holds|is grasping)"
_BOTH = r"(?:in|by|with|between) (?:both|two|the two) (?:of )?(?:its |the )?(?:robot )?(?:hands|grippers|arms)"
_HUNG = rf"hangs?|(?:{_BE} )?(?:hanging|hung|attached|mounted|fixed|fastened)"
_TURNED = r"(?:turned |switched |powered |toggled )?"

Relation = Literal[
    "at", "held", "lifted", "inside", "ontop", "nextto", "under", "open", "closed", "on", "off", "clean", "sprayed",
    "cooked", "frozen", "hot", "burning", "attached", "there", "cut",
]  # fmt: skip
_PATTERNS: tuple[tuple[Relation, re.Pattern[str]], ...] = tuple(
    (relation, re.compile(text))  # type: ignore[misc]
    for relation, text in (
        ("at", rf"robot {_BE} (?:standing )?(?:at|in|inside|by|{_BESIDE}|within reach of) (?P<subject>.+)"),
        ("lifted", rf"(?P<subject>.+?) {_BE} (?:being )?(?:held|grasped|gripped|lifted|carried)(?: up)? {_BOTH}"),
        ("lifted", rf"(?:robot|{_HAND}) {_HOLD} (?P<subject>.+?) {_BOTH}"),
        ("lifted", rf"(?P<subject>.+?) {_BE} (?:lifted|raised)(?: up)?(?: (?:off|from|above) .+)?"),
        ("held", rf"(?P<subject>.+?) {_BE} (?:being )?(?:held|grasped|gripped)(?: (?:in|by|with) {_HAND})?"),
        ("held", rf"(?P<subject>.+?) {_BE} in {_HAND}"),
        ("held", rf"(?:robot|{_HAND}) {_HOLD} (?P<subject>.+?)(?: in (?P<other>left|right) \w+)?"),
        ("open", rf"(?P<subject>.+?) {_BE} (?:fully |wide |partly )?open(?:ed)?"),
        ("closed", rf"(?P<subject>.+?) {_BE} (?:fully |completely )?(?:closed|shut)"),
        ("on", rf"(?P<subject>.+?) {_BE} {_TURNED}on"),
        ("off", rf"(?P<subject>.+?) {_BE} {_TURNED}off"),
        ("clean", rf"(?P<subject>.+?) {_BE} (?:wiped clean|wiped|clean|cleaned|dusted|scrubbed)"),
        ("cooked", rf"(?P<subject>.+?) {_BE} (?:fully |completely )?(?:cooked|fried|baked|roasted)(?: through)?"),
        ("frozen", rf"(?P<subject>.+?) {_BE} (?:fully |completely )?(?:frozen)(?: through)?"),
        ("hot", rf"(?P<subject>.+?) {_BE} (?:hot|heated(?: up)?)"),
        ("burning", rf"(?P<subject>.+?) (?:burns?|{_BE} (?:burning|on fire|alight|lit)|(?:has|have) caught fire)"),
        ("attached", rf"(?P<subject>.+?) (?:{_HUNG})(?: up)? (?:to|onto|on|from) (?P<object>.+)"),
        ("cut", rf"no (?P<subject>.+?) {_BE} (?:still )?(?:whole|uncut)"),
        ("there", rf"there {_BE} (?P<subject>.+)"),
        ("sprayed", rf"(?P<subject>.+?) {_BE} (?:sprayed|misted|watered)(?: with .+)?"),
        ("nextto", rf"(?P<subject>.+?) {_BE} {_PUT}(?:on .+? )?{_BESIDE} (?P<object>.+)"),
        ("under", rf"(?P<subject>.+?) {_BE} {_PUT}(?:on .+? )?{_UNDER} (?P<object>.+)"),
        ("inside", rf"(?P<subject>.+?) {_BE} {_PUT}{_IN} (?P<object>.+)"),
        ("ontop", rf"(?P<subject>.+?) {_BE} {_PUT}{_ON} (?P<object>.+)"),
    )
)  # fmt: skip
# Relations of one thing.
UNARY = (
    "at", "held", "lifted", "open", "closed", "on", "off", "clean", "sprayed", "cooked", "frozen", "hot", "burning",
    "there", "cut",
)  # fmt: skip


@dataclass(frozen=True)
class Criterion:
    """A state that can be looked for.

    Attributes:
        relation: "held" in a hand or "lifted" by both; "inside" a container, "ontop" of a surface, "nextto" or "under"
            a thing; "open" or "closed", switched "on" or "off", "clean", "sprayed", "cooked", "frozen", "hot",
            "burning"; "attached" to a mount; "there": it exists, "cut": no such thing is whole any more; "at": where
            the robot itself is.
        subject: What the state is about, such as "can of soda".
        object: The other thing; "" for a relation in `UNARY`.
        count: How many of the subject, at least.
        side: The hand that must hold it, or None for either.
    """

    relation: Relation
    subject: str
    object: str = ""
    count: int = 1
    side: Side | None = None


def parse(text: str) -> Criterion | None:
    """The criterion in a sentence; None if it has none of these forms.

    "the robot is at <place>"; "<object> is held in a gripper", "... in the left gripper", "... with both hands";
    "<object> is in <container>"; likewise "on", "next to" and "under"; each also with a count ("two cans of soda are in
    the trash can", "there are 2 cans of soda in ..."). "<object> is open", "closed", "turned on", "turned off",
    "clean", "sprayed", "cooked", "frozen", "hot"; "<object> burns"; "<object> hangs on", "is mounted on <thing>";
    "there are <objects>", "no <object> is whole".
    """
    if len(text) > MOST_CHARACTERS:
        return None
    owner = r"\b(?:the|an?|its|one of|of|robot|s) (?=(?:(?:the|its|robot|s|left|right) )*(?:gripper|hand))"
    words = re.sub(owner, "", normalize(text))
    if there := re.fullmatch(rf"there (is|are) (.+?) ({_BESIDE}|{_UNDER}|{_IN}|{_ON}) (.+)", words):
        words = f"{there[2]} {there[1]} {there[3]} {there[4]}"
    if " not " in f" {words} ":
        return None
    for relation, pattern in _PATTERNS:
        found = pattern.fullmatch(words)
        if found is None:
            continue
        groups = found.groupdict()
        count, subject = _counted(groups["subject"])
        other = groups.get("object") or ""
        if not subject or (relation not in UNARY and not normalize(other)):
            return None
        return Criterion(relation, subject, normalize(other), count, groups.get("side") or groups.get("other"))  # type: ignore[arg-type]
    return None


def named(phrase: str, phrases: Mapping[str, Iterable[str]]) -> list[str]:
    """Names matching a phrase, in the order of the table; singular and plural are alike.

    A part stands for its thing where nothing is called like the part: "the fridge door", "the door of the fridge".

    Args:
        phrase: Such as "cans of soda".
        phrases: Name of each thing to what people call it.
    """
    wanted = _singular(phrase)
    found = [name for name, called in phrases.items() if any(_singular(p) == wanted for p in (*called, name))]
    if not found and (thing := whole(phrase)) is not None:
        return named(thing, phrases)
    return found


def _counted(subject: str) -> tuple[int, str]:
    """The number that a phrase begins with (1 if with none), and the rest of it."""
    first, _, rest = subject.partition(" ")
    rest = re.sub(r"^(?:of the|of)\s+(?=\w)", "", rest)
    if first.isdecimal() and len(first) <= 3:
        return max(1, int(first)), normalize(rest)
    if first in _NUMBERS[1:]:
        return _NUMBERS.index(first), normalize(rest)
    if first == "both":
        return 2, normalize(rest)
    return 1, normalize(subject)


def _singular(phrase: str) -> tuple[str, ...]:
    return tuple(map(singular, normalize(phrase).split()))
