"""Places to look from into what something is to be put in."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.solids import Array, bounds
from mpvi_bt.ground.robot.motion import MotionFailure
from mpvi_bt.ground.robot.protocol import Side
from mpvi_bt.hands.motion.gaze import study
from mpvi_bt.hands.motion.hold_out import present
from mpvi_bt.hands.motion.work import Work
from mpvi_bt.hands.skills.openings import FACING_RAD, stand_before_open


@dataclass(frozen=True)
class Viewpoints:
    """Where a container is looked into from."""

    same: float = 0.05  # viewpoints this close to each other show the same [m, rad]; our choice
    # turns of the base from facing the thing [rad]; the picture may have shown an end of a large one; our choice
    turns_rad: tuple[float, ...] = (0.0, 0.6, -0.6)
    around_rad: tuple[float, ...] = (0.0, 0.7, -0.7, 1.2, -1.2)  # bearings around the thing [rad]; our choice
    off_m: float = 1.0  # distance from its nearest face, where a payload does not hide it [m]; our choice
    held_out: tuple[int, ...] = (0, 3, 6)  # poses before the body where a hand holds it out; our choice


_VIEWS = Viewpoints()
Look = Generator[Array, None, bool]  # returns whether there was a way to look from there


def looks_inside(work: Work, name: str) -> Iterator[Look]:
    """Looks into a container, one after the other, for as long as no room has been found in it.

    It may have been seen in part, from the side, or past a payload. The order of viewpoints: where the robot stands, if
    it knows of no volume at all; before a door that stands open; turned to the container and, if there is still no
    volume, to both sides; farther off; around it. Some scenes need no looks. A container in a hand is looked at
    where it is, and then held out before the head, which may not have its rim in view where it is carried.
    """
    yield _from_here(work, name)
    if not work.scene.needs_looks:
        return
    if (side := next((s for s in work.motion.robot.sides if work.scene.holding(s) == name), None)) is not None:
        for turn in _VIEWS.held_out:
            yield _held_out(work, side, name, turn)
    elif name not in work.carried():
        yield _from_before(work, name)
        for goal in _viewpoints(work, name):
            yield _from(work, name, goal)


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


def _from(work: Work, name: str, goal: Array) -> Look:
    with work.scene.trusting(remembering=True):
        route = work.search("right", {name}).route(work.motion.felt.base_pose.copy(), goal)
    try:
        for base in route or ():
            yield from work.motion.drive(base)
    except MotionFailure:  # something that no picture showed
        return False
    if route is not None:
        yield from study(work, name)
    return route is not None


def _viewpoints(work: Work, name: str) -> Iterator[Array]:
    """Base poses (3,) to look at a thing from, as it is known when the next one is asked for."""
    start = work.motion.felt.base_pose.copy()
    for turn in _VIEWS.turns_rad:
        ahead = work.middle(name)[:2] - start[:2]
        goal = np.append(start[:2], kin.wrap(np.arctan2(ahead[1], ahead[0]) + turn))
        if not (work.scene.volumes(name) if turn else abs(kin.wrap(goal[2] - start[2])) < FACING_RAD):
            yield goal
    for around in _VIEWS.around_rad:
        box = bounds(work.scene.solids(name))[:, :2]
        middle, half = box.mean(0), np.ptp(box, axis=0) / 2
        bearing = float(np.arctan2(*(start[:2] - middle)[::-1])) + around
        out = np.array([np.cos(bearing), np.sin(bearing)])
        far = float(np.min(half / np.maximum(np.abs(out), 1e-6))) + _VIEWS.off_m
        yield np.append(middle + far * out, kin.wrap(bearing + np.pi))
