"""Rows of actions: their rate and kind, and how rows of one rate become rows of another (docs/observations.md).

A row says what the robot is told until the next row. Its base velocity holds for all of its time, its joint targets are
reached at the end of it, in a straight line from those before, and its gripper commands hold from its beginning. So
the commands of any stretch of time make a row: the base velocity that leads to the same place, the joint targets at its
end, and of each gripper the command that differs most from the row before, so that no grasp falls between two rows.

Our choice: a line that ends at the row needs nothing of the future, so that it goes on from one chunk to the next.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Mapping, Sequence
from fractions import Fraction
from itertools import pairwise
from typing import Literal, get_args

import numpy as np

from mpvi_bt.ground.errors import PolicyError, UserError, shown
from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.limits import largest_step
from mpvi_bt.ground.robot.model import RobotModel
from mpvi_bt.ground.robot.protocol import ACTION_SIZE, CONTROL_HZ, Proprioception, StaticLayout
from mpvi_bt.ground.robot.trunk import LiftTrunk

ActionKind = Literal["absolute", "delta", "velocity"]
KINDS: tuple[ActionKind, ...] = get_args(ActionKind)
LEAST_HZ, MOST_HZ = 1.0, 1000.0  # Our choice: no policy acts once in more than a second, none is asked for more
_PARTS: Mapping[str, slice] = {
    "torso": StaticLayout.TORSO,
    **{f"{side} arm": arm for side, arm in StaticLayout.ARM.items()},
}
_NAMES = {i: f"{part} joint {i - where.start + 1}" for part, where in _PARTS.items() for i in range(ACTION_SIZE)[where]}
_JOINTS = np.array(list(_NAMES))
_GRIPPERS = list(StaticLayout.GRIPPER.values())


def check_rate(given: float) -> float:
    """A number of rows a second. Raises UserError unless it is 1 to 1000."""
    if isinstance(given, bool) or not isinstance(given, int | float) or not LEAST_HZ <= given <= MOST_HZ:
        raise UserError(f"a rate is {LEAST_HZ:g} to {MOST_HZ:g} rows a second, not {shown(given)}")
    return float(given)


class Resampler:
    """Rows of one rate at another, without drift: of a row that ends within a step the rest waits for the next rows.

    Attributes:
        at: Of each step of the last answer, which of the rows then at hand was in force at its end.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget what is left."""
        self._rows = np.empty((0, ACTION_SIZE))
        self._spent = Fraction(0)  # of the first of these
        self.at: list[int] = []

    @property
    def last(self) -> Array | None:
        """(23,) the last row that is not wholly carried out; None if there is none."""
        return self._rows[-1] if len(self._rows) else None

    def resampled(self, rows: Array, rate_hz: float, to_hz: float, before: Array, whole: bool = True) -> Array:
        """(K, 23) all steps that end within the rows so far; there may be none.

        Args:
            rows: (H, 23) the next ones, joints absolute.
            rate_hz: Of the rows.
            to_hz: Of the steps.
            before: (23,) the command in force when the first step begins.
            whole: Whether a step that goes on beyond the rows waits for more; else the robot stands in the rest of it.
        """
        step = _exact(rate_hz) / _exact(to_hz)  # in rows
        self._rows, self.at = np.concatenate([self._rows, rows]), []
        count = (len(self._rows) - self._spent) / step
        edges = [self._spent + i * step for i in range(math.floor(count) + 1)]
        if not whole and count > len(edges) - 1:
            edges.append(Fraction(len(self._rows)))
        steps = np.empty((len(edges) - 1, ACTION_SIZE))
        told = before[_GRIPPERS]
        for k, (begin, end) in enumerate(pairwise(edges)):
            first, last = math.floor(begin), math.ceil(end) - 1
            self.at.append(last)
            steps[k] = self._rows[last]
            if last > first or end - begin < step:
                steps[k, StaticLayout.BASE] = self._twist(begin, end, step, 1 / to_hz)
            steps[k, _JOINTS] = self._targets(end, last, before)[_JOINTS]
            commands = self._rows[first : last + 1, _GRIPPERS]
            farthest = np.abs(commands - told).argmax(0)
            told = steps[k, _GRIPPERS] = commands[farthest, range(len(_GRIPPERS))]
        done = math.floor(edges[-1])
        self._rows, self._spent = self._rows[done:], edges[-1] - done
        return steps

    def _twist(self, begin: Fraction, end: Fraction, step: Fraction, step_s: float) -> Array:
        """(3,) the base's constant velocity in a step with the same end pose as the rows'."""
        parts = range(math.floor(begin), math.ceil(end))
        cuts = [begin, *map(Fraction, parts[1:]), end]
        seconds = [float((until - since) / step) * step_s for since, until in pairwise(cuts)]
        return composed(self._rows[parts.start : parts.stop, StaticLayout.BASE], seconds, step_s)

    def _targets(self, at: Fraction, row: int, before: Array) -> Array:
        """(23,) on the straight line to a row from the one before."""
        begin, start = (Fraction(row), self._rows[row - 1]) if row else (self._spent, before)
        share = float((at - begin) / (row + 1 - begin))
        return self._rows[row] if share == 1.0 else start + share * (self._rows[row] - start)


def composed(twists: Array, seconds: Sequence[float], total_s: float) -> Array:
    """(3,) the constant base velocity with the same end pose as several in turn; without turns, their mean.

    Exponential and logarithm of SE(2).

    Args:
        twists: (n, 3) vx, vy [m/s] and yaw rate [rad/s] in the base frame.
        seconds: How long each holds.
        total_s: How long the one is to hold.
    """
    if len(seconds) == 1 and seconds[0] == total_s:
        return twists[0].copy()
    way, yaw = 0j, 0.0  # x + y i
    for (vx, vy, rate), held_s in zip(twists.tolist(), seconds, strict=True):
        half = rate * held_s / 2
        way += cmath.rect(np.sinc(half / math.pi), yaw + half) * complex(vx, vy) * held_s
        yaw += 2 * half
    if abs(yaw) > math.pi:  # our choice: of a row in which it turns farther, as far as it went
        return np.asarray(matmul(seconds, twists) / total_s)
    straight = way / cmath.rect(np.sinc(yaw / 2 / math.pi), yaw / 2)
    return np.array([straight.real, straight.imag, yaw]) / total_s


def as_absolute(rows: Array, kind: ActionKind, rate_hz: float, before: Array, robot: RobotModel) -> Array:
    """(H, 23) rows whose joints are targets, of rows of a kind. Bases and grippers are the same in all kinds.

    Args:
        rows: (H, 23). Of "delta" they are how far the joints' targets go in a row [rad or m], of "velocity" how fast
            [rad/s or m/s].
        kind: Of the rows.
        rate_hz: Of the rows.
        before: (23,) the command that the first row begins at.
        robot: Whose.

    Raises:
        PolicyError: "bad_reply": a joint is to go farther or faster than the robot is ever told to.
    """
    if kind == "absolute":
        return rows
    by = rows[:, _JOINTS]
    most = largest_step(robot)[_JOINTS] * CONTROL_HZ * (1.0 if kind == "velocity" else 1.0 / rate_hz)
    over = np.abs(by) - most * (1 + 1e-9)
    if (over > 0).any():
        row, joint = np.unravel_index(int(over.argmax()), over.shape)
        unit = "m" if _JOINTS[joint] == StaticLayout.TORSO.start and isinstance(robot.trunk, LiftTrunk) else "rad"
        unit += "/s" if kind == "velocity" else f" in a row of {1 / rate_hz:.3g} s"
        raise PolicyError(
            "bad_reply",
            f"actions: {kind}: {_NAMES[int(_JOINTS[joint])]} is to move by {by[row, joint]:.3g} {unit}; the "
            f"{robot.name} takes {most[joint]:.3g} at most. Are joints absolute, or is the rate not {rate_hz:g} Hz?",
        )
    targets = rows.copy()
    targets[:, _JOINTS] = before[_JOINTS] + np.cumsum(by * (1.0 / rate_hz if kind == "velocity" else 1.0), axis=0)
    return targets


def of_kind(rows: Array, kind: ActionKind, rate_hz: float, before: Array) -> Array:
    """(H, 23) rows of a kind, of rows whose joints are targets: the inverse of `as_absolute`."""
    if kind == "absolute":
        return rows
    changed = rows.copy()
    changed[:, _JOINTS] = np.diff(rows[:, _JOINTS], axis=0, prepend=before[None, _JOINTS])
    changed[:, _JOINTS] *= rate_hz if kind == "velocity" else 1.0
    return changed


def command_of(body: Proprioception) -> Array:
    """(23,) the command in force, the base at rest: joint targets where the robot tells them, else its joints."""
    action = np.zeros(ACTION_SIZE)
    action[StaticLayout.TORSO] = body.torso
    for side in body.sides:
        action[StaticLayout.ARM[side]] = body.arm_command.get(side, body.arm[side])
        action[StaticLayout.GRIPPER[side]] = body.gripper_command[side]
    return action


def _exact(rate_hz: float) -> Fraction:
    """A rate as a fraction, so that 29.97 or 12.5 rows a second keep step with 30 for ever."""
    return Fraction(rate_hz).limit_denominator(1001)
