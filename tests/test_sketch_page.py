"""A tree with errors is drawn as far as it goes, each problem at its node."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mpvi_bt.apps.authoring.checking import problems_in
from mpvi_bt.apps.watch.dry_page import drawn as page_of
from mpvi_bt.apps.watch.sketch_page import sketch_page
from mpvi_bt.executive.tree.writer import dump_tree
from mpvi_bt.executive.tree.yaml_io import parse_tree
from mpvi_bt.ground.errors import FileProblems
from tests.test_html import Tags

BROKEN = """\
tree: broken
root:
  sequence: all
  memory: true
  children:
    - navigate: kitchen
    - wiat: 1
      child:
        say: below an unknown node
    - retry: lots
      child:
        selector: go $nowhere
        memory: true
        children:
          - wait: -1
          - say: hello
          - only text
    - sequence:
        - wait: 1
    - timeout: 3
      child:
    - subtree: nowhere
"""


def drawn(text: str) -> list[tuple[int, str, str]]:
    """Depth, label and what its problem begins with, of every node of the page."""
    data: dict[str, Any] = Tags(sketch_page(text, "t.yaml")).data
    states = [state["feedback"] if state else "" for state in data["states"]]
    return [
        (node["depth"], node["label"], re.split("[.,]", told)[0])
        for node, told in zip(data["trees"][0], states, strict=True)
    ]


def test_every_node_is_drawn_and_each_problem_stands_at_its_own() -> None:
    """Those of nodes below do not mark the ones above, and what is below a wrong node is drawn too."""
    assert drawn(BROKEN) == [
        (0, "all", ""),
        (1, "Navigate(kitchen)", ""),
        (1, "wiat: 1", "unknown node 'wiat'"),
        (2, 'say "below an unknown node"', ""),
        (1, "retry: lots", "should be a whole number"),
        (2, "selector: go $nowhere", "unknown parameter 'nowhere'"),
        (3, "wait: -1", "a duration is simulated seconds"),
        (3, 'say "hello"', ""),
        (3, "only text", "a node is a mapping such as 'navigate: kitchen'"),
        (1, "sequence", "a list of children stands under 'children:'"),
        (2, "wait 1 s", ""),
        (1, "timeout: 3", "'timeout' needs a node under 'child:'"),
        (1, "subtree: nowhere", "unknown tree 'nowhere'"),
    ]  # fmt: skip


def test_every_problem_of_a_node_is_on_the_page() -> None:
    """Whatever `mpvi check` says of the nodes of a file, the drawing says too."""
    told = "; ".join(state["feedback"] for state in Tags(sketch_page(BROKEN, "t.yaml")).data["states"] if state)
    assert [problem.message for problem in problems_in("t.yaml", text=BROKEN) if problem.message not in told] == []


@pytest.mark.parametrize(
    "rest", ['    - say: "open\n', "    - say: [1\n", "   - say: x\n", "    - say: a: b\n", "\t- x\n"]
)
def test_what_is_above_a_mistake_in_yaml_is_drawn(rest: str) -> None:
    """With the mistake at the last node, and a line that says how far it goes."""
    text = "tree: t\nroot:\n  sequence: all\n  memory: true\n  children:\n    - wait: 1\n    - wait: 2\n"
    data = Tags(sketch_page(text + rest + "    - wait: 3\n", "t.yaml")).data
    assert [node["label"] for node in data["trees"][0]] == ["all", "wait 1 s", "wait 2 s"]
    assert [bool(state) for state in data["states"]] == [False, False, True]
    assert data["about"].startswith("Drawn as far as line 7;")


@pytest.mark.parametrize("text", ["", "[", "- 1\n", "tree: t\n", "tree: t\nroot: x\n", "name: x\n"])
def test_a_text_without_a_node_is_no_drawing(text: str) -> None:
    """It is refused with its problems."""
    with pytest.raises(FileProblems):
        sketch_page(text, "t.yaml")


@given(at=st.integers(0, 400), char=st.sampled_from("x:-[\"'{\n \t&*!"))
def test_one_wrong_key_press_never_breaks_the_drawing(at: int, char: str) -> None:
    """Wherever it falls, there is a page, or the text's problems are told."""
    text = dump_tree(parse_tree(BROKEN.split("    - wiat")[0] + "    - wait: 1\n    - say: a longer text\n"))
    at %= len(text)
    try:
        assert Tags(sketch_page(text[:at] + char + text[at:], "t.yaml")).data["trees"][0]
    except FileProblems as error:
        assert error.problems


def test_what_is_said_in_place_of_a_drawing_is_no_markup(tmp_path: Path) -> None:
    """Whatever the text holds."""
    page = page_of("<script>: 1\n", "t.yaml", str(tmp_path))
    assert "There is no drawing: " in page
    assert "<script>" not in page
