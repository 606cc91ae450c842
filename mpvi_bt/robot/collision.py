"""Where a robot's arms would touch: spheres on an arm against its own body, the other arm, and solids around it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.robot import kernels
from mpvi_bt.robot import kinematics as kin
from mpvi_bt.robot.linear_algebra import matmul
from mpvi_bt.robot.model import RobotModel
from mpvi_bt.robot.protocol import Side, other
from mpvi_bt.robot.solids import Array, Solid


class Obstacles(Protocol):
    """What may be in the way: anything that tells how far a point is from it."""

    def seen_from(self, T: Array) -> Obstacles:
        """The same in another frame; `T` (4, 4) maps that frame into the present one."""
        ...

    def distance(self, p: Array) -> Array:
        """(...,) distance [m] of points (..., 3) to the nearest of it; 0 within, 9 if there is nothing."""
        ...


class Surroundings:
    """Solids stacked so that distances to all of them come at once; balls count as the cylinders around them."""

    def __init__(self, solids: Sequence[Solid]) -> None:
        """Gather solids posed in one frame."""
        self._inverse = np.array([kin.inverse(s.T) for s in solids]).reshape(-1, 4, 4)
        self._half = np.array([s.half_m for s in solids]).reshape(-1, 3)
        self._round = np.array([s.kind != "box" for s in solids], bool)

    def seen_from(self, T: Array) -> Surroundings:
        """The same solids in another frame; `T` (4, 4) maps that frame into the present one."""
        other = copy(self)
        other._inverse = matmul(self._inverse, T)
        return other

    def distance(self, p: Array) -> Array:
        """(...,) distance [m] of points (..., 3) to the nearest solid; 0 within one, 9 if there is none."""
        flat = np.ascontiguousarray(p, float).reshape(-1, 3)
        return np.asarray(kernels.solids_distance(flat, *self.arrays).reshape(p.shape[:-1]))

    @property
    def arrays(self) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Inverse poses (n, 4, 4), half extents (n, 3) and which are round (n,), for `kernels`."""
        return self._inverse, self._half, self._round


NOTHING = Surroundings(())


class Together:
    """Several obstacles as one."""

    def __init__(self, parts: Sequence[Obstacles]) -> None:
        """Gather what is posed in one frame."""
        self._parts: list[Obstacles] = []
        for part in parts:  # one after the other, not one within the other: they are asked thousands of times
            self._parts += part._parts if isinstance(part, Together) else [part]

    def seen_from(self, T: Array) -> Together:
        """All of them in another frame; `T` (4, 4) maps that frame into the present one."""
        return Together([part.seen_from(T) for part in self._parts])

    def distance(self, p: Array) -> Array:
        """(...,) distance [m] of points (..., 3) to the nearest of all; 9 if there is nothing."""
        out = np.full(p.shape[:-1], 9.0)
        for part in self._parts:
            np.minimum(out, part.distance(p), out=out)
        return out


def carries(face: Solid, spot: Array, radius: float) -> bool:
    """Whether a disc about a spot (3,) lies on a solid: the corners of its bounding box may not, if round or turned."""
    angles = np.arange(8) * np.pi / 4
    rim = spot + np.stack([np.cos(angles) * radius, np.sin(angles) * radius, np.full(8, -0.002)], -1)
    return bool((Surroundings([face]).distance(rim) <= 1e-9).all())  # a disc may reach right to an edge


class Load:
    """What a hand holds, in its tcp frame: exact for what might meet it, covered by spheres for what it might meet."""

    def __init__(self, solids: Sequence[Solid], volumes: Sequence[Solid] = ()) -> None:
        """Gather what is held; solids and container volumes in the tcp frame.

        Volumes count as filled: between two checked postures a hand would slip through a thin wall.
        """
        self.solids = Surroundings([*solids, *volumes])
        self.centers, self.radii = covering_spheres(solids)

    def within(self, room_m: Array) -> Load:
        """The same with no more than `room_m` (n,) about each center: spheres reach beyond what they stand for.

        No sphere shrinks to less than half of its size.
        """
        other = copy(self)
        other.radii = np.minimum(self.radii, np.maximum(room_m, self.radii / 2))
        return other


_NO_ARM = np.zeros((1, 0, 3)), np.eye(4)[None], np.zeros(0), 0  # as `Body._arm_points` has an arm


