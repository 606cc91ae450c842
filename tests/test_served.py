"""The executive behind a socket: whoever has a robot sends what it feels and sees, and is told what it is to do."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from websockets.sync.client import connect

from mpvi_bt.executive.remote.codec import pack, unpack
from mpvi_bt.executive.remote.odometry import moved
from mpvi_bt.executive.remote.reading import CHUNK
from mpvi_bt.executive.trace.read import read_trace
from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.geometry.kinematics import rot_z, wrap
from mpvi_bt.hands.behavior_robot.behavior import NAMES
from mpvi_bt.hands.robots.r1pro import R1PRO
from tests.driven import DIALECTS, Driver, driving
from tests.layouts import BASE, LAYOUT
from tests.openpi_env import openpi_python
from tests.small_house import small_world


@pytest.mark.parametrize("dialect", DIALECTS)
def test_an_episode_is_played_behind_the_socket(dialect: str, tmp_path: Path) -> None:
    """Metadata come first; each observation is a tick, whose action is the answer; result and trace are written."""
    said: list[str] = []
    with driving(dialect, tmp_path, said=said) as driver:
        assert driver.metadata["protocol"] == dialect
        actions = np.concatenate([driver.step() for _ in range(80)])
        assert "ended" in driver.told[-1]
        assert "ended" not in driver.told[0]
    assert (actions[:, LAYOUT.gripper["right"]] == -1).any()
    assert (actions[:, LAYOUT.gripper["left"]] == 1).all()
    (result,) = tmp_path.glob("runs/*_served_1.json")
    told = json.loads(result.read_text())
    assert told["ended"] == "failure"
    assert told["failures"][0]["reason"] == "timeout"
    trace = read_trace(tmp_path / "runs" / "exercise_served_1.trace.jsonl")
    assert trace.ticks[-1].tick == told["ticks"] == told["time"]["simulator_time"] * 30 + 1
    assert said[0] == "episode 1: exercise"
    assert said[1].startswith("episode 1: ")


def test_all_dialects_tell_the_same(tmp_path: Path) -> None:
    """Action by action, to the rounding of the float32 that evaluators have."""
    told = []
    for dialect in DIALECTS:
        with driving(dialect, tmp_path) as driver:
            told.append(np.concatenate([driver.step() for _ in range(50)]))
    for actions in told[:2]:
        np.testing.assert_allclose(actions, told[2], atol=1e-6)


@pytest.mark.parametrize("dialect", DIALECTS)
def test_resets_are_silent_and_begin_anew(dialect: str, tmp_path: Path) -> None:
    """Before the first observation, several in a row, amid an episode, after its end: each begins one, at its start."""
    with driving(dialect, tmp_path) as driver:
        driver.reset()
        driver.reset()
        first = [driver.step() for _ in range(50)]
        for steps in (50, 7, 50):
            driver.reset()
            driver.begin()
            np.testing.assert_allclose([driver.step() for _ in range(steps)], first[:steps], atol=1e-6)
    assert len(list(tmp_path.glob("runs/*.json"))) == 4


@pytest.mark.parametrize("batched", [False, True])
def test_chunks_are_ticked_one_by_one(batched: bool, tmp_path: Path) -> None:
    """Asked for K actions the tree is ticked K times; the first is `action` to the bit, and the clock counts all."""
    with driving("behavior-2026", tmp_path, batched) as driver:
        driver.step()
        shape = (1, 8, 23) if batched else (8, 23)
        for _ in range(6):
            driver.step(**{CHUNK: 8})
            answer = driver.told[-1]
            assert answer["action_chunk"].shape == shape
            np.testing.assert_array_equal(answer["action"], answer["action_chunk"][..., 0, :])
        chunked = [np.reshape(answer["action_chunk"], (8, 23)) for answer in driver.told[1:]]
    with driving("behavior-2026", tmp_path) as driver:
        driver.step()
        singly = np.concatenate([np.reshape(driver.ask()["action"], (1, 23)) for _ in range(1)])
    np.testing.assert_array_equal(chunked[0][0], singly[0])


def test_batches_of_one_are_answered_alike(tmp_path: Path) -> None:
    """With a leading 1 where the observation has one."""
    with driving("behavior-2026", tmp_path, batched=True) as driver:
        assert driver.ask()["action"].shape == (1, 23)
    with driving("behavior-2026", tmp_path) as driver:
        assert driver.ask()["action"].shape == (23,)


REFUSED: dict[str, tuple[str, dict[str, Any], str]] = {
    "task_id": ("behavior-2026", {"task_id": np.array([77])}, "task_id 77 is not known here"),
    "size": ("behavior-2026", {"robot_r1::robot_r1:zed_link:Camera:0::rgb": np.zeros((6, 8, 4), np.uint8)}, "8 x 6"),
    "nan": ("behavior-2026", {"robot_r1::proprio": np.full(61, np.nan)}, "base_qvel[0]"),
    "batch": ("behavior-2026", {"robot_r1::proprio": np.zeros((2, 61))}, "a batch of 2"),
    "depth": ("behavior-2025", {"robot_r1::robot_r1:zed_link:Camera:0::depth_linear": None}, "DefaultWrapper"),
    "other": ("behavior-2025", {"robot_r1::proprio": np.zeros(61)}, "--protocol behavior-2026"),
    "own": ("behavior-2025", {"proprioception": {}}, "--protocol openpi"),
    "chunk": ("behavior-2026", {CHUNK: 0}, "1 to 1024 is wanted"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_begun_is_refused(name: str, tmp_path: Path) -> None:
    """By a text frame, which evaluators end with, that says what is wrong and what would be right."""
    dialect, wrong, why = REFUSED[name]
    config: dict[str, Any] = {"tree": None} if name == "task_id" else {}
    with driving(dialect, tmp_path, **config) as driver:
        answer = driver.ask(**wrong)
        assert isinstance(answer, str)
        assert answer.startswith("bad_message: ")
        assert why in answer


BROKEN: dict[str, tuple[str, dict[str, Any], str]] = {
    "nan": ("behavior-2026", {"robot_r1::proprio": np.full(61, np.nan)}, "base_qvel[0]"),
    "order": ("openpi", {}, "does not follow the one before"),
    "lost": ("behavior-2025", {"robot_r1::proprio": None}, "no key that ends with '::proprio'"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_what_goes_wrong_on_the_way_is_held_through(name: str, tmp_path: Path) -> None:
    """The robot stands and keeps its last targets, the reason is told, and the next episode is played."""
    dialect, wrong, why = BROKEN[name]
    said: list[str] = []
    with driving(dialect, tmp_path, said=said) as driver:
        first = [driver.step() for _ in range(40)]
        if name == "order":
            driver.world.robot.restore({**driver.world.robot.save(), "pose": [2.0, 0.0, 0.0]})
        held = driver.step(**wrong)
        expected = first[-1].copy()
        expected[:, BASE] = 0
        np.testing.assert_allclose(held, expected, atol=1e-6)
        assert why in driver.told[-1]["ended"]
        np.testing.assert_array_equal(driver.step(), held)
        driver.reset()
        driver.begin()
        np.testing.assert_allclose([driver.step() for _ in range(40)], first, atol=1e-6)
    assert any(why in line for line in said)
    told = json.loads((tmp_path / "runs" / "exercise_served_1.json").read_text())
    assert told["ended"] == "error"
    assert why in told["error"]


def test_a_policy_that_fails_is_held_through(tmp_path: Path) -> None:
    """One that is somewhere else and not there: the reason is its own, and the next episode asks it again."""
    settings = tmp_path / "hurry.yaml"
    settings.write_text("connect_s: 0.1\n")
    said: list[str] = []
    with driving("openpi", tmp_path, said=said, policy="openpi:127.0.0.1:9", policy_settings=str(settings)) as driver:
        for _ in range(2):
            driver.reset()
            driver.begin()
            while "ended" not in (driver.told or [""])[-1]:
                driver.step()
            assert "server_absent" in driver.told.pop()["ended"]
    assert [line for line in said if line.endswith(": exercise")] == ["episode 1: exercise", "episode 2: exercise"]


def test_who_leaves_amid_an_episode_leaves_a_whole_trace(tmp_path: Path) -> None:
    """The episode is interrupted, its files are written, and others are served."""
    with driving("openpi", tmp_path) as driver:
        for _ in range(5):
            driver.step()
        driver.connection.close()
    told = json.loads((tmp_path / "runs" / "exercise_served_1.json").read_text())
    assert told["ended"] == "interrupted"


def test_the_base_is_where_its_speed_has_taken_it() -> None:
    """The evaluator of 2026 does not say where the base is: it is where it began, and as far as it went since."""
    pose = np.zeros(3)
    for _ in range(30):
        pose = moved(pose, np.array([0.3, 0.0, 1.0]), 1 / 30)
    np.testing.assert_allclose(pose, [0.3 * np.sin(1), 0.3 * (1 - np.cos(1)), 1.0], atol=1e-3)


def test_odometry_drifts_by_centimeters() -> None:
    """Of a base that drives and turns about a room for 20 s, taken from what it feels at each step, as in 2026."""
    world, rng = small_world(robot=R1PRO), np.random.default_rng(0)
    told = world.robot.proprioception().base_pose
    for _ in range(13):
        way = rng.uniform(-1.5, 1.5, 2) - world.robot.proprioception().base_pose[:2]
        velocity = np.append(np.clip(way / 1.5, -0.6, 0.6), rng.uniform(-0.8, 0.8))
        for _ in range(45):
            action = world.robot.action.copy()
            yaw = world.robot.proprioception().base_pose[2]
            action[BASE] = rot_z(-yaw) @ velocity
            world.robot.act(action)
            world.step()
            told = moved(told, world.robot.proprioception().base_velocity, 1 / 30)
    off = told - world.robot.proprioception().base_pose
    assert np.linalg.norm(off[:2]) < 0.05
    assert abs(wrap(off[2])) < 0.02


def test_pictures_are_asked_for_where_they_are_left_out(tmp_path: Path) -> None:
    """In the place of an action; the same observation with the picture then gets one."""
    tree = tmp_path / "look.yaml"
    tree.write_text("tree: look\nroot:\n  navigate: cup\n")
    with driving("openpi", tmp_path, tree=str(tree)) as driver:
        asked = driver.ask(images={})
        assert asked["look"] == ["head"]
        assert "actions" not in asked
        assert "actions" in driver.ask()


@pytest.mark.parametrize(
    ("given", "why"),
    [
        ({"policy": "expert"}, "policy expert reads the simulator itself"),
        ({"checker": "oracle"}, "checker oracle reads the simulator itself"),
        ({"map": "prior"}, "choose --map online"),
        ({"robot": "r1"}, "choose --robot r1pro"),
        ({"tree": None, "task": "picking_up_trsh"}, "picking_up_trash"),
    ],
)
def test_what_cannot_be_served_is_told_before_anybody_connects(given: dict[str, Any], why: str, tmp_path: Path) -> None:
    """With what would be right."""
    with pytest.raises(UserError, match=why), driving("behavior-2026", tmp_path, **given):
        pass


def test_labels_are_wanted_where_something_reads_them(tmp_path: Path) -> None:
    """A detector of labels sees nothing in an evaluator's pictures: that is told, and what would see."""
    with driving("behavior-2026", tmp_path) as driver:
        assert "choose another, such as --detector learned" in driver.ask(**{NAMES: None})


