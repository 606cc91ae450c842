"""Sequence, selector and until_complete: py_trees' composites, with our paths and named exceptions."""

from __future__ import annotations

from collections.abc import Sequence as List

from py_trees import composites
from py_trees.behaviour import Behaviour
from py_trees.common import ParallelPolicy

from mpvi_bt.behaviors.node import Node


class Sequence(Node, composites.Sequence):
    """Children in order, until one fails. With memory a child that succeeded is not ticked again in this round."""

    def __init__(self, name: str, children: List[Behaviour], memory: bool) -> None:
        super().__init__(name=name, memory=memory, children=list(children))


class Selector(Node, composites.Selector):
    """Children in order, until one succeeds. With memory a child that failed is not ticked again in this round."""

    def __init__(self, name: str, children: List[Behaviour], memory: bool) -> None:
        super().__init__(name=name, memory=memory, children=list(children))


class UntilComplete(Node, composites.Parallel):
    """All children side by side until the last one succeeds, which interrupts the others; any failure fails it.

    Children are ticked in order, so that a completion check sees the step's new state after the policy has acted, and
    its SUCCESS has the last word on the robot's command: hold.
    """

    def __init__(self, name: str, children: List[Behaviour]) -> None:
        policy = ParallelPolicy.SuccessOnSelected(children=[children[-1]], synchronise=True)
        super().__init__(name=name, policy=policy, children=list(children))
