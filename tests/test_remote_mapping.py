"""Settings of remote policies: what the shipped ones send and read, and what is wrong with others."""

from __future__ import annotations

import json
import re
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from mpvi_bt.executive.remote import dialect_settings as settings_module
from mpvi_bt.executive.remote.dialect_settings import Action, DialectSettings, Observation, load_settings
from mpvi_bt.executive.remote.wire_mapping import MOST_ACTIONS, actions_of, message_of, resize_with_pad
from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import FileProblems, PolicyError, UnknownName, UserError
from mpvi_bt.ground.robot.protocol import SIDES
from mpvi_bt.testing.doubles import KinematicRobot
from tests.layouts import ACTION_SIZE, BASE, CAMERAS, LAYOUT
from tests.numbered_body import numbered_body
from tests.openpi_env import openpi_python

PRESETS = paths.names("policies")
PAGE = (Path(__file__).parent.parent / "docs" / "policy_servers.md").read_text(encoding="utf-8")


def observation(cameras: tuple[str, ...] = CAMERAS) -> dict[str, Any]:
    robot = KinematicRobot()
    return {
        "prompt": "pick up the cup",
        "proprioception": numbered_body("r1"),
        "images": {c: robot.look(c) for c in cameras},
    }


@pytest.mark.parametrize("name", PRESETS)
def test_shipped_settings_are_documented(name: str) -> None:
    """Each file is valid, says what it is for, and stands in the page's table."""
    assert load_settings(name).about
    assert re.search(rf"^\| `{name}`", PAGE, re.MULTILINE)


def test_an_action_without_parts_is_ours() -> None:
    """`mpvi serve` answers in our own order and units: nothing is changed, to the last bit."""
    theirs = np.random.default_rng(0).normal(size=(4, ACTION_SIZE))
    assert np.array_equal(actions_of({"actions": theirs}, load_settings("mpvi").action, numbered_body("r1")), theirs)


def test_parts_that_a_policy_lacks_are_held() -> None:
    """A policy for one arm leaves trunk, other arm and other gripper as they were, and the base still."""
    layout = Action.model_validate({"size": 7, "parts": [{"part": "arm_right", "at": 0}]})
    ours = actions_of({"actions": np.ones((3, 7))}, layout, numbered_body("r1"))
    assert not ours[:, BASE].any()
    assert (ours[:, LAYOUT.torso] == numbered_body("r1").torso).all()
    assert (ours[:, LAYOUT.arm["left"]] == numbered_body("r1").arm["left"]).all()
    assert (ours[:, LAYOUT.arm["right"]] == 1).all()
    assert (ours[:, [LAYOUT.gripper[side] for side in SIDES]] == [-1.0, 0.5]).all()


@given(
    order=st.permutations(range(7)),
    scale=st.lists(st.sampled_from([-2.0, -1.0, 0.5, 1.0]), min_size=7, max_size=7),
    offset=st.lists(st.floats(-3, 3), min_size=7, max_size=7),
)
def test_what_a_policy_echoes_is_where_the_arm_is(order: list[int], scale: list[float], offset: list[float]) -> None:
    """Order, signs, units and zeros mean the same both ways: a state sent back as an action is the posture felt."""
    piece = {"part": "arm_left", "at": order, "scale": scale, "offset": offset}
    state = {"state": {"parts": [piece], "dtype": "float64"}}
    sent = message_of(observation(()), Observation.model_validate({"state": state}))
    layout = Action.model_validate({"size": 7, "parts": [piece]})
    ours = actions_of({"actions": sent["state"][None]}, layout, numbered_body("r1"))
    np.testing.assert_allclose(ours[0, LAYOUT.arm["left"]], numbered_body("r1").arm["left"], atol=1e-9)


