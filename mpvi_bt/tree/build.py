"""TreeSpec -> py_trees. Needs no backend; those arrive at `Tree.setup`."""

from __future__ import annotations

import contextlib
import importlib
import traceback
from collections.abc import Callable, Iterator
from typing import Any

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from mpvi_bt.behaviors.context import Context, Failure
from mpvi_bt.behaviors.node import failure_of
from mpvi_bt.errors import MpviError, NodeError
from mpvi_bt.tree.spec import NodeSpec, TreeSpec
from mpvi_bt.tree.state import NodeState


class Tree:
    """A tree that can be ticked.

    Attributes:
        spec: What it was built from.
        root: The py_trees root.
        nodes: Every py_trees node by its path, in the order of `spec.nodes`.
    """

    def __init__(self, spec: TreeSpec) -> None:
        self.spec = spec
        self.root = _build(spec.root)
        self._last: dict[str, NodeState] | None = None
        paths = [placed.path for placed in spec.nodes]
        self.nodes: dict[str, Behaviour] = dict(zip(paths, _walk(self.root), strict=True))
        for path, node in self.nodes.items():
            vars(node)["path"] = path

    def setup(self, context: Context) -> None:
        """Hand every node the run's backends.

        Raises:
            UserError: A node names something that the run does not have.
            NodeError: A node's setup broke.
        """
        for path, node in self.nodes.items():
            try:
                node.setup(context=context)
            except MpviError:
                raise
            except Exception as error:
                raise NodeError(path, error) from error

    def tick(self) -> Status:
        """Tick once; the root's status.

        Raises:
            NodeError: A behavior raised; every node has been terminated.
        """
        self._last = None
        try:
            self.root.tick_once()
        except Exception as error:
            path = self._culprit(error)
            self._last = {**self.interrupt(), path: NodeState("FAILURE", f"error: {error!r}")}
            raise NodeError(path, error) from error
        except BaseException:
            self.interrupt()
            raise
        return self.root.status

    def _culprit(self, error: Exception) -> str:
        """Path of the node in which an exception arose.

        py_trees does not say whose it was, but the traceback does: it is the innermost frame's own node.
        """
        owners = (frame.f_locals.get("self") for frame, _ in traceback.walk_tb(error.__traceback__))
        nodes = [owner for owner in owners if isinstance(owner, Behaviour)]
        return next((path for path, node in self.nodes.items() if nodes and node is nodes[-1]), self.spec.nodes[0].path)

    def interrupt(self) -> dict[str, NodeState]:
        """Terminate every node as interrupted, leaves first, whatever state an exception may have left them in.

        `states` goes on telling how they stood before, so that the last picture shows where it ended.
        """
        self._last = states = self.states()
        for node in reversed(self.nodes.values()):
            with contextlib.suppress(Exception):  # one that cannot stop must not keep the others from it
                node.stop(Status.INVALID)
        return states

    @property
    def status(self) -> Status:
        """The root's status."""
        return self.root.status

    @property
    def failure(self) -> Failure | None:
        """Why the root failed, or None if it did not."""
        return failure_of(self.root)

    def states(self) -> dict[str, NodeState]:
        """What `render.ascii_tree` draws: status, feedback and time of every node, by path."""
        if self._last is not None:
            return self._last
        return {
            path: NodeState(
                node.status.value,
                node.feedback_message if node.status != Status.INVALID else "",
                getattr(node, "elapsed_s", None) if node.status != Status.INVALID else None,
                getattr(node, "limit_s", None),
                node.status == Status.SUCCESS and getattr(node, "failure", None) is not None,
            )
            for path, node in self.nodes.items()
        }

    def statuses(self) -> list[Status]:
        """Status of every node, in the order of `spec.nodes`; cheap enough for every tick."""
        return [node.status for node in self.nodes.values()]


def _build(node: NodeSpec) -> Behaviour:
    children = [_build(child) for child in node.children]
    arguments: dict[str, Any] = dict(node.parameters)
    if node.type.family == "composite":
        arguments["children"] = children
    elif node.type.family == "decorator":
        arguments["child"] = children[0]
    module, _, name = node.type.factory.partition(":")
    factory: Callable[..., Behaviour] = getattr(importlib.import_module(module), name)
    return factory(name=node.name or node.kind, **arguments)


def _walk(node: Behaviour) -> Iterator[Behaviour]:
    """Parents before children."""
    yield node
    for child in node.children:
        yield from _walk(child)
