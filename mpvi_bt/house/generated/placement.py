"""Furniture in one room of a generated house: what stands there, and whether more has room."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from mpvi_bt.house.generated.plane import SIDES, Rect, Side, WallFrame, grown, overlap, within
from mpvi_bt.house.things.catalogue import Catalogue

Corner = tuple[float, float, float]
WALL_M = 0.05  # half a wall, which is inside the room's rectangle
GAP_M = 0.004  # between things that touch
LOW_M = 0.05  # lower things are driven over
HEAD_M = 1.5  # what begins above this is over the robot's body
HINGE_M = 0.1  # between a wall and a thing whose door may open toward it
SWING_M = 0.3  # beside a thing: what sticks out there keeps its door from opening by three quarters
DOOR_ZONE_M = 0.95  # floor before a doorway that stays free
_STEP_M = 0.05


class NoRoom(Exception):
    """Something has no room; the room is furnished anew."""


@dataclass(frozen=True)
class Furnishing:
    """A fixture, as it will stand in the file, and what it takes up.

    Attributes:
        name, entry: As in the file.
        at: x, y [m].
        z_m, yaw_deg, shape: As in the file.
        area: What it covers.
        heights: Its lowest and highest point [m].
        front: Where one stands to use it; None: nobody does.
    """

    name: str
    entry: str
    at: tuple[float, float]
    yaw_deg: float
    area: Rect
    heights: tuple[float, float]
    z_m: float = 0.0
    shape: Mapping[str, Any] = field(default_factory=dict)
    front: Rect | None = None

    @property
    def on_floor(self) -> bool:
        """Whether the robot's body cannot pass it."""
        return self.heights[0] < HEAD_M and self.heights[1] > LOW_M


@dataclass(frozen=True)
class WallOpening:
    """A doorway in one wall of a room.

    Attributes:
        side: Which wall.
        middle_m: Where along the wall [m], from its south or west end.
        width_m: Clear width.
    """

    side: Side
    middle_m: float
    width_m: float


