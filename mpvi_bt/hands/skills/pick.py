"""Take hold of a thing with one hand, lift it, bring it to the chest."""

from __future__ import annotations

from collections.abc import Callable, Generator
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.collision import Load
from mpvi_bt.ground.robot.motion import GRIP, Actions, MotionFailure
from mpvi_bt.ground.robot.protocol import SIDES, Side
from mpvi_bt.ground.words.phrases import OTHER, normalize
from mpvi_bt.hands.motion.approach import LEGS, approach, arrive, go_around, leave, lines, withdraw
from mpvi_bt.hands.motion.carry import back_off, settle
from mpvi_bt.hands.motion.work import NEAR_M, Words, Work
from mpvi_bt.hands.skills.draw_out import draw_out
from mpvi_bt.hands.stance.grasps import grasps
from mpvi_bt.hands.stance.stance import Option, Stance
from mpvi_bt.hands.stance.stance_search import Search


@dataclass(frozen=True)
class Lifting:
    """How a hand closes in on a thing and lifts it, and when it holds it."""

    # standoff before the grasp, lift after it, run-up of the base [m] and cost of each way; our choice
    ways: tuple[tuple[float, float, float, float], ...] = (
        (0.10, 0.15, 0.0, 0.0),
        (0.10, 0.06, 0.0, 0.1),
        (0.05, 0.06, 0.0, 0.2),
        (0.10, 0.03, 0.4, 0.3),
        (0.10, 0.03, 0.25, 0.4),
    )
    slanted_rad: float = 0.8  # least tilt of the approach from straight down for ways with a run-up [rad]; our choice
    off_m: float = 0.055  # a payload this far above where it lay is lifted [m]; our choice
    away_m: float = 0.20  # a payload this far aside is lifted [m]; tipped in the hand it moves by less; our choice
    alike: int = 4  # things of the name that are tried, the nearest first; our choice
    board_m: float = 0.03  # distance to a board, or the top of a compartment, that covers a hand [m]; our choice
    above_m: tuple[float, float] = (0.1, 1.2)  # heights above the hand where a board is looked for [m]; our choice
    step_m: float = 0.04  # step between these heights [m]; our choice


_LIFT = Lifting()


Ways = Callable[[Work, str], list[Option]]  # to take hold of a thing
Take = Callable[[Work, str, Side, list[Array]], Actions]  # what a hand does with a thing, as `pick_up`


def pick(work: Work, words: Words, tried: list[Array], take: Take | None = None) -> Actions:
    """Pick up the thing that `words["object"]` names, with the hand `words["hand"]` if that is said.

    Of several alike the nearest that a hand can take is meant; where it cannot be reached, the next one is. Where none
    can be, the robot goes around the nearest that is out of reach.

    Args:
        work: Robot and world.
        words: Of the skill call.
        tried: Base poses that did not do; the one taken is added.
        take: What is done with it; None: `pick_up`.

    Raises:
        MotionFailure: "unknown_object", "hands_full", or as `take`.
    """
    failed, beyond = MotionFailure("no_stance"), None  # what is out of reach
    alike = {e.name for e in work.scene.knowledge().find(words["object"])}
    for side in SIDES:
        held = work.scene.holding(side)
        if held in alike and words.get("hand") in (None, side):
            if held in work.lay:  # a try that failed on its way has it in hand
                yield from _bring(work, held, side)
            return
    held_ones = {work.scene.holding(side) for side in SIDES}
    names = [n for n in work.alike(words["object"], words.get("source")) if n not in held_ones]
    said = normalize(OTHER.sub("", words["object"]))
    if OTHER.match(words["object"]):  # of two that are as much put away it is not the one taken before
        names.sort(key=lambda name: name == work.meant.get(said))
    if not names:  # no hand takes what the other one has
        raise MotionFailure("unknown_object")
    been: list[Array] = []
    for leg in range(LEGS + 1):
        for name in names[: _LIFT.alike]:
            if beyond is not None and not _near(work, name):
                continue
            for side in work.free_hands(name, words.get("hand")):
                try:
                    yield from (take or pick_up)(work, name, side, tried)
                    return
                except MotionFailure as failure:
                    if failure.reason not in ("no_stance", "no_grasp"):
                        raise
                    failed = failure
                    beyond = beyond or (name if failure.reason == "no_stance" else None)
                finally:  # who is told that it is in hand hears the next prompt while it is still being brought
                    if work.scene.holding(side) == name:
                        work.meant[said] = name
        if beyond is None or leg == LEGS or not (yield from go_around(work, work.middle(beyond)[:2], been)):
            raise failed


def _near(work: Work, name: str) -> bool:
    """Whether what is around a thing is known."""
    return bool(norm(work.middle(name)[:2] - work.motion.felt.base_pose[:2]) < NEAR_M)


def pick_up(work: Work, name: str, side: Side, tried: list[Array], ways: Ways | None = None) -> Actions:
    """Pick up a thing with one hand.

    Args:
        work: Robot and world.
        name: The thing.
        side: The hand.
        tried: Base poses that did not do; the one taken is added.
        ways: How it may be taken; None: `options`.

    Raises:
        MotionFailure: "no_grasp", "no_stance", "closed_empty", "slipped", "dropped", or a motion's own reason.
    """
    ways = ways or options
    yield from work.motion.grip(side, 1.0, GRIP.ready_s)
    try:
        found = yield from approach(work, side, name, lambda: ways(work, name), tried)
    except MotionFailure as failure:
        if failure.reason != "no_stance":
            raise
        yield from draw_out(work, name, side)
        found = yield from approach(work, side, name, lambda: ways(work, name), tried)
    yield from take_hold(work, name, side, (yield from _before(work, name, side, *found)))


