"""The executive, finding and runs know no robot: their code and docstrings name none, and none has a size there."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from py_trees.common import Status

from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.protocols import NO_SKILL
from mpvi_bt.ground.robot.action_rows import command_of
from mpvi_bt.ground.robot.robots import ROBOTS, layout_of, robot_named
from mpvi_bt.runs.choices.policies import PolicyInputs, make_policy
from mpvi_bt.testing import KinematicWorld, scripted_context
from tests.bench import HELD, PICK, PLACES, SKILLS, Bench
from tests.rooms import MODULES, PACKAGE, parsed, room_of

ANY_ROBOT = ("executive", "finding", "runs")
VERB = "fetch"  # an English word, too: it is a robot's name only as "the fetch" or "--robot fetch"
NAMES = re.compile(
    "|".join(rf"\b{name}\b" for name in sorted(ROBOTS) if name != VERB) + rf"|(?:\bthe|\ba|--robot)\s{VERB}\b",
    re.IGNORECASE,
)
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
        if room_of(path).startswith(f"{wing}/")
        for line, value in literals(path)
        if (isinstance(value, str) and (NAMES.search(value) or re.search(rf"\b{SIZE}\b", value)))
        or (type(value) is int and value == SIZE)
    ]
    assert not found, "\n".join(found)


FOUR_JOINTS = str(Path(__file__).parent.parent / "examples" / "four_joints" / "robot.yaml")


class Closing:
    """Closes the gripper of any robot."""

    name, cameras = "closing", ("head",)

    def reset(self) -> None:
        """There is nothing to forget."""

    def infer(self, observation: Mapping[str, Any]) -> Array:
        """(60, A) rows."""
        rows = np.tile(command_of(observation["proprioception"]), (60, 1))
        rows[:, layout_of(observation["proprioception"]).gripper["right"]] = -1.0
        return rows


def test_the_nodes_run_on_a_robot_that_only_its_file_describes() -> None:
    """No torso, three joints, a base on two wheels: arms are folded, it looks around, a policy picks, all watched."""
    world = KinematicWorld(robot_named(FOUR_JOINTS))
    bench = Bench(
        "sequence: all\nmemory: true\nchildren:\n- posture: travel\n- look_around:\n"
        f"- monitor: pick\n  child:\n    {PICK.replace(chr(10), chr(10) + '    ')}\n- back_off:"
    )
    context = scripted_context(world, SKILLS, PLACES, {HELD: (True,)})
    bench.world, bench.context = world, replace(context, policy=Closing())
    assert bench.run() == Status.SUCCESS
    assert np.allclose(world.robot.proprioception().arm["right"], world.robot.model.travel_arm["right"])


def test_our_policies_say_that_they_have_no_skill_on_such_a_robot() -> None:
    """They stand, and a policy behind them may take over."""
    body = KinematicWorld(robot_named(FOUR_JOINTS)).robot.proprioception()
    for policy in (make_policy("reactive", PolicyInputs(SKILLS)), make_policy("learned", PolicyInputs(SKILLS))):
        chunk = policy.infer({"prompt": "pick up the cup", "proprioception": body, "images": {}})
        assert np.array_equal(chunk[-1], command_of(body))
        assert getattr(policy, "gave_up", False)
        assert getattr(policy, "note", "").startswith(NO_SKILL)
