"""Which door, drawer or lid of which thing a phrase means."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from mpvi_bt.finding.shapes.moving_parts import Door, moved
from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.ground.geometry.solids import Array, bounds
from mpvi_bt.ground.robot.motion import MotionFailure
from mpvi_bt.hands.motion.work import Work

_PARTS = "doors?|drawers?|lids?|hatch|flap|boot|trunk|cover"
_RANKS = {  # of doors, from the top
    "first": 0, "second": 1, "third": 2, "fourth": 3, "fifth": 4,
    "1": 0, "2": 1, "3": 2, "4": 3, "5": 4, "one": 0, "two": 1, "three": 2, "four": 3, "five": 4,
}  # fmt: skip
_PLACES = ("top", "upper", "uppermost", "highest", "bottom", "lower", "lowest", "middle", "left", "right", *_RANKS)


def thing_meant(work: Work, phrase: str, ajar: bool = False, content: str | None = None) -> tuple[str, list[str]]:
    """The thing that a phrase names, and the words that tell its doors apart.

    Args:
        work: Robot and world.
        phrase: Such as "cabinet", "top drawer of the chest of drawers", "left cabinet door".
        ajar: As of `Work.alike`.
        content: As of `Work.alike`.

    Raises:
        MotionFailure: "unknown_object" if nothing is called so.
    """
    words = _plain(phrase)
    found = work.scene.knowledge().find
    place = "|".join(_PLACES)
    forms = (
        rf"(?P<places>(?:(?:{place})\s+)*)(?:(?:{_PARTS})\s+)?(?P<rank>(?:number\s+)?(?:{place})\s+)?"
        r"(?:of|on|in|to)\s+(?:the\s+)?(?P<thing>.+)",
        rf"(?P<places>(?:(?:{place})\s+)*)(?P<thing>.+?)(?:\s+(?:{_PARTS}))(?P<rank>\s+(?:number\s+)?(?:{place}))?",
        rf"(?P<places>(?:(?:{place})\s+)+)(?P<thing>.+)(?P<rank>)",
    )
    for form in forms:
        match = re.fullmatch(form, words)
        if match and (found(match["thing"]) or found(words)):
            said = [w for w in f"{match['places']} {match['rank'] or ''}".split() if w != "number"]
            # What only cameras know is called as it was asked for, place and all.
            return work.same(match["thing"] if found(match["thing"]) else words, ajar, content), said
    return work.same(words, ajar, content), []


def doors_meant(work: Work, thing: str, places: Sequence[str]) -> list[Door]:
    """The doors of a thing that words of place tell apart: one, or all from the top.

    Raises:
        MotionFailure: "no_door" if it has nothing that opens.
    """
    doors = list(work.scene.doors(thing))
    if not doors:
        raise MotionFailure("no_door")
    return _ranked(doors, places)


def _plain(phrase: str) -> str:
    """Lower case words split by single spaces, without an article; ranks, which tell doors apart, are kept."""
    return re.sub(r"^(?:the|an?)\s+", "", " ".join(re.sub(r"[_\W]+", " ", phrase.lower()).split()))


def _ranked(doors: Sequence[Door], places: Sequence[str]) -> list[Door]:
    """The doors that match the words, the best first; all of them, from the top, if there are no words."""
    at = {id(d): _middle(d) for d in doors}
    barred = [d for d in doors if d.bar is not None]
    facing = np.array([1.0, 0.0, 0.0])
    if barred and barred[0].bar is not None:
        facing = matmul(moved(barred[0], -barred[0].position)[:3, :3], barred[0].bar.outward)
    rightward = np.cross([0.0, 0.0, 1.0], facing)  # of someone who stands before it
    left = sorted(doors, key=lambda d: float(matmul(at[id(d)], rightward)))
    high = sorted(doors, key=lambda d: (-round(float(at[id(d)][2]), 2), float(matmul(at[id(d)], rightward))))
    for word in places:
        if word in ("top", "upper", "uppermost", "highest"):
            return [high[0]]
        if word in ("bottom", "lower", "lowest"):
            return [high[-1]]
        if word == "middle":
            return [high[len(high) // 2]]
        if word == "left":
            return [left[0]]
        if word == "right":
            return [left[-1]]
        if word in _RANKS and _RANKS[word] < len(doors):
            return [high[_RANKS[word]]]
    return high


def _middle(door: Door) -> Array:
    """(3,) where it is when it is closed."""
    shut = moved(door, -door.position)
    if door.bar is not None:
        return np.asarray(matmul(shut[:3, :3], door.bar.center) + shut[:3, 3], float)
    return np.asarray(bounds(s.moved(shut) for s in door.solids).mean(0))
