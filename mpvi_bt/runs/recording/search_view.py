"""Read access to a search's state, for drawing and logging."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mpvi_bt.executive.plan.knowledge import LIKELY, Entry
from mpvi_bt.executive.ticking.loop import World
from mpvi_bt.finding.perception.detector import ROBOT, Detection
from mpvi_bt.finding.scene.occupancy_map import OccupancyMap
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import CameraImage
from mpvi_bt.ground.words.spoken import spoken

Mask = NDArray[np.bool_]

_FRESH_S = 0.5  # a picture that was searched is shown so long
_SNAP_M = 2.0  # a map that grows is shown in steps of this, so that a film of it stands still between them
_REACH_M = 4.0  # the visible area is drawn so far


class SearchView(Protocol):
    """The present state of a search, for drawing and logging; grids (H, W) have the map's cells.

    Attributes:
        map: Occupied or not, as it is driven by: cells that are not known count as occupied.
        known: Cells of which it is known; all with a map from before.
        seen: Floor that the camera has seen.
        frontier: Of the last plan.
        path: (N, 2) way being driven [m] in the world, or None.
        goal: (3,) pose at its end [m, m, rad]; without a path that of the one before.
        image: Picture that was searched last, or None before the first.
        detections: What was detected in it.
        entries: All that is in the knowledge base.
    """

    @property
    def map(self) -> OccupancyMap: ...  # noqa: D102
    @property
    def known(self) -> Mask: ...  # noqa: D102
    @property
    def seen(self) -> Mask: ...  # noqa: D102
    @property
    def frontier(self) -> Mask: ...  # noqa: D102
    @property
    def path(self) -> Array | None: ...  # noqa: D102
    @property
    def goal(self) -> Array | None: ...  # noqa: D102
    @property
    def image(self) -> CameraImage | None: ...  # noqa: D102
    @property
    def detections(self) -> Sequence[Detection]: ...  # noqa: D102
    @property
    def entries(self) -> Iterable[Entry]: ...  # noqa: D102


class Head:
    """The head's picture with its detections; cheap to ask for often."""

    def __init__(self, search: SearchView | None) -> None:
        """Look through the pictures of a search, if there is one."""
        self._search = search
        self._last: CameraImage | None = None
        self._taken_s = 0.0

    def fresh(self, world: World) -> CameraImage | None:
        """The picture that was searched last, while it is fresh."""
        image = self._search.image if self._search is not None else None
        if image is not None and image is not self._last:
            self._last, self._taken_s = image, world.time_s
        return image if world.time_s - self._taken_s <= _FRESH_S else None

    def look(self, world: World) -> tuple[CameraImage, list[Detection]]:
        """The last searched picture while it is fresh; else a new one, at the cost of a rendering."""
        image = self.fresh(world)
        if image is not None and self._search is not None:
            return image, detected(self._search.detections)
        return world.robot.look("head"), []


def found(entries: Iterable[Entry]) -> list[Entry]:
    """What was found by looking, and is still believed to be there."""
    return [e for e in entries if e.seen_s is not None and e.source != "prior" and e.confidence >= LIKELY]


def called(entry: Entry) -> str:
    """A thing's everyday name, in ASCII for OpenCV."""
    name = entry.phrases[0] if entry.phrases else spoken(entry.name)
    return name.encode("ascii", "replace").decode()


def detected(detections: Iterable[Detection]) -> list[Detection]:
    """Detections without the robot's own parts, the most certain first."""
    return sorted((d for d in detections if d.phrase != ROBOT), key=lambda d: -d.score)


def seen_m2(view: SearchView) -> tuple[float, float | None]:
    """Area [m2] of the seen floor, and of the whole floor if it is known beforehand."""
    grid, floor = view.map, view.known & ~view.map.occupied
    cell_m2 = grid.resolution_m**2
    total = float(floor.sum()) * cell_m2 if view.known.all() else None
    return float((floor & view.seen).sum()) * cell_m2, total


