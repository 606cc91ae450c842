"""Laws of the benchmark of lost cans: one is lost an episode, on the way, and pairs are compared."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from benchmarks.lost import OPEN_STEPS, WAYS, Losing, rows
from mpvi_bt.ground.protocols import Progress, Report
from mpvi_bt.testing import KinematicRobot


class Ahead:
    """Drives straight ahead."""

    def __init__(self, robot: KinematicRobot) -> None:
        self._robot = robot

    def start(self, target: str, room: str | None) -> None:
        """Nothing."""

    def step(self) -> Report:
        action = self._robot.action
        self._robot.model.layout.set_velocity(action, np.array([0.5, 0.0, 0.0]))
        self._robot.act(action)
        return Report(Progress.RUNNING)

    def stop(self) -> None:
        self._robot.hold()


@pytest.mark.parametrize("seed", range(4))
def test_one_hand_opens_once_for_half_a_second(seed: int) -> None:
    """In one of the first drives, and it closes as it was; the other hand keeps what it holds."""
    robot = KinematicRobot()
    grippers = list(robot.model.layout.gripper.values())
    action = robot.action
    action[grippers] = -1.0
    for _ in range(60):
        robot.act(action)
        robot.advance(robot.action)
    losing = Losing(robot, Ahead(robot), seed)  # type: ignore[arg-type]
    opened: list[tuple[int, ...]] = []
    for drive in range(4):
        losing.start("trash can", None)
        for _ in range(240):
            losing.step()
            opened += [(drive, i) for i in grippers if robot.action[i] > 0]
            robot.advance(robot.action)
        losing.stop()
    assert len(opened) == OPEN_STEPS - 1
    assert len({*opened}) == 1
    assert (robot.action[grippers] < 0).all()


def test_ways_are_compared_start_by_start() -> None:
    """The interval is that of the differences, not of the ways."""

    def result(q: float) -> dict[str, Any]:
        return {"q_score": {"final": q}, "time": {"simulator_time": 100.0}, "failures": [], "replans": []}

    q = {"advance": [0.0, 2 / 3, 1 / 3], "replan": [1 / 3, 1.0, 2 / 3]}
    table = list(rows({way: [result(one) for one in q[way]] for way in WAYS}))
    assert table[-1][:2] == ["difference: 3 higher, 0 lower", "+0.33 (+0.33 to +0.33)"]
    assert table[1][2] == (1, 3)
