"""A tree that runs takes the new text of its file: what is the same goes on, and no part of a text is taken alone."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from py_trees.common import Status

from mpvi_bt.executive.ticking.dry import EmptyWorld, dry_context, dry_tree
from mpvi_bt.executive.tree.build import Tree
from mpvi_bt.executive.tree.spec import TreeSpec
from mpvi_bt.executive.tree.updating import Updated, update
from mpvi_bt.executive.tree.yaml_io import parse_tree
from mpvi_bt.ground.errors import UserError
from tests.tree_strategies import trees

DAY = """\
tree: day
root:
  sequence: day
  memory: true
  children:
    - say: good morning
    - timeout: 9
      child: {wait: 1}
    - wait: 2
    - say: good night
"""


def ticked(spec: TreeSpec, ticks: int) -> tuple[Tree, EmptyWorld]:
    """A tree after so many ticks."""
    tree, world = dry_tree(spec), EmptyWorld()
    tree.setup(dry_context(world, tree))
    for _ in range(ticks):
        tick(tree, world)
    return tree, world


def tick(tree: Tree, world: EmptyWorld) -> Status:
    status = tree.tick()
    world.step()
    return status


@pytest.mark.parametrize(
    ("old", "new", "changed", "interrupted"),
    [
        ("good night", "sleep well", ["day/say#2"], []),
        ("good morning", "hello", ["day/say"], []),
        ("wait: 2", "wait: 3", ["day/wait"], []),
        ("wait: 1", "wait: 4", ["day/timeout/wait"], ["day/timeout/wait"]),
        ("timeout: 9", "timeout: 8", ["day/timeout"], ["day/timeout"]),
        ("- say: good night", "- say: good night\n    - say: and farewell", ["day/say#2"], []),
        ("    - say: good night\n", "", ["day/say#2"], []),
        ("- wait: 2", "- say: soon\n    - wait: 2", ["day/wait"], []),
        ("tree: day", "tree: day\nabout: a day", [], []),
    ],
)
def test_what_is_the_same_goes_on(old: str, new: str, changed: list[str], interrupted: list[str]) -> None:
    """Only where a change lies is anything begun anew; a step that is over is not done again."""
    tree, world = ticked(parse_tree(DAY), 5)
    goal = parse_tree(DAY.replace(old, new))
    assert update(tree, goal) == Updated(tuple(changed), tuple(interrupted))
    assert tree.spec.root == goal.root
    running = tree.nodes["day/timeout"].status
    assert (running == Status.RUNNING) == ("day/timeout" not in interrupted)
    while tick(tree, world) == Status.RUNNING:
        pass
    assert tree.status == Status.SUCCESS
    assert ("hello" in DAY.replace(old, new)) <= (tree.nodes["day/say"].status == Status.INVALID)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (DAY.partition("    - timeout")[0], "day/timeout is left out, and runs"),
        (DAY.replace("root:", "blackboard: {laps: 0}\nroot:"), "'laps' of the blackboard is new"),
    ],
)
def test_a_text_is_taken_whole_or_not_at_all(text: str, said: str) -> None:
    """Where a part of it cannot be put into the tree, the others are not either."""
    tree, _ = ticked(parse_tree(DAY), 5)
    before = tree.spec, tree.statuses()
    with pytest.raises(UserError, match=said):
        update(tree, parse_tree(text))
    assert (tree.spec, tree.statuses()) == before


@given(trees, trees, st.integers(0, 4))
@settings(deadline=None)
def test_any_tree_becomes_any_other(old: TreeSpec, new: TreeSpec, ticks: int) -> None:
    """It is then the new one, node by node, and goes on."""
    tree, world = ticked(old, ticks)
    update(tree, replace(new, blackboard=old.blackboard))
    assert tree.spec.root == new.root
    assert list(tree.nodes) == [placed.path for placed in new.nodes]
    tick(tree, world)
