"""Parts of things that hands work on: bars to hold, doors, lids and drawers to open."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array, Solid


@dataclass(frozen=True)
class PartSizes:
    """Sizes assumed for doors, lids and drawers that are only seen from outside.

    Our choice: those of kitchen furniture.
    """

    panel_m: float = 0.018  # thickness of a front [m]
    upright_rad: float = 1.6  # limit of doors and lids [rad]; one that stands wider open has that opening as its limit
    flap_rad: float = 1.3  # limit of doors that swing about a level hinge [rad]
    slide_m: float = 0.32  # limit of drawers [m]
    deep_m: float = 0.6  # largest depth behind an open door [m]


PART = PartSizes()
_UPRIGHT = 0.7  # our choice: cosine with the vertical of axes and faces that count as vertical, half way to level


class Bar(Protocol):
    """A bar that a hand can close around, in the world frame [m]; `mpvi_bt.house.things.description.Handle` is one."""

    @property
    def center(self) -> Array:
        """(3,) middle of the bar."""
        ...

    @property
    def axis(self) -> Array:
        """(3,) unit vector along it."""
        ...

    @property
    def outward(self) -> Array:
        """(3,) unit vector to its free side."""
        ...

    @property
    def length_m(self) -> float:
        """Free length of the bar."""
        ...


@dataclass(frozen=True, eq=False)
class Door:
    """A part of a thing that opens: a hinged door, a lid, a drawer.

    Attributes:
        name: Of the part, such as "door" or "drawer_2".
        kind: A hinge turns [rad], a slide shifts [m].
        origin: (3,) a point on the hinge's axis, or any on the slide's, in the world.
        axis: (3,) unit vector in the world: positive motion about or along it opens.
        position: How far it is open [rad or m].
        limit: How far it opens [rad or m].
        bar: What to hold it by, where it is now; None if it has no handle.
        solids: The moving part as it stands now, in the world.
    """

    name: str
    kind: Literal["hinge", "slide"]
    origin: Array
    axis: Array
    position: float
    limit: float
    bar: Bar | None
    solids: Sequence[Solid]


def moved(door: Door, by: float) -> Array:
    """(4, 4) motion of a door's moving parts as the door opens further, by `by` [rad or m]."""
    if door.kind == "slide":
        return kin.transform(np.eye(3), door.axis * by)
    R = turned(door.axis, by)
    return kin.transform(R, door.origin - matmul(R, door.origin))


def turned(axis: Array, angle_rad: float) -> Array:
    """(3, 3) rotation about a unit vector (3,), in a tenth of the time that scipy takes: searches ask for thousands."""
    x, y, z = axis
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + np.sin(angle_rad) * K + (1.0 - np.cos(angle_rad)) * matmul(K, K))


def upright(door: Door) -> bool:
    """Whether it turns about a vertical hinge."""
    return door.kind == "hinge" and abs(float(door.axis[2])) > _UPRIGHT


def lid(door: Door) -> bool:
    """Whether it lies on top of what it closes, and turns about a level hinge."""
    shut = matmul(moved(door, -door.position)[:3, :3], outward(door))
    return door.kind == "hinge" and not upright(door) and float(shut[2]) > _UPRIGHT


def panel(door: Door) -> Solid:
    """Its largest solid."""
    return max(door.solids, key=lambda s: float(np.sort(s.half_m)[1:].prod()))


def outward(door: Door) -> Array:
    """(3,) unit vector out of the outer face of its panel, as it stands: the side that it opens to."""
    face = panel(door)
    way = door.axis if door.kind == "slide" else np.cross(door.axis, face.T[:3, 3] - door.origin)
    along = matmul(way, face.T[:3, :3])
    k = int(np.abs(along).argmax())
    return np.asarray(face.T[:3, k] * np.sign(along[k]))


def to_and_behind(door: Door) -> Solid:
    """Box, in the world, around the path of a closed door's panel and around the space behind the panel."""
    face = panel(door)
    arm = face.T[:3, 3] - door.origin
    if door.kind == "slide":
        out, reach = door.axis, door.limit
    else:
        arm = arm - door.axis * matmul(door.axis, arm)
        out, reach = np.cross(door.axis, arm) / norm(arm), 2 * float(norm(arm))
    k, half, T = int(np.abs(matmul(out, face.T[:3, :3])).argmax()), face.half_m.copy(), face.T.copy()
    half[k] = (reach + PART.deep_m) / 2
    T[:3, 3] += out * (reach - PART.deep_m) / 2
    return Solid("box", half, T)
