"""A map to draw an episode on: rooms, ways, things, poses, and what a search knows."""

from __future__ import annotations

import colorsys
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mpvi_bt.executive.plan.knowledge import Entry
from mpvi_bt.finding.scene.occupancy_map import OccupancyMap
from mpvi_bt.ground.geometry.linear_algebra import norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.words.spoken import spoken_each
from mpvi_bt.runs.recording import search_colors as colors
from mpvi_bt.runs.recording.drawn_map import DrawnMap, around, hatch
from mpvi_bt.runs.recording.labels import Labels, Picture
from mpvi_bt.runs.recording.search_view import Mask, SearchView, cropped, extent, room_places

_WIDTH_PX = 1400  # of the finished picture, at most; drawn at twice that and shrunk
_OUTSIDE, _WALL, _INK, _UNKNOWN = (255, 255, 255), (74, 78, 92), (40, 44, 54), (206, 210, 216)
_MOVED, _GOAL = (240, 120, 20), (20, 110, 150)
_OBJECTS_NAMED = 8  # more names than these in a picture cover one another


class Canvas:
    """A map that is drawn on, at twice its final size."""

    def __init__(self, grid_map: OccupancyMap, search: SearchView | None) -> None:
        import cv2

        self._cv = cv2
        self._known: Mask = np.ones_like(grid_map.occupied)
        self._seen, self._frontier = self._known, ~self._known
        self._searched = search is not None
        if search is not None:
            grid_map, self._known, self._seen, self._frontier = search.map, search.known, search.seen, search.frontier
            if not search.known.all():
                part = extent(search, margin_m=0.5)
                grid_map = cropped(grid_map, *part)
                self._known, self._seen, self._frontier = (
                    mask[part] for mask in (self._known, self._seen, self._frontier)
                )
        self._map = grid_map
        rows, columns = grid_map.occupied.shape
        self._scale = max(2, 2 * round(_WIDTH_PX / max(columns, rows)))  # pixels a cell
        self._rgb = np.full((rows * self._scale, columns * self._scale, 3), 255, np.uint8)
        self._drawn = DrawnMap(self._rgb, grid_map, self._scale)
        self._unit = max(1.0, self._scale * 0.05 / grid_map.resolution_m / 6)  # sizes of marks go by the map's scale
        self._labels, self._rooms = Labels(self._rgb, 0.72 * self._unit), Labels(self._rgb, 0.95 * self._unit)
        self._rooms.taken = self._labels.taken  # neither covers the other

    def rooms(self) -> None:
        """Pale floors and dark obstacles; with a search, frontiers, and what was not seen."""
        rooms, occupied = self._map.rooms, self._map.occupied & self._known
        floor = (rooms >= 0) | (self._known & ~occupied)
        color = np.empty((*occupied.shape, 3), np.uint8)
        color[:] = _OUTSIDE
        for k in range(len(self._map.room_names)):
            color[rooms == k] = _pale(k)
        # Obstacles are seen in full in rooms; what a map from before has all around the house stays white.
        walls = occupied & ndimage.binary_dilation(floor, np.ones((3, 3))) if self._known.all() else occupied
        color[walls & floor] = (color[walls & floor] * 0.72).astype(np.uint8)
        color[walls & ~floor] = _WALL
        if self._searched:
            color[~self._known] = _UNKNOWN
            color[self._frontier & ~occupied] = colors.FRONTIER
        self._rgb[:] = self._grown(color)
        if self._searched:
            self._shade(self._rgb, self._grown(floor & ~self._seen & ~occupied))

    def names(self) -> None:
        """Write each room's name where it has most space; names that do not fit are left out."""
        self._drawn.names(room_places(self._map), self._rooms, 0.95 * self._unit, 2, _INK, lower=False)

    def _grown(self, cells: NDArray[Any]) -> NDArray[Any]:
        """Pixels of cells, north up."""
        return np.repeat(np.repeat(cells[::-1], self._scale, 0), self._scale, 1)

    def way(self, poses: Array) -> None:
        """The base's way, from dark (early) to bright (late)."""
        points = self._drawn.px(poses[:, :2])
        ramp = _ramp(len(points), self._cv)
        width = max(2, round(3.2 * self._unit))
        for a, b, color in zip(points[:-1], points[1:], ramp, strict=False):
            if (a != b).any():
                self._cv.line(self._rgb, a.tolist(), b.tolist(), color.tolist(), width, self._cv.LINE_AA)

    def objects(self, before: Mapping[str, Array], after: Mapping[str, Array]) -> None:
        """Rings at the old places of things, discs at the new ones, an arrow between if a thing moved."""
        moved = [n for n in after if n in before and norm(after[n] - before[n]) > 0.10]
        radius = max(4, round(7 * self._unit))
        for name in before:
            a = self._drawn.px(before[name]).tolist()
            self._cv.circle(self._rgb, a, radius, _MOVED if name in moved else _INK, 3, self._cv.LINE_AA)
        for name in moved:
            a, b = self._drawn.px(before[name]), self._drawn.px(after[name])
            self._cv.arrowedLine(self._rgb, a.tolist(), b.tolist(), _MOVED, 3, self._cv.LINE_AA, 0, 0.04)
        for name in after:
            color = _MOVED if name in moved else _INK
            self._cv.circle(self._rgb, self._drawn.px(after[name]).tolist(), radius - 2, color, -1, self._cv.LINE_AA)
        words = spoken_each(before)
        # What a search has found is named itself.
        for name in moved[:_OBJECTS_NAMED] if moved or self._searched else list(after)[:_OBJECTS_NAMED]:
            self._labels.beside(self._drawn.square(before[name], radius), words[name], _INK, _OUTSIDE)

    def found(self, entries: Sequence[Entry]) -> None:
        """A named square at each believed place, and a thin line to it from the last view."""
        half = max(4, round(6 * self._unit))
        for entry in entries:
            if entry.view is not None:
                ends = np.stack([entry.view[:2], entry.center[:2]])
                self._drawn.line(ends, colors.FOUND, max(1, round(self._unit)))
        self._drawn.found(entries, self._labels, half, 2, _INK, _OUTSIDE)

    def goals(self, poses: Sequence[Array]) -> None:
        """A numbered arrowhead at each pose, pointing where the base was to face."""
        marks = []
        for k, pose in enumerate(poses, 1):
            turns = pose[2] + np.array([0.0, 2.5, np.pi, -2.5])
            corners = pose[:2] + 0.16 * np.array([1, 1, 0.3, 1])[:, None] * np.stack([np.cos(turns), np.sin(turns)], 1)
            self._cv.fillPoly(self._rgb, [self._drawn.px(corners).astype(np.int32)], _GOAL, self._cv.LINE_AA)
            mark = around(self._drawn.px(corners))
            self._labels.taken.append(mark)
            marks.append((mark, str(k)))
        for mark, number in marks:
            self._labels.beside(mark, number, _GOAL, _OUTSIDE)

    def robot(self, pose: Array, outline: Array, color: tuple[int, int, int], label: str) -> None:
        """The outline (n, 2) of a base, an arrow for its heading, and a label on free space."""
        mark = self._drawn.base(pose, outline, color, max(2, round(2.2 * self._unit)), tip=0.35)
        self._labels.beside(mark, label, color, _OUTSIDE)
        self._labels.taken.append(mark)

    def finished(self, title: str, timed: bool) -> Picture:
        """The picture with its title, a meter bar and the colors of time, shrunk to half."""
        rows, columns = self._rgb.shape[:2]
        head, foot = round(52 * self._unit) if title else 0, round(46 * self._unit)
        framed = np.full((rows + head + foot, columns, 3), 255, np.uint8)
        framed[head : head + rows] = self._rgb
        if title:
            left, size = round(14 * self._unit), 0.9
            wide = self._cv.getTextSize(title, self._cv.FONT_HERSHEY_SIMPLEX, size * self._unit, 2)[0][0]
            size *= min(1.0, (columns - 2 * left) / wide)
            self._write(framed, title, (left, round(34 * self._unit)), size, _INK)
        base, left = head + rows + foot // 2, round(14 * self._unit)
        meter = round(self._scale / self._map.resolution_m)
        self._cv.line(framed, (left, base), (left + meter, base), _INK, 4)
        self._write(framed, "1 m", (left + meter + 12, base + round(7 * self._unit)), 0.8, _INK)
        if timed:
            x0, length, half = left + meter + round(150 * self._unit), 3 * meter, round(7 * self._unit)
            framed[base - half : base + half, x0 : x0 + length] = _ramp(length, self._cv)[None, : columns - x0]
            self._write(framed, "start", (x0 - round(72 * self._unit), base + half), 0.8, _INK)
            self._write(framed, "end", (x0 + length + 12, base + half), 0.8, _INK)
            left = x0 + length + round(90 * self._unit)
        if self._searched:
            self._explain(framed, left, base)
        half_size = framed.shape[1] // 2, framed.shape[0] // 2
        return self._cv.resize(framed, half_size, interpolation=self._cv.INTER_AREA).astype(np.uint8)

    def _explain(self, framed: Picture, left: int, middle: int) -> None:
        """What the colors of a search mean."""
        half, font = round(7 * self._unit), self._cv.FONT_HERSHEY_SIMPLEX
        words = {"not seen": _OUTSIDE, "frontier": colors.FRONTIER, "found": colors.FOUND, "things": _INK}
        if not self._known.all():
            words["not known"] = _UNKNOWN
        for word, color in words.items():
            swatch = framed[middle - half : middle + half, left : left + 4 * half]
            swatch[:] = color
            if color == _OUTSIDE:
                self._shade(swatch, np.ones(swatch.shape[:2], bool))
            self._cv.rectangle(framed, (left, middle - half), (left + 4 * half, middle + half), _INK, 1)
            self._write(framed, word, (left + 4 * half + 12, middle + half), 0.8, _INK)
            left += 4 * half + 48 + int(self._cv.getTextSize(word, font, 0.8 * self._unit, 2)[0][0])

    def _shade(self, rgb: Picture, unseen: Mask) -> None:
        """Darken and hatch what was not seen."""
        lines = unseen & hatch(unseen.shape, False, round(26 * self._unit), round(4 * self._unit))
        rgb[unseen] = (rgb[unseen] * 0.86).astype(np.uint8)
        rgb[lines] = (rgb[lines] * 0.84).astype(np.uint8)

    def _write(self, rgb: Picture, text: str, at: tuple[int, int], size: float, color: Sequence[int]) -> None:
        font, scale = self._cv.FONT_HERSHEY_SIMPLEX, size * self._unit
        thick = max(1, round(2 * size * self._unit))
        self._cv.putText(rgb, text, at, font, scale, (255, 255, 255), thick + 4, self._cv.LINE_AA)
        self._cv.putText(rgb, text, at, font, scale, tuple(color), thick, self._cv.LINE_AA)


def _pale(k: int) -> tuple[int, int, int]:
    """A pale color for the k-th room; neighbors in the list are far apart in hue (golden ratio)."""
    r, g, b = colorsys.hls_to_rgb((0.09 + k * 0.618034) % 1.0, 0.91, 0.55)
    return round(r * 255), round(g * 255), round(b * 255)


def _ramp(n: int, cv: object) -> Picture:
    """(n, 3) RGB colors of time, dark blue to yellow, alike to eyes that tell red from green badly."""
    values = np.linspace(0, 235, max(n, 1)).astype(np.uint8)[:, None]
    colors: Picture = cv.applyColorMap(values, cv.COLORMAP_PLASMA)[:, 0, ::-1]  # type: ignore[attr-defined]
    return colors
