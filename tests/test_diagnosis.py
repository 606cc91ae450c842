"""What each handoff to a policy came to, and the likely cause, for any policy: by commands and proprioception alone."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mpvi_bt.executive.drawing.cells import columns
from mpvi_bt.executive.monitors.causes import likely_cause
from mpvi_bt.executive.monitors.handoff import HandFigures, Handoff
from mpvi_bt.executive.monitors.handoff_text import handoff_line, handoff_lines
from mpvi_bt.executive.plan.skills import load_skills
from mpvi_bt.executive.ticking.goal_report import GoalCondition, GoalReport
from mpvi_bt.executive.ticking.live import LiveTree
from mpvi_bt.executive.ticking.loop import Outcome, run_episode
from mpvi_bt.executive.trace.explain import Explanation, explain
from mpvi_bt.executive.trace.explain_text import explanation_text
from mpvi_bt.executive.trace.html import trace_page
from mpvi_bt.executive.trace.read import read_trace
from mpvi_bt.executive.tree.build import Tree
from mpvi_bt.executive.tree.yaml_io import parse_tree
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import SIDES, Proprioception
from mpvi_bt.runs.disturbances.late_policy import LatePolicy
from mpvi_bt.runs.episode.queries import with_truth
from mpvi_bt.runs.episode.result import kept_handoff, read_result, write_result
from mpvi_bt.runs.recording.recorder import Recorder
from mpvi_bt.runs.report.figures import figures
from mpvi_bt.runs.report.page import report_page
from mpvi_bt.runs.report.runs import Runs
from mpvi_bt.runs.report.timeline import timeline
from mpvi_bt.testing import KinematicWorld, scripted_context
from tests.layouts import ACTION_SIZE, LAYOUT
from tests.synthetic_suites import synthetic_result, synthetic_runs

SKILLS = load_skills()
HELD = "the cup is held in a gripper"
LIMIT_S = 12
UNIT = f"""
tree: unit
root:
  timeout: {LIMIT_S}
  child:
    until_complete:
    children:
      - manipulate: pick up the cup
      - check_complete: {HELD}
"""
ALONE = "tree: alone\nroot:\n  manipulate: pick up the cup\n"
RIGHT = LAYOUT.arm["right"]
GRIPPER = LAYOUT.gripper["right"]


class Moving:
    """Turns an arm joint to and fro; what a test needs besides is in a subclass."""

    name = "moving"
    cameras: tuple[str, ...] = ()
    note = ""
    gave_up = False
    horizon = 10

    def __init__(self) -> None:
        self.step = 0

    def reset(self) -> None:
        """Begin anew."""
        self.step, self.gave_up = 0, False

    def infer(self, observation: Mapping[str, Any]) -> Array:
        """(10, 23)."""
        body: Proprioception = observation["proprioception"]
        still = np.zeros(ACTION_SIZE)
        still[LAYOUT.torso] = body.torso
        for side in body.sides:
            still[LAYOUT.arm[side]] = body.arm[side]
            still[LAYOUT.gripper[side]] = body.gripper_command[side]
        rows = []
        for _ in range(self.horizon):
            rows.append(self.act(still))
            self.step += 1
        return np.array(rows)

    def act(self, still: Array) -> Array:
        """(23,) the next action."""
        action = still.copy()
        action[RIGHT.start] = 0.3 * np.sin(self.step / 10)
        return action


class Still(Moving):
    """Asks for no motion."""

    def act(self, still: Array) -> Array:
        """(23,)."""
        return still


class Snapping(Moving):
    """Opens and closes a hand once in two seconds, while the arm moves."""

    def act(self, still: Array) -> Array:
        """(23,)."""
        action = super().act(still)
        action[GRIPPER] = 1.0 if self.step % 60 < 30 else -1.0
        return action


class Overreaching(Moving):
    """Tells the right arm's second joint to go where it never can."""

    def act(self, still: Array) -> Array:
        """(23,)."""
        action = super().act(still)
        action[RIGHT.start + 1] = 99.0
        return action