def take_hold(work: Work, name: str, side: Side, stance: Stance) -> Actions:
    """Take a thing that a hand has come before, lift it, bring it to the chest.

    Args:
        work: Robot and world.
        name: The thing.
        side: The hand.
        stance: As `come_before` returns it.

    Raises:
        MotionFailure: "closed_empty", "slipped", "dropped", or a motion's own reason.
    """
    motion, scene = work.motion, work.scene
    try:
        yield from lines(work, side, stance, [1])
        work.lay[name] = np.append(scene.pose(name)[:2, 3], _lowest(work, name))
        work.grasped[side] = work.hand(side)[:3, :3]
        yield from motion.grip(side, -1.0, GRIP.take_s)
        yield from motion.wait(0.1)
        if not work.gripped(side):
            raise MotionFailure("closed_empty")
        yield from lines(work, side, stance, [2])
        yield from work.see(side)
        if not work.gripped(side) or scene.holding(side) != name:
            raise MotionFailure("slipped")
    except MotionFailure:
        yield from withdraw(work, side, stance)
        raise
    yield from leave(work, stance)
    yield from _bring(work, name, side)


def come_before(work: Work, name: str, side: Side, tried: list[Array]) -> Generator[Array, None, Stance]:
    """Bring a hand, open as far as the grasp needs, before a thing, as `pick_up` does, and no further.

    Yields actions, returns the stance.

    Args:
        work: Robot and world.
        name: The thing; nothing touches it.
        side: The hand.
        tried: Base poses that did not do; the one taken is added.

    Raises:
        MotionFailure: "no_grasp", "no_stance", or a motion's own reason.
    """
    yield from work.motion.grip(side, 1.0, GRIP.ready_s)
    found = yield from approach(work, side, name, lambda: options(work, name), tried)
    return (yield from _before(work, name, side, *found))


def _before(work: Work, name: str, side: Side, stance: Stance, search: Search) -> Generator[Array, None, Stance]:
    """Take up a stance; returns it, corrected by a look from there. A motion that fails is taken back."""
    motion = work.motion
    yield from motion.grip(side, motion.robot.hand.command(stance.opening_m), GRIP.preset_s)
    try:
        stance = yield from arrive(work, stance, search, lambda: options(work, name))
        yield from lines(work, side, stance, [0])  # aside to where it stands: on a slant a finger would meet the thing
    except MotionFailure:
        yield from withdraw(work, side, stance)
        raise
    return stance


def _bring(work: Work, name: str, side: Side) -> Actions:
    """Bring what a hand has taken to the chest, and off what it lay on."""
    yield from settle(work, without={name})
    if _covered(work, side):
        yield from back_off(work)
    if not _off(work, name):
        with suppress(MotionFailure):
            yield from work.rise(side)
    if not work.gripped(side):
        raise MotionFailure("dropped")
    if not _off(work, name):
        raise MotionFailure("slipped")


def _covered(work: Work, side: Side) -> bool:
    """Whether there is something above a hand: a board, the top of a compartment."""
    over = np.array([[0.0, 0.0, z] for z in np.arange(*_LIFT.above_m, _LIFT.step_m)])
    at = matmul(work.base, work.motion.hand(side))[:3, 3] + over
    return bool((work.near().distance(at) < _LIFT.board_m).any())


def _off(work: Work, name: str) -> bool:
    """Whether a thing is well above what it lay on, or well away from there."""
    lay = work.lay[name]
    away = float(norm(work.scene.pose(name)[:2, 3] - lay[:2]))
    return _lowest(work, name) > lay[2] + _LIFT.off_m or away > _LIFT.away_m


def _lowest(work: Work, name: str) -> float:
    return float(min(solid.aabb()[0, 2] for solid in work.scene.solids(name)))


def options(work: Work, name: str) -> list[Option]:
    """Ways to take hold of a thing as it is known now. Raises MotionFailure "no_grasp" if there is none.

    Where no hand fits over the middle of the thing, next to a wall, the hand is not over its middle. Our choice: only
    then, as every way more makes each search longer.
    """
    found = _ways(work, name, off_center=False)
    if not work.search("right", work.along(name)).admits(found):
        found += _ways(work, name, off_center=True)
    if not found:
        raise MotionFailure("no_grasp")
    return found


def slanted_options(work: Work, name: str) -> list[Option]:
    """Those of `options` whose hand comes from a side. Raises MotionFailure "no_grasp" if there is none."""
    if not (found := [o for o in options(work, name) if not from_above(o.waypoints[o.contact])]):
        raise MotionFailure("no_grasp")
    return found


def from_above(T_world_tcp: Array) -> bool:
    """Whether a hand (4, 4) points down rather than aside: a compartment needs room for it over its payload."""
    return bool(T_world_tcp[2, 2] < -np.cos(_LIFT.slanted_rad))


def _ways(work: Work, name: str, off_center: bool) -> list[Option]:
    at, here = work.scene.pose(name)[:2, 3], work.motion.felt.base_pose
    parts = [s for n in work.along(name) for s in work.scene.solids(n)]
    found = []
    bearing = float(np.arctan2(at[1] - here[1], at[0] - here[0]))
    for grasp in grasps(work.scene, work.motion.robot.hand, name, bearing, off_center):
        T = grasp.T_world_tcp
        frame = kin.inverse(T)
        load = Load([solid.moved(frame) for solid in parts])
        for standoff, lift, run_up, cost in _LIFT.ways:
            if run_up and grasp.tilt_rad < _LIFT.slanted_rad:
                continue
            before, lifted = T.copy(), T.copy()
            before[:3, 3] -= standoff * T[:3, 2]
            lifted[2, 3] += lift
            waypoints = np.stack([before, T, lifted])
            found.append(Option(waypoints, 1, grasp.cost + cost, run_up, load, grasp.opening_m))
    return found
