"""Search for things by sight: around the robot, then from other places, then from any free place."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import chain

import numpy as np

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.collision import Obstacles
from mpvi_bt.ground.robot.motion import Actions, MotionFailure
from mpvi_bt.hands.motion.both_hands import look_over
from mpvi_bt.hands.motion.gaze import look_down
from mpvi_bt.hands.motion.viewpoints import VIEWS, Look, climb, drive_straight, elsewhere, look_from
from mpvi_bt.hands.motion.work import Work


@dataclass(frozen=True)
class SearchViews:
    """Where the robot looks, and drives to, while it searches.

    Our choice: the work is mostly ahead.
    """

    # lift [m] and tilt of the head [rad], with empty hands: down, near, ahead, and into compartments low and high
    looks: tuple[tuple[float, float], ...] = (
        (0.42, 0.55),
        (0.42, 0.95),
        (0.42, 0.10),
        (0.05, 0.40),
        (0.05, -0.10),
        (0.55, -0.30),
    )
    # turns of the base from its first heading [rad], each with its number of looks
    turns: tuple[tuple[float, int], ...] = ((0.0, 6), (0.6, 6), (-0.6, 6), (-1.8, 2), (3.0, 2), (1.8, 2))
    elsewhere: int = 4  # looks at each place that it strolls to
    again: int = 3  # looks at another side of a known place
    strolls: int = 40  # random places that it drives to after that
    stroll_m: tuple[float, float] = (0.5, 1.5)  # least and largest distance of such a place [m]


_LOOK = SearchViews()
Found = Callable[[], bool]


def look_for(work: Work, found: Found, passable: Callable[[], Obstacles]) -> Look:
    """Look until `found` says so.

    It looks around from where it stands, then from other sides of the place before it, as far as the way there is seen
    to be free, then strolls about at random. It keeps no map: what was looked at once may be looked at again.

    Args:
        work: Robot and scene.
        found: Asked after every picture.
        passable: Says what is known to be in the way of the base.

    Returns:
        Whether it was found before there was nowhere else to go.
    """
    yield from look_over(work)
    start, before_m = work.motion.felt.base_pose.copy(), VIEWS.elsewhere_m[0]

    def turned(turn: float, looks: int) -> Look:
        if turn:
            with contextlib.suppress(MotionFailure):  # what it does not turn to it does not see
                yield from work.motion.drive(start + [0, 0, turn])
        return (yield from _look(work, found, looks))

    def gone_to(goal: Array) -> Look:
        way = drive_straight(work, goal, passable())
        return (yield from way) and (yield from _look(work, found, _LOOK.elsewhere))

    place = start[:2] + before_m * np.array([np.cos(start[2]), np.sin(start[2])])
    goals = chain(elsewhere(place, float(start[2]), before_m), _strolls(work))
    return (yield from climb(chain((turned(*each) for each in _LOOK.turns), map(gone_to, goals))))


def look_from_elsewhere(work: Work, place: Array, passable: Callable[[], Obstacles]) -> Actions:
    """Go to look at a place (2,) from the first other side to which the way is seen to be free; stay where none is.

    What stands out from the place, such as its door, may be in the way near it: then it looks from farther off.
    """
    here = work.motion.felt.base_pose
    bearing = float(np.arctan2(place[1] - here[1], place[0] - here[0]))
    around = passable()
    goals = chain.from_iterable(elsewhere(place, bearing, far) for far in VIEWS.elsewhere_m)
    ways = (drive_straight(work, goal, around) for goal in goals)
    yield from climb(look_from(way, _look(work, lambda: False, _LOOK.again)) for way in ways)


def _look(work: Work, found: Found, looks: int) -> Look:
    held = bool(work.in_hands())
    for lift, tilt in _LOOK.looks[:looks]:
        robot = work.motion.robot
        torso = robot.trunk.joints(np.array([lift, 0.0, 0.0, tilt]))
        if held:
            torso = work.motion.bent(tilt=float(np.clip(tilt - work.motion.posture[2], *robot.trunk.limits[3])))
        with contextlib.suppress(MotionFailure):  # a picture from where it got to shows something, too
            yield from work.motion.stand(torso)
            if not robot.nods:
                yield from look_down(work, tilt)
        yield from work.see("head")
        if found():
            return True
    return False


def _strolls(work: Work) -> Iterator[Array]:
    """Base poses (3,) somewhere about the robot, each drawn when the one before has been gone to or found blocked."""
    for _ in range(_LOOK.strolls):
        here = work.motion.felt.base_pose
        heading, far = here[2] + work.rng.uniform(-np.pi, np.pi), work.rng.uniform(*_LOOK.stroll_m)
        yield np.array([here[0] + far * np.cos(heading), here[1] + far * np.sin(heading), kin.wrap(heading)])
