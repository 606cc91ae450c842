"""The episode loop and the live tree, over the shipped doubles."""

from __future__ import annotations

import io
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from py_trees.common import Status

from mpvi_bt.executive.behaviors.context import Context
from mpvi_bt.executive.drawing.text import ascii_tree
from mpvi_bt.executive.plan.planners import RecordedPlanner
from mpvi_bt.executive.plan.skills import load_skills
from mpvi_bt.executive.ticking.live import LiveTree
from mpvi_bt.executive.ticking.loop import Outcome, Watcher, World, run_episode
from mpvi_bt.executive.trace.explain import explain
from mpvi_bt.executive.trace.explain_text import explanation_text
from mpvi_bt.executive.trace.read import read_trace
from mpvi_bt.executive.tree.build import Tree
from mpvi_bt.executive.tree.compile import compile_plan
from mpvi_bt.ground.errors import BackendError, NodeError, PolicyError
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.runs.recording.recorder import Recorder as TraceRecorder
from mpvi_bt.testing import KinematicWorld, scripted_context
from tests.layouts import BASE

SKILLS = load_skills()
SPEC = compile_plan(RecordedPlanner().plan("picking_up_trash"), SKILLS)
ANSWERS = {"the trash can is held in a gripper": (True,), "a can of soda is in the trash can": (True,)}
PLACES = {"trash can": (1.0, 0.0), "can of soda": (0.0, 0.5)}


class Recorder(Watcher):
    """Keeps what it is called with."""

    def __init__(self) -> None:
        self.calls: list[str] = []
        self.times: list[float] = []
        self.outcome: Outcome | None = None

    def start(self, tree: Tree, world: World) -> None:
        self.calls.append("start")

    def step(self, tree: Tree, world: World) -> None:
        self.times.append(world.time_s)

    def end(self, outcome: Outcome) -> None:
        self.calls.append("end")
        self.outcome = outcome


class Interrupting(Watcher):
    """Presses Ctrl-C at a time."""

    def __init__(self, at_s: float) -> None:
        self.at_s = at_s

    def step(self, tree: Tree, world: World) -> None:
        if world.time_s >= self.at_s:
            raise KeyboardInterrupt


def scene() -> tuple[Tree, KinematicWorld, Context]:
    """A fresh run of picking_up_trash with doubles."""
    world = KinematicWorld()
    return Tree(SPEC), world, scripted_context(world, SKILLS, PLACES, ANSWERS)


def test_a_plan_runs_to_its_end() -> None:
    """Instruction to SUCCESS: every unit ends, and each manipulation unit asked exactly once."""
    tree, world, context = scene()
    watcher = Recorder()
    outcome = run_episode(tree, world, context, [watcher])
    assert (outcome.ending, outcome.complete, outcome.failure) == ("success", True, None)
    assert [q.event for q in outcome.log.queries] == ["grasp", "release", "release", "release"]
    assert (outcome.steps, outcome.time_s) == (world.steps, world.time_s)
    assert outcome.ticks == outcome.steps + 1 == len(watcher.times)
    assert watcher.calls == ["start", "end"]
    assert watcher.outcome is outcome


def test_the_same_run_twice_is_the_same() -> None:
    """Nothing in the loop depends on wall time: two runs tell the same story, step for step."""
    stories = []
    for _ in range(2):
        tree, world, context = scene()
        stream = io.StringIO()
        outcome = run_episode(tree, world, context, [LiveTree(stream)])
        stories.append((outcome.log, outcome.steps, stream.getvalue()))
    assert stories[0] == stories[1]


def test_watching_changes_nothing() -> None:
    """An episode with subscribers goes as it goes without."""
    bare = run_episode(*scene())
    watched = run_episode(*scene(), subscribers=[Recorder(), LiveTree(io.StringIO())])
    assert (bare.steps, bare.log) == (watched.steps, watched.log)


def test_the_time_limit_ends_it() -> None:
    """At the limit of simulated time the episode is over and the robot holds."""
    tree, world, context = scene()
    outcome = run_episode(tree, world, context, max_time_s=1.0)
    assert outcome.ending == "time_limit"
    assert outcome.time_s == pytest.approx(1.0, abs=1 / 30)
    assert not world.robot.action[BASE].any()


