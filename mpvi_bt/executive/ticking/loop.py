"""The episode loop: the one place that ticks. Subscribers watch it and never steer it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Protocol

from py_trees.common import Status

from mpvi_bt.executive.behaviors.context import Context, Failure, Log
from mpvi_bt.executive.behaviors.manipulate import GAVE_UP
from mpvi_bt.executive.drawing.endings import ended, is_plan
from mpvi_bt.executive.ticking.goal_report import GoalReport
from mpvi_bt.executive.tree.build import Tree
from mpvi_bt.executive.tree.saving import SavedTree, restore
from mpvi_bt.executive.tree.spec import TreeSpec
from mpvi_bt.executive.tree.state import Ending
from mpvi_bt.ground.compiled import compiling
from mpvi_bt.ground.errors import BackendError, ModelError, NodeError, PolicyError, RobotError
from mpvi_bt.ground.robot.protocol import Robot


class World(Protocol):
    """The world that the loop steps. It is the run's clock, too."""

    @property
    def time_s(self) -> float:
        """Simulated seconds since the episode began."""
        ...

    @property
    def steps(self) -> int:
        """Control steps since the episode began."""
        ...

    @property
    def robot(self) -> Robot:
        """The robot that each step moves."""
        ...

    def step(self) -> None:
        """Carry out the robot's command for one control step (1/30 s)."""
        ...

    def save(self) -> dict[str, Any]:
        """The state of everything in it, as JSON values."""
        ...

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Restore the saved state in a newly made world of the same configuration.

        Raises:
            UserError: The state is of another world.
        """
        ...


@dataclass
class Outcome:
    """The outcome of an episode.

    Attributes:
        ending: The root's SUCCESS or FAILURE; "stopped": the policy stopped of its own accord, and the goal is met; the
            limit of simulated time, Ctrl-C, a policy's server or a language model that failed, or another exception.
        time_s, steps: Simulated time and control steps.
        ticks: Updates of the tree.
        failure: Cause of the root's failure, or of the backend's.
        error: The exception, if ending is "error" or "backend_error".
        goal: The goal at the end; None without a goal, or after an exception.
        log: Segments that were given up, questions to the checker, what hands noticed, actions that were clipped.
        wall_s: Wall time [s] by activity: "stepping" the world; within ticks the behaviors' "navigation", "motion",
            "policy", "rendering", "triggers", "checker", "planner", and "ticking", the rest of it, which is the tree's
            own; "watching", the subscribers'; "paused", until a person let it go on; "compiling" loops, at the first
            run on a machine; "total".
    """

    ending: Ending
    time_s: float = 0.0
    steps: int = 0
    ticks: int = 0
    failure: Failure | None = None
    error: Exception | None = None
    goal: GoalReport | None = None
    log: Log = field(default_factory=Log)
    wall_s: dict[str, float] = field(default_factory=dict)

    @property
    def complete(self) -> bool:
        """The tree ended in SUCCESS and no segment was given up."""
        return self.ending == "success" and not self.log.failures

    def told(self, tree: TreeSpec) -> str:
        """One line, such as "q = 0.333, plan finished after 15.6 s, 2 units given up"."""
        q = self.goal.q if self.goal else None
        return ended(self.ending, len(self.log.failures), is_plan(tree), self.time_s, q)


class Subscriber(Protocol):
    """Watches an episode."""

    def start(self, tree: Tree, world: World) -> None:
        """Called before the tree's setup, so that a failing setup is seen, too."""
        ...

    def step(self, tree: Tree, world: World) -> None:
        """Called after each tick, before the world is stepped."""
        ...

    def end(self, outcome: Outcome) -> None:
        """The last call, in every case; close files here."""
        ...


class Watcher:
    """A subscriber that does nothing: a base class."""

    def start(self, tree: Tree, world: World) -> None:
        """Nothing."""

    def step(self, tree: Tree, world: World) -> None:
        """Nothing."""

    def end(self, outcome: Outcome) -> None:
        """Nothing."""


class Last(Watcher):
    """Keeps how the episode ended, for an end by an exception, which the loop raises.

    Attributes:
        outcome: How; interrupted before it began, as long as it has not ended.
    """

    outcome = Outcome("interrupted")

    def end(self, outcome: Outcome) -> None:
        """Keep it."""
        self.outcome = outcome


