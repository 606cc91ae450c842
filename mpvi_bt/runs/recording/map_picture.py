"""A search seen from above: map, seen floor, frontiers, the robot's path, things found."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.finding.scene.occupancy_map import OccupancyMap
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.mobile_base import MobileBase
from mpvi_bt.ground.robot.protocol import CameraImage
from mpvi_bt.runs.recording import search_colors as colors
from mpvi_bt.runs.recording.drawn_map import DrawnMap, hatch
from mpvi_bt.runs.recording.labels import Labels, Picture
from mpvi_bt.runs.recording.search_view import Mask, SearchView, Window, cropped, found, room_places, visible

_DISC = MobileBase(0.2, 0.2, 0.2, 0.2).outline  # of a goal

_BLANK, _WALL, _UNKNOWN, _UNSEEN, _SEEN, _FRONTIER = range(6)
_COLORS = np.array([colors.PAPER, colors.WALL, colors.UNKNOWN, colors.UNSEEN, colors.SEEN, colors.FRONTIER], np.uint8)
_HATCHED = (_UNKNOWN, _UNSEEN)
_INKS = np.vstack([_COLORS, _COLORS])  # without and with a line of the hatch
_INKS[[len(_COLORS) + k for k in _HATCHED]] = (_COLORS[[*_HATCHED]] * colors.HATCH).astype(np.uint8)


class MapPicture:
    """Draws a search from above; north (world y) is up. Made to be asked often: 3 ms a picture."""

    def __init__(self, size: tuple[int, int]) -> None:
        """Draw pictures of (width, height) [px]."""
        self._size = size
        self._paper = np.full((size[1], size[0], 3), colors.PAPER, np.uint8)
        self._window = Window()
        self._hatches: dict[tuple[int, int], tuple[NDArray[np.uint8], NDArray[np.uint8]]] = {}
        self._rooms: tuple[NDArray[np.int16], list[tuple[str, Array]]] | None = None

    def draw(
        self,
        view: SearchView,
        base_pose: Array,
        outline: Array,
        way: Sequence[Array] = (),
        image: CameraImage | None = None,
    ) -> Picture:
        """Draw what is known now.

        Args:
            view: What is known.
            base_pose: (3,) where the robot is.
            outline: (n, 2) corners of its base, in the base frame [m].
            way: (2,) or (3,) each; where it has been.
            image: What it sees: floor in view is marked.

        Returns:
            (height, width, 3) uint8 RGB.
        """
        grid_map = view.map
        rows, columns = self._window.of(view)
        part = cropped(grid_map, rows, columns)
        height, width = part.occupied.shape
        scale = min(self._size[0] / width, self._size[1] / height)
        shape = round(height * scale), round(width * scale)
        rgb = self._floor(
            part, view.known[rows, columns], view.seen[rows, columns], view.frontier[rows, columns], shape
        )

        drawn = DrawnMap(rgb, part, scale)
        if image is not None:
            _tint(rgb, drawn.px(visible(grid_map, image)))
        if len(way) > 1:
            drawn.line(np.array([pose[:2] for pose in way]), colors.WAY, 2)
        if view.path is not None and len(view.path) > 1:
            drawn.line(view.path, colors.SEEN, 5)
            drawn.line(view.path, colors.PATH, 2)
        if view.goal is not None and view.path is not None:
            drawn.base(view.goal, _DISC, colors.PATH, fill=colors.SEEN)
        labels = Labels(rgb)
        labels.taken.append(drawn.base(base_pose, outline, colors.INK, fill=colors.ROBOT))
        drawn.found(found(view.entries), labels, 5, 1, colors.INK, colors.SEEN)
        if self._rooms is None or self._rooms[0] is not grid_map.rooms:
            self._rooms = grid_map.rooms, room_places(grid_map)
        drawn.names(self._rooms[1], labels, 0.42, 1, colors.ROOM_INK, lower=True)
        picture = self._paper.copy()
        top, left = (self._size[1] - shape[0]) // 2, (self._size[0] - shape[1]) // 2
        picture[top : top + shape[0], left : left + shape[1]] = rgb
        return picture

    def _floor(self, part: OccupancyMap, known: Mask, seen: Mask, frontier: Mask, shape: tuple[int, int]) -> Picture:
        """Cells in their colors, of the finished size (height, width)."""
        import cv2

        edges = np.ones((3, 3), np.uint8)
        occupied = part.occupied & known
        floor = known & ~occupied
        cells = np.where(floor, np.where(seen, _SEEN, _UNSEEN), _UNKNOWN).astype(np.uint8)
        # What is solid all around a house is no wall.
        solid = cv2.dilate((floor | (part.rooms >= 0)).view(np.uint8), edges, iterations=3).view(bool)
        cells[occupied] = np.where(solid[occupied], _WALL, _BLANK)
        edge = cv2.dilate(frontier.view(np.uint8), edges).view(bool)
        cells[edge & ~occupied] = _FRONTIER
        pixels = cv2.resize(cells[::-1], shape[::-1], interpolation=cv2.INTER_NEAREST)
        if shape not in self._hatches:
            step = np.uint8(len(_COLORS))
            self._hatches[shape] = hatch(shape, False) * step, hatch(shape, True) * step
        once, crossed = self._hatches[shape]
        rgb: Picture = _INKS[pixels + np.where(pixels == _UNKNOWN, crossed, once)]
        return rgb


def _tint(rgb: Picture, corners: NDArray[np.int32]) -> None:
    """Show within a polygon that the floor is in view now."""
    import cv2

    (left, top), (right, bottom) = corners.min(0).clip(0), corners.max(0).clip(0) + 1
    part = rgb[top:bottom, left:right]
    if not part.size:
        return
    inside = np.zeros(part.shape[:2], np.uint8)
    cv2.fillPoly(inside, [corners - (left, top)], 1)
    part[(inside > 0) & (part == colors.SEEN).all(-1)] = colors.IN_VIEW
