"""Where a robot's arms would touch: spheres on an arm against its own body, the other arm, and solids around it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.ground.geometry import kernels
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.ground.geometry.solids import Array, Solid
from mpvi_bt.ground.robot.model import RobotModel
from mpvi_bt.ground.robot.protocol import Side, other


class Obstacles(Protocol):
    """Things to avoid; gives the distance of points from them."""

    def seen_from(self, T: Array) -> Obstacles:
        """The same in another frame; `T` (4, 4) maps that frame into the present one."""
        ...

    def distance(self, p: Array) -> Array:
        """(...,) distance [m] of points (..., 3) to the nearest of it; 0 within, 9 if there is nothing."""
        ...


_Solids = tuple[Array, Array, NDArray[np.bool_]]  # inverse poses (n, 4, 4), half extents (n, 3), which are round
# Centers (n, 3) and radii (n,) of the other arm and the trunk's links; what the other hand holds; links that are boxes.
_Rest = tuple[Array, Array, _Solids, _Solids]


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
    def arrays(self) -> _Solids:
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
        first, *others = self._parts or [NOTHING]
        out = first.distance(p)
        for part in others:
            out = np.minimum(out, part.distance(p))
        return out


def carries(face: Solid, spot: Array, radius: float) -> bool:
    """Whether a disc about a spot (3,) lies on a solid: the corners of its bounding box may not, if round or turned."""
    angles = np.arange(8) * np.pi / 4
    rim = spot + np.stack([np.cos(angles) * radius, np.sin(angles) * radius, np.full(8, -0.002)], -1)
    return bool((Surroundings([face]).distance(rim) <= 1e-9).all())  # a disc may reach right to an edge


class Load:
    """A payload in its hand's tcp frame. Others are tested against its exact solids; it is tested as spheres."""

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


