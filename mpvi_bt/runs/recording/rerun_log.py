"""An episode as a recording for the rerun viewer: https://rerun.io. The only module that knows its SDK."""

from __future__ import annotations

import contextlib
import ctypes
import importlib.util
import uuid
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.executive.drawing.text import ascii_tree
from mpvi_bt.executive.ticking.loop import Outcome, Watcher, World
from mpvi_bt.executive.tree.build import Tree
from mpvi_bt.finding.perception.detector import Detection
from mpvi_bt.finding.scene.occupancy_map import OccupancyMap
from mpvi_bt.ground.errors import BackendError, UserError
from mpvi_bt.ground.extras import install
from mpvi_bt.ground.geometry.linear_algebra import norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.mobile_base import placed
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, CameraImage
from mpvi_bt.ground.robot.robots import robot_named
from mpvi_bt.ground.writing import unwritable
from mpvi_bt.runs.recording import search_colors as colors
from mpvi_bt.runs.recording.drawn_map import cells_north_up
from mpvi_bt.runs.recording.labels import Color
from mpvi_bt.runs.recording.news import News, ending
from mpvi_bt.runs.recording.search_view import Head, SearchView, Window, called, cropped, found, seen_m2

_JPEG = 80  # quality of the head's pictures: 20 kB each
_TALL_M = 1.2  # of the box that stands for the robot
_WAY_M = 0.1  # between points of the way, which is logged anew with each
_FLUSH_S = 30.0  # of wall time, in which a disk takes a frame
_GROUND_S = 10.0  # simulated time between two textures of the ground, which the viewer cannot keep compressed
# What cells of the map show.
_NOTHING, _UNKNOWN, _WALL, _FLOOR, _SEEN, _FRONTIER = np.arange(6, dtype=np.uint8)
_COLORS = np.array(
    [
        (0, 0, 0, 0),
        *((*color, 255) for color in (colors.UNKNOWN, colors.WALL, colors.UNSEEN, colors.SEEN, colors.FRONTIER)),
    ],
    np.uint8,
)


def require_sdk() -> None:
    """Raises UserError unless the SDK is installed."""
    if importlib.util.find_spec("rerun") is None:
        raise UserError(f"--rerun needs the SDK of rerun, which is not installed: {install('rerun')}")


