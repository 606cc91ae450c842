"""Trees as YAML files that read like an outline.

    tree: fetch
    parameters:
      object: text
      room: {type: text, default: kitchen}
    root:
      sequence: fetch the $object
      memory: true
      children:
        - navigate: $object
          room: $room
        - timeout: 90
          child:
            navigate: sofa
        - subtree: put_away
          arguments: {object: $object}

The first key of a node is its kind and holds its headline parameter, the other keys its other parameters; `children:`
or `child:` come last. `segments:` names the plan's segments that a node came from; where it is left out it is the
parent's. `$name` is a parameter of the tree, filled in here, or else a blackboard key, filled in when the node begins.
A subtree's file is read, its parameters filled in, and its root becomes the child of the node that calls it.
Writing a tree and reading it again gives the same tree.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mpvi_bt.executive.behaviors.parameters import Value
from mpvi_bt.executive.plan.skills import Skill
from mpvi_bt.executive.tree.reader import read
from mpvi_bt.executive.tree.spec import TreeSpec
from mpvi_bt.executive.tree.tree_file import TreeReading
from mpvi_bt.executive.tree.writer import dump_tree, expanded
from mpvi_bt.ground.file_kinds import expect
from mpvi_bt.ground.marked_yaml import SourceMarks, load_marked, parse_marked

__all__ = ["check_tree", "dump_tree", "expanded", "from_expanded", "load_tree", "parse_tree"]


def load_tree(
    path: str | Path, skills: Mapping[str, Skill] | None = None, arguments: Mapping[str, Value] | None = None
) -> TreeSpec:
    """A tree from its file.

    Args:
        path: A YAML file.
        skills: If given, the skills that the tree names must be among them.
        arguments: Values of its parameters. Text is read as the parameter's type: "3" is a number where one is due.

    Raises:
        UserError: There is no such file, or an argument that the tree does not have or that is of another type.
        FileProblems: Everything that is wrong with it and with the files of its subtrees.
    """
    return check_tree(*load_marked(path), skills, arguments)


def parse_tree(
    text: str,
    name: str = "<text>",
    skills: Mapping[str, Skill] | None = None,
    arguments: Mapping[str, Value] | None = None,
) -> TreeSpec:
    """As `load_tree`, of a text that `name` stands for in problems."""
    return check_tree(*parse_marked(text, name), skills, arguments)


def check_tree(
    data: Any,
    marks: SourceMarks,
    skills: Mapping[str, Skill] | None = None,
    arguments: Mapping[str, Value] | None = None,
) -> TreeSpec:
    """As `load_tree`, of data that is already loaded."""
    expect("tree", data, marks)
    return read(data, marks, TreeReading(skills), arguments or {})


def from_expanded(data: Any, name: str = "<data>") -> TreeSpec:
    """The tree of what `expanded` gave. `name` stands for it in problems. Raises FileProblems."""
    return read(data, SourceMarks(name), TreeReading(expanded=True), {})