@dataclass(frozen=True, eq=False)
class Body:
    """The robot in one posture, with its payloads; tells which arm postures are free.

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
        return (self.around.distance(p) - radii).min(1), self._from_itself(side, p, hands, radii, own)

    def _from_itself(self, side: Side, p: Array, hands: Array, radii: Array, own: int) -> Array:
        """How far an arm keeps from the robot itself (n,), as `_arm_points` has it."""
        hull, mine = self.robot.hull, self.held[side].solids if side in self.held else NOTHING
        return np.asarray(kernels.self_distance(
            p, radii, hull.hand_from, own, hands, self.from_chest, hull.boxes, hull.boxes_from, hull.columns,
            hull.base, hull.fold_m, *self._rest(other(side)), mine.arrays,
        ))  # fmt: skip

    def _rest(self, idle: Side) -> _Rest:
        """What an arm keeps clear of besides boxes, with the other one as it stands."""
        load = self.held.get(idle)
        if (idle, load) not in self._rests:
            centers, radii, theirs = *self._links, NOTHING
            if idle in self.arms:
                p, hands, r, own = self._arm_points(idle, self.arms[idle], False)
                centers, radii = np.concatenate([p[0, :own], centers]), np.concatenate([r[:own], radii])
                theirs = NOTHING if load is None else load.solids.seen_from(kin.inverse(hands[0]))
            self._rests[idle, load] = centers, radii, theirs.arrays, self._link_boxes.arrays
        return self._rests[idle, load]

    def amid(self, around: Obstacles, held: Mapping[Side, Load] | None = None) -> Body:
        """The same posture with other things around it, and other loads if they are given.

        What has been computed of the posture is kept: searches ask the same one thousands of times.
        """
        there = replace(self, around=around, held=self.held if held is None else held)
        vars(there).update(
            _chest=self._chest, from_chest=self.from_chest, _links=self._links, trunk=self.trunk, _rests=self._rests
        )
        return there

    def spheres(self, side: Side, q: Array) -> tuple[Array, Array]:
        """Centers (n, m, 3) in the base frame and radii (m,) of an arm in postures q (n, 7), with what it holds."""
        p, _, radii, _ = self._arm_points(side, q, False)
        return p, radii

    def distance(self, side: Side, q: Array, grasping: bool = False) -> float:
        """How far posture q (7,) of an arm, with what it holds, keeps from the surroundings [m], negative within.

        `grasping` leaves the fingers out, which may touch what they grasp.
        """
        p, _, radii, _ = self._arm_points(side, q, grasping)
        return float((self.around.distance(p) - radii).min())

    def distances(self, side: Side, q: Array, chests: Array) -> Array:
        """(n,) the same for postures q (n, 7), the torso moved to T_base_chest (n, 4, 4)."""
        p, _, radii, _ = self._arm_points(side, q, False, chests)
        return np.asarray((self.around.distance(p) - radii).min(1))

    def free(self, side: Side, q: Array, margin: float = 0.0, grasping: bool = False) -> NDArray[np.bool_]:
        """(n,) bool: postures q (n, 7) that keep `margin` [m] from the surroundings and clear of the robot itself."""
        p, hands, radii, own = self._arm_points(side, q, grasping)
        out = np.asarray((self.around.distance(p) - radii).min(1) > margin)
        if out.any():
            some = slice(None) if out.all() else out
            out[some] = self._from_itself(side, p[some], hands[some], radii, own) > 0.0
        return out

    def whole(self) -> tuple[Array, Array]:
        """Centers (n, 3) in the base frame and radii (n,) of the spheres of trunk and arms, with what they hold."""
        parts = [self.trunk, *((p[0], radii) for p, radii in (self.spheres(s, q) for s, q in self.arms.items()))]
        return np.concatenate([p for p, _ in parts]), np.concatenate([radii for _, radii in parts])

    def trunk_gaps(self) -> Array:
        """(n,) how far the spheres about head, chest and the trunk's links keep from the surroundings [m]."""
        centers, radii = self.trunk
        return self.around.distance(centers) - radii

    def trunk_free(self) -> bool:
        """Whether head and chest are clear of the surroundings: a pitched waist puts them where the furniture is."""
        return bool((self.trunk_gaps() > 0).all())

    def all_free(self) -> bool:
        """Whether arms and trunk are free as they stand."""
        return self.trunk_free() and all(bool(self.free(s, q)[0]) for s, q in self.arms.items())

    @cached_property
    def _chest(self) -> Array:
        return self.robot.chest(self.torso)

    @cached_property
    def from_chest(self) -> Array:
        """T_chest_base (4, 4)."""
        return kin.inverse(self._chest)

    @cached_property
    def _links(self) -> tuple[Array, Array]:
        return self.robot.links(self.torso)

    @cached_property
    def trunk(self) -> tuple[Array, Array]:
        """Spheres about head, chest and the trunk's links in the base frame: centers (n, 3) and radii (n,)."""
        T, trunk = self._chest, self.robot.hull.trunk
        centers, radii = self._links
        chest = matmul(trunk[:, :3], T[:3, :3].T) + T[:3, 3]
        return np.concatenate([chest, centers]), np.concatenate([trunk[:, 3], radii])

    @cached_property
    def _link_boxes(self) -> Surroundings:
        boxes = self.robot.hull.link_boxes
        if not len(boxes):
            return NOTHING
        frames = zip(self.robot.trunk.links(self.torso), boxes, strict=False)
        return Surroundings([Solid("box", b[3:], matmul(T, kin.transform(np.eye(3), b[:3]))) for T, b in frames])

    @cached_property
    def _rests(self) -> dict[tuple[Side, Load | None], _Rest]:
        return {}  # `_rest`, by arm and what it holds, once it is asked for

    def _arm_points(
        self, side: Side, q: Array, grasping: bool, chests: Array | None = None
    ) -> tuple[Array, Array, Array, int]:
        """Centers (n, m, 3) in the base frame, T_base_tcp (n, 4, 4), radii (m,) and how many are the arm's own.

        `chests` (n, 4, 4) are the T_base_chest of the postures, where the torso moves, too.
        """
        hull = self.robot.hull
        own = len(hull.radii) - (hull.fingers if grasping else 0)
        centers, radii, link = hull.centers[:own], hull.radii[:own], hull.frame[:own]
        if side in self.held:
            load = self.held[side]
            centers, radii = np.concatenate([centers, load.centers]), np.concatenate([radii, load.radii])
            link = np.concatenate([link, np.full(len(load.radii), hull.hand_frame)])
        q = np.ascontiguousarray(np.atleast_2d(q), float)
        p, hands = kernels.sphere_centers(
            self.robot.arms[side].frames(q), self._chest[None] if chests is None else chests, centers, link
        )
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
