"""Going to a stance: looking on the way, taking up the posture, correcting it for what is seen there, coming away."""

from __future__ import annotations

from collections.abc import Callable, Collection, Generator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot import arm_motion
from mpvi_bt.ground.robot.motion import GRIP, Actions, MotionFailure
from mpvi_bt.ground.robot.protocol import Side
from mpvi_bt.hands.motion.gaze import studied, study
from mpvi_bt.hands.motion.work import Work
from mpvi_bt.hands.stance.stance import Option, Stance
from mpvi_bt.hands.stance.stance_search import Search

_Found = TypeVar("_Found")
LEGS = 2  # our choice: drives around what is out of reach


@dataclass(frozen=True)
class Approach:
    """How a stance is approached."""

    looks: int = 4  # looks at a thing that is only seen, with a drive between two; our choice
    spared: float = 0.5  # part of the effort kept for the search that trusts hidden space [ratio]; our choice
    pause_s: float = 10.0  # wait before a new search, to earn its effort [s]; short searches see too little; our choice
    refined: int = 10  # candidates near the planned one that a correction may take instead; our choice
    corrected: float = 0.8  # largest distance of such a candidate, see `_apart`; our choice
    inward_m_s: float = 0.25  # base speed with the arm stretched out [m/s]; our choice


APPROACH = Approach()


@dataclass(frozen=True)
class Feeling:
    """How a hand feels its way onto something."""

    speed_m_s: float = 0.06  # speed of the hand until something stops it [m/s]; a faster one pushes more; our choice
    back_m_s: float = 0.12  # speed of the hand that retreats from what it has touched [m/s]; our choice
    calm_s: float = 0.4  # rest before it [s]; an arm that still swings feels false contacts; our choice
    pressed_s: float = 0.4  # duration of a press [s]; a switch needs half (`states.switches.PRESSED_STEPS`); our choice


FEEL = Feeling()


def approach(
    work: Work, side: Side, name: str, options: Callable[[], Sequence[Option]], tried: list[Array]
) -> Generator[Array, None, tuple[Stance, Search]]:
    """Find a stance to work on a thing from, and its search; the base need not have moved there yet.

    Where the scene is only seen, it looks before it searches, drives, looks from near, and searches again from there,
    so that what it returns rests on what was seen from where it stands.

    Args:
        work: Robot and world.
        side: The hand.
        name: The thing.
        options: Says what there is to do, as the thing is known at that time.
        tried: Base poses that did not do; those taken are added.

    Raises:
        MotionFailure: "no_stance", or a drive's own reason.
    """

    def find(search: Search, here_first: bool) -> Stance | None:
        return search.find(work.scene.pose(name)[:2, 3], options(), here_first)

    return (yield from close_in(work, side, work.along(name), name, find, tried))


def close_in(
    work: Work, side: Side, touched: Collection[str], about: str | None,
    find: Callable[[Search, bool], Stance | None], tried: list[Array],
) -> Generator[Array, None, tuple[Stance, Search]]:  # fmt: skip
    """As `approach`, with `find` to search for a stance, the present one first if it is told so.

    Args:
        work: Robot and world.
        side: The hand.
        touched: Things that it works on.
        about: The thing to look at; None to look at the floor ahead.
        find: Finds a stance, or None.
        tried: Base poses that did not do; those taken are added.

    Raises:
        MotionFailure: As `approach`.
    """
    trusting = False  # once the benefit of the doubt was needed it stays given, or every look finds another stance
    for looks in range(APPROACH.looks):
        if looks or not studied(work, about):
            yield from study(work, about)
        search = replace(work.search(side, touched), tried=list(tried))
        with work.effort.sparing(APPROACH.spared if work.scene.needs_looks else 0.0):
            stance = None if trusting else find(search, looks > 0)
        if stance is None and work.effort.left <= 0:
            yield from work.motion.wait(APPROACH.pause_s)
            stance = None if trusting else find(search, looks > 0)
        if stance is None and work.scene.needs_looks:
            with work.scene.trusting(remembering=True):  # the base goes where little is in view from here
                underfoot = work.search(side, touched).obstacles
            with work.scene.trusting():
                trusted = work.search(side, touched).obstacles
                search = replace(search, obstacles=trusted, underfoot=underfoot, trusting=True)
                stance = find(search, looks > 0)
                trusting = True
        if stance is None:
            raise work.no_stance()
        tried.append(stance.base)
        away = stance.route[-1] - work.motion.felt.base_pose
        if not work.scene.needs_looks or (norm(away[:2]) < 0.02 and abs(kin.wrap(away[2])) < 0.03):
            break
        if looks < APPROACH.looks - 1:
            for base in stance.route:
                yield from work.motion.drive(base)
    assert stance is not None
    return stance, search


