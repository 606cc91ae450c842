"""A robot's links as points, to be drawn: its primitives and meshes, in the posture that it drives in."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.described import DescribedRobot
from mpvi_bt.ground.robot.kinematic_chain import BaseFrame, placed
from mpvi_bt.ground.robot.mesh_points import mesh_points
from mpvi_bt.ground.robot.protocol import Side
from mpvi_bt.ground.robot.urdf_tree import UrdfLink, UrdfShape, mesh_file

_AROUND = np.arange(24) * (2 * np.pi / 24)


@dataclass(frozen=True, eq=False)
class DrawnLink:
    """A link of a robot that drives.

    Attributes:
        name: Of the link.
        side: The arm that it is on; None: none.
        place: (3,) its frame in the base frame [m].
        above: (3,) that of the link that it hangs on; its own, of the base.
        shapes: (n, 3) points of each primitive or mesh; their convex hull is drawn.
    """

    name: str
    side: Side | None
    place: Array
    above: Array
    shapes: tuple[Array, ...]

    @property
    def lowest_m(self) -> float:
        """The height of its lowest point above the floor; 0 if it has none."""
        return min((float(points[:, 2].min()) for points in self.shapes), default=0.0)


def drawn_links(robot: DescribedRobot) -> Iterator[DrawnLink]:
    """The links at and below the base frame: torso and arms in the travel posture, fingers open."""
    folder = Path(robot.tree.file).resolve().parent
    tree, frame = robot.tree, BaseFrame(robot.tree, robot.link, robot.above_floor_m)
    names = [*robot.torso_joints]
    q = [robot.travel_torso]
    of: dict[str, Side] = {}
    for side in robot.sides:
        names += [*robot.arm_joints[side], *robot.finger_joints[side]]
        q += [robot.travel_arm[side], robot.finger_range[side][:, 1]]
        of |= dict.fromkeys((*robot.arm_joints[side], *robot.finger_joints[side]), side)
    positions = np.concatenate(q)
    poses = {
        link: frame.chain(link, np.eye(4), names).pose(positions)
        for link in tree.links if tree.path(link, robot.link) is not None
    }  # fmt: skip
    for link, T in poses.items():
        way = tree.path(link, robot.link) or []
        above = poses[way[-1].parent] if way else T
        sides = [of[joint.name] for joint in way if joint.name in of]
        moved = tuple(matmul(points, T[:3, :3].T) + T[:3, 3] for points in link_points(tree.links[link], folder))
        yield DrawnLink(link, sides[0] if sides else None, T[:3, 3], above[:3, 3], moved)


def link_points(link: UrdfLink, folder: Path) -> list[Array]:
    """(n, 3) points of each shape of a link; of what collides, if something that is seen cannot be drawn."""
    seen, solid = ([_points(shape, folder) for shape in shapes] for shapes in (link.visuals, link.collisions))
    found = seen if all(map(len, seen)) or not any(map(len, solid)) else solid
    return [points for points in found if len(points)]


def _points(shape: UrdfShape, folder: Path) -> Array:
    """(n, 3) points on a shape in the frame of its link; none of a mesh that is not there or cannot be drawn."""
    if shape.kind == "mesh":
        file = mesh_file(shape.file, folder)
        points = np.zeros((0, 3)) if file is None else mesh_points(file) * np.array(shape.size)
    elif shape.kind == "box":
        signs = np.array(np.meshgrid([-0.5, 0.5], [-0.5, 0.5], [-0.5, 0.5])).reshape(3, -1).T
        points = signs * np.array(shape.size)
    else:
        radius = shape.size[0]
        ring = np.stack([np.cos(_AROUND), np.sin(_AROUND), np.zeros(len(_AROUND))], 1) * radius
        if shape.kind == "cylinder":
            half = np.array([0.0, 0.0, shape.size[1] / 2])
            points = np.concatenate([ring - half, ring + half])
        else:
            points = np.concatenate([ring, ring[:, [0, 2, 1]], ring[:, [2, 0, 1]]])
    T = placed(shape.xyz, shape.rpy)
    return matmul(points, T[:3, :3].T) + T[:3, 3]
