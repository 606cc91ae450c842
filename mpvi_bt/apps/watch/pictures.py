"""Sends a run's page the parts missing from its trace: the time, camera pictures and the map."""

from __future__ import annotations

import base64
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from mpvi_bt.apps.watch.channel import Page
from mpvi_bt.executive.plan.knowledge import Entry
from mpvi_bt.executive.ticking.loop import Watcher, World
from mpvi_bt.executive.tree.build import Tree
from mpvi_bt.finding.perception.detector import Detection
from mpvi_bt.finding.scene.occupancy_map import OccupancyMap
from mpvi_bt.ground.errors import BackendError
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import CameraImage
from mpvi_bt.ground.robot.robots import robot_named
from mpvi_bt.runs.recording.labels import Picture
from mpvi_bt.runs.recording.map_picture import MapPicture
from mpvi_bt.runs.recording.search_view import Head, Mask, SearchView

SHARE = 0.03  # of the wall time, at most, goes into pictures. Our choice: visitors are to slow a run by less than 5 %
_FREE = 3  # the first of each: with it the device warms up, once
_WIDTH_PX = 400  # of a camera's picture
_MAP_PX = (640, 440)
_QUALITY = 80  # of JPEG
_WAY_EVERY = 10  # ticks between two points of the way that is drawn


class LivePictures(Watcher):
    """Subscriber that sends pictures to a page on request; otherwise a step costs one comparison.

    Pictures take turns: the head, the wrist whose picture the checker was handed last, the map. After each it waits
    until it has spent no more than `SHARE` of the time, but for the first of each.

    Args:
        page: Which.
        grid: The prior map; None: no map is drawn, and no camera is looked through.
    """

    def __init__(self, page: Page, grid: OccupancyMap | None = None) -> None:
        self._page, self._grid = page, grid
        self._map = MapPicture(_MAP_PX)
        self._way: list[Array] = []
        self._turn, self._free_at = 0, 0.0
        self._blind = grid is None
        self._head: Head | None = None

    def step(self, tree: Tree, world: World) -> None:
        """Answer, if a page asks."""
        if self._grid is not None and world.steps % _WAY_EVERY == 0:
            self._way.append(world.robot.proprioception().base_pose)
        if not self._page.asked:
            return
        self._page.asked = False
        words: dict[str, Any] = {"now": {"tick": tree.ticks, "time": world.time_s}}
        now = time.perf_counter()
        if self._grid is not None and now >= self._free_at:
            name, picture = self._next(tree, world, self._grid)
            if picture is not None:
                words["pictures"] = {name: _encoded(picture)}
            done = time.perf_counter()
            self._free_at = done + ((done - now) / SHARE if self._turn > _FREE else 0.0)
        self._page.send(words)

    def _next(self, tree: Tree, world: World, grid: OccupancyMap) -> tuple[str, Picture | None]:
        """Whose turn it is, and the picture."""
        self._turn += 1
        navigator = tree.context.navigator
        search = cast("SearchView", navigator) if hasattr(navigator, "frontier") else None
        if self._blind or self._turn % 3 == 0:
            view = search or _known(grid, navigator, world)
            felt = world.robot.proprioception()
            return "map", self._map.draw(view, felt.base_pose, robot_named(felt.robot).base.outline, self._way)
        try:
            if self._turn % 3 == 1:
                self._head = self._head or Head(search)
                return "head", self._head.look(world)[0].rgb
            wrist = _wrist(tree, world)
            return wrist, world.robot.look(wrist).rgb if wrist else None
        except BackendError:  # no device draws pictures here, or none is needed in this run
            self._blind = True
            return "", None


def _wrist(tree: Tree, world: World) -> str:
    """The camera at a wrist whose picture the checker was handed last; else the first."""
    wrists = [name for name in robot_named(world.robot.proprioception().robot).cameras if name != "head"]
    asked = [query.camera for query in tree.context.log.queries if query.camera in wrists]
    return (asked or wrists or [""])[-1] or ""


def _encoded(picture: Picture) -> str:
    """As JPEG, in base64."""
    import cv2

    height, width = picture.shape[:2]
    if width > _WIDTH_PX and width != _MAP_PX[0]:
        size = _WIDTH_PX, height * _WIDTH_PX // width
        picture = cv2.resize(picture, size, interpolation=cv2.INTER_AREA).astype(np.uint8)
    ok, data = cv2.imencode(".jpg", np.ascontiguousarray(picture[..., ::-1]), [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    assert ok
    return base64.b64encode(data.tobytes()).decode()


@dataclass(frozen=True)
class _Known:
    """Implements `SearchView` of a house that is known."""

    map: OccupancyMap
    known: Mask
    seen: Mask
    frontier: Mask
    path: Array | None
    goal: Array | None
    entries: Iterable[Entry]
    image: CameraImage | None = None
    detections: Sequence[Detection] = ()


def _known(grid: OccupancyMap, navigator: object, world: World) -> SearchView:
    every = np.ones_like(grid.occupied)
    path, goal = getattr(navigator, "path", None), getattr(navigator, "goal", None)
    knowledge: Callable[[], Iterable[Entry]] = getattr(world, "knowledge", tuple)
    entries = [entry for entry in knowledge() if entry.kind == "object"]
    return cast("SearchView", _Known(grid, every, every, ~every, path, goal, entries))
