"""What the robot takes up on the floor and in front of itself: a circle for the base, one for each thing carried."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from mpvi_bt.navigation.traversability import Traversability
from mpvi_bt.perception.knowledge import Entry
from mpvi_bt.robot.kinematics import rot_z
from mpvi_bt.robot.solids import Array


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
            (*(turn.T @ (e.center[:2] - base_pose[:2])), float((e.highest - e.lowest)[:2].max()) / 2 + 0.02)
            for e in entries
            if e.held and e.inside is None
        ]
        return cls(base_m, np.array(loads, float).reshape(-1, 3))

    def slack(self, grid: Traversability, pose: Array) -> float:
        """How far [m] the loads keep from obstacles with the base at `pose` (3,); negative within, 9 without loads."""
        if not len(self.loads):
            return 9.0
        c, s = np.cos(pose[2]), np.sin(pose[2])
        x = pose[0] + c * self.loads[:, 0] - s * self.loads[:, 1]
        y = pose[1] + s * self.loads[:, 0] + c * self.loads[:, 1]
        cells = np.floor(grid.cells(np.stack([x, y], -1))).astype(int)
        inside = ((cells >= 0) & (cells < grid.occupied.shape)).all(-1)
        rows, columns = cells.clip(0, np.array(grid.occupied.shape) - 1).T
        return float(np.where(inside, grid.clearance_m[rows, columns] - self.loads[:, 2], -9.0).min())
