"""A tree for Graphviz."""

from __future__ import annotations

from collections.abc import Mapping

from mpvi_bt.executive.drawing.cells import one_line, wrapped
from mpvi_bt.executive.drawing.symbols import MARKS, sign, standing
from mpvi_bt.executive.tree.spec import Placed, TreeSpec
from mpvi_bt.executive.tree.state import NodeState

_SHAPES = {"composite": "box", "decorator": "hexagon", "leaf": "box"}
_COLUMNS = 28  # of a line of a label


def dot_tree(tree: TreeSpec, states: Mapping[str, NodeState] | None = None) -> str:
    """The tree in Graphviz' language: composites are boxes, decorators hexagons, leaves rounded boxes.

    Args:
        tree: What to draw.
        states: By path; they fill the shapes with color, add marks, and feedback as tooltips.
    """
    names = {node.path: f"n{i}" for i, node in enumerate(tree.nodes)}
    lines = [
        f"digraph {_quoted(one_line(tree.name))} {{",
        '  graph [ordering=out, ranksep=0.35, nodesep=0.2, fontname="Helvetica,Arial,sans-serif"];',
        '  node [fontname="Helvetica,Arial,sans-serif", fontsize=11, margin="0.12,0.06", color="#8a929e"];',
        '  edge [arrowhead=none, color="#8a929e"];',
    ]
    for node in tree.nodes:
        lines.append(f"  {names[node.path]} [{_attributes(node, states)}];")
        lines += [f"  {names[node.path]} -> {names[child]};" for child in node.children]
    return "\n".join([*lines, "}"])


def _attributes(node: Placed, states: Mapping[str, NodeState] | None) -> str:
    family = node.spec.type.family
    label = wrapped(one_line(node.spec.label), _COLUMNS)
    if family == "composite":
        label[0] = f"{sign(node.spec)} {label[0]}"
    given = {"shape": _SHAPES[family], "style": "rounded" if family == "leaf" else "", "tooltip": node.path}
    if states is not None:
        state = states.get(node.path, NodeState())
        mark = MARKS[standing(state)]
        label[0] = f"{mark.unicode} {label[0]}"
        given |= {
            "style": f"{given['style']},filled".lstrip(","),
            "fillcolor": mark.fill,
            "color": mark.ink,
            "fontcolor": mark.ink,
            "tooltip": "\n".join(filter(None, (node.path, mark.word, one_line(state.feedback)))),
        }
    return ", ".join(f"{key}={_quoted(value)}" for key, value in {"label": "\n".join(label), **given}.items() if value)


def _quoted(text: str) -> str:
    r"""A string of the language, in which Graphviz also sees HTML's entities and escapes such as \N."""
    text = "\n".join(one_line(line) for line in text.split("\n"))
    escaped = text.replace("&", "&amp;").replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
    return f'"{escaped}"'
