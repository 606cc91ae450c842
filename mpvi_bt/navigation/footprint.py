"""What the robot takes up on the floor and in front of itself: a circle for the base, one for each thing carried."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from mpvi_bt.navigation.traversability import Traversability
from mpvi_bt.perception.knowledge import Entry
from mpvi_bt.robot.kinematics import rot_z
from mpvi_bt.robot.linear_algebra import matmul
from mpvi_bt.robot.protocol import Proprioception
from mpvi_bt.robot.robots import robot_named
from mpvi_bt.robot.solids import Array

_ARM_M, _HAND_M = 0.05, 0.05  # radii of elbow and wrist, and along the hand, from the side


@dataclass(frozen=True, eq=False)
class Footprint:
    """Circles that turn with the base.

    Attributes:
        base_m: Radius of the robot with its arms folded; planning inflates the map by it.
        loads: (n, 3) x, y [m] in the base frame and radius [m] of what is carried.
    """

    base_m: float
    loads: Array

    @classmethod
    def carrying(cls, base_m: float, base_pose: Array, entries: Iterable[Entry]) -> Footprint:
        """Of a robot at `base_pose` (3,) that carries those of `entries` that are held.

        Our choice: a load counts as the circle in its bounding box, plus 2 cm; corners may pass over what is low.
        """
        turn = rot_z(float(base_pose[2]))[:2, :2]
        loads = [
            (*matmul(turn.T, e.center[:2] - base_pose[:2]), float((e.highest - e.lowest)[:2].max()) / 2 + 0.02)
            for e in entries
            if e.held and e.inside is None
        ]
        return cls(base_m, np.array(loads, float).reshape(-1, 3))

    @classmethod
    def of(cls, base_m: float, body: Proprioception, entries: Iterable[Entry]) -> Footprint:
        """Of a robot as it feels itself, which carries those of `entries` that are held.

        Its arms take up room, too, where they reach out over the base: they keep what they hold before the body.
        """
        around = []
        robot = robot_named(body.robot)
        for side in body.sides:
            elbow, hand = (matmul(robot.chest(body.torso), T) for T in robot.arm_frames(body.arm[side], side)[-2:])
            wrist = hand[:3, 3] - robot.tcp_m * hand[:3, 2]
            parts = [
                (elbow[:3, 3], _ARM_M),
                (wrist, _ARM_M),
                ((wrist + hand[:3, 3]) / 2, _HAND_M),
                (hand[:3, 3], _HAND_M),
            ]
            around += [(p[0], p[1], radius) for p, radius in parts if math.hypot(p[0], p[1]) + radius > base_m]
        load = cls.carrying(base_m, body.base_pose, entries)
        return cls(base_m, np.concatenate([load.loads, np.array(around, float).reshape(-1, 3)]))

    def smaller(self, by_m: float) -> Footprint:
        """The same with smaller loads."""
        return Footprint(self.base_m, np.column_stack([self.loads[:, :2], (self.loads[:, 2] - by_m).clip(0.0)]))

    def places(self, poses: Array) -> Array:
        """(..., n, 2) where the loads' centers are [m] with the base at poses (..., 3)."""
        c, s = np.cos(poses[..., 2, None]), np.sin(poses[..., 2, None])
        x, y = self.loads[:, 0], self.loads[:, 1]
        places: Array = np.stack([c * x - s * y, s * x + c * y], -1) + poses[..., None, :2]
        return places

    def slack(self, grid: Traversability, poses: Array) -> Array:
        """(...,) how far [m] the loads keep from obstacles with the base at poses (..., 3).

        Negative within, 9 without loads.
        """
        if not len(self.loads):
            return np.full(poses.shape[:-1], 9.0)
        cells = np.floor(grid.cells(self.places(poses))).astype(int)
        inside = ((cells >= 0) & (cells < grid.occupied.shape)).all(-1)
        rows, columns = np.moveaxis(cells.clip(0, np.array(grid.occupied.shape) - 1), -1, 0)
        slack: Array = np.where(inside, grid.clearance_m[rows, columns] - self.loads[:, 2], -9.0).min(-1)
        return slack
