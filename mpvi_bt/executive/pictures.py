"""The top-down picture of an episode: rooms, the base's way colored by time, and what was moved from where to where.

Drawn with OpenCV, which SAPIEN brings: antialiased lines and text without a further dependency.
"""

from __future__ import annotations

import colorsys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mpvi_bt.errors import UserError
from mpvi_bt.executive.loop import Outcome, Watcher, World
from mpvi_bt.perception.knowledge import KnowledgeBase
from mpvi_bt.perception.map import OccupancyMap
from mpvi_bt.robot.solids import Array
from mpvi_bt.tree.build import Tree

Picture = NDArray[np.uint8]

_WIDTH_PX = 1400  # of the finished picture, at most; drawn at twice that and shrunk
_OUTSIDE, _WALL, _INK = (255, 255, 255), (74, 78, 92), (40, 44, 54)
_START, _END, _MOVED, _GOAL = (24, 130, 70), (200, 40, 50), (240, 120, 20), (20, 110, 150)
_OBJECTS_NAMED = 8  # more names than these in a picture cover one another


class PathPicture(Watcher):
    """Subscriber that writes the picture at the end of an episode, however it ended.

    Args:
        file: Where to write the PNG.
        grid_map: The prior map.
        knowledge: Says where things are; its movable ones are drawn as at the start and at the end. None: no objects.
        goal: Says where the base is being driven to, (3,); every new answer is marked. None: no marks.
        title: Written on top.
    """

    def __init__(
        self,
        file: str | Path,
        grid_map: OccupancyMap,
        knowledge: Callable[[], KnowledgeBase] | None = None,
        goal: Callable[[], Array | None] | None = None,
        title: str = "",
    ) -> None:
        self._file, self._map, self._knowledge, self._title = Path(file), grid_map, knowledge, title
        self._goal, self._goals = goal, list[Array]()
        self._poses: list[Array] = []
        self._before: dict[str, Array] = {}

    def start(self, tree: Tree, world: World) -> None:
        """Note where everything is."""
        self._poses = [world.robot.proprioception().base_pose]
        self._before = self._objects()

    def step(self, tree: Tree, world: World) -> None:
        """Note where the base is, ten times a second."""
        if world.steps % 3 == 0:
            self._poses.append(world.robot.proprioception().base_pose)
            goal = self._goal() if self._goal else None
            if goal is not None and not (self._goals and goal is self._goals[-1]):
                self._goals.append(goal)

    def end(self, outcome: Outcome) -> None:
        """Draw and write. Raises UserError if the file cannot be written."""
        if not self._poses:
            return
        how = f"{self._title}   {outcome.ending.replace('_', ' ')} after {outcome.time_s:.0f} s".strip()
        poses = np.array(self._poses)
        write_png(self._file, path_picture(self._map, poses, self._before, self._objects(), self._goals, how))

    def _objects(self) -> dict[str, Array]:
        if self._knowledge is None:
            return {}
        return {e.name: e.center[:2].copy() for e in self._knowledge() if e.kind == "object"}


def path_picture(
    grid_map: OccupancyMap,
    poses: Array,
    before: Mapping[str, Array] | None = None,
    after: Mapping[str, Array] | None = None,
    goals: Sequence[Array] = (),
    title: str = "",
) -> Picture:
    """Draw an episode from above; north (world y) is up.

    Args:
        grid_map: Rooms and obstacles.
        poses: (N, 3) base poses in the order of time, at even intervals.
        before: Name to (2,) place [m] of each object at the start.
        after: The same at the end; an arrow leads to it from where it was.
        goals: (3,) each; poses that were driven to, numbered in this order.
        title: Written on top.

    Returns:
        (H, W, 3) uint8 RGB.
    """
    canvas = _Canvas(grid_map)
    canvas.rooms()
    canvas.way(poses)
    canvas.objects(before or {}, after or {})
    canvas.goals(goals)
    canvas.robot(poses[0], _START, "start")
    if len(poses) > 1:
        canvas.robot(poses[-1], _END, "end")
    return canvas.finished(title, len(poses) > 1)


