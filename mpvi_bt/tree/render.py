"""A tree as text, from its spec and, while it is ticked, the states of its nodes. Needs neither py_trees nor numpy."""

from __future__ import annotations

from collections.abc import Mapping

from mpvi_bt.tree.spec import Placed, TreeSpec
from mpvi_bt.tree.state import NodeState

MARKS = {"SUCCESS": "[o]", "FAILURE": "[x]", "RUNNING": "[*]", "INVALID": "[-]"}
GAVE_UP = "[!]"
LEGEND = "[*] running  [o] success  [x] failure  [!] gave up, went on  [-] not running"
_INDENT = 4
_LEAST_LABEL = 40  # columns that indentation leaves; what lies deeper is not indented further
_LEAST_FEEDBACK = 22  # columns that feedback may take from a long label


def ascii_tree(
    tree: TreeSpec, states: Mapping[str, NodeState] | None = None, width: int = 80, fold: bool = False
) -> str:
    """The tree, one line a node, no line longer than `width`.

    Args:
        tree: What to draw.
        states: By path; None draws no statuses.
        width: Columns.
        fold: Leave out what is below a node (not the root) that neither runs nor failed: a long tree fits a screen.
    """
    lines = []
    hidden: tuple[str, ...] = ()
    for node in tree.nodes:
        if hidden and node.path.startswith(hidden):
            continue
        state = states.get(node.path, NodeState()) if states is not None else None
        lines.append(node_line(node, state, width))
        if fold and node.depth and state and state.status not in ("RUNNING", "FAILURE"):
            hidden = (node.path + "/",)
    return "\n".join(lines)


def node_line(node: Placed, state: NodeState | None, width: int = 80) -> str:
    """One node: indent, glyph, label, status, time, feedback; labels and feedback that are too long lose their end."""
    start = " " * min(_INDENT * node.depth, max(width - _LEAST_LABEL, 0)) + node.spec.glyph + " "
    if state is None:
        return _cut(start + node.spec.label, width)
    end = f" {GAVE_UP if state.gave_up else MARKS[state.status]}{_time(state)}"
    room = width - len(start) - len(end)
    feedback = f"  {state.feedback}" if state.feedback else ""
    news = state.status != "SUCCESS" or state.gave_up  # a success needs no words, if that would cost its label
    least = min(len(feedback), _LEAST_FEEDBACK) if news and room >= 2 * _LEAST_FEEDBACK else 0
    label = _cut(node.spec.label, room - least)
    left = room - len(label)
    return start + label + end + (_cut(feedback, left) if left >= min(len(feedback), _LEAST_FEEDBACK) else "")


def _time(state: NodeState) -> str:
    """Whole seconds, so that the picture stays still between them."""
    if state.elapsed_s is None or state.limit_s is None or state.status == "INVALID":
        return ""
    if state.status != "RUNNING":
        return f" {state.elapsed_s:.1f} s"
    return f" {int(state.elapsed_s + 1e-6)} s, {max(0, round(state.limit_s - int(state.elapsed_s + 1e-6)))} s left"


def _cut(text: str, width: int) -> str:
    if len(text) <= width:
        return text
    return text[: width - 3].rstrip() + "..." if width > 3 else text[: max(width, 0)]
