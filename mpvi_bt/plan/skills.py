"""What a manipulation primitive is, from skill files: the phrases that name it, what shows that it ended, its time.

A phrase is a small pattern: plain words, `(one|another)` for alternatives, `[...]` for what may be left out, and slots
such as `{object}` whose words become the call's arguments; those of `{object:button|switch}` end in one of the words
listed. The first alternative that fits wins, so longer ones come first: `(take hold of|take)`.

Slots: `object` is what the hands do something to; `container`, `surface` and `target` are where it goes, or what a
`tool` is held over; `source` is where it comes from. Four have words of their own: `hand` and, of a thing that changes
hands, `to_hand` are left or right, `state` is on or off, `direction` a way to push.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, ValidationInfo, field_validator

from mpvi_bt.errors import FileProblems, UnknownName
from mpvi_bt.file_kinds import expect
from mpvi_bt.marked_yaml import Marks, Record, load_marked, validate_data
from mpvi_bt.plan.schema import Phrase

SLOTS = ("object", "container", "surface", "target", "source", "tool", "hand", "to_hand", "state", "direction")
_WORDS = {
    "hand": "left|right",
    "to_hand": "left|right",
    "state": "on|off",
    "direction": "left|right|forward|backward|away|aside",
}
_LISTED = set("|".join(_WORDS.values()).split("|"))
_TOKEN = re.compile(r"\{(\w*)(?::([\w\s|-]+))?\}|[\[\]()|]|[^\[\](){}|]+|.")
_SLOT = re.compile(r"\{(\w*)\}")
_ENDING = re.compile(r"\{\w*:([\w\s-]+)[^{}]*\}")
_BRACKETS = {"[": "(?:", "]": ")?", "(": "(?:", ")": ")", "|": "|"}
_ARTICLE = re.compile(r"(?:an?|the|its|your|my)\s+", re.IGNORECASE)
_ITS_ARTICLE = r"(?>(?:(?:an?|the|its|your|my)\s+)?)"  # no thing alone: "press the button" is no button of "the"

# What names a thing begins with no preposition ("in the chair"), has none of motion in it ("box across the table") and
# ends in no word that belongs to the verb ("door open").
_BEFORE = (
    r"(?!(?:in|into|inside|within|on|onto|upon|off|out|of|from|to|towards?|at|by|with|using|under|underneath|beneath|"
    r"below|over|above|across|along|against|behind|between|beside|near|next|through|up|down|away|and|then)(?:\s|$))"
)
_WITHIN = r"(?:(?!\s(?:into|onto|off|out|towards?|across|through|until)\s).)*?"
_VERBAL = "in|into|on|onto|off|out|up|down|over|away|back|open|shut|closed|upside"
_AFTER = "".join(rf"(?<!\s{word})" for word in _VERBAL.split("|"))
# Where something comes from or goes to is no side of itself, nor a side of nothing.
_NOT_A_SIDE = r"(?!its\s|(?:the\s+)?(?:left|right|side|front)(?:\s+side)?(?:$|\s+(?:of|with|using)\s))"
_PLACES = ("source", "surface", "container")

_MANNER = re.compile(
    r"(?:^|(?<=\s))(?:please|now|again|gently|carefully|slowly|quickly|firmly|softly|fully|completely|tightly|securely)"
    r"(?=[\s,.;!]|$)",
    re.IGNORECASE,
)
_THEN = re.compile(r"(?:,|;)?\s+(?:and\s+)?then\s+|;\s+", re.IGNORECASE)
_JOINT = re.compile(r"(,?\s+and\s+|[,.!]\s+)", re.IGNORECASE)
_THING = r"(?:an?|the|its?|them|your|my|this|that|these|those|both|all|some|one|two|three|four|five|six|\d+)\b"
_PARTICLE = r"(?:\s+(?:up|down|off|out|away|back|open|shut|hold\s+of{}))?"
# What follows a verb, so that it is one: "brush the ...". After an "and", "brush on the table" may be one more thing.
_AFTER_AND = re.compile(rf"\w+{_PARTICLE.format('')}\s+{_THING}", re.IGNORECASE)
_AFTER_COMMA = re.compile(rf"\w+{_PARTICLE.format('|on|in|over')}\s+{_THING}", re.IGNORECASE)
_PRONOUN = re.compile(r"(?<![\w$])(?:it|them)\b", re.IGNORECASE)


def pattern(phrase: str) -> re.Pattern[str]:
    """The regular expression of a phrase.

    Raises:
        ValueError: An unknown slot, one slot twice, or brackets or braces that do not close.
    """
    source = ""
    seen: set[str] = set()
    for token in _TOKEN.finditer(" ".join(phrase.split())):
        text, slot = token.group(), token.group(1)
        if slot is not None:
            if slot not in SLOTS:
                raise ValueError(str(UnknownName("slot", slot, SLOTS)))
            if slot in seen:
                raise ValueError(f"slot {slot!r} twice in one phrase")
            seen.add(slot)
            source += f"(?P<{slot}>{_named(slot, token.group(2))})"
        elif text in "{}":
            raise ValueError(f"a {text!r} without its other half; a slot is written {{object}}")
        else:
            source += _BRACKETS.get(text) or re.escape(text)
    try:
        return re.compile(source, re.IGNORECASE)
    except re.error:
        raise ValueError("brackets that do not match; known: (a|b), [may be left out], {slot}") from None


def _named(slot: str, ending: str | None) -> str:
    """What the words of a slot may be, as a regular expression."""
    if slot in _WORDS:
        return _WORDS[slot]
    before = _BEFORE + (_NOT_A_SIDE if slot in _PLACES else "")
    if ending is not None:
        words = "|".join(re.escape(word.strip()) for word in ending.split("|"))
        return rf"{before}{_ITS_ARTICLE}(?:\S{_WITHIN}\s)?(?:{words})"
    return rf"{before}{_ITS_ARTICLE}\S(?:{_WITHIN}\S)?{_AFTER}"


def example(phrase: str) -> str:
    """What a phrase reads like, such as "pick up {object}": first alternatives, and nothing that may be left out."""
    text = _ENDING.sub(r"\1", phrase)
    while (shorter := re.sub(r"\[[^\[\]]*\]|\(([^()|\[\]]*)(?:\|[^()\[\]]*)?\)", r"\1", text)) != text:
        text = shorter
    return " ".join(text.split())


def _first_words(phrase: str) -> list[str]:
    """What a phrase may begin with: "take" and "grab" of `(take hold of|grab) {object}`."""
    leading = re.match(r"\s*(?:\[[^\[\]]*\]\s*)?(?:\(((?:[^()]|\([^()]*\))*)\)|(\w+))", phrase)
    if leading is None:
        return []
    plain = re.sub(r"\([^()]*\)", "", leading[1] or leading[2])
    return [words.split()[0].lower() for words in plain.split("|") if words.split()]


def filled(template: str, arguments: Mapping[str, str]) -> str | None:
    """A template such as "the {object} is held[ in the {hand} hand]" with words for its slots.

    What may be left out is left out where a slot in it has no words. None if another slot has none.
    """

    def kept(part: re.Match[str]) -> str:
        return part[1] if set(_SLOT.findall(part[1])) <= arguments.keys() else ""

    text = re.sub(r"\[([^\[\]]*)\]", kept, template)
    if not set(_SLOT.findall(text)) <= arguments.keys():
        return None
    return _SLOT.sub(lambda slot: arguments[slot[1]], text)


def _is_phrase(phrase: str) -> str:
    regex = pattern(phrase)
    if regex.fullmatch(""):
        raise ValueError("a phrase must not match an empty text")
    if any(regex.fullmatch(" ".join(["%"] * count)) for count in range(1, len(SLOTS) + 1)):
        raise ValueError("a phrase needs a word of its own: slots alone catch every sentence")
    return phrase


def _is_template(template: str) -> str:
    """Raises ValueError as `pattern` does; alternatives have no place in what is filled in."""
    pattern(template)
    if set("(|)") & set(template):
        raise ValueError("no alternatives here: what the judge should see is one sentence")
    return template


class Trigger(Record):
    """What proprioception shows when the primitive has ended, and the camera that then sees the result.

    Attributes:
        event: A hand has taken hold, or has let go, or the arms have moved and come to rest.
        camera: "head"; "hand": the wrist camera of the hand that it happened to (Paper, Manipulation: the trigger
            directs the query to that wrist's view); "other_hand": that of the other one, which now holds the thing.
    """

    event: Literal["grasp", "release", "rest"]
    camera: Literal["head", "hand", "other_hand"]


class Skill(Record):
    """A manipulation primitive (Paper, Subtask Planning appendix: a primitive with a pre-defined completion heuristic).

    Attributes:
        name: Such as "place_in".
        about: One line for a person.
        phrases: What names it in a plan.
        hands: How many hands it takes.
        shows: What the judge should see at the end, as a criterion with slots; `SkillCall.criterion` fills it in.
        triggers: Events that ask the completion checker.
        timeout_s: Simulated time that it may take.
    """

    name: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")]
    about: Phrase
    phrases: tuple[Annotated[Phrase, AfterValidator(_is_phrase)], ...] = Field(min_length=1)
    hands: Literal[1, 2] = 1
    shows: Annotated[Phrase, AfterValidator(_is_template)] | None = None
    triggers: tuple[Trigger, ...] = Field(min_length=1)
    timeout_s: float = Field(gt=0, le=86_400, allow_inf_nan=False, strict=True)

    @field_validator("shows")
    @classmethod
    def _is_said(cls, shows: str | None, info: ValidationInfo) -> str | None:
        """Raises ValueError for a slot that no phrase has words for: the judge would never be told anything."""
        given = [slot for phrase in info.data.get("phrases", ()) for slot in pattern(phrase).groupindex]
        for slot in _SLOT.findall(shows or "") if given else ():
            if slot not in given:
                raise ValueError(f"no phrase gives {slot!r}; they give: {', '.join(dict.fromkeys(given))}")
        return shows

    @cached_property
    def patterns(self) -> tuple[re.Pattern[str], ...]:
        """Its phrases as regular expressions."""
        return tuple(map(pattern, self.phrases))

    @cached_property
    def verbs(self) -> frozenset[str]:
        """The words that its phrases begin with, in lower case."""
        return frozenset(verb for phrase in self.phrases for verb in _first_words(phrase))


@dataclass(frozen=True)
class SkillCall:
    """A skill and the words that fill its slots, such as {"object": "can of soda", "hand": "right"}."""

    skill: Skill
    arguments: Mapping[str, str]

    @property
    def criterion(self) -> str | None:
        """The state that it should end in, such as "the cup is in the sink"; None if its words do not say."""
        return filled(self.skill.shows, self.arguments) if self.skill.shows else None


def load_skill(path: str | Path) -> Skill:
    """A skill from its file, which bears its name.

    Raises:
        UserError: There is no such file.
        FileProblems: Everything that is wrong with it.
    """
    return check_skill(*load_marked(path))


def check_skill(data: object, marks: Marks) -> Skill:
    """As `load_skill`, of data that is already loaded."""
    expect("skill", data, marks)
    skill = validate_data(data, marks, Skill)
    named = Path(marks.file).suffix  # what comes through a pipe has no file's name
    if named and skill.name != (stem := Path(marks.file).stem):
        message = f"skill {skill.name!r} in a file named {stem!r}; they must agree"
        raise FileProblems([marks.problem(("name",), "name", message)])
    return skill


def load_skills(folders: Iterable[str | Path] | None = None) -> dict[str, Skill]:
    """Skills by name, from every `*.yaml` of the folders, the first folder's winning.

    Args:
        folders: By default `skills/` of every root (`mpvi_bt.paths.roots`).

    Raises:
        FileProblems: Everything that is wrong with the files.
    """
    if folders is None:
        from mpvi_bt.paths import roots

        folders = [root / "skills" for root in roots()]
    skills: dict[str, Skill] = {}
    for folder in folders:
        for path in sorted(Path(folder).glob("*.yaml")):
            if path.stem not in skills:
                skills[path.stem] = load_skill(path)
    return skills


def clauses(prompt: str, skills: Mapping[str, Skill]) -> list[str]:
    """The single descriptions that a prompt joins: "pick up the cup and put it in the sink" has two.

    They end at "then" and ";", and at "and", "," and "." where a skill's verb and what it is done to follow: "salt and
    pepper" are one thing. "It" and "them" become what was last done something to, "put the cup in the sink", of
    several things the last that the clause does not name itself.
    """
    found: list[str] = []
    things: list[str] = []
    for clause in _parts(prompt, skills):
        if things and _PRONOUN.search(clause):
            thing = next((t for t in reversed(things) if t.lower() not in clause.lower()), things[-1])
            clause = _PRONOUN.sub(lambda _, thing=thing: f"the {thing}", clause)  # type: ignore[misc]
        found.append(clause)
        call = _call(clause, skills)
        if call is not None and (thing := _head(call.arguments)):
            things.append(thing)
    return found


def match(description: str, skills: Mapping[str, Skill]) -> SkillCall | None:
    """The skill that one description names, or None; of one that joins several, too.

    Our choice where several fit: the reading with the shortest object, or target or source if it has none ("put the
    apple in the bowl on the table" is place_in), then the one that fills more slots, then the one with the fewest
    letters in them ("in front of the sofa" is not in the "front of the sofa"), then the skills' order.
    """
    parts = _parts(description, skills)
    return _call(parts[0], skills) if len(parts) == 1 else None


def _parts(prompt: str, skills: Mapping[str, Skill]) -> list[str]:
    """A prompt's clauses in its own words, but for those that say how carefully or how politely."""
    found: list[str] = []
    for text in _THEN.split(" ".join(_MANNER.sub("", prompt).split())):
        first, *more = _JOINT.split(text)
        found.append(first)
        for joint, words in zip(more[::2], more[1::2], strict=True):
            if _is_clause(words, "and" in joint.lower(), skills):
                found.append(words)
            else:
                found[-1] += joint + words
    return [part.strip(" ,.;!") for part in found if part.strip(" ,.;!")]


def _is_clause(words: str, joined: bool, skills: Mapping[str, Skill]) -> bool:
    """Whether words that follow an "and" (`joined`) or a comma are a clause, not one more thing."""
    verb = words.partition(" ")[0].lower()
    if not any(verb in skill.verbs for skill in skills.values()):
        return False
    if not joined:
        return _AFTER_COMMA.match(words) is not None
    return _AFTER_AND.match(words) is not None or _call(words.strip(" ,.;!"), skills) is not None


def _call(text: str, skills: Mapping[str, Skill]) -> SkillCall | None:
    """As `match`, of a single clause."""
    readings: list[tuple[int, int, int, SkillCall]] = []
    for skill in skills.values():
        for regex in skill.patterns:
            if found := regex.fullmatch(text):
                words = {slot: _bare(value) for slot, value in found.groupdict().items() if value is not None}
                letters = sum(map(len, words.values()))
                readings.append((len(_head(words)), -len(words), letters, SkillCall(skill, words)))
    return min(readings, key=lambda r: r[:3])[3] if readings else None


def _head(words: Mapping[str, str]) -> str:
    """What something is done to."""
    return words.get("object", words.get("target", words.get("source", "")))


def _bare(words: str) -> str:
    """Without a leading article, and lower case for words that a slot lists."""
    words = _ARTICLE.sub("", words, count=1) if _ARTICLE.match(words) else words
    return words.lower() if words.lower() in _LISTED else words
