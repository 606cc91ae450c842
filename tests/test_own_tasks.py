"""The pages on tasks and skills of one's own are what a reader gets: their files, commands, and what these print.

`python -m tests.test_tutorial docs/own_tasks.md` runs one, and writes what the commands print into it.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.test_tutorial import HOUSE, play

DOCS = Path(__file__).parent.parent / "docs"
TEXTS = [pytest.param((DOCS / name).read_text(encoding="utf-8"), id=name) for name in ("own_tasks.md", "own_skill.md")]


@pytest.mark.rare
@pytest.mark.parametrize("text", TEXTS)
def test_the_page_is_true_without_a_simulator(text: str, tmp_path: Path) -> None:
    """Its house, things, goal, skill, plan, task and test pass check, compile and run dry."""
    text = text.partition(HOUSE)[0]
    assert play(text, tmp_path) == text


@pytest.mark.rare
@pytest.mark.slow
@pytest.mark.parametrize("text", TEXTS)
def test_the_page_is_true_in_the_house(text: str, tmp_path: Path) -> None:
    """The expert carries it out, with a motion of ours or of the page."""
    assert play(text, tmp_path) == text
