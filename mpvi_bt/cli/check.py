"""`mpvi check`: everything that is wrong with files, each with its place."""

from __future__ import annotations

import importlib
import os
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

from mpvi_bt.cli import problems as show
from mpvi_bt.errors import FileProblems, Problem, UserError
from mpvi_bt.marked_yaml import MAX_PROBLEMS, Marks, load_marked


@click.command()
@click.argument("files", nargs=-1, required=True, metavar="FILE...")
@click.option("--task", help="Also check that the rooms which trees name are those of this task's house.")
@click.option("--json", "as_json", is_flag=True, help="For programs: one JSON object, made for mending the files.")
def check(files: tuple[str, ...], task: str | None, as_json: bool) -> int:
    """List every problem in trees, plans, skills, tasks, suites, houses and the catalogue, with line and column.

    FILE may be a folder: then every .yaml, .yml and .json below it is checked. The exit code is 1 if there is any
    problem, a warning too.
    """
    rooms = None if task is None else rooms_of(task)
    named = [found for given in files for found in below(given)]
    problems = [problem for file in named for problem in problems_in(file, rooms)]
    problems = list({(p.file, p.line, p.column, p.message): p for p in problems}.values())  # subtrees are read twice
    if as_json:
        click.echo(show.as_json(problems, len(named)))
    else:
        for line in show.as_text(problems):
            click.echo(line)
        click.echo(_summary(len(named), len(problems)), err=True)
        if max(Counter(p.file for p in problems).values(), default=0) >= MAX_PROBLEMS:
            click.echo(f"of one file only the first {MAX_PROBLEMS} problems are told", err=True)
    return 1 if problems else 0


@dataclass(frozen=True)
class Kind:
    """A kind of file: any of `keys` tells it, or else the name of its folder.

    Attributes:
        name: For a person.
        keys: At the top of such a file, and not of others.
        folder: Where such files lie.
        check: "module:function", called with the data and the marks of a file; raises FileProblems. None: they are
            not ours to check.
    """

    name: str
    keys: frozenset[str]
    folder: str
    check: str | None


KINDS = (
    Kind("tree", frozenset({"tree", "root"}), "trees", "mpvi_bt.tree.yaml_io:check_tree"),
    Kind("plan", frozenset({"task_name", "segments"}), "plans", "mpvi_bt.plan.schema:check_plan"),
    Kind("skill", frozenset({"phrases", "triggers"}), "skills", "mpvi_bt.plan.skills:check_skill"),
    Kind("house", frozenset({"rooms", "doorways"}), "houses", "mpvi_bt.sim.house:check_house"),
    Kind("suite", frozenset({"tasks", "instances", "seeds"}), "suites", "mpvi_bt.suite.tasks:check_suite"),
    Kind("task", frozenset({"problem", "bindings"}), "tasks", "mpvi_bt.suite.tasks:check_task"),
    Kind("catalogue", frozenset({"entries"}), "catalogues", "mpvi_bt.sim.catalogue:check_catalogue"),
    Kind("rules", frozenset({"substitute"}), "rules", "mpvi_bt.tree.substitute:check_rules"),
    Kind("JSON schema", frozenset({"$schema", "$defs"}), "schema", None),
)


def below(given: str) -> list[str]:
    """The file itself, or those below a folder that may be ours, in order."""
    if not Path(given).is_dir():
        return [given]
    return list(_files(given)) or [given]


def _files(folder: str) -> Iterator[str]:
    for place, folders, files in os.walk(folder):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        for name in sorted(files):
            path = Path(place, name)
            if path.suffix in (".yaml", ".yml", ".json") and path.is_file():
                yield str(path)


def problems_in(file: str, rooms: frozenset[str] | None = None) -> list[Problem]:
    """Everything that is wrong with one file.

    Args:
        file: Of any kind that we know.
        rooms: If given, the rooms of a tree must be among them.
    """
    try:
        data, marks = load_marked(file)
        kind = kind_of(data, marks)
        if kind.name == "tree":
            return _tree_problems(data, marks, rooms)
        if kind.check is not None:
            module, _, function = kind.check.partition(":")
            getattr(importlib.import_module(module), function)(data, marks)
    except FileProblems as error:
        return list(error.problems)
    except UserError as error:
        return [Problem(file, 0, 0, "unreadable", str(error).removeprefix(f"{file}: "))]
    return []


def kind_of(data: Any, marks: Marks) -> Kind:
    """What a file is, its own keys tell: the kind that shares most of them. Raises FileProblems."""
    keys = set(data) if isinstance(data, dict) else set()
    folder = Path(marks.file).resolve().parent.name
    kind = max(KINDS, key=lambda k: (len(keys & k.keys), k.folder == folder))
    if not keys & kind.keys and kind.folder != folder:
        known = "; ".join(f"{kind.name} ({', '.join(sorted(kind.keys))})" for kind in KINDS if kind.check)
        raise FileProblems([marks.problem((), "unknown-file", f"what is this? Known by their keys: {known}")])
    return kind


def _tree_problems(data: Any, marks: Marks, rooms: frozenset[str] | None) -> list[Problem]:
    from mpvi_bt.plan.skills import load_skills
    from mpvi_bt.tree.lint import check_rooms, lint
    from mpvi_bt.tree.yaml_io import check_tree

    skills = load_skills()
    spec = check_tree(data, marks, skills)
    found = lint(spec, skills, marks) + ([] if rooms is None else check_rooms(spec, rooms, marks))
    return sorted(found, key=lambda p: (p.file != marks.file, p.file, p.line, p.column))[:MAX_PROBLEMS]


def rooms_of(task: str) -> frozenset[str]:
    """The rooms of the house that a task is in. Raises as `load_task` and `load_house` do."""
    from mpvi_bt.sim.house import load_house
    from mpvi_bt.suite.tasks import load_task

    return frozenset(load_house(load_task(task).house).rooms)


def _summary(files: int, problems: int) -> str:
    what = "1 file" if files == 1 else f"{files} files"
    found = {0: "no problems", 1: "1 problem"}.get(problems, f"{problems} problems")
    return f"{what}: {found}"
