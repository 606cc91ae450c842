"""The time of a tick of a reactive tree of 300 nodes, against py_trees' own nodes; and what tracing adds to ours.

    python benchmarks/ticking.py

The tree is made of memoryless sequences and selectors over tests of blackboard values, most of which fail, with some
decorators: nearly every node is ticked at every tick. Its twin has the same shape in py_trees' own classes, twice:
with py_trees' own CheckBlackboardVariableValue, and with the least leaf that one could write for py_trees, which reads
a dict and tells nobody why it failed. The sides alternate within one run, so that noise meets all of them.
"""

from __future__ import annotations

import operator
import statistics
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import py_trees
from py_trees.behaviour import Behaviour
from py_trees.common import ComparisonExpression, Status

from mpvi_bt.executive.behaviors.parameters import Value
from mpvi_bt.executive.behaviors.registry import node_type
from mpvi_bt.executive.tree.build import Tree
from mpvi_bt.executive.tree.spec import NodeSpec, TreeSpec
from mpvi_bt.runs.recording.recorder import Recorder
from mpvi_bt.testing import KinematicWorld, scripted_context

ROUNDS, TICKS = 40, 20
VALUES: dict[str, Value] = {"cups": 1, "door": "open", "bell": False}

Check = Callable[[str, str, Any], Behaviour]  # of a key: "=" or ">=" a value


def node(kind: str, *children: NodeSpec, **parameters: object) -> NodeSpec:
    """A node of ours."""
    return NodeSpec(kind, node_type(kind).parameters.model_validate(parameters), "", children)


def reactive(branches: int) -> NodeSpec:
    """1 + 13 x branches nodes: rules that do not apply, but the last; the one before it, if the bell rings."""

    def rule(at: int) -> NodeSpec:
        last, bell = at == branches - 1, at == branches - 2
        both = {"memory": False}
        return node(
            "sequence",
            node("test", key="door", equals="open"),
            node("test", key="cups", at_least=1),
            node("invert", node("test", key="cups", at_least=2 + at % 3)),
            node(
                "selector",
                node("sequence", node("test", key="door", equals="shut"), node("succeed"), **both),
                node("condition", node("test", key="cups", at_least=2), key="door", equals="open"),
                node("succeed") if last else node("test", key="bell" if bell else "cups", equals=bell),
                **both,
            ),
            node("test", key="cups", at_least=1) if last else node("succeed"),
            **both,
        )

    return node("selector", *(rule(at) for at in range(branches)), memory=False)


def twin(spec: NodeSpec, check: Check) -> Behaviour:
    """The same in py_trees' own classes."""
    name, below, given = spec.label, [twin(child, check) for child in spec.children], dict(spec.parameters)
    match spec.kind:
        case "sequence":
            return py_trees.composites.Sequence(name, given["memory"], below)
        case "selector":
            return py_trees.composites.Selector(name, given["memory"], below)
        case "invert":
            return py_trees.decorators.Inverter(name, below[0])
        case "condition":
            key, wanted = given["key"], given["equals"]
            return py_trees.decorators.EternalGuard(name, below[0], lambda: bool(VALUES[key] == wanted))
        case "succeed":
            return py_trees.behaviours.Success(name)
        case "wait":
            return py_trees.behaviours.Running(name)
        case _:
            if given["equals"] is not None:
                return check(given["key"], "=", given["equals"])
            return check(given["key"], ">=", given["at_least"])


def own_check(key: str, sign: str, wanted: Any) -> Behaviour:
    """As py_trees provides it."""
    compared = ComparisonExpression(key, wanted, operator.eq if sign == "=" else operator.ge)
    return py_trees.behaviours.CheckBlackboardVariableValue(f"{key} {sign} {wanted}", compared)


class LeastCheck(Behaviour):
    """As small as a leaf for py_trees can be."""

    def __init__(self, key: str, sign: str, wanted: Any) -> None:
        super().__init__(f"{key} {sign} {wanted}")
        self.key, self.wanted = key, wanted
        self.compare: Callable[[Any, Any], bool] = operator.eq if sign == "=" else operator.ge

    def update(self) -> Status:
        """Look."""
        return Status.SUCCESS if self.compare(VALUES[self.key], self.wanted) else Status.FAILURE