class Stopping(Moving):
    """Stops of its own accord."""

    def __init__(self, note: str) -> None:
        super().__init__()
        self.said = note

    def act(self, still: Array) -> Array:
        """(23,)."""
        if self.step > 60:
            self.note, self.gave_up = self.said, True
        return super().act(still)


def play(folder: Path, policy: object, tree: str = UNIT, *watchers: Any, **world: Any) -> tuple[Explanation, Outcome]:
    """An episode with a policy, explained from its trace.

    Args:
        folder: For the trace.
        policy: At work.
        tree: Its YAML.
        watchers: Besides.
        world: `met`: whether the goal is met; `answers`: of the checker, by criterion; `between_m`: width of what is
            between the fingers; `limit_s`: of the episode.
    """
    made = KinematicWorld()
    made.robot.between_m = dict.fromkeys(SIDES, world.get("between_m", 0.0))
    context = scripted_context(made, SKILLS, {}, world.get("answers", {}))
    context.policy = policy  # type: ignore[assignment]
    met = world.get("met")
    goal = None if met is None else GoalReport(met, float(met), float(met), (GoalCondition("on(radio)", met),))
    score = None if goal is None else (lambda report=goal: report)
    trace, limit_s = folder / "t.jsonl", world.get("limit_s", 60.0)
    recorder = Recorder(trace, {"policy": "it"})
    outcome = run_episode(Tree(parse_tree(tree)), made, context, [recorder, *watchers], limit_s, score=score)
    return explain(read_trace(trace)), outcome


def only(explained: Explanation) -> tuple[Handoff, str]:
    """The one handoff and the likely cause."""
    (found,) = explained.diagnosis
    return found.handoff, found.cause.sentence if found.cause else ""


def test_a_policy_that_holds_still(tmp_path: Path) -> None:
    """It is said to, for how much of the time, and nothing has moved."""
    handoff, cause = only(play(tmp_path, Still())[0])
    assert cause == f"the policy held still for {LIMIT_S} of {LIMIT_S} s"
    assert next(handoff_lines(handoff)) == "moved: neither base nor arms"
    assert (handoff.stopped_reason, handoff.steps, handoff.chunks) == ("timeout", LIMIT_S * 30 + 1, LIMIT_S * 3 + 1)


def test_a_hand_that_closes_on_nothing(tmp_path: Path) -> None:
    """The times are counted, of the hand that did, though the arm is moving."""
    handoff, cause = only(play(tmp_path, Snapping())[0])
    assert cause == "it closed on nothing 6 times"
    assert (handoff.hands["right"].empty, handoff.hands["left"].empty) == (6, 0)
    assert handoff.hands["right"].arm_rad > 1.0


def test_a_hand_that_closes_once_to_press(tmp_path: Path) -> None:
    """That is no cause: if nothing moves from then on, standing still is."""

    class Pressing(Moving):
        def act(self, still: Array) -> Array:
            action = super().act(still) if self.step < 30 else still.copy()
            action[GRIPPER] = -1.0
            return action

    handoff, cause = only(play(tmp_path, Pressing())[0])
    assert handoff.hands["right"].empty == 1
    assert cause.startswith(f"the policy held still for 11 of {LIMIT_S} s")


def test_commands_beyond_the_limits(tmp_path: Path) -> None:
    """Every action is told to be clipped, and the joint is named."""
    handoff, cause = only(play(tmp_path, Overreaching())[0])
    assert cause == "every action was clipped: right arm joint 2 beyond its limit"
    assert handoff.clipped == handoff.steps == handoff.clipped_at["right arm joint 2 beyond its limit"]


@pytest.mark.parametrize(("latency_s", "waits"), [(1.0, True), (0.1, False)])
def test_a_slow_server(tmp_path: Path, latency_s: float, waits: bool) -> None:
    """Where the robot waits for most of the time that is the cause; where it seldom does it is not."""
    handoff, cause = only(play(tmp_path, LatePolicy(Moving(), lambda answer: latency_s))[0])
    assert cause.startswith("the robot waited for the policy's answers for ") is waits
    assert handoff.waited_s == pytest.approx(LIMIT_S * latency_s / (latency_s + 1 / 3), rel=0.15)


