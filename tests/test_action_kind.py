"""A robot whose own side takes deltas or velocities, or fewer actions a second: its file says so, and is heeded."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

import mpvi_bt
from mpvi_bt.executive.remote.own_keys import OwnKeys
from mpvi_bt.ground.errors import PolicyError
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.action_layout import ActionKind
from mpvi_bt.ground.robot.limits import travel_action
from mpvi_bt.ground.robot.protocol import CameraImage
from mpvi_bt.ground.robot.robots import robot_named
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.serving.served import ServedWork, executive_server
from mpvi_bt.testing import KinematicWorld
from tests.driven import GRIP, TREE
from tests.serving import ask, client, received, running

EXAMPLE = Path(__file__).parent.parent / "examples" / "four_joints"
TICKS = 60


def robot_file(folder: Path, kind: str, rate_hz: float) -> Path:
    """The example's robot, whose own side takes such actions."""
    folder.mkdir(exist_ok=True)
    shutil.copy(EXAMPLE / "robot.urdf", folder)
    file = folder / "robot.yaml"
    told = f"actions: {{ kind: {kind}, rate_hz: {rate_hz:g} }}\n"
    file.write_text((EXAMPLE / "robot.yaml").read_text() + told)
    return file


def driven(folder: Path, kind: ActionKind, rate_hz: float) -> tuple[Array, dict[str, object]]:
    """(60, A) what such a robot is told in two seconds, its arm out at first, and the server's metadata."""
    robot = robot_named(str(robot_file(folder, kind, rate_hz)))
    (folder / "tree.yaml").write_text(TREE)
    config = EpisodeConfig("", tree=str(folder / "tree.yaml"), policy=GRIP, map="online", robot=robot.name)
    world, keys, carried = KinematicWorld(robot), OwnKeys(), list[Array]()
    start = travel_action(robot)
    start[robot.layout.arm["right"]] = [0.1, 0.46, 0.06]
    world.robot.act(start)
    world.robot.act(start)
    world.step()
    picture = CameraImage(
        "head", np.zeros((8, 8, 3), np.uint8), np.ones((8, 8), np.float32), np.zeros((8, 8), np.int32), {},
        np.array([[8.0, 0, 4], [0, 8, 4], [0, 0, 1]]), np.eye(4),
    )  # fmt: skip
    with running(executive_server("openpi", ServedWork(config))) as server, client(server) as connection:
        metadata = received(connection)
        while len(carried) < TICKS:
            seen = {"prompt": "", "proprioception": world.robot.proprioception(), "images": {"head": picture}}
            answer = ask(connection, keys.write(seen, world.robot.action, {}))
            assert len(answer["actions"]) == 1
            for action in keys.told(np.array(answer["actions"]), robot, world.robot.action):
                world.robot.act(action)
                world.step()
                carried.append(action)
    return np.array(carried), metadata


@pytest.mark.parametrize(("kind", "rate_hz"), [("delta", 30), ("velocity", 30), ("absolute", 10), ("velocity", 10)])
def test_a_robot_gets_actions_of_its_own_kind_and_rate(kind: ActionKind, rate_hz: float, tmp_path: Path) -> None:
    """At the end of each action joints and gripper are told the same as by absolute ones, 30 a second."""
    usual, _ = driven(tmp_path / "usual", "absolute", 30)
    told, metadata = driven(tmp_path / "own", kind, rate_hz)
    assert (metadata["actions"], metadata["rate_hz"]) == (kind, rate_hz)
    ticks = round(30 / rate_hz)
    assert np.ptp(usual[:, 2:], axis=0).min() > 0.05
    np.testing.assert_allclose(told[ticks - 1 :: ticks, 2:], usual[ticks - 1 :: ticks, 2:], atol=1e-9)


@pytest.mark.parametrize("off", [0.01, 5.0])
def test_deltas_begin_at_the_targets_that_the_robot_tells(off: float, tmp_path: Path) -> None:
    """What its own side has rounded does not add up; and a joint is never told to go farther than it can."""
    robot, keys = robot_named(str(robot_file(tmp_path, "delta", 30))), OwnKeys()
    aim = travel_action(robot)
    own = aim.copy()
    own[2] += off
    (row,) = keys.answer(aim[None], {"command": own}, robot, aim)["actions"]
    assert row[2] == pytest.approx(-min(off, 3 / 30))
    assert row[3:5].tolist() == [0.0, 0.0]
    assert keys.told(row[None], robot, own)[0, 2] == pytest.approx(max(aim[2], own[2] - 3 / 30))
    with pytest.raises(PolicyError, match="right arm joint 1 is to move by"):
        keys.told(np.where(np.arange(6) == 2, 0.2, 0.0)[None], robot, own)


@pytest.mark.parametrize(
    ("kind", "rate_hz", "said"),
    [("velocity", 20, "20 does not divide 30"), ("torque", 30, "torque"), ("delta", 60, "60 does not divide 30")],
)
def test_what_is_no_kind_or_rate_is_told(kind: str, rate_hz: float, said: str, tmp_path: Path) -> None:
    """By its line."""
    (problem,) = mpvi_bt.check(robot_file(tmp_path, kind, rate_hz))
    assert said in problem.message
    assert problem.line == (EXAMPLE / "robot.yaml").read_text().count("\n") + 1
