"""Recording of the demonstrations that `learned` is made from."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.hands.demonstrations import demonstrate
from mpvi_bt.hands.learned.training_set import read_frames
from mpvi_bt.runs.datasets.demonstrations import check_demonstrations, find_demonstrations


@pytest.mark.slow
@pytest.mark.render
@pytest.mark.parametrize("skill", ["pick", "place_next_to"])
def test_a_scene_is_kept_for_training_and_as_an_episode(skill: str, tmp_path: Path):
    """Pictures that are recorded besides change nothing of what is trained on, and both are whole."""
    for name, episodes in (("with", tmp_path / "episodes"), ("without", None)):
        (tmp_path / name / skill).mkdir(parents=True)
        assert demonstrate(100_001, tmp_path / name / skill, skill, episodes)["ok"]
    assert len(read_frames(tmp_path / "with", skill).look)
    one, other = (np.load(tmp_path / name / skill / "100001.npz") for name in ("with", "without"))
    assert all(np.array_equal(one[key], other[key]) for key in one.files)
    found = find_demonstrations([tmp_path / "episodes"])
    check_demonstrations(found)
    assert found[0].about.success
    assert json.loads((found[0].folder / "episode.json").read_text())["subtasks"][0].startswith(("pick up", "put"))
