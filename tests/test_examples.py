"""Every example runs, and is short."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

import pytest

from tests import warm

EXAMPLES = sorted((Path(__file__).parent.parent / "examples").glob("[0-9]*.py"))  # others are others' to start


def _parameter(path: Path) -> object:
    """One example as a test case; those with the simulator take a minute and draw pictures."""
    text = path.read_text(encoding="utf-8")
    marks = (
        [pytest.mark.rare, pytest.mark.slow, pytest.mark.render]
        if re.search(r"mpvi_bt\.(runs\.episode|run\()", text)
        else []
    )
    if "mpvi_bt.house.maniskill" in text:
        missing = importlib.util.find_spec("mani_skill") is None
        marks = [pytest.mark.rare, pytest.mark.slow, pytest.mark.skipif(missing, reason="needs ManiSkill")]
    if "mpvi_bt.runs.ros2" in text:
        missing = importlib.util.find_spec("rclpy") is None
        marks = [
            *(pytest.mark.rare, pytest.mark.slow, pytest.mark.render),
            pytest.mark.skipif(missing, reason="needs rclpy"),
        ]
    return pytest.param(path, id=path.stem, marks=marks)


@pytest.mark.parametrize("path", [_parameter(p) for p in EXAMPLES])
def test_example_runs(path: Path, tmp_path: Path) -> None:
    """It succeeds from any folder and says something."""
    done = warm.python(str(path), cwd=tmp_path, timeout=600)
    assert done.returncode == 0, done.stderr
    assert done.stdout


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda p: p.stem)
def test_example_is_short_and_explained(path: Path) -> None:
    """Under a hundred lines, opened by what it shows."""
    text = path.read_text(encoding="utf-8")
    assert len(text.splitlines()) < 100
    assert text.startswith('"""')