def test_keys_with_dots_nest_and_constants_are_sent() -> None:
    """`images.front` is {"images": {"front": ...}}; a list of numbers is an array; depth and order of axes are kept."""
    layout = Observation.model_validate(
        {
            "prompt": "task.prompt",
            "images": {
                "images.front": {"camera": "head", "layout": "chw"},
                "images.deep.depth": {"camera": "head", "show": "depth", "size": [100, 60]},
            },
            "constants": {"task.id": [3, 4], "task.name": "r1", "flag": True},
        }
    )
    sent = message_of(observation(), layout)
    assert sent["task"]["prompt"] == "pick up the cup"
    assert sent["task"]["id"].tolist() == [3, 4]
    assert (sent["task"]["name"], sent["flag"]) == ("r1", True)
    head = observation()["images"]["head"]
    assert np.array_equal(sent["images"]["front"], np.moveaxis(head.rgb, 2, 0))
    depth = sent["images"]["deep"]["depth"]
    assert (depth.shape, depth.dtype) == ((100, 60), np.float32)


def test_pictures_that_were_not_taken_are_left_out() -> None:
    """Only what is in the observation is sent: a server that named fewer cameras gets fewer."""
    layout = load_settings("openpi_comet").observation
    assert layout is not None
    assert "observation/egocentric_camera" not in message_of(observation(("left",)), layout)


SIZES = [(240, 320), (480, 640), (224, 224), (100, 37), (37, 100), (720, 720), (1, 500)]


@pytest.mark.parametrize("size", SIZES, ids=str)
def test_a_resized_picture_keeps_its_shape(size: tuple[int, int]) -> None:
    """It is scaled alike both ways, as large as fits, in the middle, with zeros around it."""
    h, w = size
    padded = resize_with_pad(np.full((*size, 3), 200, np.uint8), 224, 224)
    assert padded.shape == (224, 224, 3)
    rows, columns = np.nonzero(padded[..., 0].any(1))[0], np.nonzero(padded[..., 0].any(0))[0]
    scale = 224 / max(h, w)
    assert abs(len(rows) - max(1, h * scale)) <= 1
    assert abs(len(columns) - max(1, w * scale)) <= 1
    assert abs(rows[0] - (223 - rows[-1])) <= 1
    assert abs(columns[0] - (223 - columns[-1])) <= 1
    assert (padded[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1] == 200).all()


def test_depth_is_not_blended() -> None:
    """A resized depth picture has only depths that were in it, and 0."""
    depth = np.where(np.arange(320) < 150, 1.0, 5.0).astype(np.float32)[None].repeat(240, 0)
    assert set(np.unique(resize_with_pad(depth, 224, 224))) == {0.0, 1.0, 5.0}


RESIZES = """
import sys, numpy as np
from openpi_client import image_tools
pictures = np.load(sys.argv[1])
np.savez(sys.argv[2], **{k: image_tools.resize_with_pad(v, 224, 224) for k, v in pictures.items()})
"""


