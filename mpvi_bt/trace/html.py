"""A tree, or a run of it, as one self-contained page: nodes fold, a slider goes through the ticks.

The page is assembled from the files in `page/`. Its data are embedded as JSON, and its script writes text as text, so
no label or feedback becomes markup; its content policy allows no other script and no request.
"""

from __future__ import annotations

import base64
import hashlib
import html
import json
import math
import re
from collections.abc import Iterable, Mapping
from importlib import resources
from typing import Any

from mpvi_bt.drawing.cells import one_line
from mpvi_bt.drawing.symbols import MARKS, Standing, sign, standing
from mpvi_bt.drawing.text import ascii_tree
from mpvi_bt.trace.lines import End
from mpvi_bt.trace.read import Trace
from mpvi_bt.tree.spec import TreeSpec
from mpvi_bt.tree.state import NodeState

_SCRIPTS = ("playback.js", "outline.js", "player.js", "page.js")
_WORDS = ("feedback", "reason", "evidence", "origin")


def tree_page(tree: TreeSpec) -> str:
    """The page of a tree that has not run."""
    return _page(tree, {"trees": [_nodes(tree)], "frames": None})


def trace_page(trace: Trace, tick: int | None = None) -> str:
    """The page of a run. It opens at `tick`, or at the end; `#tick=12` behind its address opens it at another."""
    trees, frames = [_nodes(trace.tree)], []
    numbers = _numbers(trace.tree)
    for line, moment in trace.moments():
        frame: dict[str, Any] = {"tick": line.tick, "time": line.time_s}
        if line.tree is not None:
            frame["tree"] = len(trees)
            trees.append(_nodes(moment.tree))
            numbers = _numbers(moment.tree)
        if line.nodes:
            frame["nodes"] = {numbers[path]: _state(state, line.time_s) for path, state in line.nodes.items()}
        if line.blackboard:
            frame["board"] = {one_line(key): _shown(value) for key, value in line.blackboard.items()}
        frames.append(frame)
    return _page(
        trace.tree,
        {"trees": trees, "frames": frames, "end": _end(trace), "facts": list(_facts(trace)), "open": tick},
    )


def _numbers(tree: TreeSpec) -> dict[str, int]:
    return {node.path: i for i, node in enumerate(tree.nodes)}


def _nodes(tree: TreeSpec) -> list[dict[str, Any]]:
    """Every node, its parent by number."""
    numbers = _numbers(tree)
    parents = {child: numbers[node.path] for node in tree.nodes for child in node.children}
    return [
        {
            "path": node.path,
            "parent": parents.get(node.path, -1),
            "depth": node.depth,
            "kind": node.spec.kind,
            "family": node.spec.type.family,
            "about": node.spec.type.summary,
            "sign": sign(node.spec) if node.spec.type.family != "leaf" else "",
            "label": one_line(node.spec.label),
        }
        for node in tree.nodes
    ]


def _state(state: NodeState, time_s: float) -> dict[str, Any]:
    """A state without what is at its default; a running node's time as when it began."""
    shown: dict[str, Any] = {"is": standing(state)}
    if state.elapsed_s is not None and math.isfinite(state.elapsed_s):
        running = state.status == "RUNNING"
        shown["began" if running else "elapsed"] = time_s - state.elapsed_s if running else state.elapsed_s
    if state.limit_s is not None and math.isfinite(state.limit_s):
        shown["limit"] = state.limit_s
    return shown | {word: one_line(text) for word in _WORDS if (text := str(getattr(state, word)))}


def _end(trace: Trace) -> dict[str, Any]:
    if trace.end is None:
        last = trace.ticks[-1] if trace.ticks else None
        return {
            "text": "the trace breaks off here", "is": "interrupted",
            "tick": last.tick if last else 0, "time": last.time_s if last else 0.0,
        }  # fmt: skip
    end = trace.end
    shown = {"text": trace.told, "is": _stood(end, trace.gave_up), "tick": end.tick, "time": end.time_s}
    if end.failure is not None:
        why = ": ".join(filter(None, (end.failure.reason, end.failure.evidence)))
        shown |= {"path": end.failure.path, "why": one_line(why)}
    if end.error is not None:
        shown |= {"is": "failure", "path": end.error.path, "why": one_line(end.error.message)}
    return shown


def _stood(end: End, gave_up: int) -> Standing:
    """What the end comes down to: by the goal where there is one."""
    if end.ending not in ("success", "failure"):
        return "interrupted"
    if end.q is not None:
        return "success" if end.q == 1 else "failure"
    return "failure" if end.ending == "failure" else "gave_up" if gave_up else "success"


def _facts(trace: Trace) -> Iterable[tuple[str, str]]:
    """What a person wants to know of a run, by name."""
    known: Mapping[str, Any] = {
        **trace.config, "seed": trace.seed, "started": trace.started, "mpvi_bt": trace.mpvi_bt,
    }  # fmt: skip
    for name, value in known.items():
        if value is not None and value not in ("", [], {}):
            yield one_line(name), one_line(value if isinstance(value, str) else json.dumps(value))


def _shown(value: object) -> str | None:
    """A value of the blackboard as JSON writes it, so that the text "1" is not the number 1; None where it is gone."""
    return None if value is None else one_line(json.dumps(value, ensure_ascii=False))


def _page(tree: TreeSpec, data: dict[str, Any]) -> str:
    data = {word: one_line(getattr(tree, word)) for word in ("name", "about", "instruction")} | data
    data["marks"] = {name: {"unicode": mark.unicode, "word": mark.word} for name, mark in MARKS.items()}
    style, script = _file("page.css"), "\n".join(map(_file, _SCRIPTS))
    parts = {
        "title": html.escape(one_line(tree.name)),
        "policy": f"default-src 'none'; script-src '{_hash(script)}'; style-src '{_hash(style)}'; base-uri 'none'",
        "style": style,
        "tree": html.escape("\n".join(map(one_line, ascii_tree(tree, width=120).splitlines()))),
        "data": embedded(data),
        "script": script,
    }
    return re.sub(r"\{\{(\w+)\}\}", lambda found: parts[found[1]], _file("page.html"))


def embedded(data: Any) -> str:
    """JSON in which HTML finds nothing to end or to begin, whatever its texts hold."""
    text = json.dumps(data, ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _file(name: str) -> str:
    return (resources.files("mpvi_bt.trace") / "page" / name).read_text(encoding="utf-8")


def _hash(text: str) -> str:
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
