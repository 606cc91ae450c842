"""Behaviors over the shipped doubles: what they start, what they stop, how they fail."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from py_trees.common import Status

from mpvi_bt.executive.behaviors.context import Context, Query, Stopwatch
from mpvi_bt.executive.behaviors.node import failure_of
from mpvi_bt.executive.behaviors.question import Question
from mpvi_bt.executive.tree.saving import restore, save
from mpvi_bt.ground.errors import NodeError, UnknownName
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.protocols import Judgement, Progress, Report, TriggerEvent
from mpvi_bt.ground.robot.limits import extremes, largest_step
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, CameraImage, Side
from mpvi_bt.hands.robots.r1 import R1
from mpvi_bt.testing import KinematicRobot
from tests.bench import HELD, PICK, PLACES, Bench, tree
from tests.layouts import ACTION_SIZE, BASE


def test_navigate_gets_there_and_stands_still() -> None:
    """SUCCESS comes at the target, with a base that is commanded to rest."""
    bench = Bench("navigate: cup")
    assert bench.run() == Status.SUCCESS
    assert np.linalg.norm(bench.world.robot.proprioception().base_pose[:2] - PLACES["cup"]) < 0.03
    assert not bench.base.any()


def test_a_reset_does_not_stop_what_another_node_has_begun() -> None:
    """A drive that has ended and is reset, as a selector does with what failed, leaves the one that runs now alone."""
    bench = Bench(
        "selector: s\nmemory: true\nchildren:\n"
        "  - {sequence: first, memory: true, children: [{navigate: cup}, {fail: no_cup}]}\n"
        "  - {navigate: sink}"
    )
    assert bench.run(600) == Status.SUCCESS
    assert np.linalg.norm(bench.world.robot.proprioception().base_pose[:2] - PLACES["sink"]) < 0.03


def test_navigate_passes_on_why_it_failed() -> None:
    """The navigator's reason and words become the node's failure, and the tree's."""
    bench = Bench("sequence: s\nmemory: true\nchildren: [{navigate: moon}]")
    assert bench.run() == Status.FAILURE
    failure = bench.failure
    assert (failure.reason, failure.path) == ("unknown_target", "s/navigate")
    assert "moon" in failure.evidence


@pytest.mark.parametrize("root", ["navigate: cup", PICK])
def test_an_interrupted_leaf_stops_the_robot(root: str) -> None:
    """INVALID in the middle of a drive or a grasp leaves a robot that holds still."""
    bench = Bench(root)
    bench.run(3)
    moving = bench.world.robot.action
    bench.tree.interrupt()
    held = bench.world.robot.action
    assert not held[BASE].any()
    assert root == PICK or moving[BASE].any()
    bench.world.robot.act(held)
    bench.world.step()
    assert np.allclose(bench.world.robot.action, held)


def test_a_selector_that_goes_on_stops_what_it_leaves() -> None:
    """A leaf that loses its turn to a higher one is told to stop, and the robot obeys the higher one."""
    bench = Bench("selector: s\nmemory: false\nchildren: [{navigate: sink}, {navigate: cup}]")
    bench.context.navigator.start("sink", None)
    assert bench.run() == Status.SUCCESS
    assert bench.node("/navigate").status == Status.SUCCESS


class Chunks:
    """A policy that hands out numbered chunks of a given length."""

    name = "chunks"
    cameras: tuple[str, ...] = ("head",)
    note = ""
    gave_up = False

    def __init__(self, length: int) -> None:
        self.length, self.calls, self.resets = length, 0, 0
        self.prompts: list[str] = []

    def reset(self) -> None:
        self.resets += 1

    def infer(self, observation: Mapping[str, Any]) -> Array:
        assert set(observation) == {"prompt", "proprioception", "images", "command"}
        assert isinstance(observation["images"]["head"], CameraImage)
        self.prompts.append(observation["prompt"])
        chunk = np.zeros((self.length, ACTION_SIZE))
        chunk[:, 0] = 1e-4 * (100 * self.calls + np.arange(self.length))
        self.calls += 1
        return chunk


