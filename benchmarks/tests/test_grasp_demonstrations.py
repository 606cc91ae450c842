"""Recording of picks from the pre-grasp on."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.hands.grasp_demonstrations import demonstrate
from mpvi_bt.runs.datasets.demonstrations import check_demonstrations, find_demonstrations
from tests.layouts import LAYOUT


@pytest.mark.slow
@pytest.mark.render
def test_a_pick_is_recorded_from_the_pregrasp_on(tmp_path: Path):
    """The base rests and only the named arm moves: it goes to the thing, closes, and lifts it, seen by its camera."""
    assert demonstrate(200_001, tmp_path, ("table",), "right", 10)["ok"]
    found = find_demonstrations([tmp_path])
    check_demonstrations(found)
    assert found[0].about.success
    assert set(found[0].about.cameras) == {"head", "right"}
    frames = found[0].frames
    assert np.ptp(frames["base_pose"], axis=0).max() < 1e-2
    assert np.ptp(frames["action"][:, LAYOUT.arm["left"]], axis=0).max() < 1e-3
    assert np.ptp(frames["action"][:, LAYOUT.arm["right"]], axis=0).max() > 0.1
    assert frames["action"][0, LAYOUT.gripper["right"]] > frames["action"][-1, LAYOUT.gripper["right"]] == -1.0
    assert found[0].about.subtasks == [f"{found[0].about.instruction} with the right hand"]
