"""A tree as text, from its spec and, while it is ticked, the states of its nodes. Needs neither py_trees nor numpy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from mpvi_bt.tree.spec import Placed, TreeSpec

MARKS = {"SUCCESS": "[o]", "FAILURE": "[x]", "RUNNING": "[*]", "INVALID": "[-]"}
LEGEND = "[*] running  [o] success  [x] failure  [-] not running"
_INDENT = 4


@dataclass(frozen=True)
class NodeState:
    """How a node stands.

    Attributes:
        status: "SUCCESS", "FAILURE", "RUNNING" or "INVALID" (not begun, or interrupted).
        feedback: One line, or "".
        elapsed_s: Simulated time in this round, of nodes that count it.
        limit_s: What elapsed_s may reach.
    """

    status: str = "INVALID"
    feedback: str = ""
    elapsed_s: float | None = None
    limit_s: float | None = None


def ascii_tree(
    tree: TreeSpec, states: Mapping[str, NodeState] | None = None, width: int = 80, fold: bool = False
) -> str:
    """The tree, one line a node, no line longer than `width`.

    Args:
        tree: What to draw.
        states: By path; None draws no statuses.
        width: Columns.
        fold: Leave out what is below a node that neither runs nor failed, so that a long tree fits a screen.
    """
    lines = []
    hidden: tuple[str, ...] = ()
    for node in tree.nodes:
        if hidden and node.path.startswith(hidden):
            continue
        state = states.get(node.path, NodeState()) if states is not None else None
        lines.append(node_line(node, state, width))
        if fold and state and state.status not in ("RUNNING", "FAILURE"):
            hidden = (node.path + "/",)
    return "\n".join(lines)


def node_line(node: Placed, state: NodeState | None, width: int = 80) -> str:
    """One node: indent, glyph, label, status, time, feedback. Long labels lose their end, then feedback does."""
    start = " " * (_INDENT * node.depth) + node.spec.type.glyph(node.spec.parameters) + " "
    if state is None:
        return _cut(start + node.spec.label, width)
    end = " " + MARKS[state.status] + _time(state)
    line = start + _cut(node.spec.label, max(width - len(start) - len(end), 4)) + end
    if state.feedback and width - len(line) > 12:
        line += _cut("  " + state.feedback, width - len(line))
    return line


def _time(state: NodeState) -> str:
    """Whole seconds, so that the picture stays still between them."""
    if state.elapsed_s is None or state.limit_s is None or state.status == "INVALID":
        return ""
    if state.status != "RUNNING":
        return f" {state.elapsed_s:.1f} s"
    return f" {int(state.elapsed_s + 1e-6)} s, {max(0, round(state.limit_s - int(state.elapsed_s + 1e-6)))} s left"


def _cut(text: str, width: int) -> str:
    return text if len(text) <= width else text[: width - 3].rstrip() + "..."
