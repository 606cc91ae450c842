"""Holding a tool towards a thing: a spray bottle that is turned on sprays it, a lighter sets it alight."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from mpvi_bt.finding.scene.hands import Held
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.ground.geometry.rays import interval
from mpvi_bt.ground.geometry.solids import Array, bounds
from mpvi_bt.ground.robot import arm_motion
from mpvi_bt.ground.robot.motion import Actions, MotionFailure
from mpvi_bt.ground.robot.protocol import Side
from mpvi_bt.hands.motion.approach import approach, going_around, leave, lines, take_up, withdraw
from mpvi_bt.hands.motion.carry import settle
from mpvi_bt.hands.motion.gaze import look_at
from mpvi_bt.hands.motion.work import Words, Work
from mpvi_bt.hands.skills.press import options as switch_options
from mpvi_bt.hands.skills.press_held import press_held
from mpvi_bt.hands.skills.wipe import hover, tool_hand
from mpvi_bt.hands.stance.stance import Option


@dataclass(frozen=True)
class Aiming:
    """How a tool is aimed at a thing."""

    ahead_m: tuple[float, ...] = (0.3, 0.45)  # distances from the middle of the tool to the target [m]; our choice
    # heights of the tool above the floor, the most comfortable first [m]; our choice
    heights_m: tuple[float, ...] = (0.9, 0.75, 1.05, 0.6, 1.2, 0.45)
    height_cost: float = 0.1  # added cost of each next height; our choice
    ways: int = 16  # directions that a thing is aimed at from; our choice
    back_m: float = 0.05  # standoff of the hand before and after aiming [m]; our choice
    sprayed_s: float = 3.0  # duration of spraying [s]; our choice


_AIM = Aiming()
_LIT_S = 10.0  # Our choice: a lighter takes 7 s for what burns at 250 degrees (`rules.heat`)
_FLAME_M = 0.04  # Our choice: of the lighter over what it is to light


def spray(work: Work, words: Words, tried: list[Array]) -> Actions:
    """Spray `words["target"]` with a held tool: one with a switch is aimed, its front ahead, and turned on for a while.

    A tool without a switch is held over the target, as `wipe.hover` does.

    Raises:
        MotionFailure: "not_held", "unknown_object", "no_stance", "hands_full", "no_release" if the other hand cannot
            get at the switch, or a motion's own reason.
    """
    side = tool_hand(work, words)
    tool = work.load(side)
    if not work.scene.switches(tool.name):
        yield from hover(work, words, tried)
        return
    target = work.same(words.get("target", ""))
    yield from look_at(work, target)
    on = work.scene.is_on(tool.name) or False
    if not on:
        with suppress(MotionFailure):  # where there is no room for both hands here, there may be at the target
            yield from _press(work, side, tool.name)
            on = work.scene.is_on(tool.name) is not False
    stance, search = yield from going_around(
        work, target, lambda: approach(work, side, target, lambda: list(aims(work, tool, target)), tried)
    )
    try:
        yield from take_up(work, stance, search)
        yield from lines(work, side, stance, [1])
        if not on:
            aimed = work.motion.arm(side)
            yield from _press(work, side, tool.name)
            if (back := arm_motion.plan(work.body(), side, aimed, work.rng)) is not None:
                yield from work.motion.follow(side, back)
        yield from work.motion.wait(_AIM.sprayed_s)
    except MotionFailure:
        yield from withdraw(work, side, stance)
        raise
    yield from lines(work, side, stance, [0])
    yield from leave(work, stance)
    with suppress(MotionFailure):
        yield from _press(work, side, tool.name)
    yield from settle(work, without={target})


def light(work: Work, words: Words, tried: list[Array]) -> Actions:
    """Hold a held lighter that burns over `words["target"]` until that should burn, too.

    Raises:
        MotionFailure: As `wipe.hover`.
    """
    yield from hover(work, words, tried, _FLAME_M, _LIT_S)


def _press(work: Work, side: Side, tool: str) -> Actions:
    yield from press_held(work, side, switch_options(work, tool), fold=False)


def aims(work: Work, held: Held, target: str) -> Iterator[Option]:
    """Ways of the hand: the tool as it is held, its front towards the target, at some height and distance.

    Our choice: its top, where bottles spray from, is level with some part of the target.
    """
    solids = work.scene.solids(target)
    low, high = bounds(solids)
    middle, far = (low + high)[:2] / 2, float(np.ptp(np.stack([low, high]), axis=0)[:2].max()) + 1.0
    now = work.scene.pose(held.name)
    R_now = now[:3, :3]
    ahead_now = float(np.arctan2(R_now[1, 0], R_now[0, 0]))
    to_tcp = kin.inverse(held.T_tcp_thing)
    top_m = float(bounds(s.moved(matmul(now, to_tcp)) for s in held.solids)[1][2] - now[2, 3])
    for k, z in enumerate(h for h in _AIM.heights_m if low[2] < h + top_m < high[2]):
        for angle in np.arange(_AIM.ways) * 2 * np.pi / _AIM.ways:
            way = np.array([np.cos(angle), np.sin(angle), 0.0])
            start = np.append(middle, z + top_m) - far * way
            met = [span[0] for s in solids if (span := interval(s, start, way)) is not None]
            if not met:
                continue
            R = matmul(kin.rot_z(angle - ahead_now), R_now)
            for off in _AIM.ahead_m:
                T = matmul(kin.transform(R, start + (min(met) - off) * way - [0.0, 0.0, top_m]), to_tcp)
                before = kin.transform(T[:3, :3], T[:3, 3] - _AIM.back_m * way)
                yield Option(np.stack([before, T]), 2, _AIM.height_cost * k)
