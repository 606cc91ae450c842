"""The page on tasks of one's own is what a reader gets: its files, its commands, and what they print.

`python -m tests.test_tutorial docs/own_tasks.md` runs it, and writes what the commands print into it.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.test_tutorial import HOUSE, play

TEXT = (Path(__file__).parent.parent / "docs" / "own_tasks.md").read_text(encoding="utf-8")


@pytest.mark.rare
def test_the_page_is_true_without_a_simulator(tmp_path: Path) -> None:
    """A house, things, a goal, a skill, a plan and a task of one's own pass check, compile and run dry."""
    text = TEXT.partition(HOUSE)[0]
    assert play(text, tmp_path) == text


@pytest.mark.rare
@pytest.mark.slow
def test_the_page_is_true_in_the_house(tmp_path: Path) -> None:
    """The expert carries the task out, with the motion that the skill of one's own is like."""
    assert play(TEXT, tmp_path) == TEXT
