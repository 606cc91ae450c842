"""Looks into what something is to be put in."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from mpvi_bt.ground.robot.motion import MotionFailure
from mpvi_bt.ground.robot.protocol import Side
from mpvi_bt.hands.motion.door_views import stand_before_open
from mpvi_bt.hands.motion.gaze import study
from mpvi_bt.hands.motion.hold_out import present
from mpvi_bt.hands.motion.viewpoints import Look, around, drive_by_known, look_from
from mpvi_bt.hands.motion.work import Work


@dataclass(frozen=True)
class Insides:
    """Which looks into a container are worth it, and where a hand holds it out."""

    same: float = 0.05  # viewpoints this close to each other show the same [m, rad]; our choice
    held_out: tuple[int, ...] = (0, 3, 6)  # poses before the body where a hand holds it out; our choice


_VIEWS = Insides()


def looks_inside(work: Work, name: str) -> Iterator[Look]:
    """Looks into a container, one after the other, for as long as no room has been found in it.

    It may have been seen in part, from the side, or past a payload. The order of viewpoints: where the robot stands, if
    it knows of no volume at all; before a door that stands open; turned to the container and, if there is still no
    volume, to both sides; farther off; around it. Some scenes need no looks. The head looks at a container in a hand
    first where it is. Then the hand holds it out before the head, because its rim may have been out of view.
    """
    yield _from_here(work, name)
    if not work.scene.needs_looks:
        return
    if (side := next((s for s in work.motion.robot.sides if work.scene.holding(s) == name), None)) is not None:
        for turn in _VIEWS.held_out:
            yield _held_out(work, side, name, turn)
    elif name not in work.carried():
        yield _from_before(work, name)
        for goal in around(work, name):
            yield look_from(drive_by_known(work, name, goal), study(work, name))


def _from_here(work: Work, name: str) -> Look:
    if not work.scene.volumes(name):
        yield from study(work, name)
    return True


def _held_out(work: Work, side: Side, name: str, turn: int) -> Look:
    try:
        yield from present(work, side, turn)
    except MotionFailure:
        return False
    yield from study(work, name)
    return True


def _from_before(work: Work, name: str) -> Look:
    here, known = work.motion.felt.base_pose.copy(), bool(work.scene.volumes(name))
    with suppress(MotionFailure):
        yield from stand_before_open(work, name)
    return not (known and np.allclose(work.motion.felt.base_pose, here, atol=_VIEWS.same))
