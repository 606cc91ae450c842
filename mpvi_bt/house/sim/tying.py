"""Ties between the things of a scene: drives that give way like springs."""

from __future__ import annotations

from collections.abc import Mapping

import sapien

from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.house.sim.builder import Thing


class Ties:
    """Ties between things, at most one for each child (implements `Springs`)."""

    def __init__(self, scene: sapien.Scene, things: Mapping[str, Thing]) -> None:
        """Nothing is tied yet. `things` are all that there are in the scene, by name."""
        self._scene, self._things = scene, things
        self._drives: dict[str, sapien.physx.PhysxDriveComponent] = {}

    def tie(self, child: str, parent: str, between: Array, linear: Array, angular: Array) -> None:
        """Tie a child to a parent, as of `Springs`."""
        below, thing = self._things[parent], self._things[child]
        T = between if below.moves else matmul(below.T_world_body(), between)
        drive = self._scene.create_drive(
            below.root_body if below.moves else None, sapien.Pose(T), thing.root_body, sapien.Pose()
        )
        for along in (drive.set_drive_property_x, drive.set_drive_property_y, drive.set_drive_property_z):
            along(*linear)
        drive.set_drive_property_slerp(*angular)
        self._drives[child] = drive

    def untie(self, child: str) -> None:
        """Undo the tie of a child."""
        self._things[child].entity.remove_component(self._drives.pop(child))
