"""Checkpoints of LeRobot's without LeRobot: what they are shown, how fast they are, and which ones are refused."""

from __future__ import annotations

import importlib.metadata
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mpvi_bt.executive.remote.dialect_settings import DialectSettings, load_settings
from mpvi_bt.executive.remote.lerobot_checkpoint import check_fit, read_checkpoint
from mpvi_bt.executive.remote.lerobot_frames import cameras_of_checkpoint, frame_of
from mpvi_bt.executive.remote.wire_mapping import resize_with_pad
from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.robot.robots import robot_named
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.choices.policies import PolicyInputs, check_policy_choice, make_policy, rate_doubt
from mpvi_bt.testing.doubles import KinematicRobot
from tests.layouts import LAYOUT
from tests.lerobot_files import OURS, checkpoint, dataset
from tests.numbered_body import numbered_body

MINE = """
robot: r1
rate_hz: 20
observation:
  images: {observation.images.top: {camera: head, fit: crop, layout: chw}}
  state: {observation.state: {parts: [{part: arm_right, at: 0}, {part: gripper_width_right, at: 7, scale: 0.1}]}}
action: {size: 8, parts: [{part: arm_right, at: 0}, {part: gripper_command_right, at: 7, scale: 2, offset: -1}]}
"""
THEIRS: dict[str, Any] = {
    "input_features": {
        "observation.state": {"type": "STATE", "shape": [8]},
        "observation.images.top": {"type": "VISUAL", "shape": [3, 96, 96]},
    },
    "output_features": {"action": {"type": "ACTION", "shape": [8]}},
}


@pytest.fixture
def installed(monkeypatch: pytest.MonkeyPatch) -> None:
    """A lerobot of the version that is known, as far as one asks."""
    monkeypatch.setattr(importlib.metadata, "version", lambda name: "0.4.4")


@pytest.fixture
def trained(tmp_path: Path) -> Path:
    """A checkpoint of ours, its dataset beside it."""
    return checkpoint(tmp_path / "act", dataset(tmp_path / "picks"))


def seen() -> dict[str, Any]:
    """What a robot of distinct numbers sees."""
    images = {camera: KinematicRobot().look(camera) for camera in ("head", "left", "right")}
    return {"prompt": "pick up the cup", "proprioception": numbered_body("r1"), "images": images}


def mine(folder: Path, text: str = MINE) -> DialectSettings:
    (folder / "mine.yaml").write_text(text)
    return load_settings(str(folder / "mine.yaml"))


def test_a_checkpoint_says_what_it_wants(trained: Path) -> None:
    """Sizes of pictures, numbers and chunk are its own; rate and robot are those of its dataset."""
    one = read_checkpoint(trained)
    assert (one.kind, one.rows, one.whole_chunks, one.action_size) == ("act", 8, True, 23)
    assert one.pictures == {"observation.images.head": (48, 64), "observation.images.right": (64, 64)}
    assert one.numbers == {"observation.state": 23, "observation.base_pose": 3}
    assert (one.fps, one.robot) == (10.0, "r1")


@pytest.mark.parametrize("inside", ["checkpoints/last/pretrained_model", "pretrained_model"])
def test_what_the_training_wrote_is_a_folder_too(tmp_path: Path, inside: str) -> None:
    """The last checkpoint in the output folder of `lerobot-train` is found, also in the folder of one step."""
    checkpoint(tmp_path / "out" / inside)
    assert read_checkpoint(tmp_path / "out").folder == tmp_path / "out" / inside


@pytest.mark.parametrize("config", [{"n_obs_steps": 2}, {"temporal_ensemble_coeff": 0.01}], ids=str)
def test_who_remembers_is_asked_for_each_row(tmp_path: Path, config: dict[str, Any]) -> None:
    """A chunk at once would have it miss the observations in between."""
    assert not read_checkpoint(checkpoint(tmp_path / "act", **config)).whole_chunks