def test_a_checker_that_always_says_no(tmp_path: Path) -> None:
    """The hand holds something, the policy takes it for done, and the no is told with its reason."""

    class Taking(Stopping):
        def act(self, still: Array) -> Array:
            action = super().act(still)
            action[GRIPPER] = -1.0
            return action

    explained, outcome = play(tmp_path, Taking("done"), answers={HELD: (False,)}, between_m=0.06)
    handoff, cause = only(explained)
    no = f'at last to "{HELD}": as scripted'
    assert cause == f"the policy said that it was done, and the checker said no, {no}"
    assert (handoff.stopped_reason, handoff.hands["right"].grasped, handoff.noes) == ("policy_done", 1, 1)
    (judged,) = with_truth(outcome.log.diagnosis, outcome.log.queries, [True])
    assert (found := likely_cause(judged)) is not None
    assert found.sentence == "the checker said no to what was there"
    assert list(with_truth([handoff], outcome.log.queries, [None])) == [handoff]


def test_a_yes_needs_no_cause(tmp_path: Path) -> None:
    """A handoff that the checker ends by a yes is complete, whatever its figures are."""
    explained, _ = play(tmp_path, Snapping(), answers={HELD: (True,)}, between_m=0.06)
    handoff, cause = only(explained)
    assert (handoff.stopped_reason, cause, handoff_line(handoff)) == ("complete", "", "complete")
    assert explanation_text(explained).endswith("1 handoff to the policy, 1 confirmed by a checker")


@pytest.mark.parametrize(
    ("tree", "limit_s", "reason"),
    [
        ("tree: t\nroot:\n  timeout: 1\n  child: {manipulate: pick up the cup}\n", 9.0, "timeout"),
        (ALONE, 1.0, "time_limit"),
        ("tree: t\nroot:\n  parallel: p\n  policy: success_on_one\n  children:\n"
         "    - manipulate: pick up the cup\n    - navigate: nowhere\n", 9.0, "unknown_target"),
    ],
)  # fmt: skip
def test_whatever_ends_a_handoff_is_its_reason(tmp_path: Path, tree: str, limit_s: float, reason: str) -> None:
    """A timeout above it, the end of the episode, or a node beside it that failed."""
    _, outcome = play(tmp_path, Moving(), tree, limit_s=limit_s)
    assert [handoff.stopped_reason for handoff in outcome.log.diagnosis] == [reason]
    assert outcome.log.under_way == []


@pytest.mark.parametrize("note", ["done", "2 of 2, turn on the radio: done", "pick: no_grasp"])
def test_a_policy_that_stops_with_the_goal_met_has_not_failed(tmp_path: Path, note: str) -> None:
    """Nowhere: not in its ending, explanation, page, timeline or on the terminal, whatever it says of itself."""
    shown = io.StringIO()
    explained, outcome = play(tmp_path, Stopping(note), ALONE, LiveTree(shown), met=True)
    assert (outcome.ending, outcome.failure, outcome.log.failures) == ("stopped", None, [])
    trace = read_trace(tmp_path / "t.jsonl")
    assert trace.told.startswith("q = 1.000, the policy stopped after ")
    assert (explained.cause, explained.running, explained.gave_up) == (None, (), ())
    assert [row.spans[-1].standing for row in timeline(trace)] == ["success"]
    assert '"is":"failure"' not in trace_page(trace)
    assert "[x]" not in shown.getvalue()
    assert "fail" not in explanation_text(explained) + shown.getvalue()


