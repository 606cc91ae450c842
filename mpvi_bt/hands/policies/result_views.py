"""Views of the result for the checker, which sees the head's pictures: what one view hides, another may show."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from mpvi_bt.executive.plan.skills import SkillCall
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.motion import Actions
from mpvi_bt.hands.motion.carry import back_off, upright
from mpvi_bt.hands.motion.gaze import look_at, look_into
from mpvi_bt.hands.motion.work import Work
from mpvi_bt.hands.skills.spots import is_floor
from mpvi_bt.hands.stance.site import base_clear

_WHERE = ("container", "surface", "target", "object")  # slots that name what to look at, the first that does


@dataclass(frozen=True)
class ResultViews:
    """Where the result of the work is looked at from."""

    from_m: tuple[float, ...] = (0.5, 0.6, 0.7, 0.8)  # distances of a look into a thing from its middle [m]; our choice
    from_rad: tuple[float, ...] = (0.0, 0.4, -0.4, 0.8, -0.8, 1.2, -1.2)  # bearings of these looks [rad]; our choice
    step_m: float = 0.1  # distance between two checks of the way there [m]; our choice
    beside_m: float = 0.15  # largest distance from a container's box to a dropped thing that missed it [m]; our choice


_SHOW = ResultViews()


def step_up(work: Work, name: str) -> Actions:
    """Look into a thing from the nearest place that there is a straight way to: its near wall hides what is behind it.

    Raises as any motion.
    """
    here, near, body, place = work.motion.felt.base_pose, work.near(), work.body(), work.middle(name)[:2]
    bearing, gap = float(np.arctan2(*(place - here[:2])[::-1])), float(norm(place - here[:2]))

    def clear(pose: Array) -> bool:
        around = near.seen_from(kin.base(pose))
        return base_clear(body.robot, around) and replace(body, around=around).all_free()

    for far, turn in product((m for m in _SHOW.from_m if m < gap), _SHOW.from_rad):
        heading = bearing + turn
        goal = np.array([*(place - far * np.array([np.cos(heading), np.sin(heading)])), heading])
        way = goal - here
        way[2] = kin.wrap(way[2])
        steps = 1 + int(norm(way[:2]) / _SHOW.step_m)
        if all(clear(here + u * way) for u in np.linspace(1, 0, steps, endpoint=False)):
            yield from work.motion.drive(goal)
            break
    yield from look_into(work, name)


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
    known = work.scene.knowledge()
    into = [e for e in known.find(call.arguments["container"]) if e.kind == "object"]
    left = [e for e in known.find(call.arguments["object"]) if e.inside is None and not e.held]
    gaps = [float(norm(e.center - np.clip(e.center, c.lowest, c.highest))) for e in left for c in into]
    return min(gaps, default=_SHOW.beside_m) < _SHOW.beside_m


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
            names.append(min(found, key=lambda e: float(norm(e.center - at))).name)
    return names