def test_two_are_served_at_once(tmp_path: Path) -> None:
    """Each has its own executive, at its own tick."""
    with driving("openpi", tmp_path) as first:
        host, port = first.connection.remote_address[:2]
        alone = [first.step() for _ in range(40)]
        first.reset()
        first.begin()
        with connect(f"ws://{host}:{port}", compression=None) as connection:
            other = Driver(connection, "openpi")
            both = [(first.step(), other.step() if i % 2 else None) for i in range(40)]
    np.testing.assert_array_equal([mine for mine, _ in both], alone)
    theirs = [actions for _, actions in both if actions is not None]
    np.testing.assert_array_equal(theirs, alone[: len(theirs)])


def test_an_instruction_needs_a_plan(tmp_path: Path) -> None:
    """One that is on file; for others a planner has to be chosen."""
    with driving("openpi", tmp_path, tree=None) as driver:
        assert "no plan is on file for 'sing a song'" in driver.ask(prompt="sing a song")


THEIRS = """
import sys
from openpi_client import msgpack_numpy
from openpi_client.websocket_client_policy import WebsocketClientPolicy
message = msgpack_numpy.unpackb(open(sys.argv[1], "rb").read())
policy = WebsocketClientPolicy("127.0.0.1", int(sys.argv[2]))
open(sys.argv[3], "wb").write(msgpack_numpy.packb([policy.infer(message) for _ in range(3)]))
"""


@pytest.mark.parametrize("dialect", DIALECTS)
def test_the_published_client_is_told_the_same(dialect: str, tmp_path: Path) -> None:
    """What openpi's own client unpacks equals what ours does, in each dialect."""
    with driving(dialect, tmp_path) as driver:
        message, told = driver.message(), [driver.ask() for _ in range(3)]
        driver.reset()
        (tmp_path / "message").write_bytes(pack(message))
        port = str(driver.connection.remote_address[1])
        words = [openpi_python(), "-c", THEIRS, str(tmp_path / "message"), port, str(tmp_path / "answers")]
        subprocess.run(words, check=True, timeout=60)
    key = "actions" if dialect == "openpi" else "action"
    for theirs, ours in zip(unpack((tmp_path / "answers").read_bytes()), told, strict=True):
        np.testing.assert_array_equal(theirs[key], ours[key])
