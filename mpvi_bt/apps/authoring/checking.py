"""All problems in files of any of our kinds, as `mpvi check` and `mpvi_bt.check` report them."""

from __future__ import annotations

import contextlib
import importlib
import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import FileProblems, Problem, UserError
from mpvi_bt.ground.file_kinds import kind_of, taken_by
from mpvi_bt.ground.marked_yaml import MAX_PROBLEMS, SourceMarks, load_marked, parse_marked, read_text

if TYPE_CHECKING:  # what it loads is needed only beside a task
    from mpvi_bt.executive.plan.planning_context import PlanningContext
    from mpvi_bt.house.instances.tasks import Task

STDIN = "<stdin>"


@dataclass(frozen=True)
class Checked:
    """What became of some files.

    Attributes:
        problems: Each once, in the order of the files.
        files: How many were read.
        missing: Whether one that was named is not there, or nothing that is ours is in a folder.
    """

    problems: list[Problem]
    files: int
    missing: bool


def check_files(given: Iterable[str], task: str | None = None, stdin: str = "") -> Checked:
    """Check files.

    Args:
        given: Files, folders, names of trees, or "-" for a text.
        task: Name or file of a task: rooms, and what to drive to, must be there, and plans are rehearsed for it.
        stdin: That text.

    Raises:
        UserError: There is no such task.
        FileProblems: The task is none.
    """
    of, site = (None, None) if task is None else _site(task)
    problems: list[Problem] = []
    count = 0
    missing = False
    named: dict[str, str] = {}
    for name in given:
        try:
            found = below(name)
        except UserError as error:
            problems.append(Problem(name or "''", 0, 0, "unreadable", str(error).removeprefix(f"{name}: ")))
            missing = True
            continue
        count += len(found)
        named |= {_real(file): file for file in found}
        if name == "-":
            problems += problems_in(STDIN, site, text=stdin, task=of)
        else:
            problems += [p for file in found for p in problems_in(file, site, named=found == [name], task=of)]
    # A file is read again for each file that names it, by another path perhaps: its problems are told once
    told = [replace(p, file=named.get(_real(p.file), p.file)) for p in problems]
    once = {(p.file, p.line, p.column, p.message): p for p in told}
    return Checked(list(once.values()), count, missing)


def _real(file: str) -> str:
    """The path of a file without links; an impossible name is returned unchanged."""
    try:
        return os.path.realpath(file)
    except ValueError:
        return file


def below(given: str) -> list[str]:
    """The files to check: the file itself, our files below a folder in order, or the file of a tree's name.

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
            if path.suffix in (*paths.SUFFIXES, ".bddl") and path.is_file():
                yield str(path)


def problems_in(
    file: str,
    site: PlanningContext | None = None,
    text: str | None = None,
    named: bool = True,
    lint: bool = True,
    task: Task | None = None,
) -> list[Problem]:
    """Everything that is wrong with one file.

    Args:
        file: Of any kind that we know.
        site: If given, what a tree or a plan drives to must be there.
        text: Its content, if it has been read already.
        named: Whether a user named it: then a file of ours that has nothing to check is told for what it is.
        lint: Whether what is no error is wanted too, of kinds of files that have a lint of their own.
        task: For which a plan is rehearsed; None: the one that it names.
    """
    try:
        if file.endswith(".bddl"):
            return _bddl_problems(file)
        data, marks = load_marked(file) if text is None else parse_marked(text, file)
        kind = kind_of(data, marks)
        if kind.noun == "tree":
            return _tree_problems(data, marks, site)
        if kind.noun == "plan":
            return _plan_problems(data, marks, site, task)
        if kind.check is not None:
            _called(kind.check, data, marks)
            found: list[Problem] = _called(kind.lint, data, marks) if kind.lint is not None and lint else []
            return sorted(found, key=lambda p: (p.line, p.column))[:MAX_PROBLEMS]
        if named:
            message = f"this is {kind.name}, and `mpvi check` does not check it; {taken_by(kind)}"
            return [marks.problem((), "wrong-kind", message)]
    except FileProblems as error:
        return list(error.problems)
    except UserError as error:
        return [Problem(file, 0, 0, "unreadable", str(error).removeprefix(f"{file}: "))]
    return []


def _called(name: str, data: Any, marks: SourceMarks) -> Any:
    """What "module:function" says of a file."""
    module, _, function = name.partition(":")
    return getattr(importlib.import_module(module), function)(data, marks)


def _bddl_problems(file: str) -> list[Problem]:
    from mpvi_bt.house.goals.findings import Findings
    from mpvi_bt.house.goals.problem import distributed, parse_problem
    from mpvi_bt.house.instances.words import known_words

    text, findings = read_text(file), Findings(file)
    with contextlib.suppress(FileProblems):  # the findings have them, and what is no error
        parse_problem(text, Path(file).stem, findings, known_words())
    path = Path(file).resolve()
    if (own := distributed().get(path.parent.name)) is not None and own.resolve() == path:  # BEHAVIOR's is as it is
        return [replace(p, severity="note") if p.severity == "warning" else p for p in findings.problems]
    return sorted(findings.problems, key=lambda p: (p.line, p.column))[:MAX_PROBLEMS]


def _tree_problems(data: Any, marks: SourceMarks, site: PlanningContext | None) -> list[Problem]:
    from mpvi_bt.executive.plan.skills import load_skills
    from mpvi_bt.executive.tree.lint import check_rooms, check_targets, lint
    from mpvi_bt.executive.tree.yaml_io import check_tree

    skills = load_skills()
    spec = check_tree(data, marks, skills)
    found = lint(spec, skills, marks)
    if site is not None:
        found += check_rooms(spec, site.rooms, marks) + check_targets(spec, site.phrases, marks)
    return sorted(found, key=lambda p: (p.file != marks.file, p.file, p.line, p.column))[:MAX_PROBLEMS]


def _plan_problems(data: Any, marks: SourceMarks, site: PlanningContext | None, task: Task | None) -> list[Problem]:
    from mpvi_bt.executive.plan.schema import check_plan
    from mpvi_bt.runs.choices.planning import plan_findings

    return plan_findings(check_plan(data, marks), marks, task, site)


def _site(name: str) -> tuple[Task, PlanningContext]:
    """A task, and names for plans and trees in it. Raises as `load_task` and `load_house` do."""
    from mpvi_bt.house.instances.tasks import load_task
    from mpvi_bt.runs.choices.planning import ground

    task = load_task(name)
    return task, ground(task.house, task)
