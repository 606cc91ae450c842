"""The robots that there are, by the names of their files (`robots/NAME.yaml`); a path is taken for a name, too.

A file may name a model of ours (`model: module:attribute`), with which our hands plan. Where that is not installed the
file describes the robot alone.
"""

from __future__ import annotations

import importlib
import os
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import NoModel

if TYPE_CHECKING:
    from mpvi_bt.ground.robot.action_layout import ActionLayout
    from mpvi_bt.ground.robot.model import RobotModel
    from mpvi_bt.ground.robot.protocol import Proprioception, Side
    from mpvi_bt.ground.robot.robot_description import RobotDescription

FOLDER = "robots"
_loaded: dict[tuple[str, str | None], RobotDescription] = {}  # by name, and where names are looked for


class Robots(Mapping[str, "RobotDescription"]):
    """Robots by name, each loaded when it is first asked for."""

    def __getitem__(self, name: str) -> RobotDescription:
        if name not in self:
            raise KeyError(name)
        return robot_named(name)

    def __contains__(self, name: object) -> bool:
        return name in paths.names(FOLDER)

    def __iter__(self) -> Iterator[str]:
        return iter(paths.names(FOLDER))

    def __len__(self) -> int:
        return len(paths.names(FOLDER))


ROBOTS = Robots()


def robot_named(name: str) -> RobotDescription:
    """The robot of that name, or of a file.

    Raises:
        UserError: There is no such file.
        UnknownName: There is no robot of that name.
        FileProblems: What is wrong with its file.
    """
    key = (name, os.environ.get("MPVI_PATH"))
    if (robot := _loaded.get(key)) is None:
        robot = _loaded[key] = _load(name)
    return robot


def model_named(name: str) -> RobotModel:
    """The closed-form model of a robot, which the skills that ship and our house need.

    Raises as `robot_named`, and NoModel: it is known by its file alone.
    """
    from mpvi_bt.ground.robot.model import RobotModel as Model

    robot = robot_named(name)
    if not isinstance(robot, Model):
        able = ", ".join(known for known, other in ROBOTS.items() if isinstance(other, Model))
        raise NoModel(f"the robot {name} is known by its file alone; skills that ship and our house have {able}")
    return robot


def layout_of(body: Proprioception) -> ActionLayout:
    """The layout of the actions of the robot that feels this. Raises as `robot_named`."""
    return robot_named(body.robot).layout


def sides_of(name: str) -> tuple[Side, ...]:
    """The hands of a robot; no model is loaded. Raises as `robot_named`."""
    from mpvi_bt.ground.robot.protocol import SIDES

    arms = _told(name).get("arms")
    return tuple(side for side in SIDES if isinstance(arms, dict) and side in arms)


def _load(name: str) -> RobotDescription:
    module, _, attribute = str(_told(name).get("model") or "").partition(":")
    if attribute:
        try:
            robot: RobotDescription = getattr(importlib.import_module(module), attribute)
        except ModuleNotFoundError as error:
            if not f"{module}.".startswith(f"{error.name}."):
                raise
        else:
            return robot
    from mpvi_bt.ground.robot.robot_reading import read_robot

    return read_robot(paths.find_or_file(FOLDER, name), name)


def _told(name: str) -> dict[str, Any]:
    """What the file of a robot says, unchecked."""
    from mpvi_bt.ground.yaml_reader import read_yaml

    file = paths.find_or_file(FOLDER, name)
    data, _ = read_yaml(file.read_text("utf-8"), str(file))
    return data if isinstance(data, dict) else {}