def test_a_checkpoint_of_ours_needs_no_settings(trained: Path) -> None:
    """State and base pose are those of `mpvi dataset`, and pictures are scaled and padded to its size."""
    one, given = read_checkpoint(trained), seen()
    check_fit(one, DialectSettings(), robot_named("r1"))
    frame = frame_of(given, one, DialectSettings())
    body = given["proprioception"]
    assert set(frame) == set(OURS)
    np.testing.assert_array_equal(frame["observation.state"][LAYOUT.arm["right"]], body.arm["right"].astype("f4"))
    np.testing.assert_allclose(frame["observation.state"][[14, 22]], [0.06, 0.08])
    np.testing.assert_array_equal(frame["observation.base_pose"], body.base_pose.astype("f4"))
    for camera, size in (("head", (48, 64)), ("right", (64, 64))):
        shown = frame[f"observation.images.{camera}"]
        assert shown.dtype == np.uint8
        assert np.array_equal(shown, resize_with_pad(given["images"][camera].rgb, *size))
        assert shown.shape == (*size, 3)
    assert cameras_of_checkpoint(one, DialectSettings()) == ("head", "right")


def test_features_of_others_are_mapped_by_settings(tmp_path: Path) -> None:
    """Names, order and units are those of the file; pictures get the checkpoint's size, cropped if the file says so."""
    one, given, settings = read_checkpoint(checkpoint(tmp_path / "so", **THEIRS)), seen(), mine(tmp_path)
    check_fit(one, settings, robot_named("r1"))
    frame = frame_of(given, one, settings)
    arm = given["proprioception"].arm["right"]
    np.testing.assert_allclose(frame["observation.state"], [*arm, 0.8], rtol=1e-6)
    assert frame["observation.images.top"].shape == (96, 96, 3)
    assert cameras_of_checkpoint(one, settings) == ("head",)


def without(*keys: str) -> dict[str, Any]:
    return {"input_features": {key: value for key, value in OURS.items() if key not in keys}}


def with_feature(key: str, kind: str, *shape: int) -> dict[str, Any]:
    return {"input_features": {**OURS, key: {"type": kind, "shape": list(shape)}}}


@pytest.mark.parametrize(
    ("config", "said"),
    [
        ({"type": None}, "no policy of LeRobot's"),
        ({"input_features": 3}, "no policy of LeRobot's"),
        ({"output_features": {}}, "the feature 'action'"),
        ({"n_action_steps": 5000}, "1 to 1024"),
        ({"n_action_steps": "all"}, "1 to 1024"),
        (with_feature("observation.images.head", "VISUAL", 1, 48, 64), r"\(3, height, width\) is wanted"),
        (with_feature("observation.state", "STATE", 2, 23), r"\(n,\) is wanted"),
        (with_feature("observation.state", "STATE"), r"\(n,\) is wanted"),
    ],
)
def test_what_cannot_be_run_is_refused_when_it_is_read(tmp_path: Path, config: dict[str, Any], said: str) -> None:
    """The line names the file and what it should have."""
    with pytest.raises(UserError, match=said) as told:
        read_checkpoint(checkpoint(tmp_path / "act", **config))
    assert str(told.value).startswith(f"{tmp_path / 'act'}")
    assert "\n" not in str(told.value)


@pytest.mark.parametrize(
    ("file", "text", "said"),
    [
        ("config.json", None, "no checkpoint of LeRobot's is there"),
        ("config.json", "{", "cannot be read"),
        ("config.json", "[1]", "is no mapping"),
        ("model.safetensors", None, "model.safetensors, are missing"),
        ("policy_preprocessor.json", None, "LeRobot before 0.4"),
        ("train_config.json", "{", "cannot be read"),
    ],
)
def test_a_broken_folder_is_told_of_in_a_line(trained: Path, file: str, text: str | None, said: str) -> None:
    """Whichever file is missing or broken."""
    (trained / file).unlink() if text is None else (trained / file).write_text(text)
    with pytest.raises(UserError, match=said) as told:
        read_checkpoint(trained)
    assert "\n" not in str(told.value)


def test_a_relative_dataset_is_found_from_above_the_checkpoint(tmp_path: Path) -> None:
    """Who trained with `--dataset.root=picks --output_dir=act` may run the checkpoint from any folder."""
    dataset(tmp_path / "picks", fps=20)
    one = read_checkpoint(checkpoint(tmp_path / "act/checkpoints/000500/pretrained_model", Path("picks")))
    assert (one.robot, one.fps, one.dataset) == ("r1", 20.0, tmp_path / "picks")


