"""Depth pictures of boxes on a floor, computed ray by ray, for the tests of what pictures do to maps."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from mpvi_bt.finding.scene.occupancy_map import OccupancyMap
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import CameraImage
from mpvi_bt.hands.robots import r1
from mpvi_bt.hands.robots.r1 import R1

Box = tuple[tuple[float, float, float], tuple[float, float, float]]  # lowest and highest corner [m]
HEAD = r1.CAMERAS["head"]
FOV_RAD = 2 * np.arctan(np.tan(HEAD.fov_rad / 2) * HEAD.width / HEAD.height)


def picture(
    pose: tuple[float, float, float], boxes: Iterable[Box] = (), scale: float = 1.0, torso: Array = r1.TRAVEL_TORSO
) -> CameraImage:
    """What the head camera of a robot, in its travel posture if not told, measures at a base pose, without noise."""
    width, height = round(HEAD.width * scale), round(HEAD.height * scale)
    focal = height / 2 / np.tan(HEAD.fov_rad / 2)
    K = np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]])
    T = kin.base(np.array(pose)) @ R1.head_camera(torso)
    v, u = np.mgrid[:height, :width] + 0.5
    rays = np.stack([(u - width / 2) / focal, (v - height / 2) / focal, np.ones_like(u)], -1) @ T[:3, :3].T
    eye = T[:3, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = np.where(rays[..., 2] < 0, -eye[2] / rays[..., 2], np.inf)
        for low, high in boxes:
            a, b = (np.array(low) - eye) / rays, (np.array(high) - eye) / rays
            near, far = np.minimum(a, b).max(-1), np.maximum(a, b).min(-1)
            depth = np.where((near <= far) & (near > 0), np.minimum(depth, near), depth)
    depth[~np.isfinite(depth) | (depth > HEAD.far_m)] = 0.0
    rgb = np.zeros((height, width, 3), np.uint8)
    return CameraImage("head", rgb, depth.astype(np.float32), None, {}, K, T)


def walls(grid_map: OccupancyMap, height_m: float = 2.5) -> list[Box]:
    """Boxes that fill the occupied cells of a map: runs along its rows, joined where they repeat from row to row."""
    res, (x0, y0) = grid_map.resolution_m, grid_map.origin_m
    boxes: list[Box] = []
    begun: dict[tuple[int, int], int] = {}
    for row in range(grid_map.occupied.shape[0] + 1):
        runs: set[tuple[int, int]] = set()
        if row < grid_map.occupied.shape[0]:
            ends = np.flatnonzero(np.diff(grid_map.occupied[row].astype(np.int8), prepend=0, append=0))
            runs = {(int(a), int(b)) for a, b in ends.reshape(-1, 2)}
        for a, b in [run for run in begun if run not in runs]:
            low = (float(x0 + a * res), float(y0 + begun.pop((a, b)) * res), 0.0)
            boxes.append((low, (float(x0 + b * res), float(y0 + row * res), height_m)))
        begun = {run: begun.get(run, row) for run in runs}
    return boxes
