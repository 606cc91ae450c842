"""XML of BehaviorTree.CPP 4 as our trees: the subset that has an equal here.

The elements become the data that a YAML file of ours would hold, with the places of the XML, and the reader of trees
does the rest; so values are checked and problems are told as they are of our own files.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from mpvi_bt.executive.btcpp import equivalents, nav2
from mpvi_bt.executive.btcpp.element_reader import ElementReader
from mpvi_bt.executive.btcpp.file import XmlFile
from mpvi_bt.executive.btcpp.format import check
from mpvi_bt.executive.btcpp.models import fill_in, models_of
from mpvi_bt.executive.btcpp.placeholders import module_text, node_types_of, placeholders_of
from mpvi_bt.executive.btcpp.subtree_ports import Calls
from mpvi_bt.executive.tree.spec import TreeSpec
from mpvi_bt.ground.errors import FileProblems, Problem
from mpvi_bt.ground.marked_xml import parse_xml


@dataclass(frozen=True)
class ImportedTrees:
    """What came of a file.

    Attributes:
        main: The tree to execute; its calls of the others are subtree nodes.
        subtrees: The other trees, by the names that the calls use.
        warnings: What BehaviorTree.CPP does otherwise, or what was left out, each with its place.
        module: Text of a Python module with the nodes that have to be written, "" if there are none.
    """

    main: TreeSpec
    subtrees: Mapping[str, TreeSpec]
    warnings: tuple[Problem, ...]
    module: str = ""


def from_xml(
    text: str, name: str = "<xml>", main_tree: str | None = None, placeholders: str | None = None
) -> ImportedTrees:
    """The trees of a file's text.

    Args:
        text: Of the file.
        name: Stands for the file in problems.
        main_tree: ID of the tree to run; None: what the file says, or the only one that no other calls.
        placeholders: Name of a module, for a file beside the trees, whose nodes leaves become that nobody knows here;
            None: they are problems.

    Raises:
        UnknownName: There is no tree `main_tree`.
        FileProblems: Everything in it that has no equal here.
    """
    root = parse_xml(text, name)
    file = XmlFile(name)
    main = file.trees_of(root, main_tree)
    models = models_of(file, root)
    fill_in(file, models)
    check(file, root)
    for own in file.trees:
        tree = nav2.rewritten(file, own)
        file.trees[own] = replace(tree, children=[equivalents.rewritten(file, tree.children[0])])
    module = ""
    if placeholders is not None and (found := placeholders_of(file, models)):
        module = module_text(found.values(), Path(name).name, placeholders)
        file.placeholders, file.own, file.module = found, node_types_of(module, placeholders), placeholders
    calls = Calls(file)
    specs = {
        own: spec for own in file.trees if (spec := ElementReader(file, calls, own).read(main=own == main)) is not None
    }
    if main is None or file.problems:
        raise FileProblems(_listed_once(_once(file.problems)))
    return ImportedTrees(specs.pop(main), specs, tuple(_once(file.warnings)), module)


def _once(problems: list[Problem]) -> list[Problem]:
    """In the order of the file, without repeated ones from a tree's calls."""
    found = {(p.line, p.column, p.message): p for p in problems}
    return [found[key] for key in sorted(found)]


def _listed_once(problems: list[Problem]) -> list[Problem]:
    """The list of known nodes only with the first unknown one."""
    unknown = [p for p in problems if p.code == "unknown-node"][1:]
    return [replace(p, message=p.message.partition(" Known: ")[0]) if p in unknown else p for p in problems]