def go_around(work: Work, place: Array, been: list[Array]) -> Generator[Array, None, bool]:
    """Drive around what stands before a place, or on to where more about it is known; whether there was such a way.

    What lies on the far side of a table is out of reach from the near one, what stands in a car's trunk from beside it.

    Args:
        work: Robot and world.
        place: (2,) in the world.
        been: Base poses (3,) from where it was out of reach; this one is added.

    Raises:
        MotionFailure: A drive's own reason.
    """
    way = work.search("right", ()).go_around(place, been)
    been.append(work.motion.felt.base_pose.copy())
    for base in way or ():
        yield from work.motion.drive(base)
    return way is not None


def going_around(
    work: Work, about: str | Array, attempt: Callable[[], Generator[Array, None, _Found]]
) -> Generator[Array, None, _Found]:
    """Attempt something; if there is no stance for it, drive around the obstacles before it, and attempt it again.

    Args:
        work: Robot and world.
        about: The thing to drive around to, or its place (3,) in the world.
        attempt: What is done.

    Raises:
        MotionFailure: As the last attempt, or a drive's own reason.
    """
    been: list[Array] = []
    for _ in range(LEGS):
        place = work.middle(about) if isinstance(about, str) else about  # before it may be no more, as a chopped log
        try:
            return (yield from attempt())
        except MotionFailure as failure:
            if failure.reason != "no_stance" or not (yield from go_around(work, place[:2], been)):
                raise
    return (yield from attempt())


def _refined(work: Work, side: Side, stance: Stance, options: Sequence[Option]) -> Stance:
    """A stance whose arm is at its first waypoint, with the waypoints of the option that is now nearest to it.

    What a look from there has corrected is corrected; the stance itself if no line leads to any such option.
    """
    planned = matmul(work.base, work.motion.robot.tcp(work.motion.torso, work.motion.arm(side), side))
    to_base = kin.inverse(work.base)
    lift = stance.waypoints[-1][2, 3] - stance.waypoints[-2][2, 3]
    alike = [o for o in options if abs(o.waypoints[-1][2, 3] - o.waypoints[-2][2, 3] - lift) < 0.005]
    for option in sorted(alike, key=lambda o: _apart(planned, o.waypoints[0]))[: APPROACH.refined]:
        if _apart(planned, option.waypoints[0]) > APPROACH.corrected:
            break
        waypoints, q = matmul(to_base, option.waypoints), work.motion.arm(side)
        for T in waypoints:
            line = arm_motion.trace(work.motion.robot, work.motion.torso, side, q, T)
            if line is None:
                break
            q = line[-1]
        else:
            return replace(stance, base=work.motion.felt.base_pose.copy(), waypoints=waypoints)
    return stance


def take_up(work: Work, stance: Stance, search: Search) -> Actions:
    """Go to a stance: drive, the other hand aside, the torso, the arm to the first waypoint, then straight in."""
    for base in stance.route:
        yield from work.motion.drive(base)
    if search.other is not None and len(stance.aside) > 1:
        yield from work.motion.follow(search.other, stance.aside, speed=0.8)
    yield from work.motion.stand(stance.torso, stance.level)
    yield from work.motion.follow(search.side, stance.path)
    if stance.runs_up:
        yield from work.motion.drive(stance.base, APPROACH.inward_m_s)


def arrive(
    work: Work, stance: Stance, search: Search, options: Callable[[], Sequence[Option]]
) -> Generator[Array, None, Stance]:
    """Take up a stance and, where poses may be off, look from the hand and correct what is left to do."""
    yield from take_up(work, stance, search)
    if not work.scene.pose_error_m:
        return stance
    yield from work.see(search.side)
    return _refined(work, search.side, stance, options())


def lines(work: Work, side: Side, stance: Stance, waypoints: Sequence[int], speed: float = 0.16) -> Actions:
    """Straight lines through some of a stance's waypoints, corrected for where the base really stands."""
    shift = matmul(kin.inverse(work.base), kin.base(stance.base))
    for k in waypoints:
        yield from work.motion.line(side, matmul(shift, stance.waypoints[k]), speed)


def leave(work: Work, stance: Stance) -> Actions:
    """Out again, the way that the base drove straight in."""
    if stance.runs_up:
        yield from work.motion.drive(stance.route[-1], APPROACH.inward_m_s)


def withdraw(work: Work, side: Side, stance: Stance) -> Actions:
    """After a failure at a stance: back to its first waypoint, then out; a hand that holds nothing is opened."""
    if not work.gripped(side):
        yield from work.motion.grip(side, 1.0, GRIP.clear_s)
    with suppress(MotionFailure):
        yield from lines(work, side, stance, [0])
    with suppress(MotionFailure):
        yield from leave(work, stance)


def _apart(T: Array, other: Array) -> float:
    """How far two hand poses (4, 4) are apart: their angle [rad], and 5 cm count as a tenth of one."""
    turn = float(np.arccos(np.clip((np.trace(matmul(T[:3, :3].T, other[:3, :3])) - 1) / 2, -1, 1)))
    return turn + 2 * float(norm(T[:3, 3] - other[:3, 3]))
