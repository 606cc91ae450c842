"""A skill's needs and effects in words for a language model, made from its YAML file.

The words of an effect are those of a completion criterion, where there is one.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from mpvi_bt.executive.plan.skill_effects import RELEASING
from mpvi_bt.executive.plan.skill_phrases import example, slots
from mpvi_bt.executive.plan.skills import Skill

# The words for each term; {0} and {1} are its slots.
NEEDS: Mapping[str, str] = {
    "held": "{0} in a hand",
    "near": "{0} in reach",
    "open": "{0} not closed",
    "closed": "{0} not open",
    "on": "{0} turned on",
}
EFFECTS: Mapping[str, str] = {
    "held": "{0} is held in a gripper",
    "passed": "{0} is held in the other gripper",
    "open": "{0} is open",
    "closed": "{0} is closed",
    "on": "{0} is turned on",
    "inside": "{0} is in {1}",
    "ontop": "{0} is on {1}",
    "nextto": "{0} is next to {1}",
    "under": "{0} is under {1}",
    "attached": "{0} is attached to {1}",
    "poured": "what was in {0} is in {1}",
    "pushed": "{0} is next to {1}",
    "clean": "{0} is clean",
    "sprayed": "{0} is sprayed",
    "burning": "{0} burns",
    "cut": "no {0} is whole",
    "meanwhile": "{0} is cooked, frozen or burning",
    "at": "the robot is at {0}",
}
_HANDS = ("", "a free hand", "both hands free")


def shown_phrase(skill: Skill) -> str:
    """An example of the phrase that names most of what the skill needs and changes; of several, the first."""
    told = {*skill.needs.slots, *skill.effects.slots}
    return example(max(skill.phrases, key=lambda phrase: len(told.intersection(slots(example(phrase))))))


def needs_words(skill: Skill) -> str:
    """What a skill needs, such as "{object} in a hand, {container} in reach"; "" if nothing."""
    said = slots(shown_phrase(skill))
    words = [_HANDS[skill.needs.hands]] if skill.needs.hands else []
    for term, pattern in NEEDS.items():
        named = [slot for slot in getattr(skill.needs, term) if slot in said]
        words += [pattern.format(f"{{{slot}}}") for slot in (named[:1] if term == "held" else named)]
    return ", ".join(words)


def effects_words(skill: Skill) -> str:
    """What is so after a skill, such as "{object} is in {container}, and the hand is free"; "" if nothing changes."""
    return ", ".join(_effects(skill))


def _effects(skill: Skill) -> Iterator[str]:
    said = slots(shown_phrase(skill))
    for term, pattern in EFFECTS.items():
        effect = getattr(skill.effects, term)
        named = (effect,) if isinstance(effect, str) else effect or ()
        if not named or not set(named) <= set(said):
            continue
        if term == "on" and "state" in said:
            pattern = "{0} is turned {{state}}"
        if term == "held" and skill.hands == 2:
            pattern = "{0} is held with both hands"
        yield pattern.format(*(f"{{{slot}}}" for slot in named))
        if term in RELEASING:
            yield "and the hand is free"
