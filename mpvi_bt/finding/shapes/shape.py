"""Estimated shape of a thing: solids, container volumes and bars, in the world."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from mpvi_bt.finding.shapes.outlines import Outline
from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.ground.geometry.solids import Array, Solid, bounds, pose


@dataclass(frozen=True, eq=False)
class SeenBar:
    """A bar to hold a thing by, as seen (implements `mpvi_bt.finding.shapes.moving_parts.Bar`); world frame [m]."""

    center: Array
    axis: Array
    outward: Array
    length_m: float


@dataclass(frozen=True, eq=False)
class Shape:
    """Estimated shape of a thing.

    Attributes:
        kind: The simplest solid that explains its points.
        T: (4, 4) T_world_thing: a frame in its middle, z up, x along its longer side.
        solids: Of it, in the world.
        volumes: Container volumes, in the world.
        bars: To carry it by, in the world.
        support_m: Height of what it stands on.
        extent: Of furniture: the box about all that was seen of it, in the world; its solids are only its faces.
    """

    kind: Literal["box", "cylinder", "ball", "vessel", "furniture"]
    T: Array
    solids: tuple[Solid, ...]
    support_m: float
    volumes: tuple[Solid, ...] = ()
    bars: tuple[SeenBar, ...] = ()
    extent: Solid | None = None

    def moved(self, M: Array) -> Shape:
        """The same, carried along by the motion `M` (4, 4) of the world frame into itself."""
        bars = tuple(replace(b, center=matmul(M[:3, :3], b.center) + M[:3, 3], axis=matmul(M[:3, :3], b.axis),
                             outward=matmul(M[:3, :3], b.outward)) for b in self.bars)  # fmt: skip
        return replace(
            self, T=matmul(M, self.T), solids=tuple(s.moved(M) for s in self.solids),
            volumes=tuple(v.moved(M) for v in self.volumes), bars=bars,
        )  # fmt: skip

    def box(self) -> Array:
        """(2, 3) lowest and highest corner of its axis-aligned bounding box in the world."""
        return bounds(self.solids)


def frame(xy: Array, heading: float, low: float, high: float) -> Array:
    """T_world_thing (4, 4) in the middle between two heights over a place (2,), x along the heading [rad]."""
    return pose((float(xy[0]), float(xy[1]), (low + high) / 2), heading)


def upright_box(seen: Outline, support: float, top: float) -> Shape:
    """The box of an outline between two heights [m]."""
    T = frame(seen.middle, seen.heading, support, top)
    half = np.array([*np.maximum(seen.sides, 0.004), top - support]) / 2
    return Shape("box", T, (Solid("box", half, T),), support)
