"""What a manipulation primitive is, from skill files: the phrases that name it, what shows that it ended, its time.

A phrase is a small pattern: plain words, `(one|another)` for alternatives, `[...]` for what may be left out, and slots
such as `{object}` whose words become the call's arguments. The first alternative that fits wins, so longer ones come
first: `(take hold of|take)`.

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

from pydantic import AfterValidator, Field

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
_TOKEN = re.compile(r"\{(\w*)\}|[\[\]()|]|[^\[\](){}|]+|.")
_SLOT = re.compile(r"\{(\w*)\}")
_BRACKETS = {"[": "(?:", "]": ")?", "(": "(?:", ")": ")", "|": "|"}
_ARTICLE = re.compile(r"(?:an?|the|its|your|my)\s+", re.IGNORECASE)


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
            source += f"(?P<{slot}>{_WORDS[slot]})" if slot in _WORDS else rf"(?P<{slot}>\S(?:.*?\S)?)"
        elif text in "{}":
            raise ValueError(f"a {text!r} without its other half; a slot is written {{object}}")
        else:
            source += _BRACKETS.get(text) or re.escape(text)
    try:
        return re.compile(source, re.IGNORECASE)
    except re.error:
        raise ValueError("brackets that do not match; known: (a|b), [may be left out], {slot}") from None


def example(phrase: str) -> str:
    """What a phrase reads like, such as "pick up {object}": first alternatives, and nothing that may be left out."""
    text = phrase
    while (shorter := re.sub(r"\[[^\[\]]*\]|\(([^()|\[\]]*)(?:\|[^()\[\]]*)?\)", r"\1", text)) != text:
        text = shorter
    return " ".join(text.split())


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
    if pattern(phrase).fullmatch(""):
        raise ValueError("a phrase must not match an empty text")
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

    @cached_property
    def patterns(self) -> tuple[re.Pattern[str], ...]:
        """Its phrases as regular expressions."""
        return tuple(map(pattern, self.phrases))


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


def clauses(prompt: str) -> list[str]:
    """The single descriptions that a prompt joins: "pick up the cup, then put the cup in the sink" has two."""
    parts = re.split(r"(?:,|;)?\s+(?:and\s+)?then\s+|;\s+", prompt, flags=re.IGNORECASE)
    return [part.strip(" ,.;") for part in parts if part.strip(" ,.;")]


def match(description: str, skills: Mapping[str, Skill]) -> SkillCall | None:
    """The skill that one description names, or None.

    Our choice where several fit: the reading with the shortest object, or target or source if it has none ("put the
    apple in the bowl on the table" is place_in), then the one that fills more slots, then the one with the fewest
    letters in them ("in front of the sofa" is not in the "front of the sofa"), then the skills' order.
    """
    text = " ".join(description.split()).strip(" .")
    readings: list[tuple[int, int, int, SkillCall]] = []
    for skill in skills.values():
        for regex in skill.patterns:
            if found := regex.fullmatch(text):
                words = {slot: _bare(value) for slot, value in found.groupdict().items() if value is not None}
                if any(_ARTICLE.fullmatch(f"{value} ") for value in words.values()):
                    continue  # "press the button" is no button of "the"
                letters = sum(map(len, words.values()))
                head = words.get("object", words.get("target", words.get("source", "")))
                readings.append((len(head), -len(words), letters, SkillCall(skill, words)))
    return min(readings, key=lambda r: r[:3])[3] if readings else None


def _bare(words: str) -> str:
    """Without a leading article, and lower case for words that a slot lists."""
    words = _ARTICLE.sub("", words, count=1) if _ARTICLE.match(words) else words
    return words.lower() if words.lower() in _LISTED else words
