"""`mpvi list`: what tasks, skills, trees and backends there are, with one line each."""

from __future__ import annotations

import json
from pathlib import Path

import click

from mpvi_bt import paths
from mpvi_bt.suite.backends import BACKENDS

FOLDERS = ("tasks", "suites", "skills", "trees")


@click.command(name="list")
@click.argument("what", type=click.Choice([*FOLDERS, "backends"]))
@click.option("--json", "as_json", is_flag=True, help="For programs: one JSON object, name to line.")
def list_(what: str, as_json: bool) -> None:
    """What tasks, suites, skills, trees or backends there are, with one line each."""
    lines = _backends() if what == "backends" else _files("tasks/suites" if what == "suites" else what)
    if as_json:
        click.echo(json.dumps(lines, indent=2))
        return
    width = max(map(len, lines), default=0)
    for name, line in lines.items():
        click.echo(f"{name:{width}}  {line}".rstrip())


def _files(folder: str) -> dict[str, str]:
    return {name: _about(paths.find(folder, name)) for name in paths.names(folder)}


def _about(path: Path) -> str:
    """The line that a file says of itself: its `about`, `description` or `instruction`, or its first comment."""
    import yaml

    text = path.read_text(encoding="utf-8")
    try:
        content = yaml.safe_load(text)
    except yaml.YAMLError:
        return f"(broken; see `mpvi check {path}`)"
    if isinstance(content, dict):
        for key in ("about", "description", "instruction"):
            if isinstance(content.get(key), str):
                return " ".join(content[key].split())
    first = text.partition("\n")[0]
    return first.removeprefix("#").strip() if first.startswith("#") else ""


def _backends() -> dict[str, str]:
    return {
        f"--{kind} {name}": backend.about + (" (reads simulator truth)" if backend.privileged else "")
        for kind, choices in BACKENDS.items()
        for name, backend in choices.items()
    }