def cropped(grid_map: OccupancyMap, rows: slice, columns: slice) -> OccupancyMap:
    """Part of a map."""
    shift = np.array([columns.start, rows.start]) * grid_map.resolution_m
    return replace(
        grid_map,
        occupied=grid_map.occupied[rows, columns],
        rooms=grid_map.rooms[rows, columns],
        origin_m=np.asarray(grid_map.origin_m, float) + shift,
    )


def extent(search: SearchView, margin_m: float = 0.3, snap_m: float = 0.0) -> tuple[slice, slice]:
    """Rows and columns of a window around known floor, rooms and found things.

    Args:
        search: What is known.
        margin_m: Kept around.
        snap_m: Borders are moved out to multiples of this; 0: to cells.
    """
    grid_map = search.map
    floor = (search.known & ~grid_map.occupied) | (grid_map.rooms >= 0)
    for entry in found(search.entries):
        row, column = grid_map.cell(entry.center)
        if grid_map.inside(row, column):
            floor[row, column] = True
    slices = []
    for axis in (1, 0):
        (at,) = np.nonzero(floor.any(axis))
        size = floor.shape[1 - axis]
        if not len(at):
            slices.append(slice(0, size))
            continue
        margin, step = round(margin_m / grid_map.resolution_m), max(1, round(snap_m / grid_map.resolution_m))
        first, last = (int(at[0]) - margin) // step * step, -((-int(at[-1]) - 1 - margin) // step) * step
        slices.append(slice(max(0, first), min(size, last)))
    return slices[0], slices[1]


class Window:
    """The part of a map to show while it is built, all that was ever known; it grows in steps."""

    def __init__(self) -> None:
        self._shown: tuple[int, int, int, int] | None = None

    def of(self, search: SearchView) -> tuple[slice, slice]:
        """Rows and columns to show now."""
        rows, columns = extent(search, snap_m=0.0 if search.known.all() else _SNAP_M)
        now = rows.start, rows.stop, columns.start, columns.stop
        if self._shown is not None:
            a, b, c, d = self._shown
            now = min(a, now[0]), max(b, now[1]), min(c, now[2]), max(d, now[3])
        self._shown = now
        return slice(now[0], now[1]), slice(now[2], now[3])


def room_places(grid_map: OccupancyMap) -> list[tuple[str, Array]]:
    """Each room's name and the (2,) place [m] where there is most space for it."""
    places = []
    for k, name in enumerate(grid_map.room_names):
        free = np.pad((grid_map.rooms == k) & ~grid_map.occupied, 1)
        if free.any():
            depth = ndimage.distance_transform_edt(free)[1:-1, 1:-1]
            row, column = divmod(int(depth.argmax()), depth.shape[1])
            places.append((name.replace("_", " "), grid_map.center(row, column)))
    return places


def visible(grid_map: OccupancyMap, image: CameraImage, reach_m: float = _REACH_M) -> Array:
    """(N, 2) corners [m] of the floor that a picture shows, as walls and furniture of the map bound it."""
    eye, ahead = image.T_world_camera[:2, 3], image.T_world_camera[:2, 2]
    half = float(np.arctan2(image.depth.shape[1] / 2, image.K[0, 0]))
    turns = np.arctan2(ahead[1], ahead[0]) + np.linspace(half, -half, 81)
    steps = np.arange(0, reach_m, grid_map.resolution_m / 2)
    rays = np.stack([np.cos(turns), np.sin(turns)], 1)
    points = eye + steps[:, None] * rays[:, None]  # (81, steps, 2)
    column, row = np.moveaxis(np.floor((points - grid_map.origin_m) / grid_map.resolution_m).astype(int), -1, 0)
    height, width = grid_map.occupied.shape
    outside = (row < 0) | (column < 0) | (row >= height) | (column >= width)
    stops = outside | grid_map.occupied[row.clip(0, height - 1), column.clip(0, width - 1)]
    stops[:, -1] = True
    ends: Array = eye + steps[stops.argmax(1)][:, None] * rays
    return np.vstack([eye, ends])
