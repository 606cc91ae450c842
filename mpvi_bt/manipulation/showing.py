"""Showing what has been done to whoever judges it by the head's pictures: what one view hides, another may show."""

from __future__ import annotations

import numpy as np

from mpvi_bt.manipulation.carry import back_off
from mpvi_bt.manipulation.gaze import look_at, look_into
from mpvi_bt.manipulation.spots import is_floor
from mpvi_bt.manipulation.work import Work
from mpvi_bt.plan.skills import SkillCall
from mpvi_bt.robot.motion import Actions

_WHERE = ("container", "surface", "target", "object")  # slots that name what to look at, the first that does


def stand_back(work: Work, *names: str) -> Actions:
    """Look at things upright from a little farther off: with what is above and beside them. Raises as any motion."""
    yield from back_off(work)
    if not work.held():
        yield from work.motion.stand(np.append(work.motion.robot.travel_torso[:3], work.motion.torso[3]))
    yield from look_at(work, *names)


def views(work: Work, call: SkillCall) -> list[Actions]:
    """Ways to look at what a call has done, one after the other.

    A container is looked into before it is looked at from farther off, all else after. What both hands hold is only
    looked at.
    """
    names = done_at(work, call)
    if not names or work.scene.between() in names:
        return [look_at(work, name) for name in names]
    ways = [look_into(work, names[0]), stand_back(work, *names)]
    return ways if "container" in call.arguments else ways[::-1]


def done_at(work: Work, call: SkillCall) -> list[str]:
    """What to look at to see that a call is done: what both hands hold; or where it was done, and the thing there.

    Nothing where that is not known, or is in a hand, whose own camera sees it.
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
            names.append(min(found, key=lambda e: float(np.linalg.norm(e.center - at))).name)
    return names
