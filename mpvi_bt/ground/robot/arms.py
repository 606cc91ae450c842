"""Arms of seven joints with a closed-form inverse; one free angle is sampled."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from types import ModuleType
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.ground.geometry.linear_algebra import norm
from mpvi_bt.ground.geometry.solids import Array

_WEIGHTS = np.array([1, 1, 1, 1, 0.5, 0.5, 0.3])  # of joints in the distance of postures


class Arm(Protocol):
    """The geometry of one arm.

    Frames are in the chest's. Of the tcp z points along the fingers and y across them.
    """

    @property
    def shoulder(self) -> Array:
        """(3,) where it begins in the chest frame [m]."""
        ...

    @property
    def limits(self) -> Array:
        """(7, 2) lowest and highest joint angles [rad]."""
        ...

    @property
    def reach_m(self) -> float:
        """The tcp is moved by no more when a joint turns by 1 rad."""
        ...

    def frames(self, q: Array) -> Array:
        """(n, F, 4, 4) poses of its parts at joint angles (n, 7); the last three: upper arm, forearm, tcp."""
        ...

    def inverse(self, T: Array, samples: int) -> tuple[NDArray[np.intp], Array]:
        """Postures within the limits that bring the tcp to targets (n, 4, 4), at samples of the free angle.

        Returns:
            Index into the targets (m,), ascending, and joint angles (m, 7) [rad]; m may be 0. Exact to rounding.
        """
        ...

    def nearest(self, T: Array, q_near: Array, samples: int) -> tuple[NDArray[np.bool_], Array]:
        """Which targets (n, 4, 4) are within reach (n,), and the posture of each that is nearest to its `q_near` (7,).

        The best of the samples is refined: along a line the elbow moves evenly, not from sample to sample.
        """
        ...

    def along(self, T: Array, start: Array, samples: int, leap_rad: float) -> Array:
        """The postures (m, 7) of targets (n, 4, 4), each the nearest to the one before, the first to `start` (7,).

        They end, m < n, before a target that is out of reach or for which a joint would turn by more than `leap_rad`.
        """
        ...


class _Looped(ABC):
    """An arm whose frames and inverse are compiled loops, a file for each kind of arm."""

    limits: Array

    @property
    @abstractmethod
    def _loops(self) -> ModuleType:
        """The file, with `arm_frames`, `arm_inverse`, `nearest` and `along`."""

    @property
    @abstractmethod
    def _shape(self) -> tuple[Array | float, ...]:
        """What they are told of the arm, but for its limits."""

    def frames(self, q: Array) -> Array:
        """As of `Arm`."""
        return np.asarray(self._loops.arm_frames(np.ascontiguousarray(q, float), *self._shape))

    def inverse(self, T: Array, samples: int) -> tuple[NDArray[np.intp], Array]:
        """As of `Arm`."""
        index, q = self._loops.arm_inverse(T, *self._shape, self.limits, samples)
        return index, q

    def nearest(self, T: Array, q_near: Array, samples: int) -> tuple[NDArray[np.bool_], Array]:
        """As of `Arm`."""
        found, q = self._loops.nearest(T, *self._shape, self.limits, samples, q_near, _WEIGHTS)
        return found, q

    def along(self, T: Array, start: Array, samples: int, leap_rad: float) -> Array:
        """As of `Arm`."""
        count, q = self._loops.along(T, *self._shape, self.limits, samples, start, _WEIGHTS, leap_rad)
        return np.asarray(q[:count])


@dataclass(frozen=True, eq=False)
class SphericalArm(_Looped):
    """Spherical - revolute - spherical, hanging straight down at zero: the free angle is the swivel of the elbow.

    Axes: y, x, z, y, z, y, and then z or x. Frames: upper arm (at the shoulder), forearm (at the elbow), tcp.

    Attributes:
        shoulder: (3,) in the chest frame [m].
        upper_m, forearm_m: Shoulder to elbow, elbow to wrist.
        tcp_m: Wrist to tcp.
        limits: (7, 2) [rad].
        last: Axis of the last joint: z, along the fingers, or x.
    """

    shoulder: Array
    upper_m: float
    forearm_m: float
    tcp_m: float
    limits: Array
    last: Literal["z", "x"] = "z"

    @property
    def reach_m(self) -> float:
        """The stretched arm."""
        return self.upper_m + self.forearm_m + self.tcp_m

    @property
    def _loops(self) -> ModuleType:
        from mpvi_bt.ground.robot import spherical  # numba loads when postures are first worked with

        return spherical

    @property
    def _shape(self) -> tuple[Array, float, float, float, int]:
        return self.shoulder, self.upper_m, self.forearm_m, self.tcp_m, "xyz".index(self.last)


@dataclass(frozen=True, eq=False)
class PannedArm(_Looped):
    """Pan - lift - roll - elbow, then a spherical wrist, stretched straight ahead at zero: the pan is the free angle.

    Axes: z, y, x, y, x, y, x. The lift's lies off the pan's, so that the shoulder is no ball joint; with the pan given,
    the elbow follows from the distance of lift and wrist, then roll, lift and wrist one by one.

    Frames: shoulder (at the pan joint), upper arm (at the lift joint), forearm (at the elbow), tcp. Upper arm and
    forearm lie along x.

    Attributes:
        shoulder: (3,) middle of the pan joint in the chest frame [m].
        offset: (3,) from there to the lift joint [m], which turns with the pan; y is 0.
        upper_m, forearm_m: Lift joint to elbow, elbow to wrist.
        tcp_m: Wrist to tcp.
        limits: (7, 2) [rad].
    """

    shoulder: Array
    offset: Array
    upper_m: float
    forearm_m: float
    tcp_m: float
    limits: Array

    @property
    def reach_m(self) -> float:
        """The stretched arm."""
        return float(norm(self.offset)) + self.upper_m + self.forearm_m + self.tcp_m

    @property
    def _loops(self) -> ModuleType:
        from mpvi_bt.ground.robot import panned  # likewise

        return panned

    @property
    def _shape(self) -> tuple[Array, Array, float, float, float]:
        return self.shoulder, self.offset, self.upper_m, self.forearm_m, self.tcp_m


def limit_cost(q: Array, limits: Array) -> Array:
    """(n,) how far joints of postures (n, 7) are into the last tenths of their ranges, summed, in half ranges."""
    return np.asarray(np.maximum(np.abs(q - limits.mean(1)) / (np.ptp(limits, axis=1) / 2) - 0.8, 0).sum(1))


def posture_distance(q: Array, q_near: Array) -> Array:
    """(...,) weighted squared distance of postures (..., 7); the wrist's joints, cheap to turn, count less."""
    return ((q - q_near) ** 2 * _WEIGHTS).sum(-1)