@given(length=st.integers(1, 7), ticks=st.integers(1, 30))
def test_a_chunk_is_carried_out_one_action_a_step(length: int, ticks: int) -> None:
    """Actions leave in order, one a tick, and the policy is asked once a chunk."""
    bench = Bench("manipulate: pick up the cup")
    policy = bench.context.policy = Chunks(length)
    bench.tree.setup(bench.context)
    sent = []
    for _ in range(ticks):
        assert bench.tree.tick() == Status.RUNNING
        sent.append(bench.world.robot.action[0])
    assert sent == pytest.approx([1e-4 * (100 * (i // length) + i % length) for i in range(ticks)])
    assert (policy.calls, policy.resets) == (-(-ticks // length), 1)


def test_a_handoff_drops_the_rest_of_the_chunk() -> None:
    """A unit that starts anew asks a reset policy for a fresh chunk."""
    bench = Bench("timeout: 0.1\nchild: {manipulate: pick up the cup}")
    policy = bench.context.policy = Chunks(100)
    assert bench.run() == Status.FAILURE
    assert (policy.calls, policy.resets) == (1, 1)
    bench.run(2)
    assert (policy.calls, policy.resets) == (2, 2)
    assert bench.world.robot.action[0] == pytest.approx(101e-4)


@pytest.mark.parametrize("bad", [np.zeros((0, 23)), np.zeros(23), np.zeros((2, 22)), np.full((1, 23), np.nan)])
def test_a_bad_chunk_never_reaches_the_robot(bad: Array) -> None:
    """A chunk of the wrong shape, or not finite, is an error that names the node, and the robot holds."""
    bench = Bench(PICK)
    bench.context.policy.infer = lambda observation: bad  # type: ignore[method-assign]
    with pytest.raises(NodeError, match=r"until_complete/manipulate: PolicyError: policy grip: a chunk"):
        bench.run()
    assert np.isfinite(bench.world.robot.action).all()


@pytest.mark.parametrize("bad", [None, "up", [[0.0] * 23, [0.0]], np.zeros((1, 23), complex), np.full((1, 23), "0")])
def test_what_is_no_array_of_numbers_never_reaches_the_robot(bad: Any) -> None:
    """Neither text nor complex numbers nor lists of different lengths."""
    bench = Bench(PICK)
    bench.context.policy.infer = lambda observation: bad  # type: ignore[method-assign]
    with pytest.raises(NodeError, match="actions that are no numbers"):
        bench.run()


@given(st.integers(0, 22), st.sampled_from([-1e30, -7.0, 7.0, 1e30]), st.integers(1, 40))
def test_actions_reach_the_robot_within_its_limits_and_rate(joint: int, wild: float, ticks: int) -> None:
    """However wild the policy: speeds and joints stay within their limits, no target jumps, and each clip counts."""
    bench = Bench("manipulate: pick up the cup")
    action = np.zeros(ACTION_SIZE)
    action[joint] = wild
    bench.context.policy.infer = lambda observation: action[None]  # type: ignore[method-assign]
    last = bench.world.robot.action
    for _ in range(ticks):
        bench.run(1)
        now = bench.world.robot.action
        assert np.array_equal(now, np.clip(now, *extremes(R1)))
        assert (np.abs(now - last) <= largest_step(R1) + 1e-12).all()
        last = now
    assert bench.context.log.clipped == ticks


@given(st.integers(0, 10_000))
def test_what_is_within_the_limits_reaches_the_robot_bit_by_bit(seed: int) -> None:
    """Limits change nothing of an action that keeps them, and count nothing."""
    rng = np.random.default_rng(seed)
    bench = Bench("manipulate: pick up the cup")
    bench.run(1)
    step = np.where(np.isfinite(largest_step(R1)), largest_step(R1), 0.1)
    for _ in range(10):
        last = bench.world.robot.action
        action = np.clip(last + rng.uniform(-1, 1, ACTION_SIZE) * step * 0.999, *extremes(R1))
        chunk = action[None]
        bench.context.policy.infer = lambda observation, chunk=chunk: chunk  # type: ignore[method-assign, misc]
        bench.node("manipulate").stop(Status.INVALID)  # the rest of the chunk before
        bench.world.robot.act(last)
        bench.tree.tick()
        assert bench.world.robot.action.tobytes() == action.tobytes()
        bench.world.robot.act(action)
        bench.world.step()
    assert bench.context.log.clipped == 0


def test_what_the_policy_says_of_itself_is_shown() -> None:
    """Its note, on one line and not for ever; nothing where it has none."""
    bench = Bench("manipulate: pick up the cup")
    bench.run(1)
    assert bench.node("manipulate").feedback_message == ""
    bench.context.policy.note = "pick:\n no_stance" + " x" * 500  # type: ignore[attr-defined]
    bench.run(1)
    said = bench.node("manipulate").feedback_message
    assert said.startswith("pick: no_stance x")
    assert len(said) <= 300


def test_a_policy_that_gives_up_ends_its_unit() -> None:
    """Once its chunk is used up, with its note for a reason; the unit that begins next has it reset and runs."""
    bench = Bench("manipulate: pick up the cup")
    policy = bench.context.policy = Chunks(3)
    bench.tree.setup(bench.context)
    bench.run(1)
    policy.gave_up, policy.note = True, "pick: no_stance"
    assert [bench.tree.tick() for _ in range(2)] == [Status.RUNNING, Status.FAILURE]
    failure = failure_of(bench.node("manipulate"))
    assert failure is not None
    assert (failure.reason, failure.evidence) == ("gave_up", "pick: no_stance")
    policy.gave_up = False
    assert bench.tree.tick() == Status.RUNNING
    assert policy.resets == 2


def test_a_unit_given_up_tells_what_the_checker_said_no_to() -> None:
    """The last no since the handoff of the check beside it, with what was seen; no earlier one, nor another unit's."""
    bench = Bench("until_complete:\nchildren: [{manipulate: pick up the cup}, {check_complete: a cup is held}]")
    bench.context.policy = policy = Chunks(1)
    bench.run(1)
    now = bench.context.clock.time_s
    for path, complete, reason, time_s in (
        ("until_complete/check_complete", False, "too early", now - 1),
        ("until_complete/check_complete", False, "the hand is empty", now),
        ("until_complete/check_complete", True, "that was a yes", now),
        ("other/check_complete", False, "of another", now),
    ):
        bench.context.log.queries.append(Query("a cup is held", "grasp", "head", complete, reason, path, time_s))
    policy.gave_up, policy.note = True, "done"
    bench.run(1)
    failure = failure_of(bench.node("manipulate"))
    assert failure is not None
    assert failure.evidence == 'done; "a cup is held": no, the hand is empty'


def test_a_unit_given_up_waits_for_the_answer_that_is_awaited() -> None:
    """What was asked before may be a yes, and the unit done."""
    bench = Bench("manipulate: pick up the cup")
    policy = bench.context.policy = Chunks(1)
    policy.gave_up = True
    question = cast("Question[Judgement]", object())
    bench.context.asking.add(question)
    assert bench.run(5) == Status.RUNNING
    bench.context.asking.remove(question)
    assert bench.run(1) == Status.FAILURE


def test_a_grasp_of_nothing_is_noticed_and_a_tree_may_act_on_it() -> None:
    """It is logged with hand and time, and is the value of `grip` in a tree that declares that key."""
    bench = Bench("manipulate: pick up the cup", grip="")
    bench.world.robot.between_m["right"] = 0.0
    bench.run(60)
    (notice,) = bench.context.log.notices
    assert (notice.kind, notice.side, notice.path) == ("empty", "right", "manipulate")
    assert bench.context.blackboard == {"grip": "empty right"}
    plain = Bench("manipulate: pick up the cup")
    plain.world.robot.between_m["right"] = 0.0
    plain.run(60)
    assert len(plain.context.log.notices) == 1
    assert plain.context.blackboard == {}


def test_no_question_without_an_event() -> None:
    """The checker is asked only when a trigger fires, however long it takes."""
    bench = Bench(PICK)
    bench.context.triggers.update = lambda: None  # type: ignore[method-assign]
    bench.run(200)
    assert bench.tree.status == Status.RUNNING
    assert not bench.context.log.queries


def test_a_no_lets_the_policy_go_on() -> None:
    """After a no the unit runs on, and the next event asks again."""
    bench = Bench(PICK, {HELD: (False, True)})
    events = iter([None, TriggerEvent("grasp", "left"), None, None, TriggerEvent("grasp", "right")])
    bench.context.triggers.update = lambda: next(events)  # type: ignore[method-assign]
    assert bench.run() == Status.SUCCESS
    asked = [(q.complete, q.camera, q.time_s) for q in bench.context.log.queries]
    assert asked == [(False, "left", 1 / CONTROL_HZ), (True, "right", 4 / CONTROL_HZ)]
    assert bench.node("manipulate").status == Status.INVALID


def test_questions_are_counted_on_after_a_stop() -> None:
    """A resumed check begins anew, but goes on with the number of its questions; one that ended starts from one."""
    first, second = (Bench(f"check_complete: {HELD}", {HELD: (False, True)}) for _ in range(2))
    for bench in (first, second):
        bench.tree.setup(bench.context)
        bench.context.triggers.update = lambda: TriggerEvent("grasp", None)  # type: ignore[method-assign]
    first.tick()
    restore(second.tree, save(first.tree))
    second.tick()
    assert second.tree.root.feedback_message == "asked 2: no, as scripted"
    assert second.tick() == Status.SUCCESS
    second.tick()
    assert second.tree.root.feedback_message == "asked 1: yes, as scripted"


@pytest.mark.parametrize(
    ("skill", "event", "camera"),
    [
        ("pick", TriggerEvent("grasp", "right"), "right"),
        ("pick", TriggerEvent("grasp", None), "head"),
        ("pick", TriggerEvent("idle", "left"), "left"),
        ("place_on", TriggerEvent("idle", "left"), "head"),
        ("place_in", TriggerEvent("release", "left"), "head"),
        (None, TriggerEvent("grasp", "left"), "left"),
        (None, TriggerEvent("release", "left"), "head"),
    ],
)
def test_the_skill_says_whose_picture_is_shown(skill: str | None, event: TriggerEvent, camera: str) -> None:
    """A grasp is judged from the wrist that felt it, a release from the head."""
    bench = Bench(f"check_complete: {HELD}" + (f"\nskill: {skill}" if skill else ""))
    bench.context.triggers.update = lambda: event  # type: ignore[method-assign]
    assert bench.run(1) == Status.SUCCESS
    assert bench.context.log.queries[0].camera == camera


@pytest.mark.parametrize(("event", "asks"), [("idle", 0), ("grasp", 0), ("release", 1)])
def test_a_hand_is_not_asked_about_by_the_camera_of_the_other(event: str, asks: int) -> None:
    """The left hand, full before, stands still as well: its picture says nothing of the right one, the head's may."""
    asked = "a can of soda is held in the right gripper"
    bench = Bench(f"check_complete: {asked}\nskill: pick", {asked: (True,)})
    bench.context.triggers.update = lambda: TriggerEvent(event, "left")  # type: ignore[method-assign]
    assert bench.run(1) == (Status.SUCCESS if asks else Status.RUNNING)
    assert len(bench.context.log.queries) == asks


class Releases:
    """Triggers that notice a release in the third step and tell of it from the sixth on.

    Args:
        side: The hand that lets go.
        told: The hand that the event is of; None: the same.
    """

    def __init__(self, side: Side, told: Side | None = None) -> None:
        self.released: Side | None = None
        self._side, self._told, self._step = side, told or side, 0

    def reset(self, kinds: Mapping[str, float | None] | None = None) -> None:
        """Go on."""

    def update(self) -> TriggerEvent | None:
        """The event, from the sixth step on."""
        self._step += 1
        self.released = self._side if self._step == 3 else None
        return TriggerEvent("release", self._told) if self._step >= 6 else None


@pytest.mark.parametrize(
    ("skill", "answers", "cameras"),
    [
        ("place_in", (False, True), ["head", "left"]),  # the wrist saw it fall in
        ("place_in", (True,), ["head"]),
        ("place_in", (False, False, False, True), ["head", "left", "head", "head"]),  # asked about it but once
        ("place_on", (False, True), ["head", "head"]),
    ],
)
def test_a_no_is_followed_by_the_picture_of_the_release(
    skill: str, answers: tuple[bool, ...], cameras: list[str]
) -> None:
    """That of the hand's own camera, of the step in which it let go; where the skill names it as a witness."""
    bench = Bench(f"check_complete: {HELD}\nskill: {skill}", {HELD: answers})
    bench.context.triggers = Releases("left")
    assert bench.run() == Status.SUCCESS
    assert [query.camera for query in bench.context.log.queries] == cameras


def test_a_release_of_the_other_hand_has_no_such_picture() -> None:
    """What one hand saw says nothing of what the other one let go of."""
    bench = Bench(f"check_complete: {HELD}\nskill: place_in", {HELD: (False, True)})
    bench.context.triggers = Releases("left", told="right")
    assert bench.run() == Status.SUCCESS
    assert [query.camera for query in bench.context.log.queries] == ["head", "head"]


def test_what_is_no_answer_is_no_no() -> None:
    """A checker that fails is asked about the hand's picture after its next no."""
    bench = Bench(f"check_complete: {HELD}\nskill: place_in")
    bench.context.triggers = Releases("left")
    answers = iter([Judgement(False, "away", fault="endpoint_down"), Judgement(False, "no"), Judgement(True, "yes")])
    bench.context.checker.check = lambda criterion, image: next(answers)  # type: ignore[method-assign]
    assert bench.run() == Status.SUCCESS
    assert [query.camera for query in bench.context.log.queries] == ["head", "head", "left"]


def test_only_the_skills_events_are_watched() -> None:
    """The triggers are reset to the kinds of the last segment's skill, or to all."""
    pick = {"grasp": None, "idle": None}
    for text, kinds in ((f"check_complete: {HELD}\nskill: pick", pick), (f"check_complete: {HELD}", None)):
        bench = Bench(text)
        seen: list[Mapping[str, float | None] | None] = []
        bench.context.triggers.reset = seen.append  # type: ignore[method-assign, assignment]
        bench.run(1)
        assert seen == [kinds]


def test_a_checker_that_needs_no_picture_gets_none() -> None:
    """Without a need for pictures none is rendered: a machine that cannot draw still runs."""
    bench = Bench(PICK)
    bench.context.checker.needs_image = False
    bench.world.robot.look = lambda camera: pytest.fail("rendered")  # type: ignore[method-assign]
    assert bench.run() == Status.SUCCESS


def test_an_unknown_skill_is_found_at_setup() -> None:
    """A tree that names a skill that the run lacks does not start."""
    bench = Bench(f"check_complete: {HELD}\nskill: pick")
    bench.context.skills = {}
    with pytest.raises(UnknownName, match="check_complete: unknown skill 'pick'"):
        bench.tree.setup(bench.context)


class Countdown:
    """A navigator that arrives at its n-th step, counted from 1."""

    def __init__(self, steps: int) -> None:
        self.steps = steps
        self.done = 0

    def start(self, target: str, room: str | None) -> None:
        self.done = 0

    def step(self) -> Report:
        self.done += 1
        return Report(Progress.SUCCEEDED if self.done >= self.steps else Progress.RUNNING)

    def stop(self) -> None:
        pass


@given(limit=st.integers(1, 90), needs=st.integers(1, 90))
def test_a_late_success_counts_at_the_very_tick(limit: int, needs: int) -> None:
    """A child is ticked up to and in the tick at which its time is up; there its success wins, RUNNING fails."""
    bench = Bench(f"timeout: {limit / CONTROL_HZ!r}\nchild: {{navigate: cup}}")
    bench.context.navigator = Countdown(needs)
    status = bench.run()
    assert status == (Status.SUCCESS if needs <= limit + 1 else Status.FAILURE)
    assert bench.world.steps == min(needs, limit + 1)


def test_a_timeout_says_what_was_still_going_on() -> None:
    """The failure of a timeout carries its code and the last word of what it cut off."""
    bench = Bench(f"timeout: 3\nchild:\n  {PICK.replace(chr(10), chr(10) + '  ')}", {HELD: (False,)})
    assert bench.run() == Status.FAILURE
    failure = bench.failure
    assert (failure.reason, failure.path) == ("timeout", "timeout")
    still = "until_complete/manipulate, check_complete"
    assert failure.evidence == f"not done within 3 s: still at {still} (asked 1: no, as scripted)"
    assert failure.time_s == pytest.approx(3.0)


def test_attempt_records_and_goes_on() -> None:
    """A failed attempt is a SUCCESS with the failure in the log; the next one is tried."""
    bench = Bench(
        "sequence: s\nmemory: true\nchildren:\n"
        "  - {attempt: 1 moon, child: {navigate: moon}}\n  - {attempt: 2 cup, child: {navigate: cup}}"
    )
    assert bench.run() == Status.SUCCESS
    (failure,) = bench.context.log.failures
    assert (failure.reason, failure.path) == ("unknown_target", "s/1 moon/navigate")
    states = bench.tree.states()
    assert (states["s/1 moon"].gave_up, states["s/2 cup"].gave_up) == (True, False)


def test_an_exception_names_its_node_and_everything_stops() -> None:
    """What a behavior raises comes out as NodeError with its path; no node runs on, and the robot holds."""
    bench = Bench(
        f"sequence: s\nmemory: true\nchildren:\n  - {{navigate: cup}}\n  - {PICK.replace(chr(10), chr(10) + '    ')}"
    )

    def broken(criterion: str, image: CameraImage | None) -> None:
        raise ZeroDivisionError("the judge broke")

    bench.context.checker.check = broken  # type: ignore[method-assign, assignment]
    with pytest.raises(NodeError) as caught:
        bench.run()
    assert caught.value.path == "s/until_complete/check_complete"
    assert str(caught.value).startswith("s/until_complete/check_complete: ZeroDivisionError: the judge broke, at ")
    assert "test_behaviors.py:" in str(caught.value)
    assert isinstance(caught.value.__cause__, ZeroDivisionError)
    assert all(node.status == Status.INVALID for node in bench.tree.nodes.values())
    assert not bench.base.any()
    last = bench.tree.states()
    assert last["s/navigate"].status == "SUCCESS"
    assert last[caught.value.path].feedback == "error: ZeroDivisionError('the judge broke')"


def test_one_that_cannot_stop_does_not_keep_the_others_from_it() -> None:
    """An exception in one node's terminate is no obstacle to the rest of an interruption."""
    bench = Bench(PICK)
    bench.run(2)

    def broken(new_status: Status) -> None:
        raise RuntimeError

    bench.node("check_complete").terminate = broken  # type: ignore[method-assign]
    bench.world.robot.act(np.ones(ACTION_SIZE))
    bench.tree.interrupt()
    assert not bench.base.any()


def test_constructing_a_tree_touches_no_backend() -> None:
    """A tree is built, drawn and thrown away without a context."""
    built = tree(PICK)
    assert set(built.states()) == set(built.nodes)
    built.interrupt()


def test_the_stopwatch_counts_inner_activities_only_as_themselves() -> None:
    """The sum over activities is at most the time that passed."""
    import time

    watch = Stopwatch()
    began = time.perf_counter()
    with watch("outer"):
        time.sleep(0.01)
        with watch("inner"):
            time.sleep(0.02)
    passed = time.perf_counter() - began
    assert set(watch.seconds) == {"outer", "inner"}
    assert watch.seconds["outer"] >= 0.01
    assert watch.seconds["inner"] >= 0.02
    assert sum(watch.seconds.values()) <= passed


def test_contexts_of_two_runs_are_apart() -> None:
    """Two trees that run side by side share nothing: each logs its own."""
    one, two = Bench("attempt: a\nchild: {navigate: moon}"), Bench("attempt: a\nchild: {navigate: cup}")
    one.run()
    two.run()
    assert isinstance(one.context, Context)
    assert (len(one.context.log.failures), len(two.context.log.failures)) == (1, 0)
    assert isinstance(one.world.robot, KinematicRobot)
