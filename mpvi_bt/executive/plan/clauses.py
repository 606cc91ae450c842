"""Prompts split into clauses, and the skill that each clause names."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping

from mpvi_bt.executive.plan.pattern import LISTED
from mpvi_bt.executive.plan.skill_phrases import example
from mpvi_bt.executive.plan.skills import Skill, SkillCall
from mpvi_bt.ground.errors import did_you_mean, nearest, shown
from mpvi_bt.ground.words.phrases import MOST_CHARACTERS

_ARTICLE = re.compile(r"(?:an?|the|its|your|my)\s+", re.IGNORECASE)
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


def clauses(prompt: str, skills: Mapping[str, Skill]) -> list[str]:
    """The single descriptions that a prompt joins: "pick up the cup and put it in the sink" has two.

    They end at "then" and ";", and at "and", "," and "." where a skill's verb and what it is done to follow: "salt and
    pepper" are one thing. "It" and "them" become what was last done something to, "put the cup in the sink", of
    several things the last that the clause does not name itself.
    """
    found: list[str] = []
    things: dict[str, None] = {}  # the last one last
    for clause in _parts(prompt, skills):
        if things and len(clause) <= MOST_CHARACTERS and _PRONOUN.search(clause):
            said = clause.lower()
            thing = next((t for t in reversed(things) if t.lower() not in said), next(reversed(things)))
            clause = _PRONOUN.sub(lambda _, thing=thing: f"the {thing}", clause)  # type: ignore[misc]
        found.append(clause)
        call = _call(clause, skills)
        if call is not None and (thing := _head(call.arguments)):
            things.pop(thing, None)
            things[thing] = None
    return found


def match(description: str, skills: Mapping[str, Skill]) -> SkillCall | None:
    """The skill of one description; None if there is none, or if it joins several.

    Our choice where several fit: the reading with the shortest object, or target or source if it has none ("put the
    apple in the bowl on the table" is place_in), then the one that fills more slots, then the one with the fewest
    letters in them ("in front of the sofa" is not in the "front of the sofa"), then the skills' order.
    """
    parts = _parts(description, skills)
    return _call(parts[0], skills) if len(parts) == 1 else None


def nameless(prompt: str, skills: Mapping[str, Skill]) -> Iterator[tuple[str, str | None, tuple[str, ...]]]:
    """Clauses that name no skill, but what is filled in later ("$"): what to say, the phrase meant, and all phrases."""
    examples = tuple(example(phrase) for skill in skills.values() for phrase in skill.phrases)
    verbs = {" ".join(text.partition("{")[0].split()): text for text in examples}
    for clause in clauses(prompt, skills):
        if "$" in clause or match(clause, skills) is not None:
            continue
        words = clause.lower().split()
        near = nearest(" ".join(words[:2]), verbs) or nearest(" ".join(words[:1]), verbs)
        meant = verbs[near] if near else None
        yield f"no skill is named by {shown(clause)}.{did_you_mean(meant, examples)}", meant, examples


def _parts(prompt: str, skills: Mapping[str, Skill]) -> list[str]:
    """A prompt's clauses in its own words, without words of care or politeness."""
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
    """As `match`, of a single clause; None of one that is longer than `MOST_CHARACTERS`."""
    if len(text) > MOST_CHARACTERS:
        return None
    readings: list[tuple[int, int, int, SkillCall]] = []
    for skill in skills.values():
        for pattern in skill.patterns:
            if (found := pattern.match(text)) is not None:
                words = {slot: _bare(value) for slot, value in found.items()}
                letters = sum(map(len, words.values()))
                readings.append((len(_head(words)), -len(words), letters, SkillCall(skill, words)))
    return min(readings, key=lambda r: r[:3])[3] if readings else None


def _head(words: Mapping[str, str]) -> str:
    """What something is done to."""
    return words.get("object", words.get("target", words.get("source", "")))


def _bare(words: str) -> str:
    """Without a leading article, and lower case for words that a slot lists."""
    words = _ARTICLE.sub("", words, count=1) if _ARTICLE.match(words) else words
    return words.lower() if words.lower() in LISTED else words
