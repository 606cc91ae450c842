"""Actions of a dataset as changes or speeds: of any kind and rate they lead to the same place in the same time."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from mpvi_bt.executive.remote.lerobot_checkpoint import read_checkpoint
from mpvi_bt.executive.ticking.loop import Outcome
from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.action_layout import KINDS, ActionKind
from mpvi_bt.ground.robot.protocol import CONTROL_HZ
from mpvi_bt.runs.datasets.demonstrations import read_demonstration
from mpvi_bt.runs.datasets.lerobot import DatasetForm, write_dataset
from mpvi_bt.runs.recording.demonstration_recorder import DemonstrationRecorder
from mpvi_bt.testing.doubles import KinematicRobot
from tests.demonstrating import recorded
from tests.lerobot_files import checkpoint
from tests.test_rates import JOINTS, Rows, played

STEPS = 300


def reach(folder: Path, fps: int) -> tuple[Path, Array]:
    """A demonstration of ten seconds in which all joints move a little, and the (n, 23) commands that it has."""
    robot = KinematicRobot()
    commands = np.tile(robot.action, (STEPS, 1))
    time_s = np.arange(1, STEPS + 1)[:, None] / CONTROL_HZ
    commands[:, JOINTS] += 0.1 * np.sin(time_s * np.linspace(0.3, 1.2, len(JOINTS)))
    told = {"task": "hello", "instance": 0, "seed": 0, "instruction": "Reach.", "config": {"robot": "r1"}}
    recorder = DemonstrationRecorder(folder, told, fps, ())
    recorder.begin()
    for step, command in enumerate(commands):
        recorder.note(step, robot, command, lambda: "reach")
        robot.act(command)
        robot.advance(robot.action)
    recorder.end(Outcome("success"))
    recorder.conclude(1.0, True)
    return folder, commands


def actions_of(dataset: Path) -> Array:
    """(n, 23) of its first episode."""
    pd = pytest.importorskip("pandas")
    return np.stack(pd.read_parquet(next((dataset / "data").rglob("*.parquet")))["action"]).astype(float)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("fps", [10, 30])
def test_a_motion_gets_there_in_its_time_by_actions_of_any_rate_and_kind(
    fps: int, kind: ActionKind, tmp_path: Path
) -> None:
    """A checkpoint knows both of its dataset; what was recorded, answered by it, takes as long and ends as it did."""
    pytest.importorskip("pandas")
    folder, commands = reach(tmp_path / "reach", fps)
    write_dataset([read_demonstration(folder)], tmp_path / "set", DatasetForm(actions=kind))
    one = read_checkpoint(checkpoint(tmp_path / "act", tmp_path / "set"))
    assert (one.fps, one.actions) == (fps, None if kind == "absolute" else kind)
    told = played(Rows(actions_of(tmp_path / "set"), 4, one.fps, one.actions or "absolute"))
    assert len(told) == STEPS
    np.testing.assert_allclose(told[-1], commands[-1], atol=2e-4)
    assert np.abs(told[:, JOINTS] - commands[:, JOINTS]).max() < 5e-3


def test_a_joint_at_rest_does_not_move_in_changes(tmp_path: Path) -> None:
    """What a float adds to it would be as large as a motion to who scales each joint by how far it goes."""
    pytest.importorskip("pandas")
    folder, _ = reach(tmp_path / "reach", 10)
    with np.load(folder / "frames.npz") as file:
        arrays = dict(file)
    for key in ("state", "action"):
        arrays[key][:, JOINTS] = 0.3 + 1e-6 * np.random.default_rng(0).normal(size=(STEPS // 3, len(JOINTS)))
    np.savez(folder / "frames.npz", **arrays)
    write_dataset([read_demonstration(folder)], tmp_path / "set", DatasetForm(actions="delta"))
    assert not actions_of(tmp_path / "set")[:, JOINTS].any()


def test_what_says_no_kind_is_refused(tmp_path: Path) -> None:
    """BEHAVIOR's joints are absolute; and a dataset that names a kind that there is not is told of in a line."""
    pytest.importorskip("pandas")
    episode = read_demonstration(recorded(tmp_path / "pro", 3, fps=30, robot="r1pro"))
    with pytest.raises(UserError, match="BEHAVIOR's joints are absolute"):
        write_dataset([episode], tmp_path / "set", DatasetForm(like="behavior", actions="delta"))
    write_dataset([episode], tmp_path / "set", DatasetForm(actions="delta"))
    info = tmp_path / "set/meta/info.json"
    about = json.loads(info.read_text())
    about["features"]["action"]["info"]["joints"] = "relative"
    info.write_text(json.dumps(about))
    with pytest.raises(UserError, match=r"joints is 'relative', not one of absolute, delta, velocity"):
        read_checkpoint(checkpoint(tmp_path / "act", tmp_path / "set"))
