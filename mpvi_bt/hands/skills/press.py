"""Press a switch with the fingertips, which turns a thing on or off."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.motion import GRIP, Actions, MotionFailure
from mpvi_bt.ground.robot.protocol import SIDES, Side
from mpvi_bt.hands.motion.approach import FEEL, approach, arrive, going_around, leave, lines, withdraw
from mpvi_bt.hands.motion.carry import settle
from mpvi_bt.hands.motion.gaze import study
from mpvi_bt.hands.motion.work import Words, Work
from mpvi_bt.hands.skills.press_held import press_held
from mpvi_bt.hands.stance.stance import Option, Stance


@dataclass(frozen=True)
class Pressing:
    """How fingertips press a switch."""

    short_m: float = 0.08  # standoff of the fingertips before the switch [m]; our choice
    beyond_m: float = 0.015  # target of the hand past the switch [m]; it stops at contact; our choice
    short_of_m: float = 0.04  # a hand stopped farther before the switch has met something else [m]; our choice
    calm_s: float = 0.3  # rest before it [s]; shorter than in `Feeling`, as the hand is empty; our choice
    # lean of a finger from straight on [rad], number of its directions, and cost; our choice
    leans: tuple[tuple[float, int, float], ...] = ((0.0, 1, 0.0), (0.35, 6, 0.3), (0.7, 6, 0.8))
    rolls: int = 4  # turns of the hand about its fingers; our choice
    ways: tuple[tuple[float, float], ...] = ((0.0, 0.0), (0.3, 0.2))  # run-up of the base [m] and its cost; our choice


_PRESS = Pressing()


def press(work: Work, words: Words, tried: list[Array]) -> Actions:
    """Press the switch of what `words["object"]` names; if `words["state"]` says on or off, only if it is not so yet.

    Args:
        work: Robot and world.
        words: Of the skill call.
        tried: Base poses that did not do; those taken are added.

    Raises:
        MotionFailure: "unknown_object", "no_switch", "hands_full", "no_stance", "not_pressed", or a motion's own
            reason.
    """
    name = work.nearest(_thing(work, words.get("object", "")))
    if not work.scene.switches(name):
        yield from study(work, name)
    before = work.scene.is_on(name)
    if before is not None and words.get("state") == ("on" if before else "off"):
        return
    free = work.free_hands(name, words.get("hand"))
    holder = next((side for side in SIDES if work.scene.holding(side) == name), None)
    for side in free:
        try:
            if holder is not None:
                yield from press_held(work, holder, options(work, name))
                break
            yield from _press(work, name, side, tried)
            break
        except MotionFailure as failure:
            if failure.reason != "no_stance" or side == free[-1]:
                raise
    yield from study(work, name)
    if before is not None and work.scene.is_on(name) == before:
        raise MotionFailure("not_pressed")


def _thing(work: Work, phrase: str) -> str:
    """The thing whose switch a phrase may be about: "power button of the radio" is about the radio."""
    if work.scene.knowledge().find(phrase):
        return phrase  # such as a light switch on the wall
    return re.sub(r"^.*\b(?:button|switch|lever|knob)\s+(?:of|on)\s+|\s+(?:button|switch|lever|knob)$", "", phrase)


def _press(work: Work, name: str, side: Side, tried: list[Array]) -> Actions:
    motion = work.motion
    yield from motion.grip(side, -1.0, GRIP.empty_s)
    stance, search = yield from going_around(
        work, name, lambda: approach(work, side, name, lambda: options(work, name), tried)
    )
    try:
        stance = yield from arrive(work, stance, search, lambda: options(work, name))
        yield from _push_in(work, side, stance)
    except MotionFailure:
        yield from withdraw(work, side, stance)
        raise
    yield from lines(work, side, stance, [0])
    yield from leave(work, stance)
    yield from motion.grip(side, 1.0, GRIP.empty_s)
    yield from settle(work, without={name})


def _push_in(work: Work, side: Side, stance: Stance) -> Actions:
    """Onto the switch until it is felt, and stay."""
    motion = work.motion
    yield from motion.wait(_PRESS.calm_s)
    T = matmul(kin.inverse(work.base), kin.base(stance.base), stance.waypoints[1])
    yield from motion.line(side, T, FEEL.speed_m_s, until_contact=True)
    yield from motion.wait(FEEL.pressed_s)
    if norm((motion.robot.tcp(motion.felt.torso, motion.felt.arm[side], side) - T)[:3, 3]) > _PRESS.short_of_m:
        raise MotionFailure("not_pressed")  # something else was in the way


def options(work: Work, name: str) -> list[Option]:
    """Ways to bring the fingertips onto a switch of a thing. Raises MotionFailure "no_switch"."""
    out = []
    for T in work.scene.switches(name):
        for lean, sides, cost in _PRESS.leans:
            for toward in np.arange(sides) * 2 * np.pi / sides:
                z = -matmul(T[:3, :3], [np.sin(lean) * np.cos(toward), np.sin(lean) * np.sin(toward), np.cos(lean)])
                for roll in np.arange(_PRESS.rolls) * np.pi / _PRESS.rolls * 2:
                    y = matmul(T[:3, :3], [np.cos(roll), np.sin(roll), 0.0])
                    R = kin.hand_rotation(z, y)
                    at = T[:3, 3] - work.motion.robot.hand.tip_m * z
                    touch = kin.transform(R, at + _PRESS.beyond_m * z)
                    before = kin.transform(R, at - _PRESS.short_m * z)
                    for run_up, more in _PRESS.ways:
                        out.append(Option(np.stack([before, touch]), 1, cost + more, run_up, opening_m=0.0))
    if not out:
        raise MotionFailure("no_switch")
    return out
