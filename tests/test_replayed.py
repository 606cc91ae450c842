"""A demonstration replayed at the rate that it was recorded at does what it shows."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import CONTROL_HZ
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.episode.episode import run
from mpvi_bt.runs.recording.demonstration_recorder import DemonstrationRecorder

EXPERT = EpisodeConfig("picking_up_trash", policy="expert", detector="oracle", checker="oracle")
ALONE = EpisodeConfig("picking_up_trash", planner="none", drive="policy", detector="oracle", checker="oracle")
RATES = (2, 10, 30)


class Replayed:
    """The rows of a recorded demonstration, ten at a time; its folder tells the rate."""

    name, cameras = "replayed", ()

    def __init__(self, folder: Path) -> None:
        self.dataset = str(folder)
        self.rows = np.load(folder / "frames.npz")["action"].astype(float)
        self.at = 0

    @property
    def gave_up(self) -> bool:
        """After the last row."""
        return self.at >= len(self.rows)

    def reset(self) -> None:
        """It is told one prompt."""

    def infer(self, observation: Mapping[str, Any]) -> Array:
        """The next rows."""
        self.at += 10
        return self.rows[self.at - 10 : self.at]


@pytest.mark.rare
def test_a_demonstration_of_any_rate_gets_the_same_q_in_the_same_time(tmp_path: Path) -> None:
    """Of 2, 10 and 30 rows a second: q is the original's, and the time is, to the end of the last row.

    Nothing looks on the way: 139 s of driving and grasping are carried out by their rows alone.
    """
    recorders = {fps: DemonstrationRecorder(tmp_path / str(fps), {}, fps, ()) for fps in RATES}
    original = run(EXPERT, list(recorders.values()))
    assert original["q_score"]["final"] == 1.0
    steps = original["time"]["simulator_steps"]
    for fps, recorder in recorders.items():
        recorder.conclude(1.0, True)
        policy = Replayed(tmp_path / str(fps))
        assert json.loads((tmp_path / str(fps) / "episode.json").read_text())["fps"] == fps
        replayed = run(ALONE, make=lambda ground, policy=policy: policy)  # type: ignore[misc]
        took = replayed["time"]["simulator_steps"]
        assert replayed["q_score"]["final"] == 1.0, fps
        assert took == len(policy.rows) * CONTROL_HZ // fps - 1  # the tick that ends it is not carried out
        assert 0 <= took - steps < CONTROL_HZ // fps