def ours(root: NodeSpec) -> Tree:
    """Ready to be ticked."""
    tree, world = Tree(TreeSpec("reactive", root)), KinematicWorld()
    context = scripted_context(world, {}, {}, {})
    context.blackboard.update(VALUES)
    tree.setup(context)
    return tree


def alternating(sides: Sequence[Callable[[], object]], rounds: int = ROUNDS, ticks: int = TICKS) -> list[list[float]]:
    """Seconds of a tick of each side, in each round."""
    times: list[list[float]] = [[] for _ in sides]
    for at in range(rounds):
        for side in range(len(sides)) if at % 2 else reversed(range(len(sides))):
            began = time.perf_counter()
            for _ in range(ticks):
                sides[side]()
            times[side].append((time.perf_counter() - began) / ticks)
    return times


def ratio(one: Sequence[float], other: Sequence[float]) -> float:
    """Of the times of two sides: the median over rounds."""
    return statistics.median(a / b for a, b in zip(one, other, strict=True))


def ticker(root: NodeSpec, rings: int, noted: bool = True, trace: Path | None = None) -> Callable[[], None]:
    """One tick of a tree of ours.

    Args:
        root: Its root.
        rings: After so many ticks the bell begins or ends to ring, and another rule applies; 0: never.
        noted: Whether the Tree ticks it and notes which nodes it touched, or it is ticked as in py_trees.
        trace: Where to write the trace, if at all.
    """
    tree, world = ours(root), KinematicWorld()
    recorder = Recorder(trace) if trace else None
    if recorder is not None:
        recorder.start(tree, world)
    ticks = 0

    def tick() -> None:
        nonlocal ticks
        ticks += 1
        if rings and ticks % rings == 0:
            tree.context.blackboard["bell"] = not tree.context.blackboard["bell"]
        if noted:
            tree.tick()
        else:
            tree.root.tick_once()
            tree._resets.clear()  # the bare side of the comparison
        if recorder is not None:
            recorder.step(tree, world)

    return tick


def chain(depth: int) -> NodeSpec:
    """Sequences of one child each, one inside the other."""
    at = node("wait", duration=86400.0)
    for _ in range(depth):
        at = node("sequence", at, memory=False)
    return at


def main() -> None:
    """Print the comparisons."""
    root = reactive(23)
    tree = ours(root)
    py_trees.blackboard.Blackboard.storage.update({f"/{key}": value for key, value in VALUES.items()})
    own, least = twin(root, own_check), twin(root, LeastCheck)
    mine, theirs, bare = alternating([tree.tick, own.tick_once, least.tick_once])
    assert tree.status == own.status == least.status == Status.SUCCESS
    print(f"{len(tree.nodes)} nodes, a tick of")
    for what, times in (("ours", mine), ("py_trees' own", theirs), ("py_trees, least leaves", bare)):
        print(f"  {what:40s}{1e6 * statistics.median(times):7.0f} us   ours / this {ratio(mine, times):5.2f}")
    with tempfile.TemporaryDirectory() as folder:
        for rings, when in ((0, "nothing changes"), (30, "another rule applies, once a second")):
            sides = [
                ticker(root, rings, noted=False),
                ticker(root, rings),
                ticker(root, rings, trace=Path(folder, "t")),
            ]
            bare, noted, written = alternating(sides, ticks=max(rings, TICKS))
            print(f"ours, {when}")
            print(f"  {'the nodes alone':40s}{1e6 * statistics.median(bare):7.0f} us")
            print(f"  {'noting which were touched':40s}{100 * (ratio(noted, bare) - 1):+7.1f} %")
            print(f"  {'tracing on top of that':40s}{100 * (ratio(written, noted) - 1):+7.1f} %")
    deep = chain(100)
    mine, theirs = alternating([ours(deep).tick, twin(deep, LeastCheck).tick_once])
    print(f"a chain 100 deep: ours {1e6 * statistics.median(mine):.0f} us, ours / py_trees {ratio(mine, theirs):.2f}")


if __name__ == "__main__":
    main()
