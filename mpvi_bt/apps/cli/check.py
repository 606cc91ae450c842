"""`mpvi check`: everything that is wrong with files, each with its place."""

from __future__ import annotations

import sys
from collections import Counter

import click

from mpvi_bt.apps.cli import problems as show
from mpvi_bt.apps.cli.argument_types import File
from mpvi_bt.executive.drawing.terminal import tell
from mpvi_bt.ground.marked_yaml import MAX_PROBLEMS


@click.command()
@click.argument("files", nargs=-1, required=True, type=File("trees"), metavar="FILE...")
@click.option(
    "--task",
    type=File("tasks"),
    metavar="TASK",
    help="Also compare rooms and targets with this task's house and objects.",
)
@click.option(
    "--json", "as_json", is_flag=True, help="For programs: one JSON object with all problems and their places."
)
def check(files: tuple[str, ...], task: str | None, as_json: bool) -> int:
    """List every problem in trees, plans, skills, tasks, suites, methods, houses, rules, policies and catalogues.

    FILE may be a folder: then every .yaml, .yml, .json and .bddl below it is checked. It may be the name of a tree,
    too, or "-" for the standard input. The exit code is 1 if there is any problem, a warning too, and 2 if a FILE is
    not there.
    """
    from mpvi_bt.apps.authoring.checking import STDIN, check_files

    text = sys.stdin.read() if "-" in files else ""
    checked = check_files(files, task, text)
    problems, texts = checked.problems, {STDIN: text}
    if as_json:
        tell(show.as_json(problems, checked.files, texts))
    else:
        for line in show.as_text(problems, texts):
            tell(line)
        notes = sum(p.severity == "note" for p in problems)
        click.echo(_summary(checked.files, len(problems) - notes, notes), err=True)
        if max(Counter(p.file for p in problems).values(), default=0) >= MAX_PROBLEMS:
            click.echo(f"only the first {MAX_PROBLEMS} problems of a file are shown", err=True)
    return 2 if checked.missing else int(any(p.severity != "note" for p in problems))


def _summary(files: int, problems: int, notes: int) -> str:
    what = "1 file" if files == 1 else f"{files} files"
    found = {0: "no problems", 1: "1 problem"}.get(problems, f"{problems} problems")
    return f"{what}: {found}" + (f", {notes} note{'s' * (notes > 1)}" if notes else "")
