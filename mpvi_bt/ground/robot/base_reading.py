"""The base of a robot's file: its frame, what does not fit, and the base from above."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from mpvi_bt.ground.geometry.linear_algebra import norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.described import DescribedRobot
from mpvi_bt.ground.robot.kinematic_chain import BaseFrame
from mpvi_bt.ground.robot.mobile_base import MobileBase
from mpvi_bt.ground.robot.protocol import Side
from mpvi_bt.ground.robot.robot_file import BasePart
from mpvi_bt.ground.robot.robot_findings import RobotFindings
from mpvi_bt.ground.robot.urdf_tree import UrdfTree

_OWN_M = 0.15  # our choice: so far beyond what is kept clear the head may still see the robot itself
_BASE_LINKS = ("base_footprint", "base_link")


def base_link(tree: UrdfTree) -> str:
    """The link whose frame is the base frame where a file names none."""
    return next((name for name in _BASE_LINKS if name in tree.links), tree.root)


def read_base_frame(findings: RobotFindings, part: BasePart) -> BaseFrame:
    """The base frame; tells what does not fit of the base."""
    if part.speed.sideways is not None and part.kind == "differential":
        findings.tell(("base", "speed", "sideways"), "unknown-key", "a differential base cannot go sideways", key=True)
    if part.speed.sideways is None and part.kind == "holonomic":
        findings.tell(("base", "speed"), "missing-key", "missing key 'sideways' of a holonomic base [m/s]")
    if not isinstance(part.footprint_m, float) and not _convex(part.footprint_m):
        message = "corners should go around a convex outline with the base frame's origin inside, x forward, y left"
        findings.tell(("base", "footprint_m"), "out-of-range", message)
    tree, link = findings.tree, part.link
    if link is not None and link not in tree.links:
        findings.unknown(("base", "link"), "link", link, tree.links)
        link = tree.root
    return BaseFrame(tree, link or base_link(tree), part.above_floor_m)


def _convex(corners: Sequence[tuple[float, float]]) -> bool:
    """Whether corners go around a convex outline, either way, that has the origin inside."""
    if len(corners) < 3:
        return False
    p = np.array(corners)
    along = np.roll(p, -1, 0) - p
    after = np.roll(along, -1, 0)
    turns = along[:, 0] * after[:, 1] - along[:, 1] * after[:, 0]
    inside = along[:, 1] * p[:, 0] - along[:, 0] * p[:, 1]
    return bool(((turns > 0).all() and (inside > 0).all()) or ((turns < 0).all() and (inside < 0).all()))


def base_of(part: BasePart, robot: DescribedRobot) -> MobileBase:
    """The base from above; what its file does not say of room follows from outline and arms."""
    corners = np.zeros((0, 2))
    if isinstance(part.footprint_m, float):
        radius = reach = part.footprint_m
    else:
        corners = np.array(part.footprint_m)
        after = np.roll(corners, -1, 0)
        if float((corners[:, 0] * after[:, 1] - corners[:, 1] * after[:, 0]).sum()) < 0:
            corners, after = corners[::-1].copy(), corners[::-1].copy()
            after = np.roll(corners, -1, 0)
        edge = after - corners
        radius = float((np.abs(corners[:, 0] * after[:, 1] - corners[:, 1] * after[:, 0]) / norm(edge, axis=1)).min())
        reach = float(norm(corners, axis=1).max())
    beyond = [_reach(robot, side) for side in robot.sides]
    folded = part.folded_m or max([radius, *(far for far in beyond if not len(corners))])
    own = part.own_m or max([reach, folded, *beyond]) + _OWN_M
    return MobileBase(radius, folded, part.turn_m or radius, own, corners)


def _reach(robot: DescribedRobot, side: Side) -> float:
    """How far an arm in the travel posture reaches from the base frame, from above [m]."""
    points: Iterable[Array] = robot.arm_points(robot.travel_torso, robot.travel_arm[side], side)
    return max(float(norm(point[:2])) for point in points) + robot.arm_m
