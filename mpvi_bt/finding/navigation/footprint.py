"""What the robot takes up on the floor and in front of itself: circles for the base, one for each thing carried."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np

from mpvi_bt.executive.plan.knowledge import Entry
from mpvi_bt.finding.navigation.traversability import Traversability, turned
from mpvi_bt.ground.geometry.kinematics import rot_z
from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import Proprioception
from mpvi_bt.ground.robot.robots import robot_named

_ROUND = np.zeros((0, 3))
_AROUND_LOAD_M = 0.02  # our choice: a carried thing sways


@dataclass(frozen=True, eq=False)
class Footprint:
    """Circles that turn with the base.

    Attributes:
        base_m: Radius of the robot with its arms folded; planning inflates the map by it.
        loads: (n, 3) x, y [m] in the base frame and radius [m] of what is carried.
        base: (n, 3) likewise of what of the base is beyond `base_m`.
    """

    base_m: float
    loads: Array
    base: Array = field(default_factory=lambda: _ROUND)

    @property
    def turns(self) -> bool:
        """Whether it matters how the base is turned."""
        return bool(len(self.loads) or len(self.base))

    @classmethod
    def carrying(cls, base_m: float, base_pose: Array, entries: Iterable[Entry]) -> Footprint:
        """Footprint of a robot at `base_pose` (3,) with the payloads among `entries`.

        Our choice: a load counts as the circle in its bounding box, plus a margin; corners may pass over what is low.
        """
        turn = rot_z(float(base_pose[2]))[:2, :2]
        loads = [
            (
                *matmul(turn.T, e.center[:2] - base_pose[:2]),
                float((e.highest - e.lowest)[:2].max()) / 2 + _AROUND_LOAD_M,
            )
            for e in entries
            if e.held and e.inside is None
        ]
        return cls(base_m, np.array(loads, float).reshape(-1, 3))

    @classmethod
    def of(cls, base_m: float, body: Proprioception, entries: Iterable[Entry]) -> Footprint:
        """Footprint of a robot with this proprioception and the payloads among `entries`.

        Its arms take up room, too, where they reach out over the base: they keep what they hold before the body.
        """
        around = []
        robot = robot_named(body.robot)
        m = robot.arm_m
        for side in body.sides:
            points = robot.arm_points(body.torso, body.arm[side], side)
            parts = [p for p in points if math.hypot(p[0], p[1]) + m > base_m and not robot.base.covers(p[:2], m)]
            around += [(p[0], p[1], m) for p in parts]
        load = cls.carrying(base_m, body.base_pose, entries)
        return cls(base_m, np.concatenate([load.loads, np.array(around, float).reshape(-1, 3)]), robot.base.circles)

    def smaller(self, by_m: float) -> Footprint:
        """The same with smaller loads, and half as much less of the base."""
        loads, base = (
            np.column_stack([circles[:, :2], (circles[:, 2] - m).clip(0.0)])
            for circles, m in ((self.loads, by_m), (self.base, by_m / 2))
        )
        return replace(self, loads=loads, base=base)

    def places(self, poses: Array) -> Array:
        """(..., n, 2) where the loads' centers are [m] with the base at poses (..., 3)."""
        return turned(self.loads, poses)

    def slack(self, grid: Traversability, poses: Array) -> Array:
        """(...,) how far [m] loads and base keep from obstacles with the base at poses (..., 3).

        Negative within, 9 for an empty-handed robot that is round.
        """
        room = self.room(grid, poses)
        if not len(self.loads):
            return room
        cells = np.floor(grid.cells(self.places(poses))).astype(int)
        inside = ((cells >= 0) & (cells < grid.occupied.shape)).all(-1)
        rows, columns = np.moveaxis(cells.clip(0, np.array(grid.occupied.shape) - 1), -1, 0)
        slack: Array = np.where(inside, grid.clearance_m[rows, columns] - self.loads[:, 2], -9.0).min(-1)
        return np.minimum(slack, room) if len(self.base) else slack

    def room(self, grid: Traversability, poses: Array) -> Array:
        """(...,) how far [m] the base alone keeps from obstacles, at the least, but for `base_m`; 9 if it is round."""
        if not len(self.base):
            return np.full(poses.shape[:-1], 9.0)
        room: Array = (grid.room(turned(self.base, poses)) - self.base[:, 2]).min(-1)
        return room
