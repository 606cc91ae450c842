"""Settings for servers that were made for BEHAVIOR's R1Pro: what they are sent, and what comes of their answers."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mpvi_bt.executive.remote.dialect_settings import DialectSettings, Observation, load_settings
from mpvi_bt.executive.remote.prompts import prompt_of, read_prompts
from mpvi_bt.executive.remote.task_settings import check_robot, with_task
from mpvi_bt.executive.remote.wire_mapping import actions_of, message_of, resize_with_crop
from mpvi_bt.ground.errors import FileProblems, PolicyError, UnknownName, UserError
from mpvi_bt.ground.robot.protocol import SIDES, CameraImage, Proprioception
from mpvi_bt.ground.robot.robots import robot_named
from mpvi_bt.hands.robots.r1pro import R1PRO
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.choices.policies import check_policy_choice, settings_for
from tests.layouts import ACTION_SIZE, BASE, CAMERAS, LAYOUT
from tests.numbered_body import numbered_body

LINKS = {"head": "zed_link", "left": "left_realsense_link", "right": "right_realsense_link"}
REST = [1.025, -1.45, -0.47, 0.0]  # of the trunk, where an episode of BEHAVIOR begins
TASK, NUMBER = "picking_up_trash", 1  # a task, and its number in BEHAVIOR's table


def picture_of(camera: str, height: int = 48, width: int = 64) -> CameraImage:
    """Bright everywhere; nothing is seen in the left half."""
    rgb = np.full((height, width, 3), 200, np.uint8)
    depth = np.where(np.arange(width) < width // 2, 0.0, 2.5).astype(np.float32)[None].repeat(height, 0)
    return CameraImage(camera, rgb, depth, None, {}, np.eye(3), np.eye(4))


def sent(name: str, felt: Proprioception | None = None) -> dict[str, Any]:
    """What a server of a preset is sent in an episode of `TASK`."""
    layout = with_task(load_settings(name), TASK, NUMBER).observation
    assert layout is not None
    images = {camera: picture_of(camera) for camera in CAMERAS}
    return message_of(
        {"prompt": "pick up the can", "proprioception": felt or numbered_body(), "images": images}, layout
    )


@pytest.mark.parametrize("name", ["openpi_comet", "openpi_comet_b1k", "vla_eval", "behavior_2025"])
@pytest.mark.parametrize("yaw", [0.0, 2.1])
def test_the_23_numbers_that_comet_reads_are_the_robots(name: str, yaw: float) -> None:
    """Base velocity in the frame that it was loaded at, which is the world's here, then trunk, arms, finger widths.

    The indices are those of openpi-comet's `extract_state_from_proprio`.
    """
    felt = numbered_body(yaw=yaw)
    message = sent(name, felt)
    (state,) = (message[key] for key in ("observation/state", "robot_r1::proprio", "states") if key in message)
    assert (state.shape, state.dtype) == ((256,), np.float32)
    fingers = [state[193:195].sum(), state[232:234].sum()]
    read = [*state[253:256], *state[236:240], *state[158:165], *state[197:204], *fingers]
    vx, vy, turn = felt.base_velocity
    in_world = [vx * np.cos(yaw) - vy * np.sin(yaw), vx * np.sin(yaw) + vy * np.cos(yaw), turn]
    expected = [*in_world, *felt.torso, *felt.arm["left"], *felt.arm["right"], 0.06, 0.08]
    assert len(read) == 23
    np.testing.assert_allclose(read, expected, rtol=1e-6)


def test_comets_server_is_sent_its_keys() -> None:
    """Names, sizes and dtypes are those of the native server, with this call's prompt."""
    message = sent("openpi_comet")
    pictures = ["observation/egocentric_camera", "observation/wrist_image_left", "observation/wrist_image_right"]
    assert set(message) == {*pictures, "observation/state", "prompt"}
    assert message["prompt"] == "pick up the can"
    for key in pictures:
        assert (message[key].shape, message[key].dtype) == ((224, 224, 3), np.uint8)


