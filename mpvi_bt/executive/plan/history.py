"""The history for replanning: finished and failed segments, reasons, and seen objects."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

LONGEST = 8000  # characters of it all; Our choice: some two thousand tokens, whatever happened
_SECTION = 1700  # of each list
_NAME = 60  # of a thing, or of a reason code
_SENTENCE = 300


@dataclass(frozen=True)
class Unit:
    """One begun unit of a plan.

    Attributes:
        said: Its description.
        reason: Code of its failure, such as "no_path"; "" if it was done.
        evidence: Of the failure.
        answers: The completion checker's last answers about it.
        criterion: Its state of completion, in words; "" if it has none.
    """

    said: str
    reason: str = ""
    evidence: str = ""
    answers: tuple[str, ...] = ()
    criterion: str = ""


@dataclass(frozen=True)
class SeenObject:
    """An object that the robot has seen.

    Attributes:
        name: What it is called.
        room: In which it is, or None.
        inside: What it is in, or None.
        held: Whether the robot holds it, or something that it is in.
    """

    name: str
    room: str | None = None
    inside: str | None = None
    held: bool = False


@dataclass(frozen=True)
class History:
    """The episode so far.

    Attributes:
        units: Begun units, in order; the last one has just failed.
        planned: The units after it.
        seen: Known objects, the most certain first.
        full: Hands that feel something between their fingers; None: nobody knows.
    """

    units: tuple[Unit, ...]
    planned: tuple[str, ...] = ()
    seen: tuple[SeenObject, ...] = ()
    full: tuple[str, ...] | None = None

    def text(self) -> str:
        """All of it for a prompt, in lines, at most `LONGEST` characters.

        Names and evidence come from the world and from other models. Here they are data: JSON strings on one line each,
        cut to a length, whatever they say.
        """
        *before, failed = self.units
        lines = [f"Failed just now: {_json(_told(failed))}"]
        sections = (
            ("What came before it, in order", [_told(unit) for unit in before], True),
            ("What was planned to come after it", [_line(said) for said in self.planned], False),
            ("Things that the robot has seen", [_thing(thing) for thing in self.seen], False),
        )
        for title, items, latest in sections:
            shown = _fitting([f"- {_json(item)}" for item in items], latest)
            left_out = f", {len(items) - len(shown)} left out" if len(shown) < len(items) else ""
            lines += [f"{title}{left_out}:", *shown] if items else [f"{title}: nothing."]
        return "\n".join(lines)


def _told(unit: Unit) -> dict[str, Any]:
    if not unit.reason:
        return {"what": _line(unit.said), "came_to": "done"}
    told: dict[str, Any] = {"what": _line(unit.said), "came_to": "given up", "reason": _line(unit.reason, _NAME)}
    if unit.evidence:
        told["evidence"] = _line(unit.evidence)
    if unit.answers:
        told["checker"] = [_line(answer) for answer in unit.answers]
    return told


def _thing(thing: SeenObject) -> dict[str, Any]:
    told = {"name": thing.name, "room": thing.room, "in": thing.inside}
    known: dict[str, Any] = {key: _line(text, _NAME) for key, text in told.items() if text}
    return known | ({"held": True} if thing.held else {})


def _line(text: str, longest: int = _SENTENCE) -> str:
    """A text on one line, of printable characters, not too long."""
    plain = " ".join("".join(c if c.isprintable() else " " for c in text[: 10 * longest]).split())
    return plain if len(plain) <= longest else plain[: longest - 3] + "..."


def _json(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False)


def _fitting(lines: Sequence[str], latest: bool) -> list[str]:
    """As many lines as have room in a section, the first or the latest ones."""
    room, found = _SECTION, []
    for line in reversed(lines) if latest else lines:
        room -= len(line) + 1
        if room < 0:
            break
        found.append(line)
    return found[::-1] if latest else found
