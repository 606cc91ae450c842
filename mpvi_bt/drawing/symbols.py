"""Marks of node states, the same in every kind of drawing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from mpvi_bt.tree.spec import NodeSpec
from mpvi_bt.tree.state import NodeState

Standing = Literal["running", "success", "failure", "gave_up", "interrupted", "idle"]


@dataclass(frozen=True)
class Mark:
    """How one standing is shown.

    Attributes:
        word: For a person.
        ascii: As py_trees marks it, where it does.
        unicode: One column wide.
        terminal: Color for `click.style`, or None.
        fill, ink: Colors of its box and its text on white paper. Every drawing also shows the mark or the word, so that
            nothing hangs on colors alone.
    """

    word: str
    ascii: str
    unicode: str
    terminal: str | None
    fill: str
    ink: str


MARKS: Mapping[Standing, Mark] = {
    "running": Mark("running", "[*]", "●", "yellow", "#fff1c2", "#7a5200"),
    "success": Mark("success", "[o]", "✓", "green", "#d9f2df", "#14632b"),
    "failure": Mark("failure", "[x]", "✕", "red", "#fbdcd9", "#a3160c"),
    "gave_up": Mark("gave up", "[!]", "!", "magenta", "#ffe3cc", "#93400a"),
    "interrupted": Mark("interrupted", "[/]", "⊘", "cyan", "#dfe5f5", "#36477a"),
    "idle": Mark("idle", "[-]", "○", None, "#f2f3f5", "#5f6672"),
}

# The signs of Colledanchise and Ögren, "Behavior Trees in Robotics and AI" (2018), for what py_trees draws; the star
# says memory. A leaf needs none: its branch is enough.
_SIGNS = {"{-}": "→*", "[-]": "→", "{o}": "?*", "[o]": "?", "/_/": "⇉", "-^-": "◇", "-->": ""}


def sign(node: NodeSpec) -> str:
    """What is drawn before a label where more than ASCII can be, or ""."""
    return _SIGNS.get(node.glyph, node.glyph)


def standing(state: NodeState) -> Standing:
    """What a node's state comes down to."""
    if state.status == "INVALID":
        return "interrupted" if state.interrupted else "idle"
    if state.status == "SUCCESS":
        return "gave_up" if state.gave_up else "success"
    return "running" if state.status == "RUNNING" else "failure"


def legend(unicode: bool = False) -> str:
    """Every mark with its word, in at most 80 columns."""
    return "  ".join(f"{mark.unicode if unicode else mark.ascii} {mark.word}" for mark in MARKS.values())
