"""`mpvi compile`, `mpvi render`, `mpvi check`: trees without a robot."""

from __future__ import annotations

import importlib
import json
from dataclasses import dataclass
from pathlib import Path

import click

from mpvi_bt import paths
from mpvi_bt.errors import FileProblems, Problem, UserError


@click.command(name="compile")
@click.argument("plan")
@click.option("--out", type=click.Path(dir_okay=False), help="Write here instead of to the terminal.")
@click.option("--json", "as_json", is_flag=True, help='For programs: one JSON object with the text under "yaml".')
def compile_(plan: str, out: str | None, as_json: bool) -> None:
    """Write the tree of a plan, as YAML. PLAN is a file, or the name of a recorded plan."""
    from mpvi_bt.plan.planners import RecordedPlanner
    from mpvi_bt.plan.schema import load_plan
    from mpvi_bt.plan.skills import load_skills
    from mpvi_bt.tree.compile import compile_plan
    from mpvi_bt.tree.yaml_io import dump_tree

    is_file = Path(plan).suffix in (".json", ".yaml", ".yml") or "/" in plan
    text = dump_tree(compile_plan(load_plan(plan) if is_file else RecordedPlanner().plan(plan), load_skills()))
    if out is not None:
        try:
            Path(out).write_text(text, encoding="utf-8")
        except OSError as error:
            raise UserError(f"{out}: {(error.strerror or 'cannot be written').lower()}") from None
    if as_json:
        click.echo(json.dumps({"yaml": text, "out": out}))
    elif out is None:
        click.echo(text, nl=False)


@click.command()
@click.argument("tree")
@click.option("--width", default=80, show_default=True, type=click.IntRange(20, 1000), help="Columns.")
@click.option("--json", "as_json", is_flag=True, help="For programs: every node with its path and depth.")
def render(tree: str, width: int, as_json: bool) -> None:
    """Draw a tree. TREE is a file, or the name of one of the trees that come with mpvi_bt."""
    from mpvi_bt.tree.render import ascii_tree
    from mpvi_bt.tree.yaml_io import load_tree

    spec = load_tree(paths.find_or_file("trees", tree, "tree"))
    if as_json:
        nodes = [
            {
                "path": n.path,
                "depth": n.depth,
                "kind": n.spec.kind,
                "label": n.spec.label,
                "segments": n.spec.segments,
                **n.spec.parameters.model_dump(),
            }
            for n in spec.nodes
        ]
        click.echo(json.dumps({"tree": spec.name, "instruction": spec.instruction, "nodes": nodes}, indent=2))
    else:
        click.echo(ascii_tree(spec, width=width))


@click.command()
@click.argument("files", nargs=-1, required=True, metavar="FILE...")
@click.option("--json", "as_json", is_flag=True, help="For programs: a list of problems.")
def check(files: tuple[str, ...], as_json: bool) -> int:
    """List every problem in trees, plans, skills, tasks, suites, houses and the catalogue, with line and column."""
    problems: list[Problem] = []
    for file in files:
        try:
            _check(file)
        except FileProblems as error:
            problems += error.problems
        except UserError as error:
            problems.append(Problem(file, 0, 0, "unreadable", str(error).removeprefix(f"{file}: ")))
    if as_json:
        click.echo(json.dumps([vars(p) for p in problems], indent=2))
    else:
        for problem in problems:
            click.echo(str(problem))
        click.echo(_summary(len(files), len(problems)), err=True)
    return 1 if problems else 0


@dataclass(frozen=True)
class _Kind:
    """A kind of file: any of `keys` tells it, or else the name of its folder. "module:function" raises FileProblems."""

    name: str
    keys: frozenset[str]
    folder: str
    load: str


KINDS = (
    _Kind("tree", frozenset({"tree", "root"}), "trees", "mpvi_bt.cli.trees:_load_tree"),
    _Kind("plan", frozenset({"task_name", "segments"}), "plans", "mpvi_bt.plan.schema:load_plan"),
    _Kind("skill", frozenset({"phrases", "triggers"}), "skills", "mpvi_bt.plan.skills:load_skill"),
    _Kind("house", frozenset({"rooms", "doorways"}), "houses", "mpvi_bt.sim.house:load_house"),
    _Kind("suite", frozenset({"tasks", "instances", "seeds"}), "suites", "mpvi_bt.suite.tasks:load_suite"),
    _Kind("task", frozenset({"problem", "bindings"}), "tasks", "mpvi_bt.suite.tasks:load_task"),
    _Kind("catalogue", frozenset({"entries"}), "catalogues", "mpvi_bt.sim.catalogue:load_catalogue"),
)


def _load_tree(file: str) -> None:
    from mpvi_bt.plan.skills import load_skills
    from mpvi_bt.tree.yaml_io import load_tree

    load_tree(file, load_skills())


def _check(file: str) -> None:
    """What a file is, its own keys tell: the kind that shares most of them. Raises FileProblems."""
    from mpvi_bt.marked_yaml import load_marked

    data, marks = load_marked(file)
    keys = set(data) if isinstance(data, dict) else set()
    folder = Path(file).resolve().parent.name
    kind = max(KINDS, key=lambda k: (len(keys & k.keys), k.folder == folder))
    if not keys & kind.keys and kind.folder != folder:
        known = "; ".join(f"{kind.name} ({', '.join(sorted(kind.keys))})" for kind in KINDS)
        raise FileProblems([marks.problem((), "unknown-file", f"what is this? Known by their keys: {known}")])
    module, _, function = kind.load.partition(":")
    getattr(importlib.import_module(module), function)(file)


def _summary(files: int, problems: int) -> str:
    what = "1 file" if files == 1 else f"{files} files"
    found = {0: "no problems", 1: "1 problem"}.get(problems, f"{problems} problems")
    return f"{what}: {found}"