class RoomFloor:
    """One room: its walls, doorways and furniture, more with each call.

    Args:
        name: Of the room.
        rect: Of the room, with its walls.
        openings: Its doorways.
        outer: Stretches of its walls with nothing but the open behind them.
        catalogue: Where the sizes of things come from.
        rng: Source of the draw.
    """

    def __init__(
        self,
        name: str,
        rect: Rect,
        openings: Sequence[WallOpening],
        outer: Sequence[tuple[Side, float, float]],
        catalogue: Catalogue,
        rng: np.random.Generator,
    ) -> None:
        self.name, self.rect, self.openings, self.outer, self.rng = name, rect, openings, outer, rng
        self.pieces: list[Furnishing] = []
        self._catalogue = catalogue
        self._extents: dict[tuple[str, str], tuple[Corner, Corner]] = {}
        self.inside = grown(rect, -WALL_M)
        self.doors = [self.before(opening) for opening in openings]

    def frame(self, side: Side) -> WallFrame:
        """A wall, by its surface."""
        return WallFrame(self.inside, side)

    def sides(self) -> list[Side]:
        """The four walls, in a drawn order."""
        return [SIDES[k] for k in self.rng.permutation(4)]

    def size(self, entry: str, shape: Mapping[str, Any] = {}) -> tuple[float, float, float]:
        """Depth, width and height [m] of a thing, with its handles."""
        low, high = self._extent(entry, shape)
        return high[0] - low[0], high[1] - low[1], high[2] - low[2]

    def _extent(self, entry: str, shape: Mapping[str, Any]) -> tuple[Corner, Corner]:
        """Lowest and highest corner of a thing in its own frame, with its handles [m]."""
        known = (entry, repr(sorted(shape.items())))
        if known not in self._extents:
            low, high = self._catalogue[entry].reshaped(shape).description.extent(visible=True).tolist()
            self._extents[known] = tuple(low), tuple(high)
        return self._extents[known]

    def piece(
        self,
        name: str,
        entry: str,
        frame: WallFrame,
        u: float,
        v: float = GAP_M,
        *,
        z_m: float = 0.0,
        turn_deg: float = 0.0,
        front_m: float = 0.0,
        shape: Mapping[str, Any] | None = None,
    ) -> Furnishing:
        """A thing whose middle is at `u` along a wall and whose back at `v` from it; nothing is put up yet.

        Args:
            name, entry, z_m, shape: As in the file.
            frame: The wall.
            u, v: Place [m].
            turn_deg: Turned by that from facing away from the wall.
            front_m: How far the floor before it stays free; 0: nobody stands there.
        """
        (back, right, bottom), (tip, left, top) = self._extent(entry, shape or {})
        quarter = round(turn_deg / 90) % 4
        depth, half = tip - back, max(-right, left)
        if quarter % 2:
            depth, half = 2 * half, depth / 2
        yaw = (frame.yaw_deg + turn_deg) % 360
        area = frame.area(u - half, u + half, v, v + depth)
        at = frame.point(u, v + (depth / 2 if quarter else -back))
        front = frame.area(u - half, u + half, v + depth, v + depth + front_m) if front_m else None
        heights = (z_m + bottom, z_m + top)
        return Furnishing(name, entry, at, yaw, area, heights, z_m, dict(shape or {}), front)

    def before(self, opening: WallOpening, depth_m: float = DOOR_ZONE_M) -> Rect:
        """The floor before a doorway, so deep."""
        half = opening.width_m / 2 + 0.1
        frame = WallFrame(self.rect, opening.side)
        return frame.area(opening.middle_m - half, opening.middle_m + half, 0.0, WALL_M + depth_m)

    def fits(self, pieces: Sequence[Furnishing]) -> bool:
        """Whether things have room, and all have the floor before them free."""
        return all(self._fits(piece, pieces) for piece in pieces)

    def add(self, pieces: Iterable[Furnishing]) -> None:
        """Put things up."""
        self.pieces += pieces

    def along_wall(
        self,
        name: str,
        entry: str,
        *,
        front_m: float = 0.9,
        z_m: float = 0.0,
        shape: Mapping[str, Any] | None = None,
        corner: bool = False,
        sides: Sequence[Side] | None = None,
        gap_m: float = GAP_M,
        beside_m: float = GAP_M,
    ) -> Furnishing:
        """Put a thing up with its back to a wall.

        Args:
            name, entry, front_m, z_m, shape: As of `piece`.
            corner: As near to a corner as it goes, not anywhere.
            sides: Which walls; None: any.
            gap_m: To the wall.
            beside_m: To the walls at its sides, at the least.

        Raises:
            NoRoom: It fits nowhere.
        """
        half = self.size(entry, shape or {})[1] / 2 + beside_m
        for side in sides if sides is not None else self.sides():
            frame = self.frame(side)
            for u in self.spots(frame, half, corner):
                piece = self.piece(name, entry, frame, u, gap_m, z_m=z_m, front_m=front_m, shape=shape)
                if self.fits([piece]):
                    self.add([piece])
                    return piece
        raise NoRoom(f"{name} in the {self.name}")

    def behind(self, piece: Furnishing) -> tuple[WallFrame, float]:
        """The wall that a thing has its back to, and where along it its middle is."""
        frame = next(frame for side in SIDES if (frame := self.frame(side)).yaw_deg == piece.yaw_deg)
        x0, y0, _, _ = self.inside
        return frame, piece.at[0] - x0 if frame.side in ("south", "north") else piece.at[1] - y0

    def hinge_free(self, piece: Furnishing) -> None:
        """Hinge the door of a thing along a wall at its other end, where only there nothing beside it is in the way."""
        frame, u = self.behind(piece)
        depth, width, _ = self.size(piece.entry, piece.shape)
        free = {}
        for high in (True, False):
            end = width / 2 if high else -width / 2
            swing = frame.area(u + end, u + end + (SWING_M if high else -SWING_M), depth, depth + width)
            blocked = any(other.on_floor and overlap(swing, other.area) for other in self.pieces if other is not piece)
            free[hinge_toward(frame, high=high)] = not blocked
        default = self._catalogue[piece.entry].reshaped(piece.shape).shape.get("hinge", "right")
        if not free[default] and any(free.values()):
            hinge = "left" if default == "right" else "right"
            turned = replace(piece, shape={**piece.shape, "hinge": hinge})
            self.pieces[self.pieces.index(piece)] = turned

    def spots(self, frame: WallFrame, half: float, corner: bool = False) -> list[float]:
        """Places along a wall for something of a half width, in the order in which to try them."""
        steps = int((frame.length_m - 2 * half) / _STEP_M)
        if steps < 0:
            return []
        spots = [half + k * _STEP_M for k in range(steps + 1)] + [frame.length_m - half]
        if corner:
            return sorted(spots, key=lambda u: min(u, frame.length_m - u))
        return [spots[k] for k in self.rng.permutation(len(spots))]

    def _fits(self, piece: Furnishing, mates: Sequence[Furnishing]) -> bool:
        if not within(piece.area, self.inside):
            return False
        others = [*self.pieces, *(mate for mate in mates if mate is not piece)]
        for other in self.pieces:
            together = piece.heights[0] < other.heights[1] and other.heights[0] < piece.heights[1]
            if together and overlap(piece.area, other.area):
                return False
        if piece.on_floor:
            fronts = [other.front for other in self.pieces if other.front is not None]
            if any(overlap(piece.area, kept) for kept in (*self.doors, *fronts)):
                return False
        if piece.heights[1] > LOW_M and piece.z_m > 0.0 and any(overlap(piece.area, door) for door in self._mouths()):
            return False
        if piece.front is None:
            return True
        if not within(piece.front, self.inside):
            return False
        return not any(other.on_floor and overlap(piece.front, other.area) for other in others)

    def _mouths(self) -> list[Rect]:
        """Right before each doorway: nothing hangs there."""
        return [self.before(opening, 0.1) for opening in self.openings]


def hinge_toward(frame: WallFrame, *, high: bool) -> str:
    """The hinge of a door at the end of its thing where u is high (or low), for one who looks at it."""
    return "right" if high == (frame.side in ("north", "west")) else "left"
