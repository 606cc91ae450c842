"""A tree on a kinematic robot, ticked by hand; what several tests of behaviors share."""

from __future__ import annotations

from collections.abc import Mapping

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from mpvi_bt.executive.behaviors.context import Failure
from mpvi_bt.executive.behaviors.parameters import Value
from mpvi_bt.executive.plan.skills import load_skills
from mpvi_bt.executive.tree.build import Tree
from mpvi_bt.executive.tree.yaml_io import parse_tree
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.testing import KinematicWorld, scripted_context
from tests.layouts import BASE

SKILLS = load_skills()
HELD = "the cup is held in a gripper"
PLACES = {"cup": (1.0, 0.0), "sink": (0.0, 2.0)}
PICK = f"until_complete:\nchildren: [{{manipulate: pick up the cup}}, {{check_complete: {HELD}, skill: pick}}]"


def tree(root: str) -> Tree:
    """The tree of a root node's YAML."""
    indented = "".join(f"  {line}\n" for line in root.splitlines())
    return Tree(parse_tree(f"tree: t\nroot:\n{indented}", "t.yaml", SKILLS))


class Bench:
    """A tree on a kinematic robot, ticked by hand."""

    def __init__(self, root: str, answers: Mapping[str, tuple[bool, ...]] | None = None, **blackboard: Value) -> None:
        self.world = KinematicWorld()
        self.context = scripted_context(self.world, SKILLS, PLACES, answers or {HELD: (True,)})
        self.context.blackboard.update(blackboard)
        self.tree = tree(root)

    def run(self, ticks: int = 10_000) -> Status:
        """Tick and step until the root ends, or so often."""
        for _ in range(ticks):
            if self.tick() != Status.RUNNING:
                break
        return self.tree.status

    def tick(self) -> Status:
        """Tick once and step the world."""
        if not hasattr(self.tree.root, "context"):
            self.tree.setup(self.context)
        status = self.tree.tick()
        self.world.step()
        return status

    def node(self, end: str) -> Behaviour:
        """The one node whose path ends so."""
        (found,) = [node for path, node in self.tree.nodes.items() if path.endswith(end)]
        return found

    @property
    def base(self) -> Array:
        """The base's part of the present command."""
        return self.world.robot.action[BASE]

    @property
    def failure(self) -> Failure:
        """Why the root failed."""
        assert self.tree.failure is not None
        return self.tree.failure
