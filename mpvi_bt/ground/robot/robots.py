"""The robots that there are, by name: each is loaded from its home when it is first asked for."""

from __future__ import annotations

import importlib
from collections.abc import Iterator, Mapping

from mpvi_bt.ground.errors import UnknownName
from mpvi_bt.ground.robot.model import RobotModel

_HOMES = {
    "r1": "mpvi_bt.hands.robots.r1:R1",
    "fetch": "mpvi_bt.hands.robots.fetch:FETCH",
    "r1pro": "mpvi_bt.hands.robots.r1pro:R1PRO",
}


class Robots(Mapping[str, RobotModel]):
    """Robots by name."""

    def __init__(self, homes: Mapping[str, str]) -> None:
        """Take `homes`: the "module:attribute" of each robot."""
        self._homes, self._loaded = homes, dict[str, RobotModel]()

    def __getitem__(self, name: str) -> RobotModel:
        if name not in self._loaded:
            module, attribute = self._homes[name].split(":")
            self._loaded[name] = getattr(importlib.import_module(module), attribute)
        return self._loaded[name]

    def __contains__(self, name: object) -> bool:
        return name in self._homes

    def __iter__(self) -> Iterator[str]:
        return iter(self._homes)

    def __len__(self) -> int:
        return len(self._homes)


ROBOTS = Robots(_HOMES)


def robot_named(name: str) -> RobotModel:
    """The robot of that name. Raises UnknownName if there is none."""
    if name not in ROBOTS:
        raise UnknownName("robot", name, ROBOTS)
    return ROBOTS[name]
