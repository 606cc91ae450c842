"""The robots that there are, by name: each is loaded from its home when it is first asked for."""

from __future__ import annotations

import importlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from mpvi_bt.ground.errors import NoModel, UnknownName
from mpvi_bt.ground.robot.action_layout import ActionLayout
from mpvi_bt.ground.robot.model import RobotModel
from mpvi_bt.ground.robot.protocol import SIDES, Proprioception, Side
from mpvi_bt.ground.robot.robot_description import RobotDescription


@dataclass(frozen=True)
class Home:
    """What is known of a robot before its model is loaded.

    Attributes:
        model: "module:attribute" of its model.
        sides: Its hands.
    """

    model: str
    sides: tuple[Side, ...] = SIDES


_HOMES = {
    "r1": Home("mpvi_bt.hands.robots.r1:R1"),
    "fetch": Home("mpvi_bt.hands.robots.fetch:FETCH", ("right",)),
    "r1pro": Home("mpvi_bt.hands.robots.r1pro:R1PRO"),
}


class Robots(Mapping[str, RobotDescription]):
    """Robots by name."""

    def __init__(self, homes: Mapping[str, Home]) -> None:
        """Take `homes`: where each robot is loaded from."""
        self._homes, self._loaded = homes, dict[str, RobotDescription]()

    def __getitem__(self, name: str) -> RobotDescription:
        if name not in self._loaded:
            module, attribute = self._homes[name].model.split(":")
            self._loaded[name] = getattr(importlib.import_module(module), attribute)
        return self._loaded[name]

    def __contains__(self, name: object) -> bool:
        return name in self._homes

    def __iter__(self) -> Iterator[str]:
        return iter(self._homes)

    def __len__(self) -> int:
        return len(self._homes)


ROBOTS = Robots(_HOMES)


def robot_named(name: str) -> RobotDescription:
    """The robot of that name. Raises UnknownName if there is none."""
    if name not in ROBOTS:
        raise UnknownName("robot", name, ROBOTS)
    return ROBOTS[name]


def model_named(name: str) -> RobotModel:
    """The closed-form model of a robot, which the skills that ship and our house need.

    Raises:
        UnknownName: There is no such robot.
        NoModel: It is known by its file alone.
    """
    robot = robot_named(name)
    if not isinstance(robot, RobotModel):
        able = ", ".join(known for known, other in ROBOTS.items() if isinstance(other, RobotModel))
        raise NoModel(f"the robot {name} is known by its file alone; skills that ship and our house have {able}")
    return robot


def layout_of(body: Proprioception) -> ActionLayout:
    """The layout of the actions of the robot that feels this. Raises UnknownName if there is no such robot."""
    return robot_named(body.robot).layout


def sides_of(name: str) -> tuple[Side, ...]:
    """The hands of the robot of that name; its model is not loaded. Raises UnknownName if there is none."""
    if name not in _HOMES:
        raise UnknownName("robot", name, _HOMES)
    return _HOMES[name].sides
