"""Hand-made maps and a kinematic robot for the tests of navigation."""

from __future__ import annotations

import numpy as np

from mpvi_bt.executive.plan.knowledge import Entry
from mpvi_bt.finding.scene.occupancy_map import OccupancyMap
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, CameraImage, Proprioception
from tests.layouts import ACTION_SIZE, BASE


def two_rooms(door_m: float = 0.9, resolution_m: float = 0.05) -> OccupancyMap:
    """A kitchen (x 0..4) and a living room (x 4..8), 4 m deep, with a wall between and a doorway at y = 2."""
    rows, columns = round(4 / resolution_m), round(8 / resolution_m)
    occupied = np.zeros((rows, columns), bool)
    occupied[[0, -1]] = occupied[:, [0, -1]] = True
    x = (np.arange(columns) + 0.5) * resolution_m
    y = (np.arange(rows) + 0.5) * resolution_m
    wall = (np.abs(x - 4) < 0.06)[None, :] & (np.abs(y - 2) > door_m / 2)[:, None]
    occupied |= wall
    rooms = np.where((np.arange(columns) < columns // 2)[None, :], 0, 1) * np.ones((rows, 1), int)
    rooms = np.where(np.abs(x - 4)[None, :] < 0.06, -1, rooms).astype(np.int16)
    return OccupancyMap(occupied, rooms, ("kitchen", "living_room"), resolution_m, np.zeros(2))


def put_box(grid_map: OccupancyMap, lowest: tuple[float, float], highest: tuple[float, float]) -> None:
    """Occupy a rectangle of the map [m], as furniture does."""
    (r0, c0), (r1, c1) = grid_map.cell(lowest), grid_map.cell((highest[0] - 1e-6, highest[1] - 1e-6))
    grid_map.occupied[r0 : r1 + 1, c0 : c1 + 1] = True


def thing(name: str, center: tuple[float, float, float], size: tuple[float, float, float], **more: object) -> Entry:
    """An entry called by its name, with a box about `center`."""
    middle, half = np.array(center), np.array(size) / 2
    settings: dict[str, object] = {"kind": "object", **more}
    return Entry(name, (name.replace("_", " "),), lowest=middle - half, highest=middle + half, **settings)  # type: ignore[arg-type]


class KinematicRobot:
    """A base that goes exactly as told, unless something blocks it; arms and grippers do nothing."""

    def __init__(self, x: float, y: float, yaw: float = 0.0) -> None:
        self.pose, self.velocity = np.array([x, y, yaw]), np.zeros(3)
        self.action = np.zeros(ACTION_SIZE)
        self.walls: OccupancyMap | None = None  # what the base cannot enter, whether or not a planner knows it
        self.gripper = {"left": (0.1, 1.0), "right": (0.1, 1.0)}  # width [m], command

    def act(self, action: Array) -> None:
        """Take a command."""
        assert action.shape == (ACTION_SIZE,)
        assert np.isfinite(action).all()
        self.action = action.copy()

    def hold(self) -> None:
        """Stand still."""
        self.action[BASE] = 0.0

    def look(self, camera: str) -> CameraImage:
        """There is no camera."""
        raise NotImplementedError(camera)

    def proprioception(self) -> Proprioception:
        """What it feels."""
        return Proprioception(
            self.pose.copy(),
            self.velocity.copy(),
            np.zeros(4),
            {side: np.zeros(7) for side in self.gripper},  # type: ignore[misc]
            {side: np.zeros(7) for side in self.gripper},  # type: ignore[misc]
            {side: width for side, (width, _) in self.gripper.items()},  # type: ignore[misc]
            {side: command for side, (_, command) in self.gripper.items()},  # type: ignore[misc]
        )

    def advance(self) -> None:
        """Carry out the command for one control step."""
        self.velocity = self.action[BASE].copy()
        dt = 1.0 / CONTROL_HZ
        yaw = self.pose[2] + self.velocity[2] * dt / 2
        c, s = np.cos(yaw), np.sin(yaw)
        move = np.array([c * self.velocity[0] - s * self.velocity[1], s * self.velocity[0] + c * self.velocity[1]]) * dt
        if self.walls is None or not self.walls.occupied[self.walls.cell(self.pose[:2] + move)]:
            self.pose[:2] += move
        else:
            self.velocity[:2] = 0.0
        turned = self.pose[2] + self.velocity[2] * dt
        self.pose[2] = np.arctan2(np.sin(turned), np.cos(turned))