def write_png(file: Path, picture: Picture) -> None:
    """Write (H, W, 3) RGB. Raises UserError if that is impossible."""
    import cv2

    ok, data = cv2.imencode(".png", picture[..., ::-1])
    assert ok
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(data.tobytes())
    except OSError as error:
        raise UserError(f"{file}: cannot write the picture: {error.strerror}") from error


class _Canvas:
    """A map that is drawn on, at twice its final size."""

    def __init__(self, grid_map: OccupancyMap) -> None:
        import cv2

        self._cv = cv2
        self._map = grid_map
        rows, columns = grid_map.occupied.shape
        self._scale = max(2, 2 * round(_WIDTH_PX / max(columns, rows)))  # pixels a cell
        self._rgb = np.full((rows * self._scale, columns * self._scale, 3), 255, np.uint8)
        self._unit = max(1.0, self._scale * 0.05 / grid_map.resolution_m / 6)  # sizes of marks go by the map's scale

    def rooms(self) -> None:
        """Pale floors, dark obstacles, and each room's name where there is most space for it."""
        color = np.empty((*self._map.occupied.shape, 3), np.uint8)
        color[:] = _OUTSIDE
        for k in range(len(self._map.room_names)):
            color[self._map.rooms == k] = _pale(k)
        # Obstacles are seen in full in rooms; what is solid all around the house stays white.
        walls = self._map.occupied & ndimage.binary_dilation(self._map.rooms >= 0, np.ones((3, 3)))
        color[walls & (self._map.rooms >= 0)] = (color[walls & (self._map.rooms >= 0)] * 0.72).astype(np.uint8)
        color[walls & (self._map.rooms < 0)] = _WALL
        self._rgb = np.repeat(np.repeat(color[::-1], self._scale, 0), self._scale, 1)
        for k, name in enumerate(self._map.room_names):
            free = np.pad((self._map.rooms == k) & ~self._map.occupied, 1)
            if free.any():
                depth = ndimage.distance_transform_edt(free)[1:-1, 1:-1]
                row, column = divmod(int(depth.argmax()), depth.shape[1])
                at = self._map.center(row, column)
                self._text(name.replace("_", " "), at, 0.95, _INK, centered=True)

    def way(self, poses: Array) -> None:
        """The base's way, from dark (early) to bright (late)."""
        points = self._px(poses[:, :2])
        colors = _ramp(len(points), self._cv)
        width = max(2, round(3.2 * self._unit))
        for a, b, color in zip(points[:-1], points[1:], colors, strict=False):
            if (a != b).any():
                self._cv.line(self._rgb, a.tolist(), b.tolist(), color.tolist(), width, self._cv.LINE_AA)

    def objects(self, before: Mapping[str, Array], after: Mapping[str, Array]) -> None:
        """Rings where things were, discs where they are, an arrow between if they moved."""
        moved = [n for n in after if n in before and np.linalg.norm(after[n] - before[n]) > 0.10]
        radius = max(4, round(7 * self._unit))
        for name in before:
            a = self._px(before[name]).tolist()
            self._cv.circle(self._rgb, a, radius, _MOVED if name in moved else _INK, 3, self._cv.LINE_AA)
        for name in moved:
            a, b = self._px(before[name]), self._px(after[name])
            self._cv.arrowedLine(self._rgb, a.tolist(), b.tolist(), _MOVED, 3, self._cv.LINE_AA, 0, 0.04)
        for name in after:
            color = _MOVED if name in moved else _INK
            self._cv.circle(self._rgb, self._px(after[name]).tolist(), radius - 2, color, -1, self._cv.LINE_AA)
        for name in moved[:_OBJECTS_NAMED] if moved else list(after)[:_OBJECTS_NAMED]:
            self._text(
                name.split(".")[0].replace("__", " ").replace("_", " "), before[name], 0.72, _INK, shift=(10, -10)
            )

    def goals(self, poses: Sequence[Array]) -> None:
        """A numbered arrowhead at each pose, pointing where the base was to face."""
        for k, pose in enumerate(poses, 1):
            turns = pose[2] + np.array([0.0, 2.5, np.pi, -2.5])
            corners = pose[:2] + 0.16 * np.array([1, 1, 0.3, 1])[:, None] * np.stack([np.cos(turns), np.sin(turns)], 1)
            self._cv.fillPoly(self._rgb, [self._px(corners).astype(np.int32)], _GOAL, self._cv.LINE_AA)
            beside = pose[:2] - 0.30 * np.array([np.cos(pose[2]), np.sin(pose[2])])
            self._text(str(k), beside, 0.7, _GOAL, centered=True)

    def robot(self, pose: Array, color: tuple[int, int, int], label: str) -> None:
        """A disc of the base's size with an arrow where it faces."""
        center = self._px(pose[:2])
        radius = round(0.27 / self._map.resolution_m * self._scale)
        ahead = self._px(pose[:2] + 0.27 * np.array([np.cos(pose[2]), np.sin(pose[2])]))
        width = max(2, round(2.2 * self._unit))
        self._cv.circle(self._rgb, center.tolist(), radius, color, width, self._cv.LINE_AA)
        self._cv.arrowedLine(self._rgb, center.tolist(), ahead.tolist(), color, width, self._cv.LINE_AA, 0, 0.35)
        self._text(label, pose[:2] + np.array([0.0, -0.36]), 0.7, color, centered=True)

    def finished(self, title: str, timed: bool) -> Picture:
        """The picture with its title, a metre bar and the colors of time, shrunk to half."""
        rows, columns = self._rgb.shape[:2]
        head, foot = round(52 * self._unit) if title else 0, round(46 * self._unit)
        framed = np.full((rows + head + foot, columns, 3), 255, np.uint8)
        framed[head : head + rows] = self._rgb
        if title:
            self._write(framed, title, (round(14 * self._unit), round(34 * self._unit)), 0.9, _INK)
        base, left = head + rows + foot // 2, round(14 * self._unit)
        metre = round(self._scale / self._map.resolution_m)
        self._cv.line(framed, (left, base), (left + metre, base), _INK, 4)
        self._write(framed, "1 m", (left + metre + 12, base + round(7 * self._unit)), 0.8, _INK)
        if timed:
            x0, length, half = left + metre + round(150 * self._unit), 3 * metre, round(7 * self._unit)
            framed[base - half : base + half, x0 : x0 + length] = _ramp(length, self._cv)[None, : columns - x0]
            self._write(framed, "start", (x0 - round(72 * self._unit), base + half), 0.8, _INK)
            self._write(framed, "end", (x0 + length + 12, base + half), 0.8, _INK)
        size = framed.shape[1] // 2, framed.shape[0] // 2
        return self._cv.resize(framed, size, interpolation=self._cv.INTER_AREA).astype(np.uint8)

    def _px(self, xy: Array) -> NDArray[np.int64]:
        """(..., 2) pixel columns and rows of world points (..., 2)."""
        cells = (np.asarray(xy, float) - self._map.origin_m) / self._map.resolution_m
        pixels: NDArray[np.int64] = np.round(
            np.stack([cells[..., 0], self._map.occupied.shape[0] - cells[..., 1]], -1) * self._scale
        ).astype(np.int64)
        return pixels

    def _text(
        self,
        text: str,
        xy: Array,
        size: float,
        color: Sequence[int],
        centered: bool = False,
        shift: tuple[int, int] = (0, 0),
    ) -> None:
        u, v = (self._px(xy) + np.array(shift)).tolist()
        if centered:
            (w, h), _ = self._cv.getTextSize(text, self._cv.FONT_HERSHEY_SIMPLEX, size * self._unit, 1)
            u, v = u - w // 2, v + h // 2
        self._write(self._rgb, text, (u, v), size, color)

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
