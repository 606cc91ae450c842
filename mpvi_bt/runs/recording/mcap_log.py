"""An episode as a recording in MCAP, with ROS 2's messages: https://mcap.dev. The only module that knows its writer."""

from __future__ import annotations

import contextlib
import importlib.util
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from mpvi_bt.executive.drawing.text import ascii_tree
from mpvi_bt.executive.ticking.loop import Outcome, Watcher, World
from mpvi_bt.executive.tree.build import Tree
from mpvi_bt.finding.scene.occupancy_map import OccupancyMap
from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.extras import install
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, CameraImage, Proprioception
from mpvi_bt.ground.robot.robots import robot_named
from mpvi_bt.ground.writing import unwritable
from mpvi_bt.runs.recording import ros_values as ros
from mpvi_bt.runs.recording.news import News, answer, ending
from mpvi_bt.runs.recording.ros_messages import definition
from mpvi_bt.runs.recording.search_view import Head, SearchView, Window, cropped

_CHUNK_BYTES = 512 * 1024  # of messages that are compressed and written together: half a second with pictures
_MAP_S = 1.0  # simulated time between two maps at least: one takes 40 ms to encode
_INFO, _WARN, _ERROR = 20, 30, 40  # levels of rcl_interfaces/Log


def require_mcap() -> None:
    """Raises UserError unless the writer is installed."""
    if importlib.util.find_spec("mcap_ros2") is None:
        raise UserError(f"--mcap needs the packages mcap and mcap-ros2-support: {install('mcap')}")


