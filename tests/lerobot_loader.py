"""Reads a dataset with LeRobot's own loader and prints what is in it; run in an environment that has lerobot."""

from __future__ import annotations

import json
import sys

import torch
from lerobot.datasets.lerobot_dataset import LeRobotDataset

root = sys.argv[1]
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
            "task": [row["task"] for row in rows],
            "shade": [row["observation.images.head"].mean().item() for row in rows],
            "chunk": list(batch["action"].shape[1:]),
        }
    )
)