class RerunLog(Watcher):
    """Subscriber that writes a recording (.rrd): pictures, map, poses, things, the tree and its failures, over time.

    All that a frame logs is handed to the operating system with it, so that a kill costs the frame being written at
    most; docs/pictures.md says what to do with the file then.

    Args:
        file: Where to write.
        grid_map: The map, where no search has one.
        title: Names the recording.
        search: What a search knows, if the robot searches.
        frames_per_s: Of simulated time; 30 at most. What fails is logged at once.
    """

    def __init__(
        self,
        file: str | Path,
        grid_map: OccupancyMap,
        title: str = "",
        search: SearchView | None = None,
        frames_per_s: float = 5.0,
    ) -> None:
        self._file, self._title, self._search = Path(file), title, search
        self._every = max(1, round(CONTROL_HZ / frames_per_s))
        self._head = Head(search)
        self._way: list[Array] = []
        self._ground_s = -np.inf
        self._window, self._part = Window(), grid_map
        self._news = News()
        self._stream: Any = None
        self._rr: Any = None

    def start(self, tree: Tree, world: World) -> None:
        """Open the file.

        Raises:
            UserError: It cannot be written, or the SDK is not installed.
            BackendError: The disk is full.
        """
        require_sdk()
        import rerun

        try:
            self._file.parent.mkdir(parents=True, exist_ok=True)
            self._file.open("wb").close()
        except OSError as error:
            raise unwritable(self._file, error) from None
        self._rr, self._tree, self._world = rerun, tree, world
        self._stream = rerun.RecordingStream("mpvi_bt", recording_id=uuid.uuid4())
        with self._writing():
            self._stream.save(str(self._file), default_blueprint=_layout())
        if self._title:
            self._stream.send_recording_name(self._title)
        self._stream.log("world", rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        self._base = robot_named(world.robot.proprioception().robot).base
        low, high = self._base.outline.min(0), self._base.outline.max(0)
        middle, half = ((*((high + low) / 2), _TALL_M / 2), (*((high - low) / 2), _TALL_M / 2))
        body = rerun.Boxes3D(centers=[middle], half_sizes=[half], colors=[colors.ROBOT])
        self._stream.log("world/robot", body, static=True)

    def step(self, tree: Tree, world: World) -> None:
        """Log what failed, and a frame when one is due."""
        self._now()
        for path, why in self._news.failures(tree):
            self._stream.log("reasons", self._rr.TextLog(f"{path}: {why}", level="WARN"))
        if world.steps % self._every == 0:
            self._frame()

    def end(self, outcome: Outcome) -> None:
        """Log how it ended and close the file. Raises BackendError if it cannot be written."""
        if self._stream is None:
            return
        self._now()
        told, good = ending(outcome, self._tree.spec)
        self._stream.log("reasons", self._rr.TextLog(told, level="INFO" if good else "ERROR"))
        if outcome.ending != "error":
            self._text()
        with self._writing():
            self._stream.flush(timeout_sec=_FLUSH_S)
            self._stream.disconnect()  # writes the index, without which the file is only slower to open
        self._stream = None

    def _now(self) -> None:
        self._stream.set_time("step", sequence=self._world.steps)
        self._stream.set_time("simulated time", duration=self._world.time_s)

    def _frame(self) -> None:
        self._picture(*self._head.look(self._world))
        self._map()
        self._robot(self._world.robot.proprioception().base_pose)
        self._text()
        if self._search is not None:
            self._found(self._search)
        with self._writing():
            self._stream.flush(timeout_sec=_FLUSH_S)

    @contextlib.contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            yield
        except (RuntimeError, ValueError, OSError) as error:
            # What wrote to the file is gone, and the SDK would wait for it forever where the stream is closed,
            # collected, or shut down at exit: so none of that happens.
            self._rr.unregister_shutdown()
            ctypes.pythonapi.Py_IncRef(ctypes.py_object(self._stream))
            self._stream = None
            raise BackendError(f"{self._file}: rerun cannot write the recording: {error}") from error

    # ------------------------------------------------------------------------------------------ what is logged

    def _picture(self, image: CameraImage, detections: list[Detection]) -> None:
        """The head's picture, boxes in it, and the camera in the world."""
        rr, log = self._rr, self._stream.log
        T, size = image.T_world_camera, image.rgb.shape[1::-1]
        if self._news("camera", (size, image.K.tolist())):
            log("world/head", rr.Pinhole(image_from_camera=image.K, resolution=size, image_plane_distance=0.4))
        pose, picture = rr.Transform3D(translation=T[:3, 3], mat3x3=T[:3, :3]), rr.Image(image.rgb)
        log("world/head", pose, picture.compress(jpeg_quality=_JPEG))
        labels = [f"{d.phrase} {d.score:.2f}" for d in detections]
        boxes = np.array([d.box for d in detections], float).reshape(-1, 4)
        if self._news("detections", (labels, boxes.tolist())):
            log("world/head/detections", rr.Boxes2D(array=boxes, array_format=rr.Box2DFormat.XYXY, labels=labels))

    def _robot(self, pose: Array) -> None:
        """Base, way, path and goal, in the world and on the map."""
        rr, log = self._rr, self._stream.log
        x, y, yaw = pose
        turn = rr.RotationAxisAngle(axis=(0, 0, 1), radians=yaw)
        log("world/robot", rr.Transform3D(translation=(x, y, 0), rotation=turn))
        if not self._way or norm(pose[:2] - self._way[-1]) > _WAY_M:
            self._way.append(pose[:2].copy())
        ahead = np.array([[x, y], [x + 0.6 * np.cos(yaw), y + 0.6 * np.sin(yaw)]])
        center, tip = self._pixels(ahead)
        radius = self._base.radius_m / self._part.resolution_m
        log("map/robot", rr.Points2D([center], colors=[colors.ROBOT], radii=[radius]))
        around = self._pixels(placed(self._base.outline, pose))
        outline = rr.LineStrips2D([np.vstack([around, around[:1]])], colors=[colors.INK], radii=[1.0])
        log("map/robot/outline", outline)
        log("map/robot/ahead", rr.Arrows2D(origins=[center], vectors=[tip - center], colors=[colors.INK], radii=[1.0]))
        self._line("way", np.array(self._way), colors.WAY)
        if self._search is not None:
            path = self._search.path
            self._line("path", np.zeros((0, 2)) if path is None else path, colors.PATH)
            goal = None if path is None else self._search.goal
            at = np.zeros((0, 2)) if goal is None else goal[None, :2]
            if self._news("goal", at.tolist()):
                log("map/goal", rr.Points2D(self._pixels(at), colors=[colors.PATH], radii=[4.0]))
                log("world/goal", rr.Points3D(_raised(at, 0.02), colors=[colors.PATH], radii=[0.1]))

    def _line(self, name: str, points: Array, color: Color) -> None:
        if not self._news(name, points.tolist()):
            return
        rr, log = self._rr, self._stream.log
        lines = [points] if len(points) else []
        log(f"map/{name}", rr.LineStrips2D([self._pixels(p) for p in lines], colors=[color], radii=[1.0]))
        log(f"world/{name}", rr.LineStrips3D([_raised(p, 0.02) for p in lines], colors=[color], radii=[0.02]))

    def _map(self) -> None:
        """Walls, seen floor and frontiers as separate images: the viewer can hide each."""
        images = {"floor": np.where(self._part.occupied, _WALL, _FLOOR)}
        if self._search is not None:
            part = self._window.of(self._search)
            self._part = grid_map = cropped(self._search.map, *part)
            if self._news("part", part):  # what has a place on the map has another one now
                self._news.forget("way", "path", "goal", "found")
            known = self._search.known[part]
            images["floor"] = np.where(known, np.where(grid_map.occupied, _WALL, _FLOOR), _UNKNOWN)
            images["seen"] = (self._search.seen[part] & known & ~grid_map.occupied) * _SEEN
            images["frontier"] = self._search.frontier[part] * _FRONTIER
            seen, _ = seen_m2(self._search)
            if self._news("seen_m2", seen):
                self._stream.log("seen_m2", self._rr.Scalars(seen))
        for order, (name, cells) in enumerate(images.items()):
            image = np.ascontiguousarray(cells[::-1])
            if self._news(name, image.tobytes()):
                self._stream.log(
                    f"map/{name}",
                    self._rr.EncodedImage(contents=_png(image), media_type="image/png", draw_order=float(order)),
                )
        if self._world.time_s >= self._ground_s + _GROUND_S and self._news("ground", images["floor"].tobytes()):
            self._ground_s = self._world.time_s
            self._ground(images["floor"][::-1])

    def _ground(self, cells: NDArray[np.uint8]) -> None:
        """The map as the ground of the world."""
        grid_map = self._part
        height, width = grid_map.occupied.shape
        at = np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
        corners = grid_map.origin_m + at * (width, height) * grid_map.resolution_m
        ground = self._rr.Mesh3D(
            vertex_positions=_raised(corners, -0.01),
            triangle_indices=[(0, 1, 2), (0, 2, 3)],
            vertex_texcoords=at * (1, -1) + (0, 1),
            albedo_texture=_COLORS[cells][..., :3],
        )
        self._stream.log("world/ground", ground)

    def _found(self, search: SearchView) -> None:
        """A box with a name for each thing."""
        entries = found(search.entries)
        key = [(e.name, *e.lowest, *e.highest, round(e.confidence, 2)) for e in entries]
        if not self._news("found", key):
            return
        rr, log = self._rr, self._stream.log
        labels = [f"{called(e)} {e.confidence:.2f}" for e in entries]
        centers = np.array([e.center for e in entries]).reshape(-1, 3)
        halves = np.array([(e.highest - e.lowest) / 2 for e in entries]).reshape(-1, 3)
        color = [colors.FOUND]
        log(
            "world/found", rr.Boxes3D(centers=centers, half_sizes=halves, labels=labels, colors=color, show_labels=True)
        )
        log("map/found", rr.Points2D(self._pixels(centers), labels=labels, colors=color, radii=[3.0], show_labels=True))

    def _text(self) -> None:
        """The tree, where it changed."""
        text = ascii_tree(self._tree.spec, self._tree.states(), fold=True)
        if self._news("tree", text):
            self._stream.log("tree", self._rr.TextDocument(text))

    # ------------------------------------------------------------------------------------------ places

    def _pixels(self, xy: Array) -> Array:
        """(N, 2) column and row in the images of the map, north up, of places (N, 2 or more) [m]."""
        return cells_north_up(self._part, xy)


def _png(cells: NDArray[np.uint8]) -> bytes:
    """The picture of what cells show; a map of 40 m by 40 m takes 5 kB."""
    import cv2

    ok, data = cv2.imencode(".png", _COLORS[cells][..., [2, 1, 0, 3]])
    assert ok
    return bytes(data)


def _raised(xy: Array, z: float) -> Array:
    """(N, 3) of (N, 2)."""
    return np.column_stack([xy[:, :2], np.full(len(xy), z)])


def _layout() -> Any:
    """What the viewer shows at first."""
    import rerun.blueprint as show

    return show.Blueprint(
        show.Horizontal(
            show.Vertical(
                show.Spatial2DView(origin="world/head", name="head"), show.Spatial2DView(origin="map", name="map")
            ),
            show.Vertical(
                show.Spatial3DView(origin="world", name="world"),
                show.TextDocumentView(origin="tree", name="tree"),
                show.TextLogView(origin="reasons", name="reasons"),
            ),
        ),
        collapse_panels=True,
    )
