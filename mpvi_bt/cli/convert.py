"""`mpvi convert`: trees of ours as XML of BehaviorTree.CPP 4, and the other way."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click

from mpvi_bt import paths
from mpvi_bt.errors import Problem, UserError

FORMATS = {".xml": "xml", ".yaml": "yaml", ".yml": "yaml"}


@click.command()
@click.argument("tree")
@click.argument("out", required=False)
@click.option("--to", type=click.Choice(["xml", "yaml"]), help="What to write. [default: by OUT, or what TREE is not]")
@click.option("--json", "as_json", is_flag=True, help="For programs: one JSON object with the text and the warnings.")
def convert(tree: str, out: str | None, to: str | None, as_json: bool) -> None:
    """Turn a tree into XML of BehaviorTree.CPP 4, which Groot2 opens, or such XML into a tree.

    TREE is a file, or the name of a tree. Without OUT the text is shown. From XML, the trees of its SubTrees are
    written beside OUT, a file each. What the other side does otherwise is told as warnings.
    """
    target = _target(tree, out, to)
    texts, warnings = _to_xml(tree) if target == "xml" else _to_yaml(tree)
    main, beside = texts[""], {name: text for name, text in texts.items() if name}
    if out is not None:
        _write(Path(out), main, beside)
    elif beside and not as_json:
        message = f"{tree}: it holds {len(texts)} trees, which become a file each: name one to write to"
        raise UserError(f"{message}, such as trees/{Path(tree).stem}.yaml.")
    if as_json:
        told = {target: main, **({"subtrees": beside} if target == "yaml" else {})}
        click.echo(json.dumps({**told, "out": out, "warnings": [vars(p) for p in warnings]}, indent=2))
        return
    if out is None:
        click.echo(main, nl=False)
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


def _to_yaml(tree: str) -> tuple[dict[str, str], Sequence[Problem]]:
    from mpvi_bt.btcpp.importing import from_xml
    from mpvi_bt.marked_yaml import read_text
    from mpvi_bt.tree.yaml_io import dump_tree

    made = from_xml(read_text(tree), tree)
    trees = {"": made.main, **made.subtrees}
    return {name: dump_tree(spec) for name, spec in trees.items()}, made.warnings


def _write(out: Path, main: str, beside: Mapping[str, str]) -> None:
    """Write all files, or none if one that OUT does not name would be written over."""
    files = {out.with_name(f"{name}.yaml"): text for name, text in beside.items()}
    for file, text in files.items():
        if file == out or (file.exists() and file.read_text(encoding="utf-8") != text):
            raise UserError(f"{file}: is there already, and a subtree needs that name. Write to another folder.")
    for file, text in {**files, out: main}.items():
        try:
            file.write_text(text, encoding="utf-8")
        except OSError as error:
            raise UserError(f"{file}: {(error.strerror or 'cannot be written').lower()}") from None


def grouped(warnings: Sequence[Problem]) -> list[str]:
    """One line for each message, with the place of the first and how many more there are."""
    same: dict[Any, list[Problem]] = {}
    for problem in warnings:
        same.setdefault((problem.code, problem.message), []).append(problem)
    return [f"{found[0]}" + (f" (and {len(found) - 1} more)" if found[1:] else "") for found in same.values()]
