"""`mpvi check`: everything that is wrong with files, each with its place."""

from __future__ import annotations

import importlib
import os
import re
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mpvi_bt import paths
from mpvi_bt.cli import problems as show
from mpvi_bt.cli.given import File
from mpvi_bt.errors import FileProblems, Problem, UserError
from mpvi_bt.file_kinds import kind_of, taken_by
from mpvi_bt.marked_yaml import MAX_PROBLEMS, Marks, load_marked, parse_marked, read_text

if TYPE_CHECKING:
    from mpvi_bt.plan.context import Grounding

STDIN = "<stdin>"


@click.command()
@click.argument("files", nargs=-1, required=True, type=File("trees"), metavar="FILE...")
@click.option(
    "--task",
    type=File("tasks"),
    metavar="TASK",
    help="Also check rooms, and what to drive to, against this task's house and things.",
)
@click.option("--json", "as_json", is_flag=True, help="For programs: one JSON object, made for mending the files.")
def check(files: tuple[str, ...], task: str | None, as_json: bool) -> int:
    """List every problem in trees, plans, skills, tasks, suites, methods, houses, rules, policies and catalogues.

    FILE may be a folder: then every .yaml, .yml, .json and .bddl below it is checked. It may be the name of a tree,
    too, or "-" for the standard input. The exit code is 1 if there is any problem, a warning too, and 2 if a FILE is
    not there.
    """
    site = None if task is None else _site(task)
    texts: dict[str, str] = {}
    problems: list[Problem] = []
    count = 0
    missing = False
    for given in files:
        try:
            found = below(given)
        except UserError as error:
            problems.append(Problem(given or "''", 0, 0, "unreadable", str(error).removeprefix(f"{given}: ")))
            missing = True
            continue
        count += len(found)
        if given == "-":
            texts[STDIN] = sys.stdin.read()
            problems += problems_in(STDIN, site, text=texts[STDIN])
        else:
            problems += [problem for file in found for problem in problems_in(file, site, named=found == [given])]
    problems = list({(p.file, p.line, p.column, p.message): p for p in problems}.values())  # subtrees are read twice
    if as_json:
        click.echo(show.as_json(problems, count, texts))
    else:
        for line in show.as_text(problems, texts):
            click.echo(line)
        click.echo(_summary(count, len(problems)), err=True)
        if max(Counter(p.file for p in problems).values(), default=0) >= MAX_PROBLEMS:
            click.echo(f"of one file only the first {MAX_PROBLEMS} problems are told", err=True)
    return 2 if missing else 1 if problems else 0


def below(given: str) -> list[str]:
    """The file itself, those below a folder that may be ours, in order, or that of the tree of a name.

    Raises:
        UserError: There is none.
    """
    if given == "-":
        return [given]
    try:
        is_folder = bool(given) and Path(given).is_dir()
    except OSError:  # no file can have such a name
        is_folder = False
    if not is_folder:
        return [str(paths.find_or_file("trees", given, "tree"))]
    if not (found := list(_files(given))):
        raise UserError("there is no .yaml, .yml, .json or .bddl file below it.")
    return found


def _files(folder: str) -> Iterator[str]:
    for place, folders, files in os.walk(folder):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        for name in sorted(files):
            path = Path(place, name)
            if path.suffix in (".yaml", ".yml", ".json", ".bddl") and path.is_file():
                yield str(path)


def problems_in(file: str, site: Grounding | None = None, text: str | None = None, named: bool = True) -> list[Problem]:
    """Everything that is wrong with one file.

    Args:
        file: Of any kind that we know.
        site: If given, what a tree or a plan drives to must be there.
        text: Its content, if it has been read already.
        named: Whether a user named it: then a file of ours that has nothing to check is told for what it is.
    """
    try:
        if file.endswith(".bddl"):
            return _bddl_problems(file)
        data, marks = load_marked(file) if text is None else parse_marked(text, file)
        kind = kind_of(data, marks)
        if kind.noun == "tree":
            return _tree_problems(data, marks, site)
        if kind.noun == "plan":
            return _plan_problems(data, marks, site)
        if kind.check is not None:
            module, _, function = kind.check.partition(":")
            getattr(importlib.import_module(module), function)(data, marks)
        elif named:
            message = f"this is {kind.name}, which there is nothing to check of; {taken_by(kind)}"
            return [marks.problem((), "wrong-kind", message)]
    except FileProblems as error:
        return list(error.problems)
    except UserError as error:
        return [Problem(file, 0, 0, "unreadable", str(error).removeprefix(f"{file}: "))]
    return []


def _bddl_problems(file: str) -> list[Problem]:
    from mpvi_bt.goals.problem import parse_problem

    text = read_text(file)
    try:
        parse_problem(text, file)
    except UserError as error:
        said = re.fullmatch(r"(?::(\d+))?: (.*)", str(error).removeprefix(file), re.DOTALL)
        line, message = said.groups() if said else (None, str(error))
        return [Problem(file, int(line or 0), int(line is not None), "invalid-value", message)]
    return []


def _tree_problems(data: Any, marks: Marks, site: Grounding | None) -> list[Problem]:
    from mpvi_bt.plan.skills import load_skills
    from mpvi_bt.tree.lint import check_rooms, check_targets, lint
    from mpvi_bt.tree.yaml_io import check_tree

    skills = load_skills()
    spec = check_tree(data, marks, skills)
    found = lint(spec, skills, marks)
    if site is not None:
        found += check_rooms(spec, site.rooms, marks) + check_targets(spec, site.phrases, marks)
    return sorted(found, key=lambda p: (p.file != marks.file, p.file, p.line, p.column))[:MAX_PROBLEMS]


def _plan_problems(data: Any, marks: Marks, site: Grounding | None) -> list[Problem]:
    from mpvi_bt.plan.check import plan_problems
    from mpvi_bt.plan.schema import check_plan
    from mpvi_bt.plan.skills import load_skills

    return plan_problems(check_plan(data, marks), load_skills(), site, marks)


def _site(name: str) -> Grounding:
    """What trees and plans can name where a task is. Raises as `load_task` and `load_house` do."""
    from mpvi_bt.suite.planners import ground
    from mpvi_bt.suite.tasks import load_task

    task = load_task(name)
    return ground(task.house, task)


def _summary(files: int, problems: int) -> str:
    what = "1 file" if files == 1 else f"{files} files"
    found = {0: "no problems", 1: "1 problem"}.get(problems, f"{problems} problems")
    return f"{what}: {found}"
