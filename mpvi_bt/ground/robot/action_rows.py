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
from collections.abc import Sequence
from fractions import Fraction
from itertools import pairwise

import numpy as np

from mpvi_bt.ground.errors import PolicyError, UserError, shown
from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.action_layout import ActionKind, ActionLayout
from mpvi_bt.ground.robot.limits import largest_step
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, Proprioception
from mpvi_bt.ground.robot.robot_description import RobotDescription
from mpvi_bt.ground.robot.robots import layout_of

_PRESSING_RAD = 0.4  # our choice: a command farther than this from where the arm is has been given up
LEAST_HZ, MOST_HZ = 1.0, 1000.0  # Our choice: no policy acts once in more than a second, none is asked for more


def check_rate(given: float) -> float:
    """A number of rows a second. Raises UserError unless it is 1 to 1000."""
    if isinstance(given, bool) or not isinstance(given, int | float) or not LEAST_HZ <= given <= MOST_HZ:
        raise UserError(f"a rate is {LEAST_HZ:g} to {MOST_HZ:g} rows a second, not {shown(given)}")
    return float(given)


class Resampler:
    """Rows of one rate at another, without drift: of a row that ends within a step the rest waits for the next rows.

    Args:
        layout: Of the rows.

    Attributes:
        at: Of each step of the last answer, which of the rows then at hand was in force at its end.
    """

    def __init__(self, layout: ActionLayout) -> None:
        self._layout = layout
        self._joints, self._grippers = layout.joints, list(layout.gripper.values())
        self.reset()

    def reset(self) -> None:
        """Forget what is left."""
        self._rows = np.empty((0, self._layout.size))
        self._spent = Fraction(0)  # of the first of these
        self.at: list[int] = []

    @property
    def last(self) -> Array | None:
        """(A,) the last row that is not wholly carried out; None if there is none."""
        return self._rows[-1] if len(self._rows) else None

    def resampled(self, rows: Array, rate_hz: float, to_hz: float, before: Array, whole: bool = True) -> Array:
        """(K, A) all steps that end within the rows so far; there may be none.

        Args:
            rows: (H, A) the next ones, joints absolute.
            rate_hz: Of the rows.
            to_hz: Of the steps.
            before: (A,) the command in force when the first step begins.
            whole: Whether a step that goes on beyond the rows waits for more; else the robot stands in the rest of it.
        """
        step = _exact(rate_hz) / _exact(to_hz)  # in rows
        self._rows, self.at = np.concatenate([self._rows, rows]), []
        count = (len(self._rows) - self._spent) / step
        edges = [self._spent + i * step for i in range(math.floor(count) + 1)]
        if not whole and count > len(edges) - 1:
            edges.append(Fraction(len(self._rows)))
        steps = np.empty((len(edges) - 1, self._layout.size))
        joints, grippers, layout = self._joints, self._grippers, self._layout
        told = before[grippers]
        for k, (begin, end) in enumerate(pairwise(edges)):
            first, last = math.floor(begin), math.ceil(end) - 1
            self.at.append(last)
            steps[k] = self._rows[last]
            if last > first or end - begin < step:
                layout.set_velocity(steps[k], self._twist(begin, end, step, 1 / to_hz))
            steps[k, joints] = self._targets(end, last, before)[joints]
            commands = self._rows[first : last + 1, grippers]
            farthest = np.abs(commands - told).argmax(0)
            told = steps[k, grippers] = commands[farthest, range(len(grippers))]
        done = math.floor(edges[-1])
        self._rows, self._spent = self._rows[done:], edges[-1] - done
        return steps

    def _twist(self, begin: Fraction, end: Fraction, step: Fraction, step_s: float) -> Array:
        """(3,) the base's constant velocity in a step with the same end pose as the rows'."""
        parts = range(math.floor(begin), math.ceil(end))
        cuts = [begin, *map(Fraction, parts[1:]), end]
        seconds = [float((until - since) / step) * step_s for since, until in pairwise(cuts)]
        return composed(self._layout.velocity(self._rows[parts.start : parts.stop]), seconds, step_s)

    def _targets(self, at: Fraction, row: int, before: Array) -> Array:
        """(A,) on the straight line to a row from the one before."""
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


