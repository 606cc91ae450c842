"""A tree as text, from its spec and, while it is ticked, the states of its nodes. Needs neither py_trees nor numpy."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from mpvi_bt.executive.drawing.cells import columns, cut, one_line
from mpvi_bt.executive.drawing.symbols import MARKS, Standing, legend, sign, standing
from mpvi_bt.executive.tree.spec import Placed, TreeSpec
from mpvi_bt.executive.tree.state import NodeState

LEGEND = legend()
_LEAST_TIMED = 8  # columns of a label, below which the time is left out
_LEAST_FEEDBACK = 22  # columns that feedback may take from a long label


@dataclass(frozen=True)
class Line:
    """The line of one node, in the parts that a terminal colors.

    Attributes:
        path: The node's.
        standing: None where no states are drawn.
        before: Indent, glyph, label.
        mark: "" where no states are drawn.
        after: Time and feedback.
    """

    path: str
    standing: Standing | None
    before: str
    mark: str
    after: str

    @property
    def text(self) -> str:
        """The whole line."""
        return self.before + self.mark + self.after


def ascii_tree(
    tree: TreeSpec, states: Mapping[str, NodeState] | None = None, width: int = 80, fold: bool = False
) -> str:
    """The tree, one line a node, no line wider than `width`.

    Labels are as the tree writes them; what is drawn around them is ASCII.

    Args:
        tree: What to draw.
        states: By path; None draws no statuses.
        width: Columns.
        fold: Leave out what is below a node (not the root) that neither runs nor failed: a long tree fits a screen.
    """
    return "\n".join(line.text for line in tree_lines(tree, states, width, fold))


def unicode_tree(
    tree: TreeSpec, states: Mapping[str, NodeState] | None = None, width: int = 80, fold: bool = False
) -> str:
    """As `ascii_tree`, with lines from parent to child and the signs of the field's textbook."""
    return "\n".join(line.text for line in tree_lines(tree, states, width, fold, unicode=True))


def tree_lines(
    tree: TreeSpec,
    states: Mapping[str, NodeState] | None = None,
    width: int = 80,
    fold: bool = False,
    unicode: bool = False,
) -> list[Line]:
    """The lines of `ascii_tree` or `unicode_tree`."""
    lines = []
    hidden: tuple[str, ...] = ()
    for node, indent in _indented(tree, _room_for_indent(width), unicode):
        if hidden and node.path.startswith(hidden):
            continue
        state = states.get(node.path, NodeState()) if states is not None else None
        lines.append(node_line(node, state, width, indent, unicode))
        if fold and node.depth and state and state.status not in ("RUNNING", "FAILURE"):
            hidden = (node.path + "/",)
    return lines


def node_line(
    node: Placed, state: NodeState | None, width: int = 80, indent: str | None = None, unicode: bool = False
) -> Line:
    """One node: indent, glyph, label, mark, time, feedback; labels and feedback that are too wide lose their end."""
    if indent is None:
        indent = (" " * 4 * node.depth)[: _room_for_indent(width)]
    glyph = sign(node.spec) if unicode else node.spec.glyph
    start = indent + (glyph + " " if glyph else "")
    label = one_line(node.spec.label)
    if state is None:
        return Line(node.path, None, cut(start + label, width), "", "")
    stands = standing(state)
    mark = MARKS[stands].unicode if unicode else MARKS[stands].ascii
    room = width - columns(start) - columns(mark) - 1
    time = f" {words}" if (words := time_text(state)) else ""
    if len(time) > room - _LEAST_TIMED:
        time = ""
    room -= len(time)
    feedback = f"  {one_line(state.feedback)}" if state.feedback else ""
    least = min(columns(feedback), _LEAST_FEEDBACK)
    news = stands != "success"  # a success needs no words, if that would cost its label
    label = cut(label, room - least if news and room >= 2 * _LEAST_FEEDBACK else room)
    left = room - columns(label)
    return Line(node.path, stands, f"{start}{label} ", mark, time + (cut(feedback, left) if left >= least else ""))


