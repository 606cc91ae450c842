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


def stand_back(work: Work, name: str) -> Actions:
    """Look at a thing upright from a little farther off: with what is above and beside it. Raises as any motion."""
    yield from back_off(work)
    if not work.held():
        yield from work.motion.stand(np.append(work.motion.robot.travel_torso[:3], work.motion.torso[3]))
    yield from look_at(work, name)


def views(work: Work, name: str) -> list[Actions]:
    """Ways to look at a thing, one after the other; what both hands hold is only looked at."""
    if name == work.scene.between():
        return [look_at(work, name)]
    return [look_into(work, name), stand_back(work, name)]


def done_at(work: Work, call: SkillCall) -> str | None:
    """What to look at to see that a call is done: what both hands hold, or where it was to be done.

    None where that is not known, or is in a hand, whose own camera sees it.
    """
    if (between := work.scene.between()) is not None:
        return between
    known, carried = work.scene.knowledge(), work.carried()
    for phrase in (call.arguments[slot] for slot in _WHERE if slot in call.arguments):
        if not is_floor(phrase) and (found := known.find(phrase)):
            return None if any(e.name in carried for e in found) else work.same(phrase)
    return None
