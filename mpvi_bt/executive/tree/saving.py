"""The state of every node of a tree as JSON values, so that another process can resume. No pickles.

Each node defines its own state (`Node.state`). Work of a backend that was interrupted begins anew, since the backend's
state is not saved: a navigator plans again from the present base pose.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Literal

from py_trees.behaviour import Behaviour
from py_trees.common import Status
from pydantic import Field, JsonValue

from mpvi_bt.executive.behaviors.node import Node
from mpvi_bt.executive.behaviors.stand_ins import StandIn
from mpvi_bt.executive.tree.build import Tree
from mpvi_bt.ground.errors import UserError, nearest
from mpvi_bt.ground.marked_yaml import Record

MAX_STEPS = 10**9  # a year of control steps


class SavedNode(Record):
    """How one node stands.

    Attributes:
        status: As in `NodeState`.
        feedback: Its line.
        interrupted, ended: As in `NodeState`.
        state: What the node declares.
    """

    status: Literal["SUCCESS", "FAILURE", "RUNNING", "INVALID"]
    feedback: str = ""
    interrupted: bool = False
    ended: Literal["", "SUCCESS", "FAILURE"] = ""
    state: dict[str, JsonValue] = {}


class SavedTree(Record):
    """How a tree stands between two ticks.

    Attributes:
        ticks: How often it was ticked.
        nodes: By path, those that do not stand as they do before the first tick.
    """

    ticks: Annotated[int, Field(ge=0, le=MAX_STEPS)]
    nodes: dict[str, SavedNode]


def save(tree: Tree) -> SavedTree:
    """How a tree stands now."""
    nodes = {path: _saved(node) for path, node in tree.nodes.items()}
    return SavedTree(ticks=tree.ticks, nodes={path: node for path, node in nodes.items() if node != _FRESH})


_FRESH = SavedNode(status="INVALID")


def _saved(node: Behaviour) -> SavedNode:
    state = node.state() if isinstance(node, Node) else {}
    return SavedNode(
        status=node.status.value,
        feedback=node.feedback_message,
        interrupted=bool(getattr(node, "interrupted", False)),
        ended=getattr(node, "ended", ""),
        state=state,
    )


def restore(tree: Tree, saved: SavedTree) -> None:
    """Bring a tree after setup to the saved state of another tree of the same spec.

    Raises:
        UserError: The saved nodes are not those of this tree, or one's state is not what it can use.
    """
    for path in saved.nodes:
        if path not in tree.nodes:
            hint = f" Nearest: {near!r}." if (near := nearest(path, tree.nodes)) else ""
            raise UserError(f"the saved run is of another tree: {tree.spec.name!r} has no node {path!r}.{hint}")
    begun_anew = set(_begun_anew(tree, saved.nodes))
    tree.ticks = saved.ticks
    for path, node in tree.nodes.items():
        stood = saved.nodes.get(path, _FRESH)
        node.status = Status.INVALID if path in begun_anew else Status(stood.status)
        node.feedback_message = stood.feedback
        if isinstance(node, Node):
            node.interrupted, node.ended = stood.interrupted, stood.ended
            try:
                node.restore(dict(stood.state))
            except (KeyError, TypeError, ValueError, AttributeError) as error:
                said = str(error) if type(error) is ValueError else repr(error)
                raise UserError(f"{path}: its saved state cannot be used: {said:.300}") from None


def _begun_anew(tree: Tree, saved: Mapping[str, SavedNode]) -> Iterator[str]:
    """Paths of running nodes that drive a backend."""
    for placed in tree.spec.nodes:
        stood = saved.get(placed.path)
        drives = placed.spec.type.robot and not isinstance(tree.nodes.get(placed.path), StandIn)
        if stood and stood.status == "RUNNING" and drives:
            yield placed.path
