"""Where the r1's arms would touch: spheres on the arms against its own body, the other arm, and solids around it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.robot import kinematics as kin
from mpvi_bt.robot import r1
from mpvi_bt.robot.protocol import SIDES, Side
from mpvi_bt.robot.solids import Array, Solid


def _spheres(rows: Sequence[tuple[float, float, float, float]]) -> tuple[Array, Array]:
    table = np.array(rows)
    return table[:, :3], table[:, 3]


# Centers and radii in the frames of kinematics.arm_frames: upper arm, forearm, tcp.
_UPPER = _spheres([(0, 0, -z, 0.05) for z in (0.10, 0.18, 0.26, 0.32)])
_FORE = _spheres([(0, 0, -z, 0.045) for z in (0.08, 0.16, 0.24, 0.30)])
_HAND = _spheres(
    [(0, y, 0.085 - r1.TCP_M, 0.033) for y in (-0.06, -0.02, 0.02, 0.06)]
    + [(-0.055, 0, 0.085 - r1.TCP_M, 0.02)]
    + [(0, y, z - r1.TCP_M, 0.012) for y in (-0.055, 0.055) for z in (0.135, 0.155)]
)
_RADII = np.concatenate([_UPPER[1], _FORE[1], _HAND[1]])
_NUM_FINGERS = 4  # the last spheres: what may be near a thing that is being grasped
# Boxes (center, half) in the chest frame: chest and head.
_CHEST = [((-0.04, 0, 0.21), (0.07, 0.11, 0.14)), ((-0.01, 0, 0.51), (0.06, 0.09, 0.06))]
_TRUNK = _spheres([(0.03, 0, 0.52, 0.12), (-0.04, 0, 0.40, 0.09), (-0.04, 0.06, 0.25, 0.10), (-0.04, -0.06, 0.25, 0.10),
                   (-0.04, 0, 0.10, 0.11)])  # fmt: skip


def _box_distance(p: Array, center: Sequence[float], half: Sequence[float]) -> Array:
    out = np.maximum(np.abs(p - np.asarray(center)) - np.asarray(half), 0.0)
    return np.asarray(np.sqrt(np.einsum("...i,...i->...", out, out)))


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
        other._inverse = self._inverse @ T
        return other

    def distance(self, p: Array) -> Array:
        """(...,) distance [m] of points (..., 3) to the nearest solid; 0 within one, 9 if there is none."""
        count = len(self._half)
        if not count:
            return np.full(p.shape[:-1], 9.0)
        turned = p.reshape(-1, 3) @ self._inverse[:, :3, :3].transpose(2, 0, 1).reshape(3, -1)
        local = turned.reshape(-1, count, 3) + self._inverse[:, :3, 3]
        out = np.abs(local) - self._half
        if self._round.any():
            radial = np.hypot(local[:, self._round, 0], local[:, self._round, 1]) - self._half[self._round, 0]
            out[:, self._round, 0], out[:, self._round, 1] = radial, 0.0
        np.maximum(out, 0.0, out=out)
        return np.asarray(np.sqrt(np.einsum("nsi,nsi->ns", out, out).min(1)).reshape(p.shape[:-1]))


NOTHING = Surroundings(())


class Together:
    """Several obstacles as one."""

    def __init__(self, parts: Sequence[Obstacles]) -> None:
        """Gather what is posed in one frame."""
        self._parts = parts

    def seen_from(self, T: Array) -> Together:
        """All of them in another frame; `T` (4, 4) maps that frame into the present one."""
        return Together([part.seen_from(T) for part in self._parts])

    def distance(self, p: Array) -> Array:
        """(...,) distance [m] of points (..., 3) to the nearest of all; 9 if there is nothing."""
        return np.minimum.reduce([np.full(p.shape[:-1], 9.0), *(part.distance(p) for part in self._parts)])


def carries(face: Solid, spot: Array, radius: float) -> bool:
    """Whether a disc about a spot (3,) lies on a solid: the corners of its bounding box may not, if round or turned."""
    angles = np.arange(8) * np.pi / 4
    rim = spot + np.stack([np.cos(angles) * radius, np.sin(angles) * radius, np.full(8, -0.002)], -1)
    return bool((Surroundings([face]).distance(rim) <= 0).all())


class Load:
    """What a hand holds, in its tcp frame: exact for what might meet it, covered by spheres for what it might meet."""

    def __init__(self, solids: Sequence[Solid], volumes: Sequence[Solid] = ()) -> None:
        """Gather what is held; solids and container volumes in the tcp frame.

        Volumes count as filled: between two checked postures a hand would slip through a thin wall.
        """
        self.solids = Surroundings([*solids, *volumes])
        self.centers, self.radii = covering_spheres(solids)


@dataclass(frozen=True, eq=False)
class Body:
    """The robot in one posture, and what it holds; says which postures of an arm are free.

    Attributes:
        torso: (>= 3,) lift, waist yaw, waist pitch.
        arms: (7,) posture of each arm.
        held: What each hand holds.
        around: What is near, in the base frame.
    """

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
        q = np.atleast_2d(q)
        p, radii, own = self._arm_points(side, q, grasping)
        around = (self.around.distance(p) - radii).min(1)
        chest = kin.inverse(kin.chest(self.torso))
        in_chest = p @ chest[:3, :3].T + chest[:3, 3]
        itself = np.full(len(q), np.inf)
        for (center, half), first in zip(_CHEST, (1, 2), strict=True):  # the shoulder is inside the chest
            itself = np.minimum(itself, (_box_distance(in_chest[:, first:], center, half) - radii[first:]).min(1))
        low = p[:, 2:]
        column = np.hypot(
            np.maximum(np.hypot(low[..., 0], low[..., 1]) - r1.BASE_RADIUS_M, 0), np.maximum(low[..., 2] - 0.26, 0)
        )
        itself = np.minimum(itself, (column - radii[2:]).min(1))
        itself = np.minimum(itself, (_box_distance(low, (-0.10, 0, 0.40), (0.06, 0.08, 0.20)) - radii[2:]).min(1))
        fold = np.linalg.norm(p[:, 8:own, None] - p[:, None, :2], axis=-1).min((1, 2)) - 0.09
        itself = np.minimum(itself, fold)
        other: Side = "left" if side == "right" else "right"
        p2, r2, own2 = self._arm_points(other, np.atleast_2d(self.arms[other]), False)
        apart = p[:, 2:own, None] - p2[0, None, None, :own2]
        gap = np.sqrt(np.einsum("nijk,nijk->nij", apart, apart)) - radii[2:own, None] - r2[:own2]
        itself = np.minimum(itself, gap.min((1, 2)))
        if other in self.held:
            T = kin.tcp(self.torso, self.arms[other], other)
            itself = np.minimum(
                itself, (self.held[other].solids.seen_from(kin.inverse(T)).distance(p[:, 2:]) - radii[2:]).min(1)
            )
        if side in self.held:
            T = kin.inverse(kin.tcp(self.torso, q, side))
            in_hand = np.einsum("nij,kj->nki", T[:, :3, :3], p2[0, :own2]) + T[:, None, :3, 3]
            itself = np.minimum(itself, (self.held[side].solids.distance(in_hand) - r2[:own2]).min(1))
        return around, itself

    def free(self, side: Side, q: Array, margin: float = 0.0, grasping: bool = False) -> NDArray[np.bool_]:
        """(n,) bool: postures q (n, 7) that keep `margin` [m] from the surroundings and clear of the robot itself."""
        around, itself = self.clearance(side, q, grasping)
        return np.asarray((around > margin) & (itself > 0.0))

    def trunk_free(self) -> bool:
        """Whether head and chest are clear of the surroundings: a pitched waist puts them where the furniture is."""
        T = kin.chest(self.torso)
        return bool((self.around.distance(_TRUNK[0] @ T[:3, :3].T + T[:3, 3]) > _TRUNK[1]).all())

    def all_free(self) -> bool:
        """Whether both arms and the trunk are free as they stand."""
        return self.trunk_free() and all(bool(self.free(s, self.arms[s])[0]) for s in SIDES)

    def _arm_points(self, side: Side, q: Array, grasping: bool) -> tuple[Array, Array, int]:
        C = kin.chest(self.torso)
        parts = []
        frames = kin.arm_frames(q, side)
        hand = (_HAND[0][:-_NUM_FINGERS], _HAND[1][:-_NUM_FINGERS]) if grasping else _HAND
        for T, (centers, _) in zip(frames, (_UPPER, _FORE, hand), strict=True):
            parts.append(np.einsum("nij,kj->nki", T[:, :3, :3], centers) + T[:, None, :3, 3])
        radii = [_UPPER[1], _FORE[1], hand[1]]
        own = 8 + len(hand[0])
        if side in self.held:
            centers, r = self.held[side].centers, self.held[side].radii
            T = frames[2]
            parts.append(np.einsum("nij,kj->nki", T[:, :3, :3], centers) + T[:, None, :3, 3])
            radii.append(r)
        p = np.concatenate(parts, 1)
        return p @ C[:3, :3].T + C[:3, 3], np.concatenate(radii), own


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
        centers.append(grid[shell] @ s.T[:3, :3].T + s.T[:3, 3])
        radii.append(np.full(int(shell.sum()), float(np.sort(cell)[-2:].mean()) * 1.2))
    return np.concatenate(centers), np.concatenate(radii)
