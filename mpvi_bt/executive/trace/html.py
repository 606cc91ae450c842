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
from dataclasses import dataclass
from importlib import resources
from typing import Any

from mpvi_bt.executive.drawing.cells import one_line
from mpvi_bt.executive.drawing.endings import WELL
from mpvi_bt.executive.drawing.symbols import MARKS, Standing, outcome, sign, standing, state_style
from mpvi_bt.executive.drawing.text import ascii_tree
from mpvi_bt.executive.monitors.handoff_text import handoff_line, handoff_lines
from mpvi_bt.executive.trace.lines import End, Tick
from mpvi_bt.executive.trace.read import Trace
from mpvi_bt.executive.tree.spec import TreeSpec
from mpvi_bt.executive.tree.state import NodeState
from mpvi_bt.executive.tree.yaml_io import from_expanded
from mpvi_bt.ground.words.spoken import spoken_text

_SCRIPTS = ("playback.js", "outline.js", "player.js", "log.js", "page.js")
_WORDS = ("feedback", "reason", "evidence", "origin")


def tree_page(tree: TreeSpec) -> str:
    """The page of a tree that has not run."""
    return page(tree, {"trees": [nodes(tree)], "frames": None})


def trace_page(trace: Trace, tick: int | None = None) -> str:
    """The page of a run. It opens at `tick`, or at the end; `#tick=12` behind its address opens it at another."""
    frames = PageFrames(trace.tree)
    frames.add(trace.ticks)
    facts = list(told_facts(trace.config, trace.seed, trace.started, trace.mpvi_bt))
    return page(trace.tree, {**frames.data(), "end": _end(trace), "facts": facts, "open": tick})


class PageFrames:
    """A run as the page's script plays it: what changed, tick by tick.

    Attributes:
        trees: In force one after the other, each a list of its nodes.
        frames: One for each tick at which anything changed.
    """

    def __init__(self, tree: TreeSpec) -> None:
        """Begin with the tree, before the first tick."""
        self.trees, self.frames = [nodes(tree)], list[dict[str, Any]]()
        self._numbers = _numbers(tree)

    def add(self, ticks: Iterable[Tick]) -> None:
        """Take in the next ticks."""
        for line in ticks:
            frame: dict[str, Any] = {"tick": line.tick, "time": line.time_s}
            if line.tree is not None:
                tree = from_expanded(line.tree)
                frame["tree"] = len(self.trees)
                self.trees.append(nodes(tree))
                self._numbers = _numbers(tree)
            if line.nodes:
                frame["nodes"] = {self._numbers[path]: _state(s, line.time_s) for path, s in line.nodes.items()}
            if line.blackboard:
                frame["board"] = {one_line(key): _shown(value) for key, value in line.blackboard.items()}
            if said := list(_said(line)):
                frame["said"] = said
            self.frames.append(frame)

    def data(self, trees: int = 0, frames: int = 0) -> dict[str, Any]:
        """All of it, or what came after so many trees and frames."""
        return {"trees": self.trees[trees:], "frames": self.frames[frames:]}


def _said(tick: Tick) -> Iterable[dict[str, Any]]:
    """Notes of a tick for the page: checker answers, grasps felt, new plans and ended handoffs, each with its node."""
    for answer in tick.queries:
        seen = f" ({answer.camera})" if answer.camera else ""
        text = f"{answer.criterion}? {answer.said}{seen}: {spoken_text(answer.reason)}"
        is_: Standing = "success" if answer.complete else "idle"
        yield {"path": answer.path, "text": one_line(text), "is": is_, "about": "question"}
    for notice in tick.notices:
        text = f"the {notice.side} hand " + ("closed on nothing" if notice.kind == "empty" else "lost what it held")
        yield {"path": notice.path, "text": one_line(text), "is": "failure", "about": "hand"}
    for replan in tick.replans:
        text = f"no new plan: {replan.said}" if replan.segments is None else f"new plan: {replan.segments} segments"
        made: Standing = "failure" if replan.segments is None else "success"
        yield {"path": replan.path, "text": one_line(text), "is": made, "about": "plan"}
    for handoff in tick.diagnosis:
        ended: Standing = "success" if handoff.complete else "interrupted"
        more = [one_line(line) for line in handoff_lines(handoff)]
        text = one_line(f"{handoff_line(handoff)} ({handoff.length_s:.1f} s)")
        yield {"path": handoff.path, "text": text, "is": ended, "about": "handoff", "more": more}


def _numbers(tree: TreeSpec) -> dict[str, int]:
    return {node.path: i for i, node in enumerate(tree.nodes)}


def nodes(tree: TreeSpec) -> list[dict[str, Any]]:
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
    if (ended := outcome(state)) != shown["is"]:
        shown["ended"] = ended
    if state.elapsed_s is not None and math.isfinite(state.elapsed_s):
        running = state.status == "RUNNING"
        shown["began" if running else "elapsed"] = time_s - state.elapsed_s if running else state.elapsed_s
    if state.limit_s is not None and math.isfinite(state.limit_s):
        shown["limit"] = state.limit_s
    texts = {word: one_line(text) for word in _WORDS if (text := str(getattr(state, word)))}
    return shown | {word: text if word == "origin" else spoken_text(text) for word, text in texts.items()}