def test_a_dataset_without_a_rate_is_refused(tmp_path: Path) -> None:
    """No guess is made where the dataset is there and says nonsense."""
    with pytest.raises(UserError, match="'fps' is the rows a second"):
        read_checkpoint(checkpoint(tmp_path / "act", dataset(tmp_path / "picks", fps="fast")))


@pytest.mark.parametrize(
    ("config", "robot", "said"),
    [
        ({}, "r1pro", "of the robot r1, not of the r1pro"),
        ({}, "fetch", "of the robot r1, not of the fetch"),
        (with_feature("observation.state", "STATE", 14), "r1", "wants 14 numbers as 'observation.state'; .* are 23"),
        (with_feature("observation.force", "STATE", 6), "r1", "wants numbers as 'observation.force'"),
        (with_feature("observation.images.top", "VISUAL", 3, 8, 8), "r1", "'observation.images.top', and the r1 has"),
        ({"output_features": {"action": {"type": "ACTION", "shape": [7]}}}, "r1", "actions of 7 numbers; .* are 23"),
    ],
)
def test_what_does_not_fit_the_robot_is_refused(trained: Path, config: dict[str, Any], robot: str, said: str) -> None:
    """Another robot, or features that it does not have: a line with both sides of it."""
    one = read_checkpoint(checkpoint(trained, **config))
    with pytest.raises(UserError, match=said):
        check_fit(one, DialectSettings(), robot_named(robot))


def test_who_says_nothing_of_the_robot_is_named(tmp_path: Path) -> None:
    """The file in which it should stand, whichever that is."""
    picks = dataset(tmp_path / "picks")
    act = checkpoint(tmp_path / "act", picks)
    for root in ("gone", "x" * 5000, "a\0b"):
        (act / "train_config.json").write_text(json.dumps({"dataset": {"root": root}}))
        with pytest.raises(UserError, match=r"dataset is not where .*act/train_config\.json says"):
            check_fit(read_checkpoint(act), DialectSettings(), robot_named("r1"))
    (act / "train_config.json").unlink()
    with pytest.raises(UserError, match=r"it has no train_config\.json"):
        check_fit(read_checkpoint(act), DialectSettings(), robot_named("r1"))
    (picks / "meta/info.json").write_text('{"fps": 10}')
    one = read_checkpoint(checkpoint(tmp_path / "act", picks))
    with pytest.raises(UserError, match=r"picks/meta/info\.json has no robot_type"):
        check_fit(one, DialectSettings(), robot_named("r1"))


@pytest.mark.parametrize("robot", ["r1", "r1pro", "fetch"])
def test_a_checkpoint_without_its_dataset_is_of_nobody(tmp_path: Path, robot: str) -> None:
    """The numbers of all robots are alike in size, so that only a name tells them apart: settings may say it."""
    one = read_checkpoint(checkpoint(tmp_path / "act", tmp_path / "gone", **without("observation.images.right")))
    with pytest.raises(UserError, match=f"nobody says of which robot .* write `robot: {robot}`"):
        check_fit(one, DialectSettings(), robot_named(robot))
    check_fit(one, mine(tmp_path, f"robot: {robot}"), robot_named(robot))
    with pytest.raises(UserError, match=f"of the robot {robot}, not of the"):
        check_fit(one, mine(tmp_path, f"robot: {robot}"), robot_named("fetch" if robot == "r1" else "r1"))


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("right, at: 0}, {part: gripper_width", "right, at: 0}, {part: base_velocity, at: 8}, {part: gripper_width",
         "wants 8 numbers .* are 11"),
        ("images.top", "images.front", "'observation.images.top', and the r1 has: observation.images.front"),
        ("camera: head,", "camera: head, show: depth,", "wants pictures as 'observation.images.top'"),
        ("camera: head,", "camera: head, size: [64, 64],", r"of \(96, 96\), and the settings scale it to \(64, 64\)"),
        ("size: 8", "size: 9", "answers actions of 8 numbers; .* are 9"),
    ],
)  # fmt: skip
def test_settings_that_do_not_fit_the_checkpoint_are_refused(tmp_path: Path, old: str, new: str, said: str) -> None:
    """Sizes and names have to be the checkpoint's."""
    assert old in MINE
    one = read_checkpoint(checkpoint(tmp_path / "so", **THEIRS))
    with pytest.raises(UserError, match=said):
        check_fit(one, mine(tmp_path, MINE.replace(old, new)), robot_named("r1"))


