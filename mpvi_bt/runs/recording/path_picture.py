"""An episode from above: rooms, the base's path colored by time, and old and new places of moved things.

Of one that searched it shows which floor was seen and what was found, too.

Drawn with OpenCV, which SAPIEN brings: antialiased lines and text without a further dependency.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from mpvi_bt.executive.plan.knowledge import KnowledgeBase
from mpvi_bt.executive.ticking.loop import Outcome, Watcher, World
from mpvi_bt.executive.tree.build import Tree
from mpvi_bt.finding.scene.occupancy_map import OccupancyMap
from mpvi_bt.ground.geometry.linear_algebra import norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.robots import robot_named
from mpvi_bt.ground.writing import unwritable
from mpvi_bt.runs.recording.labels import Picture
from mpvi_bt.runs.recording.map_canvas import Canvas
from mpvi_bt.runs.recording.search_view import SearchView, found

_SAME_M = 0.05  # goals that are nearer to one another are one
_START, _END = (24, 130, 70), (200, 40, 50)


class PathPicture(Watcher):
    """Subscriber that writes the picture at the end of an episode, however it ended.

    Args:
        file: Where to write the PNG.
        grid_map: The prior map.
        knowledge: Says where things are; its movable ones are drawn as at the start and at the end. None: no objects.
        goal: Says where the base is being driven to, (3,); every new answer is marked. None: no marks.
        title: Written on top.
        search: Where the robot searches: what it knows, whose map is drawn then.
    """

    def __init__(
        self,
        file: str | Path,
        grid_map: OccupancyMap,
        knowledge: Callable[[], KnowledgeBase] | None = None,
        goal: Callable[[], Array | None] | None = None,
        title: str = "",
        search: SearchView | None = None,
    ) -> None:
        self._file, self._map, self._knowledge, self._title = Path(file), grid_map, knowledge, title
        self._goal, self._goals = goal, list[Array]()
        self._search = search
        self._poses: list[Array] = []
        self._before: dict[str, Array] = {}

    def start(self, tree: Tree, world: World) -> None:
        """Note where everything is."""
        self._tree = tree.spec
        felt = world.robot.proprioception()
        self._poses, self._outline = [felt.base_pose], robot_named(felt.robot).base.outline
        self._before = self._objects()

    def step(self, tree: Tree, world: World) -> None:
        """Note where the base is, ten times a second."""
        if world.steps % 3 == 0:
            self._poses.append(world.robot.proprioception().base_pose)
            goal = self._goal() if self._goal else None
            if goal is not None:
                if self._goals and norm(goal[:2] - self._goals[-1][:2]) < _SAME_M:
                    self._goals.pop()  # it only turns there
                self._goals.append(goal)

    def end(self, outcome: Outcome) -> None:
        """Draw and write. Raises UserError if the file cannot be written."""
        if not self._poses:
            return
        how = f"{outcome.told(self._tree)}   {self._title}".strip()
        poses = np.array(self._poses)
        things = self._before, self._objects()
        picture = path_picture(self._map, poses, self._outline, *things, self._goals, how, self._search)
        write_png(self._file, picture)

    def _objects(self) -> dict[str, Array]:
        if self._knowledge is None:
            return {}
        return {e.name: e.center[:2].copy() for e in self._knowledge() if e.kind == "object"}


def path_picture(
    grid_map: OccupancyMap,
    poses: Array,
    outline: Array,
    before: Mapping[str, Array] | None = None,
    after: Mapping[str, Array] | None = None,
    goals: Sequence[Array] = (),
    title: str = "",
    search: SearchView | None = None,
) -> Picture:
    """Draw an episode from above; north (world y) is up.

    Args:
        grid_map: Rooms and obstacles.
        poses: (N, 3) base poses in the order of time, at even intervals.
        outline: (n, 2) corners of the base, in its frame [m].
        before: Name to (2,) place [m] of each object at the start.
        after: The same at the end; an arrow leads to it from where it was.
        goals: (3,) each; poses that were driven to, numbered in this order.
        title: Written on top.
        search: What a search knows; its map is drawn, unseen floor hatched, frontiers, and what was found.

    Returns:
        (H, W, 3) uint8 RGB.
    """
    canvas = Canvas(grid_map, search)
    canvas.rooms()
    canvas.way(poses)
    canvas.robot(poses[0], outline, _START, "start")
    if len(poses) > 1:
        canvas.robot(poses[-1], outline, _END, "end")
    canvas.goals(goals)
    canvas.objects(before or {}, after or {})
    if search is not None:
        canvas.found(found(search.entries))
    canvas.names()
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
        raise unwritable(file, error) from error