def where(tree: TreeSpec, states: Mapping[str, NodeState], width: int = 80) -> str:
    """One line about the node that matters most, or "" if there is none.

    The deepest running leaf (of several equally deep the first); once the root has failed, the node whose failure that
    is, with its reason.
    """
    root = states.get(tree.nodes[0].path, NodeState())
    if root.status == "FAILURE":
        why = ": ".join(filter(None, (root.reason, root.evidence))) or root.feedback
        head = f"failed: {_short_path(root.origin or tree.nodes[0].path, width // 2)}"
        return cut(head + (f": {one_line(why)}" if why else ""), width)
    running = [node for node in tree.nodes if states.get(node.path, NodeState()).status == "RUNNING"]
    if not running:
        return ""
    return cut(f"running: {_short_path(max(running, key=lambda n: n.depth).path, width - 9)}", width)


def window(lines: Sequence[Line], room: int) -> tuple[int, int]:
    """First and one past the last of `room` lines, so chosen that the deepest running node is among them."""
    if len(lines) <= room:
        return 0, len(lines)
    running = [i for i, line in enumerate(lines) if line.standing == "running"]
    middle = max(running, key=lambda i: lines[i].path.count("/"), default=0)
    first = min(max(middle - room // 2, 0), len(lines) - room)
    return first, first + room


def left_out(first: int, last: int, count: int) -> str:
    """A note on the lines of a drawing that `window` left out."""
    told = [f"{number} lines {where}" for number, where in ((first, "above"), (count - last, "below")) if number]
    return f"... {', '.join(told)}"


def _room_for_indent(width: int) -> int:
    """Columns for indentation: all but 40 for labels, or a third of a narrow terminal."""
    return max(width - 40, width // 3)


def _indented(tree: TreeSpec, limit: int, unicode: bool) -> Iterator[tuple[Placed, str]]:
    """Every node with the text before its glyph, which takes at most `limit` columns.

    A tree that is too deep for its usual steps gets smaller ones; what still goes beyond is not indented further.
    """
    usual = 3 if unicode else 4
    step = max(1, min(usual, limit // max(max(node.depth for node in tree.nodes), 1)))
    blank = " " * step
    fork, last, through = (sign + "─ "[3 - step :] for sign in "├└│") if unicode else (blank,) * 3
    through = through.replace("─", " ")
    room = limit - limit % step
    own = {tree.nodes[0].path: ("", "")}  # indent of the node, and of what is below it
    for node in tree.nodes:
        indent, below = own.pop(node.path)
        for child in node.children:
            elbow, after = (last, blank) if child == node.children[-1] else (fork, through)
            if len(below) < room:
                own[child] = below + elbow, below + after
            else:
                own[child] = below[: max(room - step, 0)] + elbow[: room and step], below
        yield node, indent


def time_text(state: NodeState) -> str:
    """Time taken and left, or "": whole seconds while it runs, so that the picture stays still between them."""
    if state.elapsed_s is None or state.limit_s is None or state.status == "INVALID":
        return ""
    if state.status != "RUNNING":
        return f"{state.elapsed_s:.1f} s"
    passed = int(state.elapsed_s + 1e-6)
    return f"{passed} s, {max(0, round(state.limit_s - passed))} s left"


def _short_path(path: str, width: int) -> str:
    """A path without its root; its long names lose their ends first, then it loses its first names."""
    names = [one_line(name) for name in path.split("/")]
    names = names[1:] or names
    for longest in (60, 40, 30, 24, 18, 12):
        short = "/".join(cut(name, longest) for name in names)
        if columns(short) <= width:
            return short
    while len(names) > 1 and columns(short) > width:
        names = names[1:]
        short = "/".join(["...", *(cut(name, 12) for name in names)])
    return cut(short, width)
