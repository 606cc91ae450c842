"""Laws of questions to checkers that take their time: what the tree does meanwhile, and what comes of it."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest
from py_trees.common import Status

from mpvi_bt.executive.behaviors.question import HANDOVER_S
from mpvi_bt.executive.ticking.loop import run_episode
from mpvi_bt.executive.trace.explain import explain
from mpvi_bt.executive.trace.explain_text import explanation_text
from mpvi_bt.executive.trace.read import read_trace
from mpvi_bt.executive.tree.saving import restore, save
from mpvi_bt.ground.cost import Cost
from mpvi_bt.ground.errors import NodeError, UserError
from mpvi_bt.ground.protocols import Checker, Judgement, TriggerEvent
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, CameraImage
from mpvi_bt.runs.recording.recorder import Recorder
from tests.bench import HELD, PICK, Bench
from tests.layouts import ACTION_SIZE

CHECK = f"check_complete: {HELD}"
HANDOVER = round(HANDOVER_S * CONTROL_HZ)  # steps that every answer of another thread is given


class Slow:
    """A checker of somewhere else: thinks for so long, or says that it did."""

    name, needs_image, remote = "slow", False, True

    def __init__(self, answers: Iterable[bool], thinks_s: float = 0.0, says_s: float | None = None) -> None:
        self.answers = iter(answers)
        self.thinks_s, self.says_s = thinks_s, says_s
        self.threads: list[threading.Thread] = []

    def check(self, criterion: str, image: CameraImage | None) -> Judgement:
        began = time.monotonic()
        self.threads.append(threading.current_thread())
        time.sleep(self.thinks_s)
        latency_s = time.monotonic() - began if self.says_s is None else self.says_s
        return Judgement(next(self.answers), "thought", latency_s, cost=Cost("tiny", 900, 2))


class Local(Slow):
    """The same, but computed here."""

    remote = False


def bench(root: str, checker: Checker, events: dict[int, TriggerEvent]) -> Bench:
    """A tree whose checker is asked at the ticks of `events`, counted from 0."""
    made = Bench(root)
    made.context.checker = checker
    made.context.triggers.reset = lambda kinds=None: None  # type: ignore[method-assign]
    made.context.triggers.update = lambda: events.get(made.world.steps)  # type: ignore[method-assign]
    return made


GRASP, RELEASE = TriggerEvent("grasp", "right"), TriggerEvent("release", "left")


def test_the_tree_runs_on_until_the_answer_is_due() -> None:
    """An answer that took 0.2 s comes six steps and the handover after its question, and ends the unit then."""
    made = bench(PICK, Slow([True], says_s=0.2), {3: GRASP})
    assert made.run(9 + HANDOVER) == Status.RUNNING
    assert made.context.asking
    assert made.tick() == Status.SUCCESS
    (query,) = made.context.log.queries
    assert (query.time_s, query.latency_s, query.cost) == (3 / CONTROL_HZ, 0.2, Cost("tiny", 900, 2))
    assert not made.context.asking


def test_a_checker_of_this_process_is_asked_in_the_loop() -> None:
    """No thread, and an answer in the same tick, unless it is said to take its time."""
    for says_s, ticks in ((0.0, 1), (0.1, 4)):
        checker = Local([True], thinks_s=0.05, says_s=says_s)
        made = bench(CHECK, checker, {0: GRASP})
        assert made.run(ticks) == Status.SUCCESS
        assert made.tree.ticks == ticks
        assert checker.threads == [threading.current_thread()]


def test_a_live_run_and_its_replay_tick_alike() -> None:
    """With the latencies that were measured, every answer falls on the same step again."""
    live = bench(PICK, Slow([False, False, True], thinks_s=0.15), {2: GRASP, 20: GRASP, 40: RELEASE})
    assert live.run(200) == Status.SUCCESS
    asked = live.context.log.queries
    latencies = iter([q.latency_s for q in asked])

    class OnFile(Slow):
        def check(self, criterion: str, image: CameraImage | None) -> Judgement:
            return Judgement(next(self.answers), "thought", next(latencies), cost=Cost("tiny", 900, 2))

    replay = bench(PICK, OnFile([q.complete for q in asked]), {2: GRASP, 20: GRASP, 40: RELEASE})
    began = time.monotonic()
    assert replay.run(200) == Status.SUCCESS
    assert replay.tree.ticks == live.tree.ticks
    assert replay.context.log.queries == asked
    assert time.monotonic() - began < live.world.time_s


def test_an_event_that_fires_while_a_question_is_open_asks_the_next_one() -> None:
    """The last of several, at once after a no, with the picture of that moment; after a yes there is none."""
    events = {0: GRASP, 5: GRASP, 7: RELEASE}
    made = bench(CHECK, Slow([False, True, True], says_s=0.5), events)
    made.run(100)
    asked = [(q.event, q.complete, round(q.time_s * CONTROL_HZ)) for q in made.context.log.queries]
    assert asked == [("grasp", False, 0), ("release", True, 16 + HANDOVER)]


@pytest.mark.parametrize("while_asked", ["go_on", "hold"])
def test_the_policy_goes_on_or_holds_while_asked(while_asked: str) -> None:
    """Holding, the robot keeps its joints, no action of the chunk is lost, and after a no the rest is carried out."""

    class Counting:
        name, cameras = "counting", ()
        given = 0

        def reset(self) -> None: ...

        def infer(self, observation: object) -> np.ndarray:
            rows = np.zeros((300, ACTION_SIZE))
            rows[:, 7] = np.linspace(0.0, 0.5, 300)  # the left arm's first joint
            return rows

    made = bench(PICK, Slow([False], says_s=1.0), {10: GRASP})
    made.context.policy, made.context.while_asked = Counting(), while_asked  # type: ignore[assignment]
    went = []
    for _ in range(60):
        made.tick()
        went.append(float(made.world.robot.proprioception().arm["left"][0]))
    moved = np.flatnonzero(np.diff(went) > 1e-6)
    still = sorted(set(range(1, 59)) - set(moved.tolist()))
    assert len(still) == (30 + HANDOVER if while_asked == "hold" else 0)
    assert np.diff(still).tolist() == [1] * (len(still) - 1)
    steps = np.diff(went)[moved]
    assert np.ptp(steps[1:]) < 1e-9, "an action was left out"


def test_an_interrupted_check_drops_its_question() -> None:
    """Nobody waits for it any more, and its answer counts for nothing."""
    made = bench(f"timeout: 0.1\nchild:\n  {CHECK}", Slow([True], says_s=0.2), {0: GRASP})
    assert made.run(100) == Status.FAILURE
    assert not made.context.asking
    assert not made.context.log.queries


def test_a_run_that_goes_on_asks_the_open_question_anew() -> None:
    """What was asked when it was stopped is asked at once, of that hand; it is one question, not two."""
    first = bench(CHECK, Slow([False, True], says_s=0.1), {0: GRASP, 20: RELEASE})
    first.run(22)
    saved = save(first.tree)
    second = bench(CHECK, Slow([True], says_s=0.1), {})
    second.tree.setup(second.context)
    restore(second.tree, saved)
    assert second.run(5 + HANDOVER) == Status.SUCCESS
    assert second.tree.root.feedback_message == "asked 2: yes, thought"
    (query,) = second.context.log.queries
    assert (query.event, query.time_s) == ("release", 0.0)


@pytest.mark.parametrize("event", [["grasp"], "grasp", ["grasp", "middle"], [1, "left"], {}])
def test_a_saved_event_that_is_none_is_refused(event: object) -> None:
    """The file may have been damaged."""
    made = bench(CHECK, Slow([True], says_s=1.0), {0: GRASP})
    made.tick()
    saved = save(made.tree)
    saved.nodes["check_complete"].state["event"] = event  # type: ignore[assignment]
    with pytest.raises(UserError, match="'event' should be"):
        restore(made.tree, saved)


def test_what_breaks_in_a_checker_names_its_node() -> None:
    """The error of the thread ends the run in the loop."""

    class Broken(Slow):
        def check(self, criterion: str, image: CameraImage | None) -> Judgement:
            raise RuntimeError("out of film")

    made = bench(f"sequence: s\nmemory: true\nchildren: [{{{CHECK}}}]", Broken([]), {0: GRASP})
    with pytest.raises(NodeError, match="s/check_complete: RuntimeError: out of film"):
        made.run(100)


def test_a_checker_that_hangs_holds_the_loop_to_real_time_and_no_tick_longer_than_a_step() -> None:
    """The unit's timeout ends it; what still hangs keeps nothing alive."""
    checker = Slow([True], thinks_s=5.0)
    made = bench(f"timeout: 0.5\nchild:\n  {CHECK}", checker, {0: GRASP})
    took, status = [], Status.RUNNING
    began = time.monotonic()
    while status == Status.RUNNING:
        before = time.monotonic()
        status = made.tick()
        took.append(time.monotonic() - before)
    assert status == Status.FAILURE
    assert 0.4 < time.monotonic() - began < 3.0
    assert np.median(took) < 1.5 / CONTROL_HZ
    assert all(thread.daemon for thread in checker.threads)


def test_a_trace_tells_when_it_was_asked_and_what_it_cost(tmp_path: Path) -> None:
    """At the tick of the answer, with what came with it; the explanation gives the time of the question."""
    made = bench(f"timeout: 1\nchild:\n  {CHECK}", Slow([False], says_s=0.2), {3: GRASP})
    run_episode(made.tree, made.world, made.context, [Recorder(tmp_path / "t.jsonl")])
    trace = read_trace(tmp_path / "t.jsonl")
    ((tick, answer),) = [(change.tick, answer) for change in trace.ticks for answer in change.queries]
    assert (tick, answer.asked_s, answer.latency_s) == (10 + HANDOVER, 3 / CONTROL_HZ, 0.2)
    assert answer.cost is not None
    assert (answer.cost.model, answer.cost.tokens_in, answer.cost.kept) == ("tiny", 900, False)
    assert "asked at 0.1 s (after a grasp, answered in 0.2 s)" in explanation_text(explain(trace)).replace("\n", " ")
