"""Views of the result for the checker, which sees the head's pictures: what one view hides, another may show."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mpvi_bt.executive.plan.skills import SkillCall
from mpvi_bt.ground.geometry.linear_algebra import norm
from mpvi_bt.ground.robot.motion import Actions
from mpvi_bt.hands.motion.carry import back_off, upright
from mpvi_bt.hands.motion.gaze import look_at, look_into
from mpvi_bt.hands.motion.viewpoints import step_up
from mpvi_bt.hands.motion.work import Work
from mpvi_bt.hands.skills.spots import is_floor

_WHERE = ("container", "surface", "target", "object")  # slots to look at; the first one in a call counts


@dataclass(frozen=True)
class ResultViews:
    """Where the result of the work is looked at from."""

    beside_m: float = 0.15  # largest distance from a container's box to a dropped thing that missed it [m]; our choice


_SHOW = ResultViews()


def stand_back(work: Work, *names: str) -> Actions:
    """Look at things upright from a little farther off: with what is above and beside them. Raises as any motion."""
    yield from back_off(work)
    if not work.held():
        yield from work.motion.stand(upright(work))
    yield from look_at(work, *names)


def views(work: Work, call: SkillCall) -> list[Actions]:
    """Ways to look at what a call has done, one after the other.

    A container is looked into before it is looked at from farther off, and once more from close to; all else after.
    What both hands hold is only looked at.
    """
    names = done_at(work, call)
    if not names or work.scene.between() in names:
        return [look_at(work, name) for name in names]
    into, back = look_into(work, names[0]), stand_back(work, *names)
    return [into, back, step_up(work, names[0])] if "container" in call.arguments else [back, into]


def fell_beside(work: Work, call: SkillCall) -> bool:
    """Whether what a call was to put into a movable container is known to lie or lean beside it instead."""
    if (inside := call.skill.effects.inside) is None:
        return False
    known, (payload, container) = work.scene.knowledge(), (call.arguments[slot] for slot in inside)
    into = [e for e in known.find(container) if e.kind == "object"]
    left = [e for e in known.find(payload) if e.inside is None and not e.held]
    gaps = [float(norm(e.center - np.clip(e.center, c.lowest, c.highest))) for e in left for c in into]
    return min(gaps, default=_SHOW.beside_m) < _SHOW.beside_m


def done_at(work: Work, call: SkillCall) -> list[str]:
    """Names of the things that show a call's result: a payload of both hands, or else the place and the thing there.

    Empty if the place is unknown, or if a hand holds the thing: that hand's own camera sees it.
    """
    if (between := work.scene.between()) is not None:
        return [between]
    known, carried, names = work.scene.knowledge(), work.carried(), list[str]()
    for phrase in (call.arguments[slot] for slot in _WHERE if slot in call.arguments):
        if is_floor(phrase) or not (found := known.find(phrase)):
            continue
        if any(e.name in carried for e in found):
            break
        if not names:
            names.append(work.same(phrase))
        else:
            at = work.middle(names[0])
            names.append(min(found, key=lambda e: float(norm(e.center - at))).name)
    return names