@pytest.mark.parametrize(("name", "size", "leading"), [("behavior_2025", 256, ()), ("behavior_2026", 61, (1,))])
def test_behaviors_servers_are_sent_what_its_evaluators_send(name: str, size: int, leading: tuple[int, ...]) -> None:
    """Keys, shapes and dtypes are those of the page: unbatched in 2025, with a leading 1 from 3.9.3 on; no prompt."""
    message = sent(name)
    pictures = {f"robot_r1::robot_r1:{link}:Camera:0::rgb" for link in LINKS.values()}
    assert set(message) == {*pictures, "robot_r1::proprio", "robot_r1::cam_rel_poses", "task_id"}
    for key in pictures:
        assert (message[key].shape, message[key].dtype) == ((*leading, 224, 224, 4), np.uint8)
        assert (message[key][..., 3] == 255).all()
    assert (message["robot_r1::proprio"].shape, message["robot_r1::proprio"].dtype) == ((*leading, size), np.float32)
    poses = message["robot_r1::cam_rel_poses"]
    assert (poses.shape, poses.dtype) == ((*leading, 21), np.float32)
    assert (message["task_id"].shape, message["task_id"].dtype) == ((*leading, 1), np.int64)
    assert message["task_id"].reshape(-1) == [NUMBER]


def test_base_velocity_of_2026_is_in_the_robots_frame() -> None:
    """Whichever way the robot is turned."""
    for yaw in (0.0, 2.1):
        state = sent("behavior_2026", numbered_body(yaw=yaw))["robot_r1::proprio"][0]
        np.testing.assert_allclose(state[:3], numbered_body().base_velocity, rtol=1e-6)


def test_base_velocity_may_be_as_in_the_demonstrations() -> None:
    """A key of the settings has it 0, as a checkpoint of 2025 has seen it."""
    layout = Observation.model_validate({"state": {"s": {"dialect": "behavior-2025", "base_velocity": "zero"}}})
    state = message_of({"prompt": "", "proprioception": numbered_body(), "images": {}}, layout)["s"]
    assert not state[253:256].any()
    np.testing.assert_allclose(state[236:240], numbered_body().torso, rtol=1e-6)


def test_camera_poses_are_of_left_wrist_right_wrist_and_head() -> None:
    """In base_link, USD's axes, xyzw: at the start of an episode the head's is where BEHAVIOR's simulator has it."""
    start = replace(numbered_body(), torso=np.array(REST), arm=dict.fromkeys(SIDES, np.zeros(7)))
    left, right, head = sent("behavior_2025", start)["robot_r1::cam_rel_poses"].reshape(3, 7)
    np.testing.assert_allclose(head[:3], [0.2397, 0.0, 1.3918], atol=1e-4)
    np.testing.assert_allclose(np.sign(-head[3]) * head[3:], [-0.392, 0.392, 0.588, -0.588], atol=1e-3)
    np.testing.assert_allclose(left[:3], [0.1747, 0.2549, 0.5007], atol=1e-4)
    np.testing.assert_allclose(right[:3], [0.1747, -0.2491, 0.5007], atol=1e-4)
    for side, pose in zip(SIDES, (left, right), strict=True):
        axes = Rotation.from_quat(pose[3:]).as_matrix()
        T = R1PRO.wrist_camera(start.torso, start.arm[side], side)
        np.testing.assert_allclose(-axes[:, 2], T[:3, 2], atol=1e-6)
        np.testing.assert_allclose(axes[:, 1], -T[:3, 1], atol=1e-6)


def test_depth_linear_is_infinite_where_nothing_is_seen() -> None:
    """Of ours, which is 0 there, and when it is resized, cropped or padded."""
    for size in (None, [24, 24], [64, 48]):
        for fit in ("crop", "pad"):
            shown = {"camera": "head", "show": "depth_linear", "size": size, "fit": fit}
            layout = Observation.model_validate({"images": {"d": shown}})
            depth = message_of(
                {"prompt": "", "proprioception": numbered_body(), "images": {"head": picture_of("head")}}, layout
            )["d"]
            assert depth.dtype == np.float32
            assert set(np.unique(depth)) == {np.float32(2.5), np.float32(np.inf)}


def test_pictures_have_no_bars() -> None:
    """What is wider than it is high is cropped, in the middle, not padded; what is square is only scaled."""
    for name in ("openpi_comet", "openpi_comet_b1k", "behavior_2025", "behavior_2026", "vla_eval"):
        for value in _arrays(sent(name)):
            if value.dtype == np.uint8:
                assert (value[..., :3] == 200).all()
    wide = np.zeros((30, 60, 3), np.uint8)
    wide[:, 15:45] = 100
    assert (resize_with_crop(wide, 20, 20) == 100).all()
    assert (resize_with_crop(wide[:, 15:45], 20, 20) == 100).all()
    tall = np.moveaxis(wide, 0, 1)
    assert (resize_with_crop(tall, 30, 30) == 100).all()


def _arrays(value: Any) -> list[Any]:
    if isinstance(value, dict):
        return [array for inner in value.values() for array in _arrays(inner)]
    return [value] if isinstance(value, np.ndarray) else []


