"""Paths of the robot and of moved things, with fewer points, so that every result can hold them."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.marked_yaml import Record

Place = Annotated[list[Annotated[float, Field(allow_inf_nan=False)]], Field(min_length=2, max_length=2)]

TOLERANCE_M = 0.03  # Our choice: less than a line on a drawn map is wide


class Way(Record):
    """Where everything went, as x and y in the world [m].

    Attributes:
        base: Corners of the base's way, in order.
        things: Where each movable thing was at the start, and at the end; what came to be meanwhile, at the end twice.
    """

    base: list[Place]
    things: dict[str, Annotated[list[Place], Field(min_length=2, max_length=2)]] = {}


def thinned(points: Array, tolerance_m: float = TOLERANCE_M) -> list[list[float]]:
    """Corners of a polyline from which none of its points is farther than the tolerance.

    Keeps the point that is farthest from the line between two kept ones until none is too far (Ramer, Douglas and
    Peucker).

    Args:
        points: (n, 2) [m].
        tolerance_m: Greatest distance of a point that is left out.

    Returns:
        Its corners, to whole centimeters, the first and the last point among them.
    """
    if not len(points):
        return []
    kept = {0, len(points) - 1}
    open_parts = [(0, len(points) - 1)]
    while open_parts:
        first, last = open_parts.pop()
        far = _distances(points[first + 1 : last], points[first], points[last])
        if len(far) and far.max() > tolerance_m:
            middle = first + 1 + int(far.argmax())
            kept.add(middle)
            open_parts += [(first, middle), (middle, last)]
    return [list(place) for place in np.round(points[sorted(kept)], 2).tolist()]


def _distances(points: Array, a: Array, b: Array) -> Array:
    """(n,) distances of points from the line segment a to b."""
    along = b - a
    length2 = float(matmul(along, along))
    share = np.clip(matmul(points - a, along) / length2, 0.0, 1.0) if length2 else np.zeros(len(points))
    return np.asarray(norm(points - a - share[:, None] * along, axis=1))