def as_absolute(rows: Array, kind: ActionKind, rate_hz: float, before: Array, robot: RobotDescription) -> Array:
    """(H, A) rows whose joints are targets, of rows of a kind. Bases and grippers are the same in all kinds.

    Args:
        rows: (H, A). Of "delta" they are how far the joints' targets go in a row [rad or m], of "velocity" how fast
            [rad/s or m/s].
        kind: Of the rows.
        rate_hz: Of the rows.
        before: (A,) the command that the first row begins at.
        robot: Whose.

    Raises:
        PolicyError: "bad_reply": a joint is to go farther or faster than the robot is ever told to.
    """
    if kind == "absolute":
        return rows
    joints = robot.layout.joints
    by = rows[:, joints]
    most = most_of_kind(robot, kind, rate_hz)
    over = np.abs(by) - most * (1 + 1e-9)
    if (over > 0).any():
        row, joint = np.unravel_index(int(over.argmax()), over.shape)
        number = int(joints[joint])
        unit = "m" if number in robot.linear_joints else "rad"
        unit += "/s" if kind == "velocity" else f" in a row of {1 / rate_hz:.3g} s"
        raise PolicyError(
            "bad_reply",
            f"actions: {kind}: {robot.layout.part(number)} is to move by {by[row, joint]:.3g} {unit}; the "
            f"{robot.name} takes {most[joint]:.3g} at most. Are joints absolute, or is the rate not {rate_hz:g} Hz?",
        )
    targets = rows.copy()
    targets[:, joints] = before[joints] + np.cumsum(by * (1.0 / rate_hz if kind == "velocity" else 1.0), axis=0)
    return targets


def most_of_kind(robot: RobotDescription, kind: ActionKind, rate_hz: float) -> Array:
    """(J,) the most that joints may be told to go in a row of deltas [rad or m], or of velocities [rad/s or m/s]."""
    return largest_step(robot)[robot.layout.joints] * CONTROL_HZ * (1.0 if kind == "velocity" else 1.0 / rate_hz)


def of_kind(rows: Array, kind: ActionKind, rate_hz: float, before: Array, layout: ActionLayout) -> Array:
    """(H, A) rows of a kind, of rows whose joints are targets: the inverse of `as_absolute`."""
    if kind == "absolute":
        return rows
    changed, joints = rows.copy(), layout.joints
    changed[:, joints] = np.diff(rows[:, joints], axis=0, prepend=before[None, joints])
    changed[:, joints] *= rate_hz if kind == "velocity" else 1.0
    return changed


def command_of(body: Proprioception) -> Array:
    """(A,) the command in force, the base at rest: joint targets where the robot tells them, else its joints."""
    layout = layout_of(body)
    action = np.zeros(layout.size)
    action[layout.torso] = body.torso
    for side in body.sides:
        action[layout.arm[side]] = body.arm_command.get(side, body.arm[side])
        action[layout.gripper[side]] = body.gripper_command[side]
    return action


def state_of(felt: Proprioception) -> Array:
    """(A,) what is felt, in the action's order and units; a gripper's entry is its opening [m]."""
    layout = layout_of(felt)
    values = np.zeros(layout.size)
    layout.set_velocity(values, felt.base_velocity)
    values[layout.torso] = felt.torso
    for side in felt.sides:
        values[layout.arm[side]] = felt.arm[side]
        values[layout.gripper[side]] = felt.gripper_width[side]
    return values


def standing(body: Proprioception) -> Array:
    """(A,) the command that has the robot stand as it is. An arm that presses against something goes on pressing.

    Two hands hold a box by nothing else.
    """
    layout, action = layout_of(body), command_of(body)
    for side in body.sides:
        if np.abs(action[layout.arm[side]] - body.arm[side]).max() >= _PRESSING_RAD:
            action[layout.arm[side]] = body.arm[side]
    return action


def _exact(rate_hz: float) -> Fraction:
    """A rate as a fraction, so that 29.97 or 12.5 rows a second keep step with 30 for ever."""
    return Fraction(rate_hz).limit_denominator(1001)
