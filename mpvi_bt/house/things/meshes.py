"""Triangle meshes of solids, one for each color of a body: what cameras draw.

On a CPU a picture of a house costs by the number of its shapes: one mesh a color, not one shape a solid, saves a third.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array, Solid
from mpvi_bt.house.things.description import Color, Part, Skin

_SIDES = 24  # of a cylinder
_RINGS = 10  # of a sphere


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles.

    Attributes:
        vertices: (V, 3) [m].
        normals: (V, 3) unit vectors.
        triangles: (T, 3) indices, counterclockwise from outside.
    """

    vertices: Array
    normals: Array
    triangles: NDArray[np.int64]


def meshes(parts: Iterable[Part]) -> Iterator[tuple[Color, Mesh]]:
    """One mesh in the body frame for each color."""
    by_color: dict[Color, list[Solid]] = {}
    for part in parts:
        by_color.setdefault(part.color, []).append(part.solid)
    for color, solids in by_color.items():
        yield color, _merged([_of(solid) for solid in solids])


def faceted(skin: Skin) -> Mesh:
    """The triangles of a skin, each flat: every corner is its own, with the normal of its triangle."""
    corners = skin.vertices[skin.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = norm(normals)[:, None]
    normals = np.where(lengths > 0, normals / np.maximum(lengths, 1e-20), [0.0, 0.0, 1.0])
    return Mesh(corners.reshape(-1, 3), np.repeat(normals, 3, axis=0), np.arange(3 * len(corners)).reshape(-1, 3))


def _of(solid: Solid) -> Mesh:
    unit = {"box": _box, "cylinder": _cylinder, "sphere": _sphere}[solid.kind]()
    R, p = solid.T[:3, :3], solid.T[:3, 3]
    # shapes are scaled along their own axes, alike around a cylinder's, so normals of flat and round faces keep theirs
    return Mesh(matmul(unit.vertices * solid.half_m, R.T) + p, matmul(unit.normals, R.T), unit.triangles)


def _merged(parts: list[Mesh]) -> Mesh:
    starts = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
    return Mesh(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.normals for part in parts]),
        np.concatenate([part.triangles + start for part, start in zip(parts, starts, strict=True)]),
    )


@cache
def _box() -> Mesh:
    """The cube of half extents 1."""
    faces = []
    square = np.array([[-1.0, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]])
    for axis in range(3):
        for sign in (1, -1):
            turned = np.roll(square * [1, sign, sign], axis + 1, axis=1)
            normal = np.roll([0.0, 0.0, sign], axis + 1)
            faces.append(Mesh(turned, np.tile(normal, (4, 1)), np.array([[0, 1, 2], [0, 2, 3]])))
    return _merged(faces)


@cache
def _cylinder() -> Mesh:
    """The cylinder of radius 1 along z from -1 to 1."""
    angle = np.arange(_SIDES) * (2 * np.pi / _SIDES)
    circle = np.stack([np.cos(angle), np.sin(angle), np.zeros(_SIDES)], 1)
    here, there = np.arange(_SIDES), np.roll(np.arange(_SIDES), -1)
    up = np.array([0.0, 0, 1])
    low, high = here, here + _SIDES
    side = Mesh(
        np.concatenate([circle - up, circle + up]),
        np.concatenate([circle, circle]),
        np.concatenate([np.stack([low, there, there + _SIDES], 1), np.stack([low, there + _SIDES, high], 1)]),
    )
    fan = np.stack([np.zeros(_SIDES - 2, int), np.arange(1, _SIDES - 1), np.arange(2, _SIDES)], 1)
    top = Mesh(circle + up, np.tile(up, (_SIDES, 1)), fan)
    bottom = Mesh(circle - up, np.tile(-up, (_SIDES, 1)), fan[:, ::-1])
    return _merged([side, top, bottom])


@cache
def _sphere() -> Mesh:
    """The sphere of radius 1."""
    columns = 2 * _RINGS
    polar, around = np.meshgrid(
        np.linspace(0, np.pi, _RINGS + 1), np.linspace(0, 2 * np.pi, columns + 1), indexing="ij"
    )
    points = np.stack([np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)], -1).reshape(
        -1, 3
    )
    row, column = (grid.ravel() for grid in np.indices((_RINGS, columns)))
    corner = row * (columns + 1) + column
    below = corner + columns + 1
    triangles = np.concatenate([np.stack([corner, below, below + 1], 1), np.stack([corner, below + 1, corner + 1], 1)])
    return Mesh(points, points, triangles)
