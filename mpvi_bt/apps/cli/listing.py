"""`mpvi list`: what tasks, methods, skills, trees, things, nodes and backends there are, with one line each."""

from __future__ import annotations

import json
import textwrap
from pathlib import Path
from typing import Any

import click

from mpvi_bt.executive.drawing.cells import WIDTH, cut, one_line
from mpvi_bt.executive.drawing.terminal import size, tell
from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import UserError

FOLDERS = {
    "tasks": "tasks", "suites": "tasks/suites", "methods": "tasks/methods", "skills": "skills", "trees": "trees",
    "robots": "robots",
}  # fmt: skip


@click.command(name="list")
@click.argument("what", type=click.Choice([*FOLDERS, "objects", "families", "nodes", "backends"]))
@click.option("--long", "whole", is_flag=True, help="Full descriptions, over several lines.")
@click.option("--json", "as_json", is_flag=True, help="For programs: one JSON object by name.")
def list_(what: str, whole: bool, as_json: bool) -> None:
    """What tasks, suites, methods, skills, trees, robots, nodes or backends there are, with one line each.

    Objects are the things of the catalogue, families what makes their shapes of parameters (with pictures:
    docs/families.md). Nodes are those that any tree may have: ours and those of installed packages.
    """
    if what == "nodes":
        _print_nodes(as_json)
        return
    others = {"backends": _backends, "objects": _objects, "families": _families}
    lines = others[what]() if what in others else _files(FOLDERS[what])
    if as_json:
        tell(json.dumps(lines, indent=2))
        return
    _print(lines, whole or what in ("backends", "families"))


def _print(lines: dict[str, str], whole: bool) -> None:
    """A line each, as wide as the terminal; or the whole of each, wrapped."""
    name_width, width = max(map(len, lines), default=0), size().columns
    for name, line in lines.items():
        first, rest = f"{name:{name_width}}  ", " " * (name_width + 2)
        line = line.strip()
        if whole:
            wrapped = textwrap.wrap(line, WIDTH, initial_indent=first, subsequent_indent=rest, break_on_hyphens=False)
            tell("\n".join(wrapped) or name)
        else:
            tell(cut(f"{first}{one_line(line)}".rstrip(), width))


def _print_nodes(as_json: bool) -> None:
    nodes = _nodes()
    if as_json:
        tell(json.dumps(nodes, indent=2))
        return
    lines = {}
    for kind, about in nodes.items():
        words = {name: f"{name}: {' or '.join(of)}" if of else name for name, of in _choices(kind).items()}
        given = [words[name] if needed else f"[{words[name]}]" for name, needed in about["parameters"].items()]
        lines[kind] = f"{about['summary']} ({', '.join([about['family'], *given])})"
    _print(lines, True)


def _nodes() -> dict[str, dict[str, Any]]:
    """Every kind of node: its family, its parameters (the headline first) and whether each is needed, its summary."""
    from mpvi_bt.executive.behaviors.registry import node_types

    found: dict[str, dict[str, Any]] = {}
    for kind, node in node_types().items():
        fields = node.parameters.model_fields
        order = sorted(fields, key=lambda name: name != node.headline)
        needed = {name: fields[name].is_required() for name in order}
        found[kind] = {"family": node.family, "headline": node.headline, "parameters": needed, "summary": node.summary}
    return found


def _choices(kind: str) -> dict[str, list[str]]:
    """Of every parameter the words that it may have, if they can be listed."""
    from mpvi_bt.executive.behaviors.registry import node_types
    from mpvi_bt.ground.marked_yaml import choices_of

    return {name: choices_of(info.annotation) for name, info in node_types()[kind].parameters.model_fields.items()}


def _files(folder: str) -> dict[str, str]:
    return {name: _about(path) + _whose(path) for name in paths.names(folder) for path in [paths.find(folder, name)]}


def _whose(path: Path) -> str:
    """The place of a file from outside mpvi_bt."""
    return "" if paths.shipped() in path.parents else f" ({path})"


def _about(path: Path) -> str:
    """A file's own description: its `about`, `description` or `instruction`, or its first comment."""
    from mpvi_bt.apps.authoring.checking import problems_in
    from mpvi_bt.ground.marked_yaml import parse_marked, read_text

    broken = f"(broken; see `mpvi check {path}`)"
    if path.parent.name != "trees" and problems_in(str(path), lint=False):
        return broken
    try:
        text = read_text(path)
        content = parse_marked(text, str(path))[0]
    except UserError:
        return broken
    if isinstance(content, dict):
        for key in ("about", "description", "instruction"):
            if isinstance(content.get(key), str):
                return " ".join(content[key].split())
    comments = (line.removeprefix("#").strip() for line in text.splitlines() if line.startswith("#"))
    return next((comment for comment in comments if not comment.startswith("yaml-language-server:")), "")


def _objects() -> dict[str, str]:
    """Every entry of the catalogue: its family, its size, its mass, BEHAVIOR's name for it."""
    from mpvi_bt.house.things.catalogue import load_catalogue

    found = {}
    for entry in sorted(load_catalogue(), key=lambda entry: entry.name):
        low, high = entry.description.extent()
        size = " x ".join(f"{side:.2f}" for side in high - low)
        mass = "fixture" if entry.mass_kg is None else f"{entry.mass_kg:g} kg"
        found[entry.name] = f"{entry.family}, {size} m, {mass}, {entry.synset}"
    return found


def _families() -> dict[str, str]:
    """Every family of shapes: what it makes, and its parameters."""
    from mpvi_bt.house.things.catalogue import load_catalogue
    from mpvi_bt.house.things.family_page import families

    return {
        info.name: f"{info.about} {'; '.join(f'{key}: {what}' for key, what in info.parameters.items())}"
        for info in families(load_catalogue())
    }


def _backends() -> dict[str, str]:
    from mpvi_bt.runs.choices.backends import BACKENDS
    from mpvi_bt.runs.choices.plugins import OFFERED, entry_points

    others = {
        f"--{kind} {name}": f"{path} (of an installed package)"
        for kind in OFFERED
        for name, path in entry_points(kind).items()
        if name not in BACKENDS[kind]
    }
    return {
        f"--{kind} {b.spelled(name)}": b.about + (" (reads simulator truth)" if b.privileged else "")
        for kind, choices in BACKENDS.items()
        for name, b in choices.items()
    } | others
