"""Marks of node states, the same in every kind of drawing: words, signs and colors have their one home here."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from mpvi_bt.executive.tree.spec import NodeSpec
from mpvi_bt.executive.tree.state import NodeState

Standing = Literal["running", "success", "failure", "gave_up", "interrupted", "idle"]


@dataclass(frozen=True)
class Mark:
    """How one standing is shown.

    Attributes:
        word: For a person.
        ascii: As py_trees marks it, where it does.
        unicode: One column wide.
        terminal: Color for `click.style`, or None: the nearest that terminals have.
        fill, ink: Colors of its box and its text on white paper. Every drawing also shows the mark or the word, so that
            nothing hangs on colors alone.
        light, dark: Color of a stretch of time, or of the mark, on white and on dark paper.
    """

    word: str
    ascii: str
    unicode: str
    terminal: str | int | None
    fill: str
    ink: str
    light: str
    dark: str


MARKS: Mapping[Standing, Mark] = {
    "running": Mark("running", "[*]", "●", "yellow", "#fff1c2", "#7a5200", "#e0a100", "#e5b32d"),
    "success": Mark("success", "[o]", "✓", "green", "#d9f2df", "#14632b", "#2e9e52", "#45b86c"),
    "failure": Mark("failure", "[x]", "✕", "red", "#fbdcd9", "#a3160c", "#d93a2b", "#f0604f"),
    "gave_up": Mark("gave up", "[!]", "!", 166, "#ffe3cc", "#93400a", "#d0661a", "#ef8a3c"),  # 166: orange
    "interrupted": Mark("interrupted", "[/]", "⊘", "bright_blue", "#dfe5f5", "#36477a", "#5b74c4", "#8197e6"),
    "idle": Mark("idle", "[-]", "○", None, "#f2f3f5", "#5f6672", "#b5bcc6", "#57606c"),
}

# The signs of Colledanchise and Ögren, "Behavior Trees in Robotics and AI" (2018), for what py_trees draws; the star
# says memory. A leaf needs none: its branch is enough.
_SIGNS = {"{-}": "→*", "[-]": "→", "{o}": "?*", "[o]": "?", "/_/": "⇉", "-^-": "◇", "-->": ""}


def sign(node: NodeSpec) -> str:
    """The sign before a label on displays with more than ASCII, or ""."""
    return _SIGNS.get(node.glyph, node.glyph)


def standing(state: NodeState) -> Standing:
    """The standing of a node. A failed node that was reset stays failed until it begins anew."""
    if state.status == "INVALID":
        return "interrupted" if state.interrupted else "failure" if state.ended == "FAILURE" else "idle"
    if state.status == "SUCCESS":
        return "gave_up" if state.gave_up else "success"
    return "running" if state.status == "RUNNING" else "failure"


def outcome(state: NodeState) -> Standing:
    """How its last round stands, over time: as `standing`, but a success that was reset is one."""
    return "success" if state.ended == "SUCCESS" else standing(state)


def legend(unicode: bool = False) -> str:
    """Every mark with its word, in at most 80 columns."""
    return "  ".join(f"{mark.unicode if unicode else mark.ascii} {mark.word}" for mark in MARKS.values())


def state_style() -> str:
    """The colors as CSS: a variable a standing, such as `--gave-up`, for light and for dark; `--is` of `data-is`."""
    light, dark = (
        " ".join(f"--{_css(name)}: {color};" for name, color in colors)
        for colors in (
            [(name, mark.light) for name, mark in MARKS.items()],
            [(name, mark.dark) for name, mark in MARKS.items()],
        )
    )
    used = "\n".join(f"[data-is={name}] {{ --is: var(--{_css(name)}); }}" for name in MARKS)
    return f":root {{ {light} }}\n@media (prefers-color-scheme: dark) {{ :root {{ {dark} }} }}\n{used}\n"


def _css(name: str) -> str:
    return name.replace("_", "-")
