"""Looks at doors, drawers and lids: from a second side, past a hinge, from before a face."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from mpvi_bt.finding.shapes.moving_parts import Door, lid, moved, outward, panel
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.motion import Actions, MotionFailure
from mpvi_bt.hands.motion.viewpoints import Look, drive_around, look_from_aside, look_over
from mpvi_bt.hands.motion.work import Work


@dataclass(frozen=True)
class DoorViews:
    """Where doors are looked at from, and which of them are the same.

    Our choice, by kitchen furniture.
    """

    beside_rad: float = 1.5  # turn from facing a door that shows the room beside the base on the hinge's side [rad]
    down_rad: float = 0.5  # tilt of the head for that look [rad]
    before_m: float = 1.1  # distance to stand before a face [m]
    stage_rad: float = 0.6  # angle between two looks on the way around a thing [rad]
    same_m: float = 0.15  # largest distance between the middles of one door that is seen twice [m]
    same: float = 0.2  # largest difference of its opening [ratio of its limit]
    ajar: float = 0.5  # opening from which the inside is seen [ratio of its limit]


_VIEWS = DoorViews()


def seen_twice(work: Work, thing: str, doors: Sequence[Door]) -> Look:
    """Look at doors from another side, for from one alone an open door may look closed and a closed one open.

    Returns:
        Whether they stand there as they did. The truth needs no second look, nor is there one without a way.
    """
    if not (yield from look_from_aside(work, thing)):
        return True
    now = work.scene.doors(thing)
    return all(any(stands_as(door, other) for other in now) for door in doors)


def look_beside(work: Work, door: Door) -> Actions:
    """Look past the hinge of a door: an upright one leads the base there, and what is there was not in view so far."""
    x, y, _ = work.motion.felt.base_pose
    shut, face = moved(door, -door.position), panel(door)
    out = matmul(shut[:3, :3], outward(door))
    toward_hinge = door.origin - matmul(shut[:3, :3], face.T[:3, 3]) - shut[:3, 3]
    left = float(np.sign(np.cross(toward_hinge, out)[2]))
    with suppress(MotionFailure):  # a base that cannot turn there has its picture all the same
        yield from work.motion.drive(np.array([x, y, np.arctan2(-out[1], -out[0]) + left * _VIEWS.beside_rad]))
    yield from work.motion.stand(work.motion.bent(tilt=_VIEWS.down_rad))
    yield from work.see("head")


def stands_as(a: Door, b: Door) -> bool:
    """Whether two doors, seen one after the other, are the same and as far open."""
    apart = float(norm(panel(a).T[:3, 3] - panel(b).T[:3, 3]))
    return apart < _VIEWS.same_m and abs(a.position / a.limit - b.position / b.limit) < _VIEWS.same


def stand_before(work: Work, thing: str, face: Array, out: Array, door: Door | None = None) -> Look:
    """Walk around a thing, as far as the way is free, to before a place (3,) on a face of it that looks `out` (3,).

    No farther, if that is the face of a `door`, once a look on the way shows that to stand otherwise. Returns whether
    the way was free so far.
    """
    middle = work.middle(thing)[:2]
    x, y, _ = work.motion.felt.base_pose
    goal = (face + _VIEWS.before_m * out)[:2] - middle
    bearing = float(np.arctan2(y - middle[1], x - middle[0]))
    left = float(kin.wrap(np.arctan2(goal[1], goal[0]) - bearing))
    stages = int(np.ceil(abs(left) / _VIEWS.stage_rad))
    for k in range(1, stages + 1):
        if not (yield from drive_around(work, thing, middle, bearing + left * k / stages)):
            return False
        yield from work.see("head")
        if door is not None and _otherwise(work, thing, door):
            yield from look_over(work, thing)  # one picture may err
            if _otherwise(work, thing, door):
                break
    return True


def stand_before_open(work: Work, thing: str) -> Actions:
    """Look into what stands open, from before its front: from beside it only the door, or a side, may be seen."""
    hinged = [door for door in work.scene.doors(thing) if door.kind == "hinge" and not lid(door)]
    ajar = [door for door in hinged if door.position > _VIEWS.ajar * door.limit]
    if ajar and work.scene.needs_looks:
        yield from stand_before_front(work, thing, ajar[0])
        yield from look_over(work, thing)


def stand_before_front(work: Work, thing: str, door: Door) -> Actions:
    """Walk around a thing, as far as the way is free, to before where a door of it is when it is closed."""
    shut = moved(door, -door.position)
    face = matmul(shut[:3, :3], panel(door).T[:3, 3]) + shut[:3, 3]
    yield from stand_before(work, thing, face, matmul(shut[:3, :3], outward(door)))


def _otherwise(work: Work, thing: str, door: Door) -> bool:
    now = work.scene.doors(thing)
    return bool(now) and not any(stands_as(door, other) for other in now)
