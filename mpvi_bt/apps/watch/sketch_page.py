"""The page of a tree with errors: the readable part is drawn, and problems stand beside their nodes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from mpvi_bt.executive.plan.skills import load_skills
from mpvi_bt.executive.trace.html import nodes, page
from mpvi_bt.executive.tree.reader import sketch
from mpvi_bt.executive.tree.spec import BrokenNode
from mpvi_bt.executive.tree.tree_file import TreeReading
from mpvi_bt.ground.errors import FileProblems, Problem
from mpvi_bt.ground.file_kinds import expect
from mpvi_bt.ground.marked_yaml import SourceMarks, parse_marked

_TRIES = 40  # lines above a mistake in YAML that are given up at most, each with a look at what is left. Our choice


def sketch_page(text: str, file: str) -> str:
    """The page of the text of `file`. Raises FileProblems if nothing of it can be drawn."""
    data, marks, cut, fault = _readable(text, file)
    expect("tree", data, marks)
    reading = TreeReading(load_skills())
    tree = sketch(data, marks, reading)
    if tree is None:
        raise FileProblems(reading.problems)
    wrong = [node.spec.problems if isinstance(node.spec, BrokenNode) else () for node in tree.nodes]
    if fault is not None:  # then only that is told: what lacks may stand in the rest
        wrong = [()] * (len(wrong) - 1) + [(fault,)]
    shown: dict[str, Any] = {"trees": [nodes(tree)], "frames": None, "states": [_state(problems) for problems in wrong]}
    if fault is not None:
        shown["about"] = f"Drawn as far as line {cut}; from there on the text cannot be read."
    return page(replace(tree, name=tree.name or Path(file).stem), shown)


def _state(problems: tuple[Problem, ...]) -> dict[str, str] | None:
    """How a node is marked."""
    return {"is": "failure", "feedback": "; ".join(p.message for p in problems)} if problems else None


def _readable(text: str, file: str) -> tuple[Any, SourceMarks, int, Problem | None]:
    """Data and marks of the longest readable beginning, the number of its lines, and the problem behind it.

    Raises FileProblems if there is none.
    """
    try:
        return *parse_marked(text, file), 0, None
    except FileProblems as error:
        problems = error.problems
    lines = text.split("\n")
    ends = {problem.line - 1 for problem in problems}
    above = range(min(ends) - 1, min(ends) - 1 - _TRIES, -1)
    for end in [*sorted(ends, reverse=True), *above]:
        if end > 0:
            try:
                return *parse_marked("\n".join(lines[:end]), file), end, problems[0]
            except FileProblems:
                continue
    raise FileProblems(problems)