@dataclass(frozen=True, eq=False)
class Body:
    """The robot in one posture, and what it holds; says which postures of an arm are free.

    Attributes:
        robot: Which.
        torso: (4,) its joints.
        arms: (7,) posture of each arm.
        held: What each hand holds.
        around: What is near, in the base frame.
    """

    robot: RobotModel
    torso: Array
    arms: Mapping[Side, Array]
    held: Mapping[Side, Load] = field(default_factory=dict)
    around: Obstacles = NOTHING

    def clearance(self, side: Side, q: Array, grasping: bool = False) -> tuple[Array, Array]:
        """How far postures q (n, 7) of arm `side` keep from things, each (n,) [m], negative within.

        Args:
            side: The arm that moves; the other one stays as in `arms`.
            q: (n, 7) postures.
            grasping: Leave the fingers out, which may touch what they grasp.

        Returns:
            Distance to the surroundings and distance to the robot itself.
        """
        p, hands, radii, own = self._arm_points(side, q, grasping)
        around = (self.around.distance(p) - radii).min(1)
        idle, hull = other(side), self.robot.hull
        stands = idle, self.held.get(idle)
        if stands not in self._standing:
            there = idle in self.arms
            self._standing[stands] = self._arm_points(idle, self.arms[idle], False) if there else _NO_ARM
        p2, hands2, r2, own2 = self._standing[stands]
        theirs = self.held[idle].solids.seen_from(kin.inverse(hands2[0])) if idle in self.held else NOTHING
        mine = self.held[side].solids if side in self.held else NOTHING
        itself = kernels.self_distance(
            p, radii, hull.hand_from, own, hands, self._from_chest, hull.boxes, hull.boxes_from, hull.columns,
            hull.base, hull.fold_m, *self._others(p2[0, :own2], r2[:own2]), mine.arrays, theirs.arrays,
            self._link_boxes.arrays,
        )  # fmt: skip
        return around, itself

    def amid(self, around: Obstacles, held: Mapping[Side, Load] | None = None) -> Body:
        """The same posture with other things around it, and other loads if they are given.

        What has been computed of the posture is kept: searches ask the same one thousands of times.
        """
        there = replace(self, around=around, held=self.held if held is None else held)
        vars(there).update(
            _chest=self._chest, _from_chest=self._from_chest, _links=self._links, _standing=self._standing,
            _link_boxes=self._link_boxes,
        )  # fmt: skip
        return there

    def spheres(self, side: Side, q: Array) -> tuple[Array, Array]:
        """Centers (n, m, 3) in the base frame and radii (m,) of an arm in postures q (n, 7), with what it holds."""
        p, _, radii, _ = self._arm_points(side, q, False)
        return p, radii

    def distance(self, side: Side, q: Array) -> float:
        """How far posture q (7,) of an arm, with what it holds, keeps from the surroundings [m], negative within."""
        p, radii = self.spheres(side, q)
        return float((self.around.distance(p) - radii).min())

    def free(self, side: Side, q: Array, margin: float = 0.0, grasping: bool = False) -> NDArray[np.bool_]:
        """(n,) bool: postures q (n, 7) that keep `margin` [m] from the surroundings and clear of the robot itself."""
        around, itself = self.clearance(side, q, grasping)
        return np.asarray((around > margin) & (itself > 0.0))

    def trunk_free(self) -> bool:
        """Whether head and chest are clear of the surroundings: a pitched waist puts them where the furniture is."""
        T, trunk = self.robot.chest(self.torso), self.robot.hull.trunk
        centers, radii = self._links
        chest = matmul(trunk[:, :3], T[:3, :3].T) + T[:3, 3]
        return all(
            bool((self.around.distance(p) > r).all()) for p, r in ((chest, trunk[:, 3]), (centers, radii)) if len(r)
        )

    def all_free(self) -> bool:
        """Whether arms and trunk are free as they stand."""
        return self.trunk_free() and all(bool(self.free(s, q)[0]) for s, q in self.arms.items())

    @cached_property
    def _chest(self) -> Array:
        return self.robot.chest(self.torso)

    @cached_property
    def _from_chest(self) -> Array:
        return kin.inverse(self._chest)

    @cached_property
    def _links(self) -> tuple[Array, Array]:
        return self.robot.links(self.torso)

    @cached_property
    def _link_boxes(self) -> Surroundings:
        boxes = self.robot.hull.link_boxes
        if not len(boxes):
            return NOTHING
        frames = zip(self.robot.trunk.links(self.torso), boxes, strict=False)
        return Surroundings([Solid("box", b[3:], matmul(T, kin.transform(np.eye(3), b[:3]))) for T, b in frames])

    def _others(self, arm: Array, radii: Array) -> tuple[Array, Array]:
        """What an arm keeps clear of besides boxes: spheres of the other arm, and of the trunk's links."""
        centers, more = self._links
        return (np.concatenate([arm, centers]), np.concatenate([radii, more])) if len(more) else (arm, radii)

    @cached_property
    def _standing(self) -> dict[tuple[Side, Load | None], tuple[Array, Array, Array, int]]:
        return {}  # `_arm_points` of the arms as they stand, by what they hold, once they are asked for

    def _arm_points(self, side: Side, q: Array, grasping: bool) -> tuple[Array, Array, Array, int]:
        """Centers (n, m, 3) in the base frame, T_base_tcp (n, 4, 4), radii (m,) and how many are the arm's own."""
        hull = self.robot.hull
        own = len(hull.radii) - (hull.fingers if grasping else 0)
        centers, radii, link = hull.centers[:own], hull.radii[:own], hull.frame[:own]
        if side in self.held:
            load = self.held[side]
            centers, radii = np.concatenate([centers, load.centers]), np.concatenate([radii, load.radii])
            link = np.append(link, np.full(len(load.radii), link.max()))
        q = np.ascontiguousarray(np.atleast_2d(q), float)
        p, hands = kernels.sphere_centers(self.robot.arms[side].frames(q), self._chest, centers, link)
        return p, hands, radii, own


def covering_spheres(solids: Sequence[Solid], step: float = 0.05) -> tuple[Array, Array]:
    """Spheres that cover thin and small solids: centers (n, 3) in the solids' frame and radii (n,) [m]."""
    centers, radii = [], []
    for s in solids:
        counts = np.maximum(1, np.ceil(2 * s.half_m / step - 1e-9)).astype(int)
        cell = s.half_m / counts
        axes = [(2 * np.arange(n) + 1) * c - h for n, c, h in zip(counts, cell, s.half_m, strict=True)]
        grid = np.stack(np.meshgrid(*axes,
                                    indexing="ij"), -1).reshape(-1, 3)  # fmt: skip
        shell = (np.abs(grid) > s.half_m - 2.5 * cell).any(1)  # the inside of a solid need not be covered
        centers.append(matmul(grid[shell], s.T[:3, :3].T) + s.T[:3, 3])
        radii.append(np.full(int(shell.sum()), float(np.sort(cell)[-2:].mean()) * 1.2))
    return np.concatenate(centers), np.concatenate(radii)
