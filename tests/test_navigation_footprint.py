"""What the robot carries takes up floor in front of it, and is not swung into things."""

from __future__ import annotations

import numpy as np
import pytest

from mpvi_bt.navigation.footprint import Footprint
from mpvi_bt.navigation.pursuit import PathFollower
from mpvi_bt.navigation.traversability import traversability
from tests.navigation_maps import put_box, thing, two_rooms

LOAD = Footprint(0.33, np.array([[0.45, 0.0, 0.18]]))


def test_a_held_thing_becomes_a_circle_in_the_base_frame() -> None:
    """What is held turns with the base; what lies in it, or is not held, adds nothing."""
    base = np.array([2.0, 1.0, np.pi / 2])
    bin_ = thing("bin", (2.0, 1.5, 0.6), (0.3, 0.2, 0.3), held=True)
    can = thing("can", (2.0, 1.5, 0.5), (0.06, 0.06, 0.1), held=True, inside="bin")
    table = thing("table", (3.0, 3.0, 0.4), (1.0, 1.0, 0.8))
    footprint = Footprint.carrying(0.33, base, [bin_, can, table])
    np.testing.assert_allclose(footprint.loads, [[0.5, 0.0, 0.17]], atol=1e-9)


def test_slack_falls_as_the_load_turns_toward_furniture() -> None:
    """Facing away from a sofa there is room; facing it there is none; with empty hands it does not matter."""
    floor = two_rooms()
    put_box(floor, (1.0, 0.5), (3.0, 1.2))
    grid = traversability(floor, 0.33)
    away, toward = np.array([2.0, 1.7, np.pi / 2]), np.array([2.0, 1.7, -np.pi / 2])
    assert LOAD.slack(grid, away) > 0 > LOAD.slack(grid, toward)
    assert Footprint(0.33, np.zeros((0, 3))).slack(grid, toward) == 9.0


@pytest.mark.parametrize("yaw", [-0.6, -0.5])
def test_a_load_is_not_swung_into_a_sofa_on_the_way(yaw: float) -> None:
    """Where the short way round would swing the load into a sofa, it is not taken, and the goal is reached."""
    floor = two_rooms()
    put_box(floor, (0.05, 0.5), (3.9, 1.2))
    grid = traversability(floor, 0.33)
    start, goal = np.array([2.6, 1.7, yaw]), np.array([0.9, 2.2, np.pi])

    def worst(footprint: Footprint | None) -> tuple[float, np.ndarray]:
        follower = PathFollower(np.linspace(start[:2], goal[:2], 35), goal, grid, footprint=footprint)
        pose, least = start.copy(), 9.0
        for _ in range(900):
            vx, vy, rate = follower.command(pose)
            c, s = np.cos(pose[2]), np.sin(pose[2])
            pose = pose + np.array([c * vx - s * vy, s * vx + c * vy, rate]) / 30
            least = min(least, LOAD.slack(grid, pose))
        return least, pose

    heedless, _ = worst(None)
    careful, end = worst(LOAD)
    assert heedless < -0.05 < -0.02 < careful
    np.testing.assert_allclose(end[:2], goal[:2], atol=0.05)
