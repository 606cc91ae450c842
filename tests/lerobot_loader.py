"""Reads a dataset with LeRobot's own loader and prints what is in it; run in an environment that has lerobot."""

from __future__ import annotations

import json
import sys

import torch

try:
    from lerobot.datasets.lerobot_dataset import LeRobotDataset
except ImportError:  # revisions before 0.3, such as the one that openpi pins
    from lerobot.common.datasets.lerobot_dataset import LeRobotDataset

root, head = sys.argv[1:]
dataset = LeRobotDataset("mpvi_bt/test", root=root, video_backend="pyav")
rows = [dataset[i] for i in range(len(dataset))]
ahead = LeRobotDataset(
    "mpvi_bt/test", root=root, delta_timestamps={"action": [i / dataset.fps for i in range(8)]}, video_backend="pyav"
)
batch = next(iter(torch.utils.data.DataLoader(ahead, batch_size=2)))
print(
    json.dumps(
        {
            "action": [row["action"].tolist() for row in rows],
            "state": [row["observation.state"].tolist() for row in rows],
            "task": [row["task"] for row in rows],
            "shade": [row[head].mean().item() for row in rows],
            "picture": list(rows[0][head].shape),
            "chunk": list(batch["action"].shape[1:]),
            "mean": torch.as_tensor(dataset.meta.stats["action"]["mean"]).tolist(),
        }
    )
)