@pytest.mark.usefixtures("installed")
def test_the_rate_is_that_of_the_settings_or_else_of_the_dataset(trained: Path, tmp_path: Path) -> None:
    """Where both say one and differ, who reads the score is told of both."""
    made: Any = make_policy(f"lerobot:{trained}", PolicyInputs({}, robot="r1"))
    assert (made.rate_hz, made.rate_from, made.cameras) == (
        10.0,
        f"the dataset {tmp_path / 'picks'}",
        ("head", "right"),
    )
    (tmp_path / "fast.yaml").write_text("rate_hz: 20")
    fast: Any = make_policy(f"lerobot:{trained}", PolicyInputs({}, robot="r1"), str(tmp_path / "fast.yaml"))
    assert fast.rate_hz == 20.0
    assert fast.rate_from == f"the settings; the dataset {tmp_path / 'picks'} says 10"


@pytest.mark.usefixtures("installed")
def test_a_rate_that_nobody_says_is_told_of(trained: Path, tmp_path: Path) -> None:
    """Without its dataset it would run at 30 Hz, unless the settings say another rate."""
    (tmp_path / "r1.yaml").write_text("robot: r1")
    (tmp_path / "rated.yaml").write_text("robot: r1\nrate_hz: 10")
    alone = f"lerobot:{checkpoint(tmp_path / 'alone')}"
    config = EpisodeConfig("picking_up_trash", policy=alone, policy_settings=str(tmp_path / "r1.yaml"))
    assert "runs at 30 Hz since the dataset" in rate_doubt(config)
    for silent in (
        EpisodeConfig("picking_up_trash", policy=f"lerobot:{trained}"),
        EpisodeConfig("picking_up_trash", policy=alone, policy_settings=str(tmp_path / "rated.yaml")),
    ):
        assert rate_doubt(silent) == ""


@pytest.mark.usefixtures("installed")
def test_settings_of_a_pair_are_those_of_the_one_that_can_have_some(tmp_path: Path) -> None:
    """`lerobot:FOLDER+reactive` takes them for the checkpoint."""
    alone = checkpoint(tmp_path / "alone")
    (tmp_path / "r1.yaml").write_text("robot: r1")
    config = EpisodeConfig("picking_up_trash", policy=f"lerobot:{alone}[pick]+reactive", robot="r1")
    with pytest.raises(UserError, match="nobody says of which robot"):
        check_policy_choice(config)
    check_policy_choice(EpisodeConfig(**{**vars(config), "policy_settings": str(tmp_path / "r1.yaml")}))


@pytest.mark.parametrize(
    ("version", "said"),
    [
        (None, r"need lerobot.*\[lerobot\]"),
        ("0.3.3", "0.3.3 is installed, and 0.4 to 0.6 are known"),
        ("0.7.0", "0.7.0 is installed, and 0.4 to 0.6 are known"),
        ("0.10.1", "0.10.1 is installed"),
    ],
)
def test_lerobot_is_asked_for_in_a_line(
    trained: Path, monkeypatch: pytest.MonkeyPatch, version: str | None, said: str
) -> None:
    """Where it is missing or of a version that nobody tried; before a simulator loads."""

    def told(name: str) -> str:
        if version is None:
            raise importlib.metadata.PackageNotFoundError(name)
        return version

    monkeypatch.setattr(importlib.metadata, "version", told)
    with pytest.raises(UserError, match=said):
        check_policy_choice(EpisodeConfig("picking_up_trash", policy=f"lerobot:{trained}", robot="r1"))


def test_a_folder_that_is_no_checkpoint_is_no_policy(tmp_path: Path) -> None:
    """As soon as it is chosen, whether LeRobot is there or not."""
    with pytest.raises(UserError, match="no checkpoint of LeRobot's is there"):
        check_policy_choice(EpisodeConfig("picking_up_trash", policy=f"lerobot:{tmp_path}"))
