"""Publishes a run while it goes on: the tree, diagnostics, the map, the path, and markers for RViz."""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Any, cast

import numpy as np

from mpvi_bt.executive.drawing.text import ascii_tree, where
from mpvi_bt.executive.ticking.loop import Outcome, Watcher, World
from mpvi_bt.executive.tree.build import Tree
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import CONTROL_HZ
from mpvi_bt.runs.recording import ros_values
from mpvi_bt.runs.recording.news import News, ending
from mpvi_bt.runs.recording.search_view import SearchView, Window, called, cropped, found
from mpvi_bt.runs.ros2.command_messages import time_message
from mpvi_bt.runs.ros2.robot_session import RobotSession

_TREE_EVERY = CONTROL_HZ // 5  # ticks between two looks at the tree
_MAP_EVERY = CONTROL_HZ  # likewise at map, path and markers


class RunTopics(Watcher):
    """Subscriber that publishes: what changes is latched, so that whoever comes later sees it too.

    Args:
        session: The robot's.
        prefix: Of the topics' names.
    """

    def __init__(self, session: RobotSession, prefix: str) -> None:
        from diagnostic_msgs.msg import DiagnosticArray
        from nav_msgs.msg import OccupancyGrid, Path
        from rclpy.qos import DurabilityPolicy, QoSProfile
        from std_msgs.msg import String
        from visualization_msgs.msg import MarkerArray

        self._heard, self._told = session.node.heard, session.told
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        kinds = {"tree": String, "tree_json": String, "map": OccupancyGrid, "path": Path, "markers": MarkerArray}
        make = session.node.node.create_publisher
        self._out = {name: make(kind, f"{prefix}/{name}", latched) for name, kind in kinds.items()}
        self._out["diagnostics"] = make(DiagnosticArray, "/diagnostics", 10)
        self._news, self._window, self._count = News(), Window(), 0

    def start(self, tree: Tree, world: World) -> None:
        """Keep the tree."""
        self._tree = tree

    def step(self, tree: Tree, world: World) -> None:
        """Publish what changed."""
        if self._count % _TREE_EVERY == 0:
            self._text(tree)
        if self._count % _MAP_EVERY == 0:
            self._diagnose(0, where(tree.spec, tree.states(), 200), {"time_s": f"{world.time_s:.1f}"})
            if hasattr(tree.context.navigator, "frontier"):
                self._place(cast("SearchView", tree.context.navigator))
        self._count += 1

    def end(self, outcome: Outcome) -> None:
        """Publish how it ended."""
        self._text(self._tree)
        line, well = ending(outcome, self._tree.spec)
        self._diagnose(0 if well else 2, line, {"ended": outcome.ending})

    def _text(self, tree: Tree) -> None:
        from std_msgs.msg import String

        spec, states = tree.spec, tree.states()
        if self._news("tree", text := ascii_tree(spec, states, fold=True)):
            self._out["tree"].publish(String(data=text))
        nodes = {path: state.told() for path, state in states.items()}
        if self._news("nodes", nodes):
            self._out["tree_json"].publish(String(data=json.dumps({"tree": spec.name, "nodes": nodes})))

    def _diagnose(self, level: int, message: str, values: dict[str, str]) -> None:
        from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

        told = self._told()
        values |= {key: str(told[key]) for key in ("commands", "late_ticks", "stalls", "lost")}
        if told["halted"]:
            level, message = 2, f"{told['halted']['reason']}: {told['halted']['why']}"
        pairs = [KeyValue(key=key, value=value) for key, value in values.items()]
        status = DiagnosticStatus(level=bytes([level]), name="mpvi: run", message=message, values=pairs)
        array = DiagnosticArray(status=[status])
        array.header.stamp = time_message(self._heard.now_ns())
        self._out["diagnostics"].publish(array)

    def _place(self, search: SearchView) -> None:
        """Map, path and markers, where they changed."""
        part = self._window.of(search)
        grid_map, known = cropped(search.map, *part), search.known[part]
        if self._news("map", (tuple(grid_map.origin_m), known.shape, grid_map.occupied.tobytes(), known.tobytes())):
            self._out["map"].publish(self._grid(ros_values.occupancy_grid(0.0, grid_map, known)))
        path, goal = search.path, search.goal
        if self._news("path", None if path is None else path.tobytes()):
            self._out["path"].publish(self._path(np.zeros((0, 2)) if path is None else path))
        things = [(entry.name, called(entry), (entry.lowest + entry.highest) / 2) for entry in found(search.entries)]
        if self._news("things", str((things, goal))):
            self._out["markers"].publish(self._markers(things, goal))

    def _header(self, message: Any) -> Any:
        """The message, in the robot's fixed frame, of now."""
        message.header.stamp, message.header.frame_id = time_message(self._heard.now_ns()), self._heard.frame
        return message

    def _grid(self, values: dict[str, Any]) -> Any:
        from nav_msgs.msg import OccupancyGrid

        grid, info = self._header(OccupancyGrid(data=values["data"])), values["info"]
        grid.info.resolution, grid.info.width, grid.info.height = info["resolution"], info["width"], info["height"]
        place = info["origin"]["position"]
        grid.info.origin.position.x, grid.info.origin.position.y = place["x"], place["y"]
        return grid

    def _path(self, points: Array) -> Any:
        from geometry_msgs.msg import PoseStamped
        from nav_msgs.msg import Path

        path = self._header(Path())
        for x, y in points[:, :2]:
            pose = PoseStamped(header=path.header)
            pose.pose.position.x, pose.pose.position.y = float(x), float(y)
            path.poses.append(pose)
        return path

    def _markers(self, things: Iterable[tuple[str, str, Array]], goal: Array | None) -> Any:
        from visualization_msgs.msg import Marker, MarkerArray

        made = [self._marker("clear", 0, Marker.CUBE, np.zeros(3))]
        made[0].action = Marker.DELETEALL
        for i, (_, name, place) in enumerate(things):
            made.append(self._marker("things", i, Marker.SPHERE, place))
            words = self._marker("names", i, Marker.TEXT_VIEW_FACING, place + [0.0, 0.0, 0.15])
            words.text = name
            made.append(words)
        if goal is not None:
            arrow = self._marker("goal", 0, Marker.ARROW, np.array([goal[0], goal[1], 0.05]))
            arrow.pose.orientation.z, arrow.pose.orientation.w = float(np.sin(goal[2] / 2)), float(np.cos(goal[2] / 2))
            arrow.scale.x = 0.4
            made.append(arrow)
        return MarkerArray(markers=made)

    def _marker(self, group: str, number: int, kind: int, place: Array) -> Any:
        from visualization_msgs.msg import Marker

        marker = self._header(Marker(ns=group, id=number, type=kind))
        at = marker.pose.position
        at.x, at.y, at.z = (float(v) for v in place)
        marker.pose.orientation.w = 1.0
        marker.scale.x = marker.scale.y = marker.scale.z = 0.08
        marker.color.r, marker.color.g, marker.color.b, marker.color.a = 0.1, 0.6, 0.9, 1.0
        return marker
