"""`mpvi convert`: trees of ours as XML of BehaviorTree.CPP 4, and the other way."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click

from mpvi_bt import paths
from mpvi_bt.cli.given import File
from mpvi_bt.drawing.terminal import give
from mpvi_bt.errors import Problem, UserError
from mpvi_bt.writing import unwritable, write_whole

FORMATS = {".xml": "xml", ".yaml": "yaml", ".yml": "yaml"}


@click.command()
@click.argument("tree", type=File("trees"))
@click.argument("out", type=File(), required=False)
@click.option(
    "--to", type=click.Choice(["xml", "yaml"]), help="Format to write. [default: by OUT, or the other one than TREE's]"
)
@click.option(
    "--main-tree", metavar="ID", help="From XML: tree to run. [default: main_tree_to_execute, or the outermost]"
)
@click.option("--force", is_flag=True, help="Overwrite existing files that differ.")
@click.option("--json", "as_json", is_flag=True, help="For programs: one JSON object with the text and the warnings.")
def convert(tree: str, out: str | None, to: str | None, main_tree: str | None, force: bool, as_json: bool) -> None:
    """Turn a tree into XML of BehaviorTree.CPP 4, which Groot2 opens, or such XML into a tree.

    TREE is a file, or the name of a tree. Without OUT the text is shown. From XML, the trees of its SubTrees are
    written beside OUT, a file each. What the other side does otherwise is told as warnings. A file that is there
    already with another text is written over only with --force.
    """
    target = _target(tree, out, to)
    if main_tree is not None and target == "xml":
        raise UserError("--main-tree names a tree of an XML file; a tree of ours has one.")
    texts, warnings = _to_xml(tree) if target == "xml" else _to_yaml(tree, main_tree)
    main, beside = texts[""], {name: text for name, text in texts.items() if name}
    files: list[str] = []
    if out is not None:
        files = _write(Path(out), main, beside, force)
    elif beside and not as_json:
        message = f"{tree}: it holds {len(texts)} trees, which become a file each: name one to write to"
        raise UserError(f"{message}, such as trees/{Path(tree).stem}.yaml.")
    if as_json:
        told: dict[str, Any] = {target: main, **({"subtrees": beside} if target == "yaml" else {})}
        told |= {"out": out, "files": files, "warnings": [vars(p) for p in warnings]}
        click.echo(json.dumps(told, indent=2))
        return
    if out is None:
        give(main)
    for file in files[1:]:
        click.echo(f"wrote {file} too: a subtree", err=True)
    for line in grouped(warnings):
        click.echo(line, err=True)


def _target(tree: str, out: str | None, to: str | None) -> str:
    """What to write: "xml" or "yaml"."""
    other = "yaml" if Path(tree).suffix == ".xml" else "xml"
    named = other if out is None else FORMATS.get(Path(out).suffix)
    if named is None:
        raise UserError(f"{out}: write to a file that ends in .{other}.")
    if to not in (None, other) or named != other:
        raise UserError(f"{tree} can only become {other}, not {to if to not in (None, other) else named}.")
    return other


def _to_xml(tree: str) -> tuple[dict[str, str], Sequence[Problem]]:
    from mpvi_bt.btcpp.export import to_xml
    from mpvi_bt.tree.yaml_io import load_tree

    made = to_xml(load_tree(paths.find_or_file("trees", tree, "tree")))
    return {"": made.xml}, made.warnings


def _to_yaml(tree: str, main_tree: str | None) -> tuple[dict[str, str], Sequence[Problem]]:
    from mpvi_bt.btcpp.encoding import read_xml
    from mpvi_bt.btcpp.importing import from_xml
    from mpvi_bt.tree.yaml_io import dump_tree

    made = from_xml(read_xml(tree), tree, main_tree)
    trees = {"": made.main, **made.subtrees}
    return {name: dump_tree(spec) for name, spec in trees.items()}, made.warnings


def _write(out: Path, main: str, beside: Mapping[str, str], force: bool) -> list[str]:
    """Write all files, or none if one would be written over; their paths, OUT first. Raises UserError, BackendError."""
    files = {out: main}
    for name, text in beside.items():
        file = out.with_name(f"{name}.yaml")
        if file == out:
            raise UserError(f"{file}: a subtree needs that name. Write to another file.")
        files[file] = text
    for file, text in files.items():
        if not force and file.is_file() and file.read_bytes() != text.encode():
            why = "" if file == out else ", and a subtree needs that name"
            raise UserError(f"{file}: is there already with another text{why}. Write elsewhere, or give --force.")
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise unwritable(out.parent, error) from None
    for file, text in files.items():
        write_whole(file, text)
    return [str(file) for file in files]


def grouped(warnings: Sequence[Problem]) -> list[str]:
    """One line for each message, with the place of the first and how many more there are."""
    same: dict[Any, list[Problem]] = {}
    for problem in warnings:
        same.setdefault((problem.code, problem.message), []).append(problem)
    return [f"{found[0]}" + (f" (and {len(found) - 1} more)" if found[1:] else "") for found in same.values()]
