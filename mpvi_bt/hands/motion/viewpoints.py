"""Go and look: viewpoints of a thing, the way to each, and one look after the other until one is enough.

All sequences of looks are built here: over the front of a thing, from the side, into it, from elsewhere, from close by.
"""

from __future__ import annotations

from collections.abc import Generator, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import norm
from mpvi_bt.ground.geometry.solids import Array, bounds
from mpvi_bt.ground.robot.collision import Body, Obstacles
from mpvi_bt.ground.robot.motion import Actions, MotionFailure
from mpvi_bt.hands.motion.gaze import look_into, study
from mpvi_bt.hands.motion.work import Work
from mpvi_bt.hands.stance.base_search import about
from mpvi_bt.hands.stance.site import base_clear


@dataclass(frozen=True)
class Viewpoints:
    """Base poses to look at things from."""

    facing_rad: float = 0.15  # a thing is faced if it is less far off straight ahead [rad]; our choice
    looks: int = 2  # looks at a whole front, with a turn between them; the first shows where its middle is; our choice
    # bearings off the present one that may show the outside of an open door [rad]; our choice
    aside_rad: tuple[float, ...] = (0.7, -0.7, 1.2, -1.2)
    aside_m: float = 1.2  # least distance on the way around a thing [m]; our choice
    # turns of the base from facing a thing to look into it; a picture may have shown one end only [rad]; our choice
    turned_rad: tuple[float, ...] = (0.0, 0.6, -0.6)
    inside_rad: tuple[float, ...] = (0.0, 0.7, -0.7, 1.2, -1.2)  # bearings of looks into a thing [rad]; our choice
    inside_m: float = 1.0  # their distance from its nearest face, where a payload does not hide it [m]; our choice
    # other bearings of looks at a place [rad]; our choice
    elsewhere_rad: tuple[float, ...] = (0.9, -0.9, 1.6, -1.6, 2.4, -2.4)
    elsewhere_m: tuple[float, ...] = (0.9, 1.3, 1.8)  # their distances [m]; our choice: first as navigation hands over
    elsewhere_step_m: float = 0.15  # distance between two checks of the way there [m]; our choice
    near_m: tuple[float, ...] = (0.5, 0.6, 0.7, 0.8)  # distances of a close look into a thing [m]; our choice
    near_rad: tuple[float, ...] = (0.0, 0.4, -0.4, 0.8, -0.8, 1.2, -1.2)  # bearings of these looks [rad]; our choice
    near_step_m: float = 0.1  # distance between two checks of the way there [m]; our choice


VIEWS = Viewpoints()
Look = Generator[Array, None, bool]  # returns whether the look was enough, or the way free


def climb(looks: Iterable[Look]) -> Look:
    """Take one look after the other until one is enough; returns whether one was."""
    for look in looks:
        if (yield from look):
            return True
    return False


def look_from(way: Look, look: Actions | Look) -> Look:
    """Drive a way and look at its end; returns whether the way was free."""
    if not (yield from way):
        return False
    yield from look
    return True


def drive_by_known(work: Work, thing: str, goal: Array) -> Look:
    """Drive to a viewpoint (3,) of a thing, if a way there is known; returns whether it was free."""
    with work.scene.trusting(remembering=True):
        route = work.search("right", {thing}).route(work.motion.felt.base_pose.copy(), goal)
    try:
        for base in route or ():
            yield from work.motion.drive(base)
    except MotionFailure:  # something that no picture showed
        return False
    return route is not None


def drive_around(work: Work, thing: str, middle: Array, bearing: float) -> Look:
    """Drive around the middle (2,) of a thing to a bearing [rad] and face it; returns whether the way was free."""
    far = max(VIEWS.aside_m, float(norm(work.motion.felt.base_pose[:2] - middle)))
    return (yield from drive_by_known(work, thing, _facing(middle, bearing, far)))


def drive_straight(work: Work, goal: Array, around: Obstacles) -> Look:
    """Drive to a viewpoint (3,) if the straight way is clear of obstacles; returns whether it was."""
    here, around = work.motion.felt.base_pose, work.with_bumps(around)
    way = goal[:2] - here[:2]
    count = max(2, int(np.ceil(norm(way) / VIEWS.elsewhere_step_m)))
    poses = [np.array([*(here[:2] + way * u), goal[2]]) for u in np.linspace(0, 1, count + 1)[1:]]
    if not _clear(work, poses, around):
        return False
    with suppress(MotionFailure):
        yield from work.motion.drive(goal)
    return True


