"""Mounts: a thing that is brought close to a mount of its kind is fixed to it, until something tears it off.

Source: OmniGibson, object_states/attached_to.py.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np

from mpvi_bt.finding.scene.mount_pose import Mount
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.marked_yaml import Coordinate, Record

Axis = Literal["x", "-x", "y", "-y", "z", "-z"]
_AXES: Mapping[Axis, Array] = {
    "x": np.array([1.0, 0, 0]), "-x": np.array([-1.0, 0, 0]),
    "y": np.array([0.0, 1, 0]), "-y": np.array([0.0, -1, 0]),
    "z": np.array([0.0, 0, 1]), "-z": np.array([0.0, 0, -1]),
}  # fmt: skip
NEAR_M, NEAR_RAD = 0.05, float(np.deg2rad(15.0))
BREAKS_N, BREAKS_NM = 5e3, 1e4


class Fitting(Record):
    """A mount as the catalogue has it.

    Attributes:
        kind: Of the pair, such as "wall_nail".
        male: Whether it is the child's, which comes to hang on or stand on the other.
        at: (3,) in the thing's frame [m].
        facing: The axis of the thing's frame that looks away from what bears it: a child comes from there.
        up: Another one, that is turned alike on both once they are mounted.
    """

    kind: str
    male: bool = False
    at: tuple[Coordinate, Coordinate, Coordinate]
    facing: Axis = "x"
    up: Axis = "z"

    def pose(self, T_world_thing: Array) -> Array:
        """(4, 4) the mount in the world: x as it faces, z up."""
        x, z = _AXES[self.facing], _AXES[self.up]
        T = np.eye(4)
        T[:3, :3] = np.stack([x, np.cross(z, x), z], axis=1)
        T[:3, 3] = self.at
        return matmul(T_world_thing, T)


def fits(child: Mount, parent: Mount, contact: bool) -> bool:
    """Whether a child is fixed to a parent now: they touch, their mounts are a free pair, close and turned alike."""
    if not (contact and child.kind == parent.kind and child.male and not parent.male and child.free and parent.free):
        return False
    off = float(norm(child.pose[:3, 3] - parent.pose[:3, 3]))
    turn = matmul(child.pose[:3, :3].T, parent.pose[:3, :3])
    angle = float(np.arccos(np.clip((np.trace(turn) - 1) / 2, -1.0, 1.0)))
    return off <= NEAR_M and angle <= NEAR_RAD


def breaks(force_n: float, torque_nm: float) -> bool:
    """Whether what holds two mounts together gives way."""
    return force_n > BREAKS_N or torque_nm > BREAKS_NM
