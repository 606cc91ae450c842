"""Forward kinematics of a URDF: the pose of one link at positions of the joints above it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.urdf_tree import UrdfJoint, UrdfTree, Vector


def turned(rpy: Vector) -> Array:
    """(3, 3) rotation of a URDF's roll, pitch and yaw [rad]."""
    roll, pitch, yaw = rpy
    return matmul(kin.rot_z(yaw), kin.rot_y(pitch), kin.rot_x(roll))


def placed(xyz: Vector, rpy: Vector) -> Array:
    """(4, 4) pose of a URDF's origin [m, rad]."""
    return kin.transform(turned(rpy), np.array(xyz))


class KinematicChain:
    """The joints from a robot's base to one of its frames, outermost last.

    Attributes:
        used: Indices into `order` of the joints that move it.
    """

    def __init__(self, joints: Sequence[UrdfJoint], order: Sequence[str | None], start: Array, end: Array) -> None:
        """Take the joints of a way down.

        Args:
            joints: From the base on.
            order: Names of the joints whose positions are given, in their order; None of a number without a joint.
            start: (4, 4) the frame that the first of them hangs on. Joints that are not in the order stay at 0.
            end: (4, 4) the frame in the last link.
        """
        self._steps: list[tuple[Array, UrdfJoint, int, float, float]] = []  # before it, joint, index, factor, offset
        self.used: list[int] = []
        before = start
        for joint in joints:
            before = matmul(before, placed(joint.xyz, joint.rpy))
            source, factor, offset = joint.mimic or (joint.name, 1.0, 0.0)
            if source in order:
                self._steps.append((before, joint, order.index(source), factor, offset))
                self.used.append(order.index(source))
                before = np.eye(4)
            elif joint.kind != "fixed":
                before = matmul(before, _moved(joint, np.array(offset)))
        self._last = matmul(before, end)

    def pose(self, positions: Array) -> Array:
        """(..., 4, 4) of the frame at joint positions (..., J) in the given order."""
        return self.poses(positions)[-1]

    def poses(self, positions: Array) -> list[Array]:
        """(..., 4, 4) of the frame of each joint that is in the order, before it moves, and of the last frame."""
        positions = np.asarray(positions, float)
        T = np.broadcast_to(np.eye(4), (*positions.shape[:-1], 4, 4))
        found = []
        for before, joint, index, factor, offset in self._steps:
            T = matmul(T, before)
            found.append(T)
            T = matmul(T, _moved(joint, factor * positions[..., index] + offset))
        return [*found, matmul(T, self._last)]


@dataclass(frozen=True)
class BaseFrame:
    """The base frame of a URDF: a link, brought down to the floor.

    Attributes:
        tree: The URDF.
        link: The link.
        above_floor_m: How high its frame is above the floor.
    """

    tree: UrdfTree
    link: str
    above_floor_m: float

    def chain(self, link: str, end: Array, order: Sequence[str | None], turn: Array | None = None) -> KinematicChain:
        """To a frame (4, 4) in a link below; `turn`: (3, 3) of it, at last. `order` as of a chain."""
        joints = self.tree.path(link, self.link)
        assert joints is not None
        if turn is not None:
            end = matmul(end, kin.transform(turn, (0.0, 0.0, 0.0)))
        return KinematicChain(joints, order, kin.transform(np.eye(3), (0.0, 0.0, self.above_floor_m)), end)


def _moved(joint: UrdfJoint, q: Array) -> Array:
    """(..., 4, 4) what a joint adds at positions (...)."""
    axis = np.array(joint.axis)
    T = np.zeros((*q.shape, 4, 4))
    T[..., range(4), range(4)] = 1.0
    if joint.kind == "prismatic":
        T[..., :3, 3] = q[..., None] * axis
    elif joint.kind in ("revolute", "continuous"):  # Rodrigues' formula
        x, y, z = axis
        across = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        sin, cos = np.sin(q)[..., None, None], np.cos(q)[..., None, None]
        T[..., :3, :3] = np.eye(3) + sin * across + (1 - cos) * matmul(across, across)
    return T
