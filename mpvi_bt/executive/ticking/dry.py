"""The dry run: the very tree without robot or simulator. Time passes, and stand-ins do the work."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NoReturn

import numpy as np

from mpvi_bt.executive.behaviors.context import Context
from mpvi_bt.executive.plan.planners import Planner
from mpvi_bt.executive.plan.skills import Skill
from mpvi_bt.executive.ticking.loop import Outcome, Subscriber, run_episode
from mpvi_bt.executive.ticking.replanning import Replanner
from mpvi_bt.executive.ticking.saved_run import SavedRun, restore_world
from mpvi_bt.executive.tree.build import Tree
from mpvi_bt.executive.tree.compile import Drive
from mpvi_bt.executive.tree.spec import TreeSpec
from mpvi_bt.executive.tree.substitute import Rules, stand_ins
from mpvi_bt.ground.errors import NotInDryRun
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.protocols import StepClock
from mpvi_bt.ground.robot.protocol import CameraImage, Proprioception

LIMIT_S = 3600.0  # Our choice: simulated time that a tree alone may take


def dry_tree(spec: TreeSpec, rules: Rules | None = None) -> Tree:
    """The tree with a stand-in for every node that needs a robot.

    Raises:
        FileProblems: A rule fits no node.
        UserError: A parameter of the tree has no value.
    """
    if rules is not None:
        rules.check(spec)
    return Tree(spec, stand_ins(rules, dry=True))


def run_dry(
    tree: Tree,
    skills: Mapping[str, Skill] | None = None,
    subscribers: Sequence[Subscriber] = (),
    max_time_s: float = LIMIT_S,
    stop: Callable[[], bool] = lambda: False,
    world: EmptyWorld | None = None,
    saved: SavedRun | None = None,
    planner: Planner | None = None,
    drive: Drive = "navigator",
) -> Outcome:
    """Tick a tree that needs no robot, as fast as it goes.

    Args:
        tree: Such as `dry_tree` makes.
        skills: By name, for nodes that look them up.
        subscribers: Who watches.
        max_time_s: Simulated time after which it is over.
        stop: Asked before every tick; where it says so the run is interrupted.
        world: Whose time passes; a new one by default.
        saved: Where the run was stopped before, to go on from there.
        planner: Makes new plans where an `attempt` wants one; None: it does without.
        drive: Who carries out the navigation segments of these, as of `compile_plan`.

    Raises:
        NodeError: A behavior raised; also one that asked for a robot though its node type does not say that it does.
        KeyboardInterrupt: Ctrl-C.
    """
    world = world or EmptyWorld()
    context = dry_context(world, tree, skills)
    if planner is not None:
        context.replanning = Replanner(planner, tree, context, drive=drive)
    if saved is not None:
        restore_world(saved, world, context)
    return run_episode(tree, world, context, subscribers, max_time_s, stop=stop, saved=saved.tree if saved else None)


def dry_context(world: EmptyWorld, tree: Tree, skills: Mapping[str, Skill] | None = None) -> Context:
    """A run's context without a backend."""
    return Context(
        clock=world,
        robot=world.robot,
        navigator=_absent("navigator"),
        policy=_absent("policy"),
        checker=_absent("checker"),
        triggers=_absent("triggers"),
        skills=skills or {},
        blackboard=dict(tree.spec.blackboard),
    )


class EmptyWorld(StepClock):
    """A world in which time passes and nothing else is.

    Attributes:
        robot: One that only stands still.
    """

    def __init__(self) -> None:
        self.robot = AbsentRobot()

    def step(self) -> None:
        """Let one control step pass."""
        self.steps += 1

    def save(self) -> dict[str, Any]:
        """Its time."""
        return {"steps": self.steps}

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Take the time of `save`."""
        self.steps = int(saved["steps"])


class AbsentRobot:
    """No robot: it can be told to hold still, and nothing else."""

    _action = np.zeros(0)

    @property
    def action(self) -> Array:
        """No number: there is nothing to command."""
        return self._action

    def hold(self) -> None:
        """Nothing moves anyway."""

    def act(self, action: Array) -> None:
        """Raises NotInDryRun."""
        _refuse("robot")

    def proprioception(self) -> Proprioception:
        """Raises NotInDryRun."""
        _refuse("robot")

    def look(self, camera: str) -> CameraImage:
        """Raises NotInDryRun."""
        _refuse("robot")


class _Absent:
    """A backend that is not there."""

    def __init__(self, what: str) -> None:
        self._what = what

    def save(self) -> dict[str, Any]:
        """It has counted nothing."""
        return {}

    def __getattr__(self, name: str) -> NoReturn:
        _refuse(self._what)


def _absent(what: str) -> Any:
    return _Absent(what)


def _refuse(what: str) -> NoReturn:
    raise NotInDryRun(f"a dry run has no {what}; a node type that needs one says so by robot=True")
