"""Carries out base velocities given at a lower rate than the control loop, with the same end pose."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby

import numpy as np

from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.action_rows import composed
from mpvi_bt.ground.robot.limits import BASE_ACCELERATION
from mpvi_bt.ground.robot.protocol import CONTROL_HZ

_STEP = BASE_ACCELERATION / CONTROL_HZ  # (3,) how far the velocity changes in a control step
_REFINED = 2  # times: then the way is right to 0.01 mm
_OWED = 0.25  # of the square of a row's steps. Our choice: half of what is lost where a row asks for twice that change


class BaseRamp:
    """A row's velocity, reached at the base's own acceleration, and passed as far as makes up for the way lost so.

    A velocity that jumps from row to row is ramped by the base, which loses way, and the more so the longer the rows:
    12 m of driving end 50 mm aside at 10 rows a second. What one row has no time to make up for is left to the next
    ones, up to a bound, so that a base that is told to stop does stop.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Owe nothing."""
        self._owed = np.zeros(3)  # velocity times steps

    def ramped(self, wanted: Array, rows: Sequence[int], now: Array) -> Array:
        """(K, 3) the velocities to tell the base.

        Args:
            wanted: (K, 3) of each control step [m/s, m/s, rad/s], in the base frame.
            rows: Of each step, which row it belongs to.
            now: (3,) the velocity before.
        """
        told = np.empty_like(wanted)
        for _, group in groupby(range(len(wanted)), lambda k: rows[k]):
            steps = list(group)
            now = told[steps] = self._row(wanted[steps], now)
            now = now[-1]
        return told

    def _row(self, wanted: Array, now: Array) -> Array:
        count = len(wanted)
        goal = _one(wanted) + self._owed / count
        mean = goal
        for _ in range(1 + _REFINED):
            told = np.stack([_axis(*each, count) for each in zip(now, mean, _STEP, strict=True)], axis=1)
            mean = mean + goal - _one(told)
        most = _OWED * count**2 * _STEP
        self._owed = np.clip((goal - _one(told)) * count, -most, most)
        return told


def _one(velocities: Array) -> Array:
    """(3,) the constant velocity with the same end pose as those of several control steps."""
    steps = len(velocities)
    return composed(velocities, [1 / CONTROL_HZ] * steps, steps / CONTROL_HZ)


def _axis(now: float, mean: float, step: float, count: int) -> Array:
    """(count,) velocities from `now` on with that mean: first ramped, then held; ramped on if there is no time."""
    ways = np.arange(1, count + 1)
    need = count * abs(mean - now)
    level = step * count
    for ramped in range(count):
        held = (need - step * ramped * (ramped + 1) / 2) / (count - ramped)
        if held <= step * (ramped + 1):
            level = held
            break
    return np.asarray(now + np.sign(mean - now) * np.minimum(step * ways, level))