def test_the_wall_clock_is_a_guard() -> None:
    """A run that takes too long in wall time is a backend's fault, not the world's."""
    tree, world, context = scene()
    watcher = Recorder()
    with pytest.raises(BackendError, match="wall time"):
        run_episode(tree, world, context, [watcher], wall_limit_s=0.0)
    assert watcher.calls == ["start", "end"]
    assert watcher.outcome is not None
    assert watcher.outcome.ending == "error"


def test_ctrl_c_stops_the_robot_and_closes_everything() -> None:
    """KeyboardInterrupt comes out again, after the robot holds, every node is stopped and every subscriber closed."""
    tree, world, context = scene()
    first, last = Recorder(), Recorder()
    with pytest.raises(KeyboardInterrupt):
        run_episode(tree, world, context, [first, Interrupting(0.5), last])
    assert not world.robot.action[BASE].any()
    assert first.calls == last.calls == ["start", "end"]
    assert all(node.status == Status.INVALID for node in tree.nodes.values())
    assert first.outcome is not None
    assert first.outcome.ending == "interrupted"
    assert "[*]" in ascii_tree(SPEC, tree.states()), "the last picture still shows what was running"


def test_a_subscriber_that_cannot_close_does_not_keep_the_others_open() -> None:
    """Every `end` is called; the first error comes out unless something else already does."""

    class Broken(Watcher):
        def end(self, outcome: Outcome) -> None:
            raise OSError("disk full")

    watcher = Recorder()
    with pytest.raises(OSError, match="disk full"):
        run_episode(*scene(), subscribers=[Broken(), watcher])
    assert watcher.calls == ["start", "end"]
    with pytest.raises(KeyboardInterrupt):
        run_episode(*scene(), subscribers=[Broken(), Interrupting(0.1)])


def test_an_error_in_a_behavior_ends_the_episode() -> None:
    """A NodeError comes out of the loop after everything was closed."""
    tree, world, context = scene()
    context.policy.infer = lambda observation: np.zeros(1 // 0)  # type: ignore[method-assign]
    watcher = Recorder()
    with pytest.raises(NodeError, match="manipulate"):
        run_episode(tree, world, context, [watcher])
    assert watcher.calls == ["start", "end"]
    assert not world.robot.action[BASE].any()


@pytest.mark.parametrize("at_call", [0, 2])
def test_a_policys_backend_that_fails_ends_the_episode_as_such(at_call: int, tmp_path: Path) -> None:
    """No exception, but an end of its own with a reason, in the trace too; everything is closed, the robot stands."""
    tree, world, context = scene()
    whole = context.policy.infer
    calls = iter(range(100))

    def infer(observation: Mapping[str, Any]) -> Array:
        if next(calls) < at_call:
            return whole(observation)
        raise PolicyError("server_closed", "openpi:ws://there: it went away")

    context.policy.infer = infer  # type: ignore[method-assign]
    file = tmp_path / "trace.jsonl"
    outcome = run_episode(tree, world, context, [watcher := Recorder(), TraceRecorder(file)])
    assert (outcome.ending, watcher.calls[-1], outcome.log.failures) == ("backend_error", "end", [])
    assert outcome.failure is not None
    assert (outcome.failure.reason, outcome.failure.evidence) == ("server_closed", "openpi:ws://there: it went away")
    assert outcome.failure.path.endswith("/manipulate")
    assert not world.robot.action[BASE].any()
    end = read_trace(file).end
    assert end is not None
    assert end.error is not None
    assert (end.ending, end.error.reason, end.error.path) == ("backend_error", "server_closed", outcome.failure.path)
    said = explanation_text(explain(read_trace(file)))
    assert "backend error" in said
    assert "server_closed" in said


def test_the_times_add_up() -> None:
    """Activities are apart from each other: together they are no more than the whole."""
    wall = run_episode(*scene(), subscribers=[LiveTree(io.StringIO())]).wall_s
    assert {"stepping", "ticking", "watching", "navigation", "policy", "checker", "triggers"} <= set(wall)
    assert sum(v for k, v in wall.items() if k != "total") <= wall["total"]


def test_ticking_is_cheap(monkeypatch: pytest.MonkeyPatch) -> None:
    """The tree's own part of a step takes the processor for less than a twentieth of a 4 ms control step."""
    monkeypatch.setattr(time, "perf_counter", time.thread_time)  # what else the machine does takes no part
    best = min((o.wall_s["ticking"] / o.ticks for o in (run_episode(*scene()) for _ in range(3))), default=1.0)
    assert best < 0.2e-3