@pytest.mark.parametrize("name", ["openpi_comet", "openpi_comet_b1k", "behavior_2025", "behavior_2026", "vla_eval"])
def test_an_r1pros_actions_are_behaviors(name: str) -> None:
    """Joints and grippers as they are, bit by bit; of the base 1 is 0.75 m/s or 1 rad/s, and more is no faster."""
    layout = load_settings(name).action
    theirs = np.random.default_rng(0).normal(size=(3, ACTION_SIZE))
    theirs[:, :3] = [[0.5, -0.2, 1.0], [2.0, -7.0, 1.2], [0.0, 0.0, -3.0]]
    ours = actions_of({layout.key: theirs[None]}, layout, numbered_body())
    np.testing.assert_allclose(ours[:, BASE], [[0.375, -0.15, 1.0], [0.75, -0.75, 1.0], [0, 0, -1.0]])
    assert np.array_equal(ours[:, 3:], theirs[:, 3:])


def test_behaviors_posture_does_not_turn_the_r1() -> None:
    """Its trunk's second joint, -1.45 rad, is no turn of the waist."""
    layout = load_settings("openpi_comet").action
    rest = np.zeros((1, ACTION_SIZE))
    rest[:, LAYOUT.torso] = REST
    lift, yaw, pitch, _ = actions_of({"actions": rest}, layout, replace(numbered_body(), robot="r1"))[0, LAYOUT.torso]
    assert yaw == 0
    assert (lift, pitch) == (pytest.approx(0.453, abs=1e-3), pytest.approx(0.045))


@pytest.mark.parametrize(
    ("name", "reply", "words"),
    [
        ("openpi_comet", {"action": np.zeros(ACTION_SIZE)}, ["no 'actions'", "behavior_2026"]),
        ("behavior_2025", {"actions": np.zeros((8, ACTION_SIZE))}, ["no 'action'", "openpi_comet"]),
    ],
)
def test_an_answer_in_another_dialect_is_told(name: str, reply: Any, words: list[str]) -> None:
    """It is said which settings such an answer fits."""
    with pytest.raises(PolicyError) as caught:
        actions_of(reply, load_settings(name).action, numbered_body())
    assert caught.value.reason == "bad_reply"
    assert all(word in str(caught.value) for word in words), caught.value


# --- what is told of the task


def with_prompts(tmp_path: Path, text: str) -> DialectSettings:
    (tmp_path / "prompts.json").write_text(text)
    mine = tmp_path / "mine.yaml"
    mine.write_text("about: Mine\nobservation: { prompts: prompts.json }\n")
    return load_settings(str(mine))


def test_a_whole_tasks_prompt_is_sent_for_every_subtask(tmp_path: Path) -> None:
    """From a file as comet's `task_mapping.json`, or of texts alone, beside the settings; the subtask's is not sent."""
    entries = {TASK: {"task_index": 1, "task": "Throw the cans away.", "skill": ["move to"]}, "mine": "Do it."}
    settings = with_prompts(tmp_path, json.dumps(entries))
    for task, prompt in ((TASK, "Throw the cans away."), ("mine", "Do it.")):
        layout = with_task(settings, task, None).observation
        assert layout is not None
        message = message_of({"prompt": "pick up the can", "proprioception": numbered_body(), "images": {}}, layout)
        assert message == {"prompt": prompt}


@pytest.mark.parametrize(
    ("text", "code", "place"),
    [
        ("[]", "wrong-type", (1, 1)),
        ("{}", "wrong-type", (1, 1)),
        ('{"a": 3}', "wrong-type", (1, 7)),
        ('{"a": {"task": 3}}', "wrong-type", (1, 16)),
        ('{"a": {"tsk": "x"}}', "missing-key", (1, 7)),
        ('{"a": " "}', "wrong-length", (1, 7)),
        ('{"a": "x",}', "syntax", (1, 11)),
    ],
)
def test_a_file_of_prompts_is_checked(text: str, code: str, place: tuple[int, int], tmp_path: Path) -> None:
    """What is wrong with it is told with its place in that file, when the settings are loaded."""
    with pytest.raises(FileProblems) as caught:
        with_prompts(tmp_path, text)
    (problem,) = caught.value.problems
    assert (problem.code, (problem.line, problem.column)) == (code, place)
    assert problem.file.endswith("prompts.json")


