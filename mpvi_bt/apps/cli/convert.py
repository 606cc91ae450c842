"""`mpvi convert`: trees of ours as XML of BehaviorTree.CPP 4, and the other way."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

from mpvi_bt.apps.cli.argument_types import File
from mpvi_bt.executive.drawing.terminal import give, tell
from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import Problem, UserError
from mpvi_bt.ground.writing import unwritable, write_whole

FORMATS = {".xml": "xml", ".yaml": "yaml", ".yml": "yaml"}


@click.command()
@click.argument("tree", type=File("trees"))
@click.argument("out", type=File(), required=False)
@click.option(
    "--to", type=click.Choice(["xml", "yaml"]), help="Format to write. [default: by OUT, or the one that TREE is not]"
)
@click.option(
    "--main-tree", metavar="ID", help="From XML: tree to run. [default: main_tree_to_execute, or the outermost]"
)
@click.option(
    "--placeholders",
    is_flag=True,
    help="From XML: turn unknown leaves into stand-ins, and write a Python module beside OUT for you to fill in.",
)
@click.option("--force", is_flag=True, help="Overwrite existing files that differ.")
@click.option("--json", "as_json", is_flag=True, help="For programs: one JSON object with the text and the warnings.")
def convert(
    tree: str, out: str | None, to: str | None, main_tree: str | None, placeholders: bool, force: bool, as_json: bool
) -> None:
    """Turn a tree into XML of BehaviorTree.CPP 4, which Groot2 opens, or such XML into a tree.

    TREE is a file, or the name of a tree. Without OUT the text is shown. From XML, the trees of its SubTrees are
    written beside OUT, a file each. What the other side does otherwise is told as warnings. A file that is there
    already with another text is written over only with --force; a module with your nodes never is.
    """
    target = _target(tree, out, to)
    if target == "xml" and (main_tree is not None or placeholders):
        which = "--placeholders is" if placeholders else "--main-tree is"
        raise UserError(f"{which} for XML; {tree} is a tree of ours.")
    module = re.sub(r"\W", "_", Path(out or tree).stem) + "_nodes" if placeholders else None
    made = _to_xml(tree) if target == "xml" else _to_yaml(tree, main_tree, module)
    files: list[str] = []
    if out is not None:
        files = _write(Path(out), made, force)
    elif len(made.files) > 1 and not as_json:
        message = f"{tree}: it becomes {len(made.files)} files: name one to write to"
        raise UserError(f"{message}, such as trees/{Path(tree).stem}.yaml.")
    if as_json:
        told: dict[str, Any] = {target: made.files[""]}
        if target == "yaml":
            told |= {"subtrees": made.subtrees, "module": made.module}
        told |= {"out": out, "files": files, "warnings": [vars(p) for p in made.warnings]}
        tell(json.dumps(told, indent=2))
        return
    if out is None:
        give(made.files[""])
    for file in files[1:]:
        what = "your nodes, to be written" if file.endswith(".py") else "a subtree"
        click.echo(f"wrote {file} too: {what}", err=True)
    for line in grouped(made.warnings):
        click.echo(line, err=True)


@dataclass(frozen=True)
class _Made:
    """What a tree became.

    Attributes:
        files: Texts by the names of their files beside OUT; OUT itself is "".
        warnings: What differs.
    """

    files: Mapping[str, str]
    warnings: Sequence[Problem]

    @property
    def subtrees(self) -> dict[str, str]:
        """Texts of the other trees, by their names."""
        return {Path(name).stem: text for name, text in self.files.items() if name.endswith(".yaml")}

    @property
    def module(self) -> str | None:
        """Text of the module with the nodes to be written, if there are any."""
        return next((text for name, text in self.files.items() if name.endswith(".py")), None)


def _target(tree: str, out: str | None, to: str | None) -> str:
    """What to write: "xml" or "yaml"."""
    other = "yaml" if Path(tree).suffix == ".xml" else "xml"
    named = other if out is None else FORMATS.get(Path(out).suffix)
    if named is None:
        raise UserError(f"{out}: write to a file that ends in .{other}.")
    if to not in (None, other) or named != other:
        raise UserError(f"{tree} can only become {other}, not {to if to not in (None, other) else named}.")
    return other


def _to_xml(tree: str) -> _Made:
    from mpvi_bt.executive.btcpp.export import to_xml
    from mpvi_bt.executive.tree.yaml_io import load_tree

    made = to_xml(load_tree(paths.find_or_file("trees", tree, "tree")))
    return _Made({"": made.xml}, made.warnings)


def _to_yaml(tree: str, main_tree: str | None, module: str | None) -> _Made:
    from mpvi_bt.executive.btcpp.encoding import read_xml
    from mpvi_bt.executive.btcpp.importing import from_xml
    from mpvi_bt.executive.tree.yaml_io import dump_tree

    made = from_xml(read_xml(tree), tree, main_tree, module)
    files = {"": dump_tree(made.main)} | {f"{name}.yaml": dump_tree(spec) for name, spec in made.subtrees.items()}
    if made.module:
        files[f"{module}.py"] = made.module
    return _Made(files, made.warnings)


def _write(out: Path, made: _Made, force: bool) -> list[str]:
    """Write all files, or none if one would be written over; their paths, OUT first. Raises UserError, BackendError."""
    files = {out: made.files[""]}
    for name, text in made.files.items():
        file = out.with_name(name) if name else out
        if name and file == out:
            raise UserError(f"{file}: a subtree needs this file name. Write to another file.")
        if file.suffix == ".py" and file.is_file() and file.read_bytes() != text.encode():
            click.echo(f"kept {file}, which is there already: it must have the nodes of the tree", err=True)
            continue
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
