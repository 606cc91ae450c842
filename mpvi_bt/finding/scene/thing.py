"""One thing that was seen, and whether two are one: detectors give masks of the same phrase, and no names."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial import cKDTree

from mpvi_bt.finding.scene.several_views import View
from mpvi_bt.finding.shapes.shape import Shape
from mpvi_bt.ground.geometry.solids import Array


@dataclass(frozen=True)
class Sameness:
    """When two sightings are of one thing.

    Our choice: from one side, or from nearby, only a part of a thing is in view.
    """

    sampled: int = 500  # points that are enough to place a part
    shared: float = 0.6  # least shared part of the smaller one's length, width and height, for furniture [ratio]
    alike: float = 0.8  # the same for two other things [ratio]; stacked bowls share less of their height
    outside_m: float = 0.05  # a leg may stand this far outside of the visible top of a table [m]


_SAME = Sameness()


@dataclass(eq=False)
class SeenThing:
    """One thing that was seen.

    Attributes:
        name, phrase: "can of soda 1", "can of soda".
        shape: What it is taken to be, where it was seen or put last.
        views: Frames that show it, with its mask, newest last.
        inner: Those that showed the room in it last: from elsewhere only a door of furniture, or a side, is in view.
        inside: The container that it is in.
        stands: It was set down in there, and did not fall.
        lowest_m: How far down furniture was ever seen: from near its foot is out of view.
    """

    name: str
    phrase: str
    shape: Shape
    views: list[View] = field(default_factory=list)
    inner: list[View] = field(default_factory=list)
    inside: str | None = None
    stands: bool = False
    lowest_m: float = np.inf


def apart(part: Array, whole: cKDTree) -> float:
    """How far points (n, 3) of a part of a thing are from all points of it [m], the median."""
    sample = part[:: max(1, len(part) // _SAME.sampled)]
    return float(np.median(whole.query(sample)[0])) if len(part) else np.inf


def is_again(thing: SeenThing, other: SeenThing) -> bool:
    """Whether a thing is another once more: the ends of a table, seen by head and hand, are no two tables.

    Nor are the foot of a coffee maker and its top, with the kettle before it, two coffee makers once all of it is seen.
    """
    large = [shape.extent for shape in (thing.shape, other.shape) if shape.extent is not None]
    if thing.phrase != other.phrase or len(large) == 1:
        return False
    (low, high), (low2, high2) = (
        [extent.aabb() for extent in large] if large else [thing.shape.box(), other.shape.box()]
    )
    shared = np.minimum(high, high2) - np.maximum(low, low2)
    return bool((shared > (_SAME.shared if large else _SAME.alike) * np.minimum(high - low, high2 - low2)).all())


def is_part(thing: SeenThing, furniture: SeenThing) -> bool:
    """Whether a thing is but a part of furniture of that name: a leg of a table, seen by a hand, is no other table."""
    if thing.phrase != furniture.phrase or thing.shape.kind == "furniture" or furniture.shape.kind != "furniture":
        return False
    (low, high), middle = furniture.shape.box(), thing.shape.box().mean(0)
    return bool((middle[:2] > low[:2] - _SAME.outside_m).all() and (middle < high + _SAME.outside_m).all())
