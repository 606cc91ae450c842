"""Recorded here, trained by LeRobot's own script, tried here: the loop of docs/lerobot.md, in small."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from mpvi_bt.ground.robot.protocol import CONTROL_HZ

pytest.importorskip("lerobot", reason="needs the extra lerobot, in an environment of its own (docs/lerobot.md)")
pytest.importorskip("pandas", reason="needs the extra dataset")

ROOT = Path(__file__).parent.parent
SMALL = {"chunk_size": 8, "n_action_steps": 8, "dim_model": 32, "n_heads": 2, "dim_feedforward": 64}
INPUTS = {
    "observation.state": {"type": "STATE", "shape": [23]},
    "observation.images.head": {"type": "VISUAL", "shape": [3, 32, 32]},
}
TRAINING = {
    "dataset.repo_id": "me/picks", "dataset.video_backend": "pyav", "policy.type": "act", "policy.device": "cpu",
    "policy.push_to_hub": "false", "policy.use_vae": "false", "policy.pretrained_backbone_weights": "null",
    "policy.input_features": json.dumps(INPUTS), "steps": 2, "save_freq": 2, "batch_size": 2, "num_workers": 0,
    "eval_freq": 0,
} | {f"policy.{key}": value for key, value in SMALL.items()}  # fmt: skip


def call(module: str, *given: Any) -> None:
    """`python -m MODULE`, which succeeds."""
    command = [sys.executable, "-m", module, *map(str, given)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=900)
    assert done.returncode == 0, done.stderr[-3000:]


@pytest.mark.slow
@pytest.mark.render
def test_what_is_recorded_here_and_trained_by_lerobot_is_tried_here(tmp_path: Path) -> None:
    """Two picks become a dataset, `lerobot-train` a checkpoint of one camera, and that moves the robot."""
    episodes, picks, act, rows = (tmp_path / name for name in ("episodes", "picks", "act", "rows.jsonl"))
    call("benchmarks.hands.demonstrations", tmp_path, "--skill", "pick", "-c", "table", "--count", 2,
         "--episodes", episodes, "-j", 1)  # fmt: skip
    call("mpvi_bt.apps.cli", "dataset", episodes, "--all", "--out", picks, "--size", 32)
    call("lerobot.scripts.lerobot_train", f"--dataset.root={picks}", f"--output_dir={act}",
         *(f"--{key}={value}" for key, value in TRAINING.items()))  # fmt: skip
    call("benchmarks.hands", "-s", "pick", "-c", "table", "-p", f"lerobot:{act}", "--seeds", 0, "-j", 1, "--out", rows)
    (row,) = (json.loads(line) for line in rows.read_text().splitlines())
    assert (row["policy"], row["ok"]) == (f"lerobot:{act}", False)
    assert row["cause"].startswith("not_held"), row["cause"]
    assert row["steps"] > 8 * CONTROL_HZ // 10  # more than one chunk, at 10 Hz
