"""Whether a new view shows only a part of a known thing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mpvi_bt.finding.shapes.shape import Shape
from mpvi_bt.ground.geometry.solids import bounds


@dataclass(frozen=True)
class Parts:
    """When a view shows only a part of what was known."""

    taller: float = 1.3  # the view of furniture that is this many times as tall shows more of it; our choice
    in_view: float = 0.5  # furniture with less of its room in view is only seen in part [ratio]; our choice
    shrunk: float = 0.9  # a thing that seems this much smaller than before is partly hidden [ratio]; our choice
    same_m: float = 0.015  # a vessel whose outside is seen this close to where it was has not moved [m]; our choice


_PART = Parts()


def in_part(shape: Shape, before: Shape) -> bool:
    """Whether only a part of furniture is seen now: nothing of its inside or, by its height or from above, less of it.

    Who sees into it sees more than its outside, however large that is.
    """
    if bool(before.volumes) != bool(shape.volumes):
        return bool(before.volumes)
    now, then = (float(np.ptp(s.box()[:, 2])) for s in (shape, before))
    # what a hand holds may hide most of the room in a sink
    less = shrunk(shape, before) or (bool(shape.volumes) and _room(shape) < _PART.in_view * _room(before))
    return now * _PART.taller < then or (now < then * _PART.taller and less)


def _room(shape: Shape) -> float:
    """How much floor the room in a thing takes up [m^2]."""
    return float(np.prod(np.ptp(bounds(shape.volumes), axis=0)[:2]))


def as_outside(shape: Shape, vessel: Shape) -> bool:
    """Whether a shape may be the outside of a known vessel at the same place: not hollow, and no larger."""
    low, high = vessel.box()
    now = shape.box()
    return not shape.volumes and bool((now[0] > low - _PART.same_m).all() and (now[1] < high + _PART.same_m).all())


def shrunk(shape: Shape, before: Shape) -> bool:
    """Whether a thing seems so much smaller than before, seen from above, that it must be partly hidden."""
    return bool((np.ptp(shape.box(), axis=0) < _PART.shrunk * np.ptp(before.box(), axis=0))[:2].any())