@pytest.mark.rare
@pytest.mark.slow
def test_pictures_are_resized_as_openpi_does(tmp_path: Path) -> None:
    """Beside the published client's own function the padding is the same; no color differs by more than 1 of 255."""
    rng = np.random.default_rng(0)
    pictures = {}
    for h, w in [size for size in SIZES if min(size) > 30]:
        y, x = np.mgrid[:h, :w]
        smooth = 127 + 100 * np.sin(x[..., None] / [9, 15, 31]) * np.cos(y[..., None] / [17, 11, 23])
        edges = (x[..., None] // 20 + y[..., None] // 30) % 2 * 60
        pictures[f"{h}x{w}"] = np.clip(smooth - edges + rng.normal(0, 3, (h, w, 3)), 0, 255).astype(np.uint8)
    np.savez(tmp_path / "in.npz", allow_pickle=False, **pictures)
    files = [str(tmp_path / "in.npz"), str(tmp_path / "out.npz")]
    subprocess.run([openpi_python(), "-c", RESIZES, *files], check=True, timeout=60)
    theirs = np.load(tmp_path / "out.npz")
    for name, picture in pictures.items():
        ours = resize_with_pad(picture, 224, 224)
        assert np.abs(ours.astype(int) - theirs[name]).max() <= 1, name


GOOD = np.zeros((2, ACTION_SIZE))


def spoiled(value: float) -> Any:
    actions = GOOD.copy()
    actions[1, 7] = value
    return actions


BAD = {
    "no mapping": [1, 2],
    "no key": {"action": GOOD},
    "a list": {"actions": GOOD.tolist()},
    "a number": {"actions": 1.0},
    "nan": {"actions": spoiled(np.nan)},
    "infinite": {"actions": spoiled(-np.inf)},
    "too few numbers": {"actions": GOOD[:, :-1]},
    "too many numbers": {"actions": np.zeros((2, 32))},
    "an empty chunk": {"actions": GOOD[:0]},
    "nothing": {"actions": np.zeros(0)},
    "a number alone": {"actions": np.array(1.0)},
    "a batch of two": {"actions": np.zeros((2, 3, ACTION_SIZE))},
    "too many actions": {"actions": np.zeros((MOST_ACTIONS + 1, ACTION_SIZE), np.float32)},
    "truth values": {"actions": np.zeros((2, ACTION_SIZE), bool)},
    "text": {"actions": np.full((2, ACTION_SIZE), "1")},
    "bytes": {"actions": np.full((2, ACTION_SIZE), b"1")},
}


@pytest.mark.parametrize("name", BAD)
def test_what_is_no_chunk_of_actions_is_refused(name: str) -> None:
    """Whatever a reply holds instead is a bad reply, told in one line."""
    with pytest.raises(PolicyError) as caught:
        actions_of(BAD[name], Action(), numbered_body("r1"))
    assert caught.value.reason == "bad_reply"
    assert "\n" not in str(caught.value)


def test_a_row_of_another_size_is_told_with_whose_size_is_meant() -> None:
    """The numbers of a row are the settings' to say, and else the robot's."""
    reply = {"actions": np.zeros((8, 32))}
    with pytest.raises(PolicyError, match=r"shape \(8, 32\), not \(H, 16\) as the settings would"):
        actions_of(
            reply, Action.model_validate({"size": 16, "parts": [{"part": "arm_left", "at": 0}]}), numbered_body("r1")
        )
    with pytest.raises(PolicyError, match=rf"not \(H, {ACTION_SIZE}\) as the robot would"):
        actions_of(reply, Action(), numbered_body("r1"))


def test_numbers_that_overflow_when_scaled_are_refused() -> None:
    """What is finite on the wire but not in our units is no action."""
    layout = Action.model_validate({"parts": [{"part": "torso", "at": 0, "scale": 1e6}]})
    with pytest.raises(PolicyError, match="not finite"):
        actions_of({"actions": np.full((1, ACTION_SIZE), 1e305)}, layout, numbered_body("r1"))


@pytest.mark.parametrize("shape", [(ACTION_SIZE,), (1, ACTION_SIZE), (1, 5, ACTION_SIZE), (1, 1, ACTION_SIZE)])
def test_one_action_or_a_batch_of_one_is_a_chunk(shape: tuple[int, ...]) -> None:
    """BEHAVIOR's servers answer one action, with or without a batch's axis; half precision and integers are numbers."""
    for dtype in (np.float16, np.float32, np.float64, np.int32):
        chunk = actions_of({"actions": np.ones(shape, dtype)}, Action(), numbered_body("r1"))
        assert chunk.shape == (shape[-2] if len(shape) > 2 else 1, ACTION_SIZE)
        assert chunk.dtype == np.dtype(float)
        chunk[:] = 0  # and may be written to


def problems(text: str, tmp_path: Path) -> list[tuple[int, int, str]]:
    path = tmp_path / "mine.yaml"
    path.write_text(text)
    try:
        load_settings(str(path))
    except FileProblems as error:
        return [(p.line, p.column, p.code) for p in error.problems]
    return []


MISTAKES = {
    "observation:\n  images:\n    a: { camera: haed }\n": (3, 18, "unknown-value"),
    "observation:\n  images:\n    a: { camera: head, size: [0, 5] }\n": (3, 31, "out-of-range"),
    "observation:\n  state:\n    s: { parts: [] }\n": (3, 17, "wrong-length"),
    "observation:\n  state:\n    s: { parts: [{ part: troso, at: 0 }] }\n": (3, 26, "unknown-value"),
    "observation:\n  state:\n    s: { parts: [{ part: torso, at: [1, 2] }] }\n": (3, 18, "invalid-value"),
    "observation:\n  state:\n    s: { size: 3, parts: [{ part: torso, at: 0 }] }\n": (3, 8, "invalid-value"),
    "observation:\n  state:\n    s: { parts: [{ part: torso, at: [1, 1, 2, 3] }] }\n": (3, 8, "invalid-value"),
    "observation:\n  constants: { a: 1, a.b: 2 }\n": (2, 3, "invalid-value"),
    "action:\n  parts: [{ part: torso, at: 0, scale: 0 }]\n": (2, 11, "invalid-value"),
    "action:\n  size: 7\n": (2, 3, "invalid-value"),
    "action:\n  parts: [{ part: torso, at: 0 }, { part: torso, at: 8 }]\n": (2, 3, "invalid-value"),
    "action:\n  parts: [{ part: torso, at: 20 }]\n": (2, 3, "invalid-value"),
    "action: {}\nconect_s: 3\n": (2, 1, "unknown-key"),
    "connect_s: 0\n": (1, 12, "out-of-range"),
    "answer_s: .inf\n": (1, 11, "out-of-range"),
    "connect_s: 1\ntries: -1\n": (2, 8, "out-of-range"),
    "action: {}\nmax_mb: 65\n": (2, 9, "out-of-range"),
    'action: {}\nmax_mb: "16"\n': (2, 9, "wrong-type"),
    'action: {}\nreset_message: "yes"\n': (2, 16, "wrong-type"),
    "action: {}\ntries: true\n": (2, 8, "wrong-type"),
    "action: {}\nrequest_chunk: 8.0\n": (2, 16, "wrong-type"),
    "action:\n  size: '23'\n": (2, 9, "wrong-type"),
    "observation:\n  state:\n    s: { size: 8.0, parts: [{ part: torso, at: 0 }] }\n": (3, 16, "wrong-type"),
    "observation:\n  images:\n    a: { camera: head, size: [224] }\n": (3, 30, "wrong-length"),
    "observation:\n  images:\n    a: { camera: head, size: [224, '224'] }\n": (3, 36, "wrong-type"),
    "observation:\n  images:\n    b..c: { camera: head }\n": (3, 11, "invalid-value"),
    "observation:\n  state:\n    s: { parts: [{ part: torso, at: -1 }] }\n": (3, 37, "out-of-range"),
    "observation:\n  state:\n    s: { parts: [{ part: torso, at: x }] }\n": (3, 37, "wrong-type"),
    "action:\n  parts: [{ part: torso, at: 0, offset: .nan }]\n": (2, 41, "out-of-range"),
    "action:\n  parts: [{ part: torso, at: 0, scale: [1, x, 1, 1] }]\n": (2, 44, "wrong-type"),
    "observation:\n  constants: { a: .nan }\n": (2, 19, "out-of-range"),
    "observation:\n  constants: { a: 99999999999999999999 }\n": (2, 19, "out-of-range"),
    "observation:\n  constants: { a: {} }\n": (2, 19, "wrong-type"),
    "observation:\n  state:\n    s: { size: 3 }\n": (3, 8, "invalid-value"),
    "observation:\n  state:\n    s: { dialect: behavior-2024 }\n": (3, 19, "unknown-value"),
    "observation:\n  state:\n    s: { dialect: behavior-2025, size: 61 }\n": (3, 8, "invalid-value"),
    "observation:\n  state:\n    s: { dialect: behavior-2025, parts: [{ part: torso, at: 0 }] }\n": (
        3,
        8,
        "invalid-value",
    ),
    "observation:\n  state:\n    s: { base_velocity: zero, parts: [{ part: torso, at: 0 }] }\n": (
        3,
        8,
        "invalid-value",
    ),
    "observation: { task_id: prompt }\n": (1, 14, "invalid-value"),
    "observation: { prompt: null, prompts: tasks.json }\n": (1, 14, "invalid-value"),
    "observation:\n  prompts: nowhere.json\n": (2, 12, "unreadable"),
    "action: { dialect: behavior-2025, size: 22 }\n": (1, 9, "invalid-value"),
}


@pytest.mark.parametrize("text", MISTAKES, ids=lambda text: text.split("{")[-1].strip()[:40])
def test_a_mistake_is_told_with_its_place(text: str, tmp_path: Path) -> None:
    """Each mistake in a file of settings is found, at its line and column, and told once."""
    assert problems(text, tmp_path) == [MISTAKES[text]]


def test_an_unknown_name_gets_the_nearest() -> None:
    """Settings are known by name, as are files by path."""
    with pytest.raises(UnknownName, match="Did you mean 'openpi_comet'"):
        load_settings("openpi_commet")
    with pytest.raises(UserError, match="no such file"):
        load_settings("./mine.yaml")


def test_the_settings_of_the_page_are_valid(tmp_path: Path) -> None:
    """Its example has no problems, and every key of a file stands in its table."""
    (text,) = re.findall(r"^```yaml\n(.*?)^```$", PAGE, flags=re.MULTILINE | re.DOTALL)
    assert problems(text, tmp_path) == []
    documented = set(re.findall(r"^\| `([\w.]+)` \|", PAGE, re.MULTILINE))
    assert set(DialectSettings.model_fields) - {"about"} <= documented
    assert {f"observation.{key}" for key in Observation.model_fields} <= documented


def test_a_user_folder_of_policies_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A file in policies/ of a root in MPVI_PATH is known by name."""
    (tmp_path / "policies").mkdir()
    (tmp_path / "policies" / "mine.yaml").write_text(yaml.safe_dump({"about": "Mine", "tries": 7}))
    monkeypatch.setenv("MPVI_PATH", str(tmp_path))
    assert load_settings("mine").tries == 7


@given(st.recursive(st.one_of(st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=5)),
                    lambda x: st.one_of(st.lists(x, max_size=3), st.dictionaries(st.sampled_from(
                        ["observation", "images", "state", "a", "parts", "part", "at", "action", "camera", "key"]),
                        x, max_size=4)), max_leaves=15))  # fmt: skip
def test_any_data_are_settings_or_have_problems(data: Any) -> None:
    """Whatever stands in a file, it is settings or a list of problems, never another exception."""
    from mpvi_bt.ground.marked_yaml import parse_marked

    try:
        settings_module.check_settings(*parse_marked(json.dumps({"action": {}, "settings": data}), "x.yaml"))
    except FileProblems as error:
        assert error.problems
    if isinstance(data, dict):
        try:
            settings_module.check_settings(*parse_marked(json.dumps(data), "x.yaml"))
        except FileProblems as error:
            assert error.problems


def test_held_parts_are_those_of_the_handoff() -> None:
    """What is held is what was handed over, not what the arm sags to since."""
    layout = Action.model_validate({"size": 1, "parts": [{"part": "gripper_command_left", "at": 0}]})
    before, now = numbered_body("r1"), replace(numbered_body("r1"), torso=numbered_body("r1").torso - 0.1)
    ours = actions_of({"actions": np.zeros((1, 1))}, layout, before)
    assert (ours[0, LAYOUT.torso] == before.torso).all()
    assert (ours[0, LAYOUT.torso] != now.torso).all()
