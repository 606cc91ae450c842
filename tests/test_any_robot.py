"""The executive, finding and runs know no robot: their code and docstrings name none, and none has a size there."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from mpvi_bt.ground.robot.robots import ROBOTS
from tests.rooms import MODULES, PACKAGE, parsed, room_of

ANY_ROBOT = ("executive", "finding", "runs")
VERB = "fetch"  # an English word, too: it is a robot's name only as "the fetch" or "--robot fetch"
NAMES = re.compile(
    "|".join(rf"\b{name}\b" for name in sorted(ROBOTS) if name != VERB) + rf"|(?:\bthe|\ba|--robot)\s{VERB}\b",
    re.IGNORECASE,
)
OPTION = ("runs/choices/config.py", "runs/choices/setting_keywords.py")  # whose help names the robots that ship
SIZE = 23  # numbers of an action of the robots that ship


def literals(path: Path) -> Iterator[tuple[int, object]]:
    """Line and value of every literal of a file, docstrings and parts of f-strings among them."""
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.Constant):
            yield node.lineno, node.value


@pytest.mark.parametrize("wing", ANY_ROBOT)
def test_a_wing_names_no_robot_and_no_size_of_its_action(wing: str) -> None:
    """What it has to know of a robot it asks the robot's description."""
    found = [
        f"{path.relative_to(PACKAGE)}:{line}: {str(value)[:60]!r}"
        for path in MODULES
        if room_of(path).startswith(f"{wing}/") and path.relative_to(PACKAGE).as_posix() not in OPTION
        for line, value in literals(path)
        if (isinstance(value, str) and (NAMES.search(value) or re.search(rf"\b{SIZE}\b", value)))
        or (type(value) is int and value == SIZE)
    ]
    assert not found, "\n".join(found)