def elsewhere(place: Array, bearing: float, far_m: float) -> Iterator[Array]:
    """Viewpoints (3,) of a place (2,) on other sides than the one that sees it at this bearing [rad]."""
    for turn in VIEWS.elsewhere_rad:
        yield about(place, float(kin.wrap(bearing + turn)), far_m, 0.0)


def around(work: Work, name: str) -> Iterator[Array]:
    """Viewpoints (3,) to look into a thing: here, facing it and turned to both sides; then around it.

    Each uses what is known of the thing by then; a known volume makes the turns to both sides needless.
    """
    start = work.motion.felt.base_pose.copy()
    for turn in VIEWS.turned_rad:
        ahead = work.middle(name)[:2] - start[:2]
        goal = np.append(start[:2], kin.wrap(np.arctan2(ahead[1], ahead[0]) + turn))
        if not (work.scene.volumes(name) if turn else abs(kin.wrap(goal[2] - start[2])) < VIEWS.facing_rad):
            yield goal
    for turn in VIEWS.inside_rad:
        box = bounds(work.scene.solids(name))[:, :2]
        middle, half = box.mean(0), np.ptp(box, axis=0) / 2
        bearing = float(np.arctan2(*(start[:2] - middle)[::-1])) + turn
        out = np.array([np.cos(bearing), np.sin(bearing)])
        yield _facing(middle, bearing, float(np.min(half / np.maximum(np.abs(out), 1e-6))) + VIEWS.inside_m)


def look_over(work: Work, thing: str) -> Actions:
    """See the whole front of a thing: look, turn to its middle, look again. Nothing if the scene needs no looks."""
    if not work.scene.needs_looks:
        return
    for looks in range(VIEWS.looks):
        middle = work.middle(thing)[:2]
        x, y, yaw = work.motion.felt.base_pose
        bearing = float(np.arctan2(middle[1] - y, middle[0] - x))
        if abs(kin.wrap(bearing - yaw)) > VIEWS.facing_rad:
            yield from work.motion.drive(np.array([x, y, bearing]))
        elif looks:
            return
        yield from study(work, thing)


def look_from_aside(work: Work, thing: str) -> Look:
    """Look at a thing from another side; returns whether it did. Nothing if the scene needs no looks."""
    if not work.scene.needs_looks:
        return False
    x, y, _ = work.motion.felt.base_pose
    middle = work.middle(thing)[:2]
    bearing = float(np.arctan2(y - middle[1], x - middle[0]))
    ways = (drive_around(work, thing, middle, bearing + turn) for turn in VIEWS.aside_rad)
    return (yield from climb(look_from(way, look_over(work, thing)) for way in ways))


def step_up(work: Work, name: str) -> Actions:
    """Look into a thing from the nearest viewpoint with a straight way: its near wall hides what is behind it.

    Raises as any motion.
    """
    here, near, body, place = work.motion.felt.base_pose, work.near(), work.body(), work.middle(name)[:2]
    bearing, gap = float(np.arctan2(*(place - here[:2])[::-1])), float(norm(place - here[:2]))

    def drive_up(far: float, turn: float) -> Look:
        goal = about(place, bearing + turn, far, 0.0)
        way = goal - here
        way[2] = kin.wrap(way[2])
        steps = 1 + int(norm(way[:2]) / VIEWS.near_step_m)
        if not _clear(work, (here + u * way for u in np.linspace(1, 0, steps, endpoint=False)), near, body):
            return False
        yield from work.motion.drive(goal)
        return True

    yield from climb(drive_up(*at) for at in product((m for m in VIEWS.near_m if m < gap), VIEWS.near_rad))
    yield from look_into(work, name)


def _facing(place: Array, bearing: float, far_m: float) -> Array:
    """The base pose (3,) that faces a place (2,) from a bearing [rad]."""
    out = np.array([np.cos(bearing), np.sin(bearing)])
    return np.append(place + far_m * out, float(kin.wrap(bearing + np.pi)))


def _clear(work: Work, poses: Iterable[Array], around: Obstacles, body: Body | None = None) -> bool:
    """Whether the base is clear of obstacles at all of these base poses (3,), and so is the body, if given."""
    there = (around.seen_from(kin.base(pose)) for pose in poses)
    return all(
        base_clear(work.motion.robot, near) and (body is None or replace(body, around=near).all_free())
        for near in there
    )
