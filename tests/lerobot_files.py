"""Folders as LeRobot writes them, for tests: a checkpoint's JSON files, and the dataset that it was trained on."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

OURS = {
    "observation.state": {"type": "STATE", "shape": [23]},
    "observation.base_pose": {"type": "STATE", "shape": [3]},
    "observation.images.head": {"type": "VISUAL", "shape": [3, 48, 64]},
    "observation.images.right": {"type": "VISUAL", "shape": [3, 64, 64]},
}  # what `mpvi dataset` has of an r1
ACTION = {"action": {"type": "ACTION", "shape": [23]}}


def checkpoint(folder: Path, dataset: Path | None = None, **config: Any) -> Path:
    """A folder with everything of an ACT but its weights, and what `lerobot-train` says of the dataset.

    Args:
        folder: Where it is written.
        dataset: What it was trained on; None: nobody says.
        config: What its `config.json` has otherwise; None: it has no such key.
    """
    folder.mkdir(parents=True, exist_ok=True)
    told = {"type": "act", "input_features": OURS, "output_features": ACTION, "n_action_steps": 8, "chunk_size": 20}
    told |= {"n_obs_steps": 1, "temporal_ensemble_coeff": None, **config}
    (folder / "config.json").write_text(json.dumps({k: v for k, v in told.items() if v is not None}))
    (folder / "model.safetensors").write_bytes(b"")
    (folder / "policy_preprocessor.json").write_text("{}")
    tell_dataset(folder, dataset)
    return folder


def tell_dataset(folder: Path, dataset: Path | None) -> None:
    """Let a checkpoint say what it was trained on."""
    if dataset is not None:
        (folder / "train_config.json").write_text(json.dumps({"dataset": {"root": str(dataset)}}))


def dataset(folder: Path, robot: str = "r1", fps: Any = 10) -> Path:
    """A dataset's `info.json`."""
    (folder / "meta").mkdir(parents=True, exist_ok=True)
    (folder / "meta/info.json").write_text(json.dumps({"robot_type": robot, "fps": fps}))
    return folder
