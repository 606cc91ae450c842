"""Whether one thing can be inside another, or on top of it, by their shapes alone.

Each answer errs to the side of "possible": what is called impossible is so in every pose of the two.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.ground.geometry.solids import Array, Solid
from mpvi_bt.house.things.description import Description, Part

_CELLS = 16  # along each side of a container's face. Our choice: openings are known to a sixteenth of it
_SIDES = 12  # of the prism that stands for a cylinder, inside of it
_LEVEL = 0.97  # cosine of the tilt up to which a face is level: 14 degrees. Our choice: things slide off a steeper one
_TOLERANCE_M = 0.002
_PARALLEL = 1e-9


def not_inside(thing: Description, container: Description) -> str | None:
    """Why a thing cannot be inside another, such as "its opening is 0.20 x 0.20 m"; None: perhaps it can.

    Inside is what `goals.predicates.inside` says: the middle of the thing is in a volume of the container. It gets
    there through a face of the volume that nothing blocks, with doors and drawers closed or open.
    """
    volumes = sum(len(body.volumes) for body in container.bodies)
    if not volumes:
        return "it has no volume that holds things (`volumes`)"
    least, middle, _ = np.sort(np.ptp(thing.extent(visible=True), axis=0))
    openings = _openings(container)
    if not openings:
        return "its volume has no opening"
    if any(least <= side + _TOLERANCE_M and middle <= np.hypot(side, other) for side, other in openings):
        return None
    side, other = max(openings)
    return f"its opening is {side:.2f} x {other:.2f} m, and the thing's smallest sides are {least:.2f} x {middle:.2f} m"


def no_top(description: Description, fixed: bool) -> bool:
    """Whether a thing has no level face to put anything on.

    Args:
        description: The thing's.
        fixed: Whether it stands as it is described; otherwise any flat face of it may be turned up.
    """
    faces = [face for body in description.bodies for part in body.parts for face in _flat_faces(part)]
    return not any(abs(face[2]) >= _LEVEL or not fixed for face in faces)


def _flat_faces(part: Part) -> Iterator[Array]:
    """Normals (3,) of the flat faces of a part that collides; of opposite ones once."""
    if not part.collides or part.solid.kind == "sphere":
        return
    if part.hull is not None:
        yield np.array([0.0, 0.0, 1.0])  # of many facets: some may be level
        return
    axes = (0, 1, 2) if part.solid.kind == "box" else (2,)
    for axis in axes:
        yield part.solid.T[:3, axis]


@lru_cache(maxsize=256)
def _openings(container: Description) -> tuple[tuple[float, float], ...]:
    """The shorter and longer side [m] of each opening of a container's volumes, its doors closed or open."""
    found: set[tuple[float, float]] = set()
    all_open = {body.name: 1.0 for body in container.bodies}
    for body in container.bodies:
        for openings in ({}, all_open, {body.name: 1.0}) if container.jointed else ({},):
            frames = container.frames(openings)
            blocks = [
                _half_spaces(part, frames[other.name])
                for other in container.bodies
                for part in other.parts
                if part.collides
            ]
            for volume in body.volumes:
                found.update(_faces_of(volume.moved(frames[body.name]), blocks))
    return tuple(sorted(found))


def _faces_of(volume: Solid, blocks: list[Array]) -> Iterator[tuple[float, float]]:
    """The shorter and longer side of what is free of each face of a volume, posed like the convex `blocks`."""
    R, center, half = volume.T[:3, :3], volume.T[:3, 3], volume.half_m
    grid = (np.arange(_CELLS) + 0.5) / _CELLS * 2 - 1
    for axis in range(3):
        first, second = (k for k in range(3) if k != axis)
        for sign in (-1.0, 1.0):
            local = np.zeros((_CELLS, _CELLS, 3))
            local[..., axis] = sign * half[axis]
            local[..., first], local[..., second] = np.meshgrid(grid * half[first], grid * half[second], indexing="ij")
            starts = matmul(local.reshape(-1, 3), R.T) + center
            free = ~_blocked(starts, sign * R[:, axis], blocks).reshape(_CELLS, _CELLS)
            if free.any():
                sides = [_width(np.flatnonzero(free.any(1 - k)), float(half[j])) for k, j in ((0, first), (1, second))]
                yield min(sides), max(sides)


def _width(free: NDArray[np.intp], half: float) -> float:
    """The free width [m], from the first to the last free cell and half a cell more on each side."""
    return min(float(free[-1] - free[0] + 2) / _CELLS, 1.0) * 2 * half


def _half_spaces(part: Part, frame: Array) -> Array:
    """(F, 4) half-spaces n x + c <= 0 of a convex body inside a part, in the frame that `frame` (4, 4) maps into."""
    if part.hull is not None:
        from scipy.spatial import ConvexHull

        return ConvexHull(matmul(part.hull, frame[:3, :3].T) + frame[:3, 3]).equations
    solid = part.solid.moved(frame)
    half = solid.half_m
    if solid.kind == "cylinder":
        angles = np.arange(_SIDES) * 2 * np.pi / _SIDES
        normals = np.vstack(
            [np.column_stack([np.cos(angles), np.sin(angles), np.zeros(_SIDES)]), [[0, 0, 1], [0, 0, -1]]]
        )
        reach = np.array([half[0] * np.cos(np.pi / _SIDES)] * _SIDES + [half[2]] * 2)
    else:
        normals = np.vstack([np.eye(3), -np.eye(3)])
        reach = np.tile(half if solid.kind == "box" else half / np.sqrt(3), 2)
    turned = matmul(normals, solid.T[:3, :3].T)
    return np.column_stack([turned, -reach - matmul(turned, solid.T[:3, 3])])


def _blocked(starts: Array, direction: Array, blocks: list[Array]) -> NDArray[np.bool_]:
    """(N,) bool: the rays from starts (N, 3) along a direction (3,) meet one of the convex blocks."""
    out = np.zeros(len(starts), bool)
    for planes in blocks:
        speed = matmul(planes[:, :3], direction)
        depth = matmul(starts, planes[:, :3].T) + planes[:, 3]
        along = np.abs(speed) < _PARALLEL
        outside = (depth[:, along] > 0).any(1)
        t = -depth[:, ~along] / speed[~along]
        leaves = np.where(speed[~along] > 0, t, np.inf).min(1)
        enters = np.where(speed[~along] < 0, t, -np.inf).max(1)
        out |= ~outside & (np.maximum(enters, 0.0) < leaves)
    return out
