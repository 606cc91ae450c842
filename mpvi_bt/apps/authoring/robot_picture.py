"""A robot from its side and from above: links, footprint, what cameras see, how far hands reach."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from mpvi_bt.apps.authoring.robot_panel import AXES, INK, PAPER, RobotPanel, View
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.described import DescribedRobot
from mpvi_bt.ground.robot.outermost import heading_vectors, joint_places, tcp_outermost
from mpvi_bt.ground.robot.protocol import Side
from mpvi_bt.ground.robot.robot_shapes import DrawnLink, drawn_links
from mpvi_bt.runs.recording.labels import Color, Picture

_WIDTH_PX = 1400  # of the finished picture; drawn at twice that and shrunk
_CONE_M = {True: 0.3, False: 0.9}  # of a camera's view so much is drawn: on an arm, elsewhere
_MARGIN_M, _BELOW_M = 0.12, 0.1
_GAP, _HEAD, _FOOT = 40, 110, 100  # about the two views [px]
_BODY: Color = (176, 182, 192)
_ARM: dict[Side | None, Color] = {"left": (0, 114, 178), "right": (213, 94, 0)}  # Okabe and Ito's: all eyes tell them
_PALE: dict[Side | None, Color] = {"left": (140, 190, 222), "right": (240, 178, 136), None: _BODY}
_VIEW: Color = (0, 140, 105)  # of cameras on base, torso and head
_BASE: Color = (110, 70, 150)

Reach = Mapping[View, Array]


def robot_picture(robot: DescribedRobot) -> Picture:
    """(H, W, 3) uint8 RGB: the robot as it drives, on the left from its right side, on the right from above."""
    links = list(drawn_links(robot))
    cones = _cones(robot)
    reached: dict[Side, Reach] = {
        side: {view: tcp_outermost(robot, side, heading_vectors(*axes)) for view, axes in AXES.items()}
        for side in robot.sides
    }
    points = np.concatenate([
        *(points for link in links for points in link.shapes), *cones.values(), _floor(_clear(robot)),
        *(places for of in reached.values() for places in of.values()),
    ])  # fmt: skip
    low, high = points.min(0) - _MARGIN_M, points.max(0) + _MARGIN_M
    low[2] = -_BELOW_M
    scale = (2 * _WIDTH_PX - 3 * _GAP) / 2 / float(high[0] - low[0])
    panels = []
    for view in AXES:
        panel = RobotPanel(view, low, high, scale)
        for name, cone in cones.items():
            panel.cone(cone, _ARM.get(robot.carried[name], _VIEW))
        _draw_links(panel, view, links)
        if view == "above":
            _draw_base(panel, robot)
        for side, of in reached.items():
            panel.outline(of[view], _ARM[side], dashed=True)
            panel.bones(joint_places(robot, side))
            panel.mark(joint_places(robot, side)[-1], _ARM[side])
        _name_parts(panel, view, robot, cones, reached)
        panels.append(panel.picture)
    return _framed(robot.name, *panels)


def _cones(robot: DescribedRobot) -> dict[str, Array]:
    """(5, 3) of each camera: where it is, and the corners of what it sees, so far away."""
    found = {}
    for name, T in robot.camera_poses(robot.travel_torso, robot.travel_arm).items():
        camera = robot.cameras[name]
        K = camera.K
        u, v = np.array([[0, 0], [camera.width, 0], [camera.width, camera.height], [0, camera.height]]).T
        rays = np.stack([(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], np.ones(4)], 1)
        rays *= _CONE_M[robot.carried[name] is not None] / norm(rays, axis=1)[:, None]
        found[name] = np.concatenate([T[None, :3, 3], matmul(rays, T[:3, :3].T) + T[:3, 3]])
    return found


def _floor(outline: Array) -> Array:
    """(n, 3) of corners (n, 2) on the floor."""
    return np.column_stack([outline, np.zeros(len(outline))])


def _clear(robot: DescribedRobot) -> Array:
    """(n, 2) the outline of what its base keeps clear."""
    base = robot.base
    return base.outline if len(base.corners) else base.outline * max(1.0, base.folded_m / base.radius_m)


def _draw_links(panel: RobotPanel, view: View, links: list[DrawnLink]) -> None:
    """Primitives, the nearest last; of a robot that has none, lines from link to link."""
    toward = {"side": (1, -1.0), "above": (2, 1.0)}[view]
    shapes = [(points, link.side) for link in links for points in link.shapes]
    for points, side in sorted(shapes, key=lambda item: toward[1] * float(item[0][:, toward[0]].mean())):
        panel.solid(points, _PALE[side])
    for link in links if not shapes else ():
        panel.bones(np.stack([link.above, link.place]))


def _draw_base(panel: RobotPanel, robot: DescribedRobot) -> None:
    """Its outline, what it keeps clear, and where it is headed."""
    base = robot.base
    panel.outline(_floor(base.outline), _BASE)
    if base.folded_m > base.radius_m:
        panel.outline(_floor(_clear(robot)), _BASE, dashed=True)
    panel.arrow(np.zeros(3), np.array([float(base.outline[:, 0].max()), 0.0, 0.0]), _BASE)


def _name_parts(
    panel: RobotPanel, view: View, robot: DescribedRobot, cones: Mapping[str, Array], reached: Mapping[Side, Reach]
) -> None:
    """Write what is what, the most important first; from the side only of the near arm."""
    up = AXES[view][1]
    near = [side for side in reached if view == "above" or side == "right"]
    for name, cone in cones.items():
        on = robot.carried[name]
        if on is not None and on not in near:
            continue
        across, tall = (math.degrees(angle) for angle in robot.cameras[name].angles_rad)
        angle = f"{tall:.0f} deg, {cone[0, 2]:.2f} m high" if view == "side" else f"{across:.0f} deg"
        low = on == "right"
        corner = cone[cone[:, up].argmin() if low else cone[:, up].argmax()].copy()
        if on is None:
            corner[0] = cone[0, 0] if view == "side" else cone[1:, 0].min()
        panel.name(corner, f"{name} camera: {angle}", _ARM.get(on, _VIEW), below=low)
    for side in near:
        places = reached[side][view]
        low = side == "right" and view == "above"
        place = places[places[:, up].argmin() if low else places[:, up].argmax()]
        panel.name(place, f"reach of the {side} tcp", _ARM[side], below=low)
    if view == "above":
        long, wide = np.ptp(robot.base.outline, axis=0)
        lowest = float(_clear(robot)[:, 1].min())
        size = f"{long:.2f} x {wide:.2f} m" if len(robot.base.corners) else f"radius {robot.base.radius_m:g} m"
        panel.name(
            np.array([float(robot.base.outline[:, 0].min()), lowest, 0.0]), f"footprint: {size}", _BASE, below=True
        )


def _framed(name: str, side: Picture, above: Picture) -> Picture:
    """Both views below their titles, shrunk to half."""
    import cv2

    height = max(len(side), len(above)) + _HEAD + _FOOT
    framed = np.full((height, 2 * _WIDTH_PX, 3), PAPER, np.uint8)
    left = _GAP
    for picture, title in (
        (side, f"{name} as it drives: from its right"),
        (above, "from above; forward is to the right"),
    ):
        wide = picture.shape[1]
        framed[_HEAD : _HEAD + len(picture), left : left + wide] = picture
        cv2.putText(framed, title, (left, 72), cv2.FONT_HERSHEY_SIMPLEX, 1.5, INK, 3, cv2.LINE_AA)
        left += wide + _GAP
    words = "Dashed: how far each tcp gets, the torso as it is; around a round base, what it keeps clear. Ring: tcp. "
    words += f"Of what cameras see, {_CONE_M[False]:g} m are drawn, on an arm {_CONE_M[True]:g} m."
    cv2.putText(framed, words, (_GAP, height - 36), cv2.FONT_HERSHEY_SIMPLEX, 0.95, INK, 2, cv2.LINE_AA)
    half = framed.shape[1] // 2, framed.shape[0] // 2
    return cv2.resize(framed, half, interpolation=cv2.INTER_AREA).astype(np.uint8)
