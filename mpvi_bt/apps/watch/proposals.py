"""Completions for the page of a tree: the schema of trees, skills, and trees to call."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any

from mpvi_bt.executive.behaviors.own_nodes import own_nodes
from mpvi_bt.executive.behaviors.registry import NodeType
from mpvi_bt.executive.plan.skill_phrases import example
from mpvi_bt.executive.plan.skills import load_skills
from mpvi_bt.executive.tree.json_schema import tree_schema
from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import MpviError
from mpvi_bt.ground.marked_yaml import load_marked, parse_marked


def proposals(text: str, file: Path) -> dict[str, Any]:
    """Completions for the page's `completion.js`, with the own nodes of a file's text."""
    skills = {name: {"about": skill.about, "says": example(skill.phrases[0])} for name, skill in load_skills().items()}
    return {
        "schema": tree_schema(_own(text, file)),
        "skills": skills,
        "trees": {name: _tree(name) for name in paths.names("trees")},
    }


def _own(text: str, file: Path) -> list[NodeType]:
    """The readable nodes. Problems of others are already among those of the text."""
    found: dict[str, NodeType] = {}
    with contextlib.suppress(MpviError):
        data, _ = parse_marked(text, str(file))
        given = data.get("nodes", []) if isinstance(data, dict) else []
        for one in given if isinstance(given, list) else [given]:
            with contextlib.suppress(MpviError):
                found |= {node.kind: node for node in own_nodes(str(one), file.parent)}
    return list(found.values())


def _tree(name: str) -> dict[str, Any]:
    """A tree's own description; empty if it cannot be read."""
    try:
        data, _ = load_marked(paths.find("trees", name))
    except MpviError:
        data = None
    told = data if isinstance(data, dict) else {}
    parameters = told.get("parameters")
    return {"about": str(told.get("about", "")), "parameters": list(parameters) if isinstance(parameters, dict) else []}
