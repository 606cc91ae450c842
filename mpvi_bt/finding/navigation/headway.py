"""Whether a base that drives gets on."""

from __future__ import annotations

import math

import numpy as np

from mpvi_bt.finding.navigation.pursuit import PathFollower
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import CONTROL_HZ

# Our choice: more than a base drifts, or is shaken, where it stands.
_MOVED_M, _TURNED_RAD = 0.05, 0.1  # a base that has moved or turned by that gets on
_NEARER_M = 0.05  # and one that has come nearer to its goal by that


class Headway:
    """Tells when a base that is told to move does not, or comes no nearer to its goal.

    Attributes:
        steps: Since it began.
    """

    def __init__(self, still_s: float, idle_s: float) -> None:
        """Begin to watch.

        Args:
            still_s: Standing still for so long is a halt.
            idle_s: So is coming no nearer for so long.
        """
        self._still, self._idle = round(still_s * CONTROL_HZ), round(idle_s * CONTROL_HZ)
        self._pose, self._moved = np.full(3, 1e9), 0  # where it was when it had last moved, and at which step
        self._least, self._nearer = math.inf, 0  # what remained at the least, and at which step
        self.steps = 0

    def stalled(self, pose: Array, follower: PathFollower) -> bool:
        """Whether it has come to a halt; asked once a step."""
        self.steps += 1
        if (
            math.dist(pose[:2], self._pose[:2]) >= _MOVED_M
            or abs(math.remainder(pose[2] - self._pose[2], 2 * math.pi)) >= _TURNED_RAD
        ):
            self._pose, self._moved = pose, self.steps
        remaining = follower.remaining_m(pose)
        if remaining < self._least - _NEARER_M:
            self._least, self._nearer = remaining, self.steps
        return self.steps - self._moved > self._still or self.steps - self._nearer > self._idle