def run_episode(
    tree: Tree,
    world: World,
    context: Context,
    subscribers: Sequence[Subscriber] = (),
    max_time_s: float = 3600.0,
    wall_limit_s: float = float("inf"),
    stop: Callable[[], bool] = lambda: False,
    saved: SavedTree | None = None,
    score: Callable[[], GoalReport] | None = None,
) -> Outcome:
    """Tick the tree and step the world until the tree ends or the time is up.

    In every case all behaviors are terminated, the robot holds still, the goal is scored, and every subscriber's `end`
    is called.

    Args:
        tree: What to tick; it is set up here.
        world: What to step.
        context: The run's backends.
        subscribers: Observers of the episode.
        max_time_s: Simulated time after which the episode is over.
        wall_limit_s: A guard against a hung backend, in wall time.
        stop: Asked before every tick; if true, the run is interrupted there.
        saved: State of the tree of an interrupted run; world and context are restored already.
        score: Evaluates the goal once, unless an exception ended the run; None: there is no goal.

    Raises:
        UserError: `saved` is of another tree.
        NodeError: A behavior raised. (PolicyError and ModelError end the episode as outcomes instead.)
        BackendError: The wall limit was passed.
        KeyboardInterrupt: Ctrl-C.
    """
    clock, compiled_s = compiling.clock, compiling.seconds
    outcome = Outcome("error", log=context.log)
    stepping = ticking = watching = 0.0
    began = clock()
    started: list[Subscriber] = []
    try:
        for subscriber in subscribers:
            started.append(subscriber)
            subscriber.start(tree, world)
        tree.setup(context)
        if saved is not None:
            restore(tree, saved)
        while True:
            if stop():
                outcome.ending = "interrupted"
                break
            before = clock()
            with context.stopwatch("navigation"):
                context.sense()
            status = tree.tick()
            if context.replanning is not None:
                context.replanning.swap()
            if status == Status.FAILURE and score is not None and _met_though_stopped(tree, world, outcome, score):
                outcome.ending = "stopped"
            ticked = clock()
            for subscriber in subscribers:
                subscriber.step(tree, world)
            watched = clock()
            ticking += ticked - before
            watching += watched - ticked
            if outcome.ending == "stopped":
                break
            if status != Status.RUNNING:
                outcome.ending = "success" if status == Status.SUCCESS else "failure"
                outcome.failure = tree.failure
                break
            if world.time_s >= max_time_s:
                outcome.ending = "time_limit"
                break
            if watched - began - context.stopwatch.seconds["paused"] > wall_limit_s:
                raise BackendError(f"the episode took more than {wall_limit_s:g} s of wall time")
            world.step()
            stepping += clock() - watched
        _blame_model(outcome, world.time_s)
    except KeyboardInterrupt:
        outcome.ending = "interrupted"
        raise
    except NodeError as error:
        outcome.error = error
        if not isinstance(error.__cause__, PolicyError | ModelError | RobotError):
            raise
        outcome.ending = "backend_error"
        outcome.failure = Failure(error.__cause__.reason, str(error.__cause__), error.path, world.time_s)
    except RobotError as error:
        outcome.error, outcome.ending = error, "backend_error"
        outcome.failure = Failure(error.reason, str(error), tree.spec.name, world.time_s)
    except Exception as error:
        outcome.error = error
        raise
    finally:
        inside = dict(context.stopwatch.seconds)
        paused = inside.pop("paused", 0.0)
        outcome.wall_s = {
            "stepping": stepping,
            **inside,
            "ticking": max(0.0, ticking - sum(inside.values())),
            "watching": max(0.0, watching - paused),
            "paused": paused,
            "compiling": (compiled_s := compiling.seconds - compiled_s),
            "total": clock() - began + compiled_s,
        }
        outcome.ticks, outcome.time_s, outcome.steps = tree.ticks, world.time_s, world.steps
        _close(tree, world, started, outcome, score)
    return outcome


def _blame_model(outcome: Outcome, time_s: float) -> None:
    """Blame the checker's model, not tree or policy, if it refused every question of a failed run."""
    queries = outcome.log.queries
    if outcome.complete or outcome.ending == "interrupted" or {query.fault for query in queries} != {"refused"}:
        return
    last = queries[-1]
    error = ModelError("refused", f"the checker's model refused every question ({len(queries)}): {last.reason}")
    outcome.ending, outcome.error = "backend_error", error
    outcome.failure = Failure(error.reason, str(error), last.path, time_s)


def _met_though_stopped(tree: Tree, world: World, outcome: Outcome, score: Callable[[], GoalReport]) -> bool:
    """Whether the goal is met and the root failed only because the policy stopped by itself: not a failure.

    This is the one place of that rule. It comes before the subscribers are shown the tick: what they tell follows.
    """
    failure = tree.failure
    while failure is not None and failure.cause is not None:
        failure = failure.cause
    if failure is None or failure.reason != GAVE_UP:
        return False
    world.robot.hold()
    outcome.goal = score()
    if outcome.goal.satisfied:
        tree.accept(failure.path, f"the policy stopped: {failure.evidence}" if failure.evidence else "")
    return outcome.goal.satisfied


def _close(
    tree: Tree,
    world: World,
    subscribers: Sequence[Subscriber],
    outcome: Outcome,
    score: Callable[[], GoalReport] | None,
) -> None:
    """Everything is ended, each whatever becomes of the others; then the first error is raised, if nothing else is."""

    def judge() -> None:
        if outcome.goal is None and score is not None and outcome.ending != "error":
            outcome.goal = score()

    def interrupt() -> None:
        tree.interrupt()
        outcome.log.end_handoffs(outcome.ending, world.time_s)

    ends: list[Callable[[], object]] = [judge, *(partial(subscriber.end, outcome) for subscriber in subscribers)]
    if outcome.ending in ("time_limit", "interrupted", "backend_error", "error"):
        ends.insert(0, interrupt)
    ends.insert(0, world.robot.hold)
    first: BaseException | None = None
    for end in ends:
        try:
            end()
        except Exception as error:
            first = first or error
    if first is not None and outcome.ending not in ("interrupted", "error"):
        raise first
