"""A search seen from above: map, seen floor, frontiers, the robot's path, things found."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.finding.scene.occupancy_map import OccupancyMap
from mpvi_bt.ground.geometry.linear_algebra import norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.mobile_base import MobileBase, placed
from mpvi_bt.ground.robot.protocol import CameraImage
from mpvi_bt.runs.recording import search_colors as colors
from mpvi_bt.runs.recording.labels import Color, Labels, Picture, Rectangle
from mpvi_bt.runs.recording.search_view import Mask, SearchView, Window, called, cropped, found, room_places, visible

Pixels = Callable[[Array], NDArray[np.int32]]

_LEAST_PX = 5
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
        import cv2

        grid_map = view.map
        rows, columns = self._window.of(view)
        part = cropped(grid_map, rows, columns)
        height, width = part.occupied.shape
        scale = min(self._size[0] / width, self._size[1] / height)
        shape = round(height * scale), round(width * scale)
        rgb = self._floor(
            part, view.known[rows, columns], view.seen[rows, columns], view.frontier[rows, columns], shape
        )

        def px(xy: Array) -> NDArray[np.int32]:
            cells = (np.asarray(xy, float)[..., :2] - part.origin_m) / part.resolution_m
            pixels: NDArray[np.int32] = np.round(np.stack([cells[..., 0], height - cells[..., 1]], -1) * scale).astype(
                np.int32
            )
            return pixels

        if image is not None:
            _tint(rgb, px(visible(grid_map, image)))
        if len(way) > 1:
            cv2.polylines(rgb, [px(np.array([pose[:2] for pose in way]))], False, colors.WAY, 2, cv2.LINE_AA)
        if view.path is not None and len(view.path) > 1:
            cv2.polylines(rgb, [px(view.path)], False, colors.SEEN, 5, cv2.LINE_AA)
            cv2.polylines(rgb, [px(view.path)], False, colors.PATH, 2, cv2.LINE_AA)
        if view.goal is not None and view.path is not None:
            _shape(rgb, px, view.goal, _DISC, colors.SEEN, colors.PATH)
        robot = _shape(rgb, px, base_pose, outline, colors.ROBOT, colors.INK)
        self._names(rgb, view, px, robot)
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

    def _names(self, rgb: Picture, view: SearchView, px: Pixels, robot: Rectangle) -> None:
        """Marks and names of the things found, and the rooms' names; none covers the robot."""
        import cv2

        labels, entries = Labels(rgb), found(view.entries)
        marks = [(*(at := px(entry.center)).tolist(), *at.tolist()) for entry in entries]
        marks = [(u - 5, v - 5, right + 5, bottom + 5) for u, v, right, bottom in marks]
        for left, top, right, bottom in marks:
            cv2.rectangle(rgb, (left, top), (right, bottom), colors.INK, -1)
            cv2.rectangle(rgb, (left + 1, top + 1), (right - 1, bottom - 1), colors.FOUND, -1)
        labels.taken += [robot, *marks]
        for entry, mark in zip(entries, marks, strict=True):
            labels.beside(mark, called(entry), colors.INK, colors.SEEN)
        if self._rooms is None or self._rooms[0] is not view.map.rooms:
            self._rooms = view.map.rooms, room_places(view.map)
        for name, place in self._rooms[1]:
            u, v = px(place).tolist()
            (width, height), _ = cv2.getTextSize(name, cv2.FONT_HERSHEY_SIMPLEX, 0.42, 1)
            labels.beside((u - width // 2, v + height, u, v + height), name, colors.ROOM_INK)


def hatch(shape: tuple[int, int], crossed: bool, pitch_px: int = 8, thick_px: int = 1) -> Mask:
    """(H, W) bool, diagonal lines, one way or both ways."""
    rows, columns = np.ogrid[: shape[0], : shape[1]]
    lines = (rows + columns) % pitch_px < thick_px
    return lines | ((rows - columns) % pitch_px < thick_px) if crossed else lines


def hatched(color: Color, shape: tuple[int, int]) -> Picture:
    """(H, W, 3) of one color, hatched if it is drawn so on maps."""
    picture = np.full((*shape, 3), color, np.uint8)
    if color in (colors.UNSEEN, colors.UNKNOWN):
        lines = hatch(shape, color == colors.UNKNOWN)
        picture[lines] = (picture[lines] * colors.HATCH).astype(np.uint8)
    return picture


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


def _shape(rgb: Picture, px: Pixels, pose: Array, outline: Array, fill: Color, edge: Color) -> Rectangle:
    """Draw an outline (n, 2) at a pose (3,), with a line for its heading, at a visible size. Returns its box."""
    import cv2

    center = px(pose[:2])
    ahead_px = float(norm(px(pose[:2] + np.array([outline[:, 0].max(), 0.0])) - center))
    outline = outline * max(1.0, _LEAST_PX / max(ahead_px, 1e-9))
    corners, (front,) = (px(placed(points, pose)) for points in (outline, np.array([[outline[:, 0].max(), 0.0]])))
    cv2.fillPoly(rgb, [corners], fill, cv2.LINE_AA)
    cv2.polylines(rgb, [corners], True, edge, 2, cv2.LINE_AA)
    cv2.line(rgb, center.tolist(), front.tolist(), edge, 2, cv2.LINE_AA)
    (left, top), (right, bottom) = corners.min(0).tolist(), corners.max(0).tolist()
    return left, top, right, bottom
