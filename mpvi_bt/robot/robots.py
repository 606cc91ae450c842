"""The robots that there are, by name."""

from __future__ import annotations

from collections.abc import Mapping

from mpvi_bt.errors import UnknownName
from mpvi_bt.robot.fetch import FETCH
from mpvi_bt.robot.model import RobotModel
from mpvi_bt.robot.r1 import R1
from mpvi_bt.robot.r1pro import R1PRO

ROBOTS: Mapping[str, RobotModel] = {robot.name: robot for robot in (R1, FETCH, R1PRO)}


def robot_named(name: str) -> RobotModel:
    """The robot of that name. Raises UnknownName if there is none."""
    if name not in ROBOTS:
        raise UnknownName("robot", name, ROBOTS)
    return ROBOTS[name]
