"""Writes the URDFs in `robots/` of the robots that ship: `python -m tests.robot_urdfs`."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

from mpvi_bt.ground.robot.model import RobotModel
from mpvi_bt.hands.robots.fetch import FETCH
from mpvi_bt.hands.robots.r1 import R1
from mpvi_bt.hands.robots.r1pro import R1PRO

MODELS = {model.name: model for model in (R1, R1PRO, FETCH)}
FOLDER = Path(__file__).parent.parent / "robots"


def indented(model: RobotModel) -> str:
    """A model's URDF with a line for each element."""
    robot = ET.fromstring(model.urdf())
    ET.indent(robot)
    return ET.tostring(robot, encoding="unicode") + "\n"


if __name__ == "__main__":
    for name, model in MODELS.items():
        (FOLDER / f"{name}.urdf").write_text(indented(model))