@pytest.mark.parametrize(("note", "reason"), [("done", "policy_done"), ("pick: no_grasp", "policy_gave_up")])
def test_a_policy_that_stops_short_of_the_goal_has_failed(tmp_path: Path, note: str, reason: str) -> None:
    """Its failure stays, and the handoff tells whether it took its work for done."""
    explained, outcome = play(tmp_path, Stopping(note), ALONE, met=False)
    assert outcome.ending == explained.ending == "failure"
    assert explained.cause is not None
    assert only(explained)[0].stopped_reason == reason


def test_an_explanation_with_handoffs_fits_eighty_columns(tmp_path: Path) -> None:
    """Whatever a handoff has to tell, no line is wider, and prompts and notes become no lines of their own."""
    explained, _ = play(tmp_path, Overreaching())
    (found,) = explained.diagnosis
    wild = replace(found, handoff=replace(found.handoff, prompt="pick\nup " * 40, last_no="no\x1b[2J" * 60, noes=3))
    text = explanation_text(replace(explained, diagnosis=(wild, found)))
    assert max(columns(line) for line in text.splitlines()) <= 80
    assert "\x1b" not in text
    assert "every action was clipped: right arm joint 2 beyond its limit" in " ".join(text.split())


def test_results_and_their_report_tell_of_handoffs(tmp_path: Path) -> None:
    """A result keeps the figures with the cause, and wall times apart; a report's page shows both."""
    _, outcome = play(tmp_path, Overreaching())
    (config,) = synthetic_runs("m", 0.0, ["picking_up_trash"], 1).episodes
    plain = synthetic_result(config, 0.0)
    kept_handoffs = [kept_handoff(handoff) for handoff in outcome.log.diagnosis]
    wall = {**plain.wall, "answers": [{"mean_s": 0.25, "most_s": 0.5}]}
    write_result(tmp_path / "r.json", plain.model_copy(update={"diagnosis": kept_handoffs, "wall": wall}))
    result = read_result(tmp_path / "r.json")
    assert result is not None
    assert result.diagnosis is not None
    (kept,) = result.diagnosis
    assert kept.cause == "every action was clipped: right arm joint 2 beyond its limit"
    assert kept.wall_mean_s == kept.wall_most_s == 0.0
    assert result.timed_diagnosis is not None
    assert result.timed_diagnosis[0].wall_mean_s == 0.25
    runs = [Runs("m", [config], {config: result})]
    page = report_page(figures("s", runs), runs)
    for told in (kept.cause, "in 0.250 s each (wall time)", "1 to the policy, 0 confirmed by a checker"):
        assert told in page
    old = [Runs("m", [config], {config: plain})]
    assert "was not kept" in report_page(figures("s", old), old)


def test_an_older_trace_is_said_to_tell_nothing(tmp_path: Path) -> None:
    """Where a policy was at work and the trace has no figures, that is said, and none are made up."""
    play(tmp_path, Still())
    lines = (tmp_path / "t.jsonl").read_text().splitlines()
    kept = [{key: value for key, value in json.loads(line).items() if key != "diagnosis"} for line in lines]
    (tmp_path / "old.jsonl").write_text("".join(json.dumps(line) + "\n" for line in kept))
    explained = explain(read_trace(tmp_path / "old.jsonl"))
    assert explained.diagnosis == ()
    assert "of 1 node the trace does not tell" in explanation_text(explained)


@given(
    st.floats(0, 200), st.integers(0, 9), st.integers(0, 9), st.booleans(),
    st.sampled_from(["timeout", "policy_gave_up"]),
)  # fmt: skip
def test_every_handoff_can_be_told(still: float, noes: int, empty: int, judged: bool, reason: str) -> None:
    """There are words for any figures, and a cause is one line."""
    hands = {"right": HandFigures(empty=empty)}
    handoff = Handoff("m", "p", 0.0, 200.0, reason, steps=6000, still_s=still, noes=noes, asked=noes, judged=judged,
                      hands=hands, told_still_s=still)  # fmt: skip
    assert (cause := likely_cause(handoff)) is not None
    assert cause.sentence
    assert "\n" not in "".join([handoff_line(handoff), *handoff_lines(handoff)])