def test_a_task_without_a_prompt_gets_the_nearest(tmp_path: Path) -> None:
    """It is told which file has none for it."""
    file = tmp_path / "prompts.json"
    file.write_text(json.dumps({TASK: "Throw the cans away."}))
    assert read_prompts(file) == {TASK: "Throw the cans away."}
    with pytest.raises(UnknownName, match=rf"prompts.json.*picking_up_thrash.*Did you mean '{TASK}'"):
        prompt_of("picking_up_thrash", file)
    settings = with_prompts(tmp_path, file.read_text())
    with pytest.raises(UserError, match="name a task"):
        with_task(settings, None, None)


def test_a_task_without_a_number_is_refused() -> None:
    """Settings that send one say what to write instead; those that send none do not mind."""
    settings = load_settings("behavior_2025")
    with pytest.raises(UserError, match=r"no number for the task 'tidying_my_desk'.*constants.*task_id: \[0\]"):
        with_task(settings, "tidying_my_desk", None)
    with pytest.raises(UserError, match="no task is named"):
        with_task(settings, None, None)
    assert with_task(load_settings("openpi_comet"), None, None) == load_settings("openpi_comet")


def test_the_number_is_that_of_the_episodes_task(tmp_path: Path) -> None:
    """Of a task of BEHAVIOR's, by its name there, the number in its table; of another one the user is told."""
    for task, number in ((TASK, NUMBER), ("make_pizza", 49)):
        observation = settings_for("behavior_2025", task, "r1pro").observation
        assert observation is not None
        assert observation.constants == {"task_id": (number,)}
    with pytest.raises(UserError, match="no number for the task 'make_pasta'"):
        settings_for("behavior_2026", "make_pasta", "r1pro")
    with pytest.raises(UserError, match="the robot is the fetch: choose --robot r1pro"):
        settings_for("openpi_comet", TASK, "fetch")
    mine = tmp_path / "mine.yaml"
    mine.write_text("about: Mine\nobservation: { prompt: null, constants: { task_id: [7] } }\n")
    loaded = load_settings(str(mine)).model_copy(update={"robot": "r1pro"})
    assert settings_for(str(mine), "make_pasta", "r1pro") == loaded


def test_a_run_is_refused_before_it_begins(tmp_path: Path) -> None:
    """A file of prompts without the task's, or a robot that does not fit, end the command, not the episode."""
    (tmp_path / "prompts.json").write_text('{"turning_on_radio": "Turn it on."}')
    (tmp_path / "mine.yaml").write_text("about: Mine\nobservation: { prompts: prompts.json }\n")
    config = EpisodeConfig(
        TASK, robot="r1pro", policy="openpi:localhost:1", policy_settings=str(tmp_path / "mine.yaml")
    )
    with pytest.raises(UnknownName, match=rf"prompts.json.*{TASK}.*Known: turning_on_radio"):
        check_policy_choice(config)
    check_policy_choice(replace(config, task="turning_on_radio"))


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"observation": {"state": {"s": {"dialect": "behavior-2026"}}}}, "R1Pro.* choose --robot r1pro, or"),
        ({"action": {"dialect": "behavior-2025"}}, "R1Pro.* choose --robot r1pro, or"),
        (
            {"observation": {"state": {"s": {"parts": [{"part": "arm_left", "at": 0}]}}}},
            "no left arm: choose --robot r1 or",
        ),
        ({"action": {"parts": [{"part": "gripper_command_left", "at": 0}]}}, "no left arm: choose --robot r1 or"),
        ({"observation": {"images": {"i": {"camera": "left"}}}}, "no such camera: choose --robot r1 or"),
    ],
)
def test_settings_of_a_body_that_the_robot_lacks_are_refused(settings: Any, words: str) -> None:
    """What does not fit is told before an episode begins, with the robots that would; those are taken."""
    made = DialectSettings.model_validate(settings)
    with pytest.raises(UserError, match=words) as refused:
        check_robot(made, robot_named("fetch"))
    for robot in ("r1", "r1pro"):
        if f"--robot {robot} " in str(refused.value).replace(",", " "):
            check_robot(made, robot_named(robot))
        else:
            with pytest.raises(UserError, match="choose --robot r1pro"):
                check_robot(made, robot_named(robot))


def test_comet_with_another_robot_than_its_own_is_refused_before_a_simulator_loads() -> None:
    """The default robot is no R1Pro: the message names the settings and the option that fits."""
    config = EpisodeConfig(TASK, policy="openpi:localhost:1", policy_settings="openpi_comet")
    with pytest.raises(UserError, match=r"settings openpi_comet .* robot is the r1: choose --robot r1pro"):
        check_policy_choice(config)
    check_policy_choice(replace(config, robot="r1pro"))