class McapLog(Watcher):
    """Subscriber that writes a recording (.mcap): joints, commands and base at each step; pictures, map, tree, log.

    Times are simulated. The file is written in chunks, each of which can be read without what follows.

    Args:
        file: Where to write.
        grid_map: The map, where no search has one; None: there is none.
        search: What a search knows, if the robot searches.
        frames_per_s: Of pictures, cameras' poses and the tree, in simulated time; 30 at most.
        looks: Whether the head looks where no picture was searched. A real robot would wait for the picture.
    """

    def __init__(
        self,
        file: str | Path,
        grid_map: OccupancyMap | None = None,
        search: SearchView | None = None,
        frames_per_s: float = 5.0,
        looks: bool = True,
    ) -> None:
        self._looks = looks
        self._path, self._map, self._search = Path(file), grid_map, search
        self._every = max(1, round(CONTROL_HZ / frames_per_s))
        self._head, self._window, self._news = Head(search), Window(), News()
        self._map_s = -float("inf")
        self._image: CameraImage | None = None
        self._queries = self._notices = 0
        self._writer: Any = None
        self._schemas: dict[str, Any] = {}
        self._file: BinaryIO | None = None

    def start(self, tree: Tree, world: World) -> None:
        """Open the file.

        Raises:
            UserError: It cannot be written, or the writer is not installed.
            BackendError: The disk is full.
        """
        require_mcap()
        from mcap_ros2.writer import Writer

        self._tree, self._world, self._began_s = tree, world, world.time_s
        self._robot = robot_named(world.robot.proprioception().robot)
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            self._file = self._path.open("wb")
        except OSError as error:
            raise unwritable(self._path, error) from None
        with self._writing() as file:
            self._writer = Writer(file, chunk_size=_CHUNK_BYTES)
            file.flush()

    def step(self, tree: Tree, world: World) -> None:
        """Write what is due."""
        with self._writing() as file:
            felt, due = world.robot.proprioception(), world.steps % self._every == 0
            self._body(felt)
            self._happened(tree)
            image = self._head.fresh(world)
            if image is None and due and self._looks:
                image = world.robot.look("head")
            if image is not None and image is not self._image:
                self._image = image
                self._picture(image, felt)
            if due:
                self._cameras(felt)
                self._text()
                self._grid()
                file.flush()

    def end(self, outcome: Outcome) -> None:
        """Write how it ended, and the index; close the file. Raises BackendError if it cannot be written."""
        if self._file is None:
            return
        with self._writing() as file:
            told, good = ending(outcome, self._tree.spec)
            self._log(_INFO if good else _ERROR, self._tree.spec.name, told)
            if outcome.ending != "error":
                self._text()
            self._writer.finish()
            file.close()
        self._file = None

    @contextlib.contextmanager
    def _writing(self) -> Iterator[BinaryIO]:
        assert self._file is not None
        try:
            yield self._file
        except OSError as error:
            file, self._file = self._file, None
            with contextlib.suppress(OSError):
                file.close()
            raise unwritable(self._path, error) from None

    def _write(self, topic: str, kind: str, value: ros.Value) -> None:
        """Write a message of a type such as "sensor_msgs/JointState"."""
        if kind not in self._schemas:
            full = kind.replace("/", "/msg/")
            self._schemas[kind] = self._writer.register_msgdef(full, definition(kind))
        self._writer.write_message(topic, self._schemas[kind], value, log_time=ros.nanoseconds(self._world.time_s))

    # ------------------------------------------------------------------------------------------ what is written

    def _body(self, felt: Proprioception) -> None:
        """Joints, base, and what both are told."""
        now, robot, action = self._world.time_s, self._robot, self._world.robot.action
        self._write("/joint_states", "sensor_msgs/JointState", ros.joint_states(now, robot, felt))
        self._write("/joint_commands", "sensor_msgs/JointState", ros.joint_commands(now, robot, felt, action))
        self._write("/cmd_vel", "geometry_msgs/Twist", ros.twist(robot.layout.velocity(action)))
        self._write("/odom", "nav_msgs/Odometry", ros.odometry(now, felt))
        self._place(ros.MAP, {ros.BASE: kin.base(felt.base_pose)})

    def _cameras(self, felt: Proprioception) -> None:
        """Where the cameras are on the robot; the head's goes with its pictures."""
        poses = self._robot.camera_poses(felt.torso, felt.arm)
        self._place(ros.BASE, {ros.optical_frame(name): T for name, T in poses.items() if name != "head"})

    def _picture(self, image: CameraImage, felt: Proprioception) -> None:
        now, name = self._world.time_s, image.camera
        T_base_camera = matmul(kin.inverse(kin.base(felt.base_pose)), image.T_world_camera)
        self._place(ros.BASE, {ros.optical_frame(name): T_base_camera})
        self._write(f"/{name}/color/image_raw/compressed", "sensor_msgs/CompressedImage", ros.color_picture(now, image))
        self._write(f"/{name}/depth/image_raw", "sensor_msgs/Image", ros.depth_picture(now, image))
        for kind in ("color", "depth"):
            self._write(f"/{name}/{kind}/camera_info", "sensor_msgs/CameraInfo", ros.camera_info(now, image))

    def _place(self, parent: str, frames: dict[str, Any]) -> None:
        """Write where frames are: (4, 4) transforms to the parent."""
        if frames:
            moved = [ros.transform(self._world.time_s, parent, child, T) for child, T in frames.items()]
            self._write("/tf", "tf2_msgs/TFMessage", {"transforms": moved})

    def _grid(self) -> None:
        """The map, where it changed."""
        now = self._world.time_s
        if now < self._map_s + _MAP_S:
            return
        self._map_s = now
        if self._search is not None:
            part = self._window.of(self._search)
            grid_map, known = cropped(self._search.map, *part), self._search.known[part]
        elif self._map is not None:
            grid_map, known = self._map, np.ones_like(self._map.occupied)
        else:
            return
        if self._news("map", (tuple(grid_map.origin_m), known.shape, grid_map.occupied.tobytes(), known.tobytes())):
            self._write("/map", "nav_msgs/OccupancyGrid", ros.occupancy_grid(now, grid_map, known))

    def _text(self) -> None:
        """The tree, where it changed."""
        spec, states = self._tree.spec, self._tree.states()
        text = ascii_tree(spec, states, fold=True)
        if self._news("tree", text):
            self._write("/tree/text", "std_msgs/String", {"data": text})
        nodes = {path: state.told() for path, state in states.items()}
        if self._news("nodes", nodes):
            self._write("/tree/json", "std_msgs/String", {"data": json.dumps({"tree": spec.name, "nodes": nodes})})

    def _happened(self, tree: Tree) -> None:
        """What failed, what the checker answered, and what hands felt of their grasps."""
        for path, why in self._news.failures(tree):
            self._log(_WARN, path, why)
        log = tree.context.log
        for query in log.queries[self._queries :]:
            if query.time_s >= self._began_s:
                self._log(_INFO, query.path, answer(query))
        for notice in log.notices[self._notices :]:
            if notice.time_s >= self._began_s:
                self._log(_WARN, notice.path, f"{notice.kind} grasp, {notice.side} hand")
        self._queries, self._notices = len(log.queries), len(log.notices)

    def _log(self, level: int, name: str, text: str) -> None:
        value = {"stamp": ros.stamp(self._world.time_s), "level": level, "name": name, "msg": text}
        self._write("/rosout", "rcl_interfaces/Log", value | {"file": "", "function": "", "line": 0})