def _end(trace: Trace) -> dict[str, Any]:
    if trace.end is None:
        last = trace.ticks[-1] if trace.ticks else None
        return {
            "text": "the trace breaks off here", "is": "interrupted",
            "tick": last.tick if last else 0, "time": last.time_s if last else 0.0,
        }  # fmt: skip
    return told_end(trace.end, trace.told, trace.gave_up)


def told_end(end: End, text: str, gave_up: int) -> dict[str, Any]:
    """How a run ended.

    Args:
        end: The last line of its trace.
        text: As a line of text.
        gave_up: How many units were given up.
    """
    shown = {"text": text, "is": _stood(end, gave_up), "tick": end.tick, "time": end.time_s}
    if end.failure is not None:
        why = ": ".join(filter(None, (end.failure.reason, end.failure.evidence)))
        shown |= {"path": end.failure.path, "why": one_line(why)}
    if end.error is not None:
        shown |= {"is": "failure", "path": end.error.path, "why": one_line(end.error.message)}
    return shown


def _stood(end: End, gave_up: int) -> Standing:
    """Standing at the end: by the goal, if there is one."""
    if end.ending not in ("failure", *WELL):
        return "interrupted"
    if end.q is not None:
        return "success" if end.q == 1 else "failure"
    return "failure" if end.ending == "failure" else "gave_up" if gave_up else "success"


def told_facts(config: Mapping[str, Any], seed: int | None, started: str, version: str) -> Iterable[tuple[str, str]]:
    """What a person wants to know of a run, by name."""
    known: Mapping[str, Any] = {**config, "seed": seed, "started": started, "mpvi_bt": version}
    for name, value in known.items():
        if value is not None and value not in ("", [], {}):
            yield one_line(name), one_line(value if isinstance(value, str) else json.dumps(value))


def _shown(value: object) -> str | None:
    """A blackboard value as JSON writes it: the text "1" is not the number 1. None if it is gone."""
    return None if value is None else one_line(json.dumps(value, ensure_ascii=False))


@dataclass(frozen=True)
class More:
    """Additions to the common page.

    Attributes:
        script: It runs before the page starts.
        style: Behind the page's own.
        allows: What its content policy allows besides, such as "img-src 'self'".
    """

    script: str = ""
    style: str = ""
    allows: str = ""


def page(tree: TreeSpec, data: dict[str, Any], more: More = More()) -> str:
    """The page of a tree, with what its script reads."""
    data = {word: one_line(getattr(tree, word)) for word in ("name", "about", "instruction")} | data
    data["marks"] = {name: {"unicode": mark.unicode, "word": mark.word} for name, mark in MARKS.items()}
    looks = "\n".join(filter(None, (page_style(), more.style)))
    script = "\n".join([*map(asset, _SCRIPTS[:-1]), *filter(None, [more.script]), asset(_SCRIPTS[-1])])
    policy = ["default-src 'none'", f"script-src '{digest(script)}'", f"style-src '{digest(looks)}'", "base-uri 'none'"]
    parts = {
        "title": html.escape(one_line(tree.name)),
        "policy": "; ".join([*policy, *filter(None, [more.allows])]),
        "style": looks,
        "tree": html.escape("\n".join(map(one_line, ascii_tree(tree, width=120).splitlines()))),
        "data": embedded(data),
        "script": script,
    }
    return re.sub(r"\{\{(\w+)\}\}", lambda found: parts[found[1]], asset("page.html"))


def filled(
    template: str, title: str, script: str, style: str, allows: str, data: str, scripts: str = "", styles: str = ""
) -> str:
    """A page of ours that runs only its own script and style, and sources named here.

    Args:
        template: With title, policy, style, data and script to fill in.
        title: Of the page.
        script, style: Its own.
        allows: What its content policy allows besides.
        data: As `embedded` gives them.
        scripts, styles: Sources of others, as a content policy names them.
    """
    ours = f"script-src '{digest(script)}' {scripts}; style-src '{digest(style)}' {styles}"
    parts = {
        "title": html.escape(one_line(title)),
        "policy": f"default-src 'none'; {ours}; {allows}; base-uri 'none'",
        "style": style,
        "script": script,
        "data": data,
    }
    return re.sub(r"\{\{(\w+)\}\}", lambda found: parts[found[1]], template)


def embedded(data: Any) -> str:
    """JSON in which HTML finds nothing to end or to begin, whatever its texts hold."""
    text = json.dumps(data, ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def page_style() -> str:
    """What pages look like, with the colors of nodes' states."""
    return state_style() + asset("page.css")


def asset(name: str) -> str:
    """A file of the page."""
    return (resources.files("mpvi_bt.executive.trace") / "page" / name).read_text(encoding="utf-8")


def digest(text: str) -> str:
    """What a content policy calls a script or a style."""
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
