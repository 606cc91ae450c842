"""`mpvi fmt`: tree files in canonical form, their comments kept."""

from __future__ import annotations

import difflib
import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from mpvi_bt.apps.authoring.checking import STDIN, below
from mpvi_bt.apps.cli import problems as show
from mpvi_bt.apps.cli.argument_types import File
from mpvi_bt.executive.drawing.terminal import give, tell
from mpvi_bt.ground.errors import FileProblems, Problem, UserError, with_article
from mpvi_bt.ground.file_kinds import kind_of
from mpvi_bt.ground.marked_yaml import parse_marked, read_text
from mpvi_bt.ground.writing import write_whole


@click.command()
@click.argument("files", nargs=-1, required=True, type=File("trees"), metavar="FILE...")
@click.option("--check", "only_check", is_flag=True, help="Write nothing; the exit code is 1 if a file would change.")
@click.option("--diff", "only_diff", is_flag=True, help="Write nothing; show what would change.")
@click.option("--json", "as_json", is_flag=True, help="For programs: one JSON object.")
def fmt(files: tuple[str, ...], only_check: bool, only_diff: bool, as_json: bool) -> int:
    """Bring trees into canonical form, in place, with their comments.

    FILE may be the name of a tree, or a folder: then the trees below it are meant. "-" reads from the standard input
    and writes to the standard output. A tree with problems is left as it is, and the exit code is 2.
    """
    named: list[tuple[str, bool]] = []
    changed: list[str] = []
    problems: list[Problem] = []
    texts: dict[str, str] = {}
    count = 0
    for given in files:
        try:
            found = below(given)
            named += [(file, len(found) == 1 and not Path(given).is_dir()) for file in found]
        except UserError as error:
            problems.append(Problem(given, 0, 0, "unreadable", str(error)))
    for file, is_named in named:
        try:
            text = sys.stdin.read() if file == "-" else read_text(file)
            if file == "-":
                texts[STDIN] = text
            result = _formatted(text, STDIN if file == "-" else file, is_named)
        except FileProblems as error:
            problems += error.problems
            continue
        except UserError as error:
            problems.append(Problem(file, 0, 0, "unreadable", str(error).removeprefix(f"{file}: ")))
            continue
        count += result is not None
        if result is not None and result != (text if file == "-" else _as_it_is(file)):
            changed.append(file)
            if only_diff and not as_json:
                give("".join(_diff(text, result, file)))
            elif file != "-" and not (only_check or only_diff):
                write_whole(file, result)
        if file == "-" and result is not None and not (only_check or only_diff or as_json):
            give(result)
    _report(changed, problems, texts, count, only_check or only_diff, as_json)
    return 2 if problems else int(only_check and bool(changed))


def _formatted(text: str, name: str, is_named: bool) -> str | None:
    """The canonical form, or None for a file of a folder that is no tree. Raises FileProblems."""
    from mpvi_bt.executive.tree.formatting import formatted

    data, marks = parse_marked(text, name)
    try:
        kind = kind_of(data, marks).noun
    except FileProblems:
        kind = "file of a kind that we do not know"
    if kind == "tree" and not name.endswith(".json"):
        return formatted(text, name)
    if is_named:
        kind = "JSON file" if kind == "tree" else kind
        raise FileProblems(
            [marks.problem((), "not-a-tree", f"only trees in YAML have a canonical form, not {with_article(kind)}")]
        )
    return None


def _as_it_is(file: str) -> str:
    """The text with its own line ends, so that a file is rewritten for these too."""
    path = Path(file)
    return path.read_bytes().decode("utf-8", "replace") if path.is_file() else ""


def _diff(old: str, new: str, file: str) -> list[str]:
    return list(difflib.unified_diff(old.splitlines(True), new.splitlines(True), file, f"{file} (canonical)"))


def _report(
    changed: list[str], problems: list[Problem], texts: Mapping[str, str], count: int, dry: bool, as_json: bool
) -> None:
    if as_json:
        found: list[dict[str, Any]] = json.loads(show.as_json(problems, count, texts))["problems"]
        tell(json.dumps({"changed": changed, "files": count, "problems": found}, indent=2))
        return
    for line in show.as_text(problems, texts):
        click.echo(line, err=True)
    for file in changed:
        click.echo(f"{'would change' if dry else 'changed'} {file}", err=True)
    what = "1 tree" if count == 1 else f"{count} trees"
    click.echo(f"{what}, {len(changed)} {'to change' if dry else 'changed'}", err=True)
