"""Replace the tree of a run by a new version: nodes that did not change go on, others are replaced."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial

from py_trees.common import Status

from mpvi_bt.executive.tree.build import Tree
from mpvi_bt.executive.tree.spec import NodeSpec, Placed, TreeSpec
from mpvi_bt.ground.errors import UserError, shown


@dataclass(frozen=True)
class Updated:
    """What became of a tree.

    Attributes:
        changed: Paths, as they were before, of what gave place; or of the last child, where more were put behind it.
        interrupted: Those of them that ran.
    """

    changed: tuple[str, ...]
    interrupted: tuple[str, ...]


def update(tree: Tree, new: TreeSpec) -> Updated:
    """Make it the new one, between two ticks, by as few swaps as that takes.

    Children of the same number are compared one by one, others up to the first that differs; from there on the new ones
    stand in the place of the old.

    Raises:
        UserError: The new one has keys of the blackboard that begin with a run, or what is left out runs; nothing was
            changed.
    """
    if keys := sorted(new.blackboard.keys() - tree.spec.blackboard.keys()):
        raise UserError(f"the key {shown(keys[0])} of the blackboard is new; first values are given when a run begins")
    placed = {node.path: node for node in tree.spec.nodes}
    changes = list(_changes(tree, placed, tree.spec.nodes[0], new.root))
    interrupted = tuple(path for path, _ in changes if tree.nodes[path].status == Status.RUNNING)
    for _, make in reversed(changes):  # from the last, as names of siblings are told apart by those before
        make()
    return Updated(tuple(path for path, _ in changes), interrupted)


Change = tuple[str, Callable[[], None]]


def _changes(tree: Tree, placed: Mapping[str, Placed], at: Placed, new: NodeSpec) -> Iterator[Change]:
    """Path and swap of each change, in the order of the tree."""
    old = at.spec
    if old == new:
        return
    if replace(old, children=()) != replace(new, children=()) or not old.children or not new.children:
        yield at.path, partial(tree.swap, at.path, new)
    elif len(old.children) == len(new.children):
        for path, child in zip(at.children, new.children, strict=True):
            yield from _changes(tree, placed, placed[path], child)
    else:
        yield _rest(tree, at, new)


def _rest(tree: Tree, at: Placed, new: NodeSpec) -> Change:
    """Of a node with more or fewer children: from the first that differs on, all are the new ones."""
    same = 0
    for one, other in zip(at.spec.children, new.children, strict=False):
        if one != other:
            break
        same += 1
    rest = new.children[same:]
    running = [path for path in at.children[same:] if tree.nodes[path].status == Status.RUNNING]
    if not rest and running:
        raise UserError(f"{running[0]} is left out, and runs")
    if same == 0:
        return at.children[0], partial(tree.swap_rest, at.children[0], rest)
    first = running[0] if running else at.children[min(same, len(at.children) - 1)]
    return first, partial(tree.swap_after, at.children[same - 1], rest)
