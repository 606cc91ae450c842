"""How far hands get: the outermost places of an arm's tcp."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.described import DescribedRobot
from mpvi_bt.ground.robot.protocol import Side

_DRAWN = 2000  # postures to begin with, the best of which are improved joint by joint
_STARTS = 3  # of them, for each direction: one alone may end at an elbow bent the wrong way
_TRIED = 13  # positions of a joint at a time
_SPANS = (1.0, 1.0, 0.4, 0.15, 0.05)  # how much of its limits they cover, in each round
_HEADINGS = 48


def heading_vectors(first: int, second: int) -> Array:
    """(48, 3) unit vectors all around, in the plane of two axes."""
    angles = np.arange(_HEADINGS) * (2 * np.pi / _HEADINGS)
    out = np.zeros((_HEADINGS, 3))
    out[:, first], out[:, second] = np.cos(angles), np.sin(angles)
    return out


def outermost(place: Callable[[Array], Array], limits: Array, directions: Array) -> Array:
    """(D, 3) where a point is that joints bring as far as they can in each direction.

    Args:
        place: (..., 3) of the point at joint positions (..., J).
        limits: (J, 2) of the joints.
        directions: (D, 3) unit vectors.
    """
    drawn = np.random.default_rng(0).uniform(limits[:, 0], limits[:, 1], (_DRAWN, len(limits)))
    first = matmul(directions, place(drawn).T).argsort(1)[:, -_STARTS:]
    best = drawn[first]
    for span in _SPANS:
        for j, (low, high) in enumerate(limits):
            grid = np.linspace(low, high, _TRIED)
            around = grid if span == 1 else best[..., j, None] + (grid - (low + high) / 2) * span
            tried = np.repeat(best[..., None, :], _TRIED + 1, -2)
            tried[..., 1:, j] = np.clip(around, low, high)
            far = (place(tried) * directions[:, None, None]).sum(-1)
            best = np.take_along_axis(tried, far.argmax(-1)[..., None, None], -2)[..., 0, :]
    places = place(best)
    far = (places * directions[:, None]).sum(-1)
    return np.asarray(places[np.arange(len(places)), far.argmax(1)])


def tcp_outermost(robot: DescribedRobot, side: Side, directions: Array) -> Array:
    """(D, 3) of a tcp in the base frame [m], by the joints of the arm alone: the torso stays as it drives."""
    torso = robot.travel_torso

    def place(arm: Array) -> Array:
        return robot.tcp(np.broadcast_to(torso, (*arm.shape[:-1], len(torso))), arm, side)[..., :3, 3]

    return outermost(place, robot.arm_limits[side], directions)


def tcp_heights(robot: DescribedRobot, side: Side) -> tuple[float, float]:
    """Lowest and highest of a tcp [m] by the joints of torso and arm; below 0 it would be below the floor."""
    count = len(robot.torso_joints)
    limits = np.concatenate([robot.torso_limits, robot.arm_limits[side]])
    vertical = np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]])
    low, high = outermost(lambda q: robot.tcp(q[..., :count], q[..., count:], side)[..., :3, 3], limits, vertical)
    return float(low[2]), float(high[2])


def reach(robot: DescribedRobot, side: Side) -> float:
    """The farthest that a tcp gets from the first joint of its arm [m]."""
    shoulder = joint_places(robot, side)[0]
    directions = np.concatenate([heading_vectors(0, 1), heading_vectors(0, 2), heading_vectors(1, 2)])
    return float(norm(tcp_outermost(robot, side, directions) - shoulder, axis=1).max())


def joint_places(robot: DescribedRobot, side: Side) -> Array:
    """(n + 1, 3) of the joints of an arm and its tcp, in the base frame [m], as the robot drives."""
    arm = robot.travel_arm[side]
    poses = robot.hands[side].poses(np.concatenate([robot.travel_torso, arm]))
    return np.array([T[:3, 3] for T in poses[-1 - len(arm) :]])
