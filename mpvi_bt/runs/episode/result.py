"""The result of one episode: a JSON file in the layout of BEHAVIOR's evaluator, with our own keys beside it.

Every wall-clock figure is under "wall": without that key the same config gives the same bytes. A digest of the others
tells a file that was changed by hand.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, replace
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import ConfigDict, Field, JsonValue, model_validator

from mpvi_bt.executive.behaviors.context import WatchedHandoff
from mpvi_bt.executive.drawing.endings import ended, gave_up
from mpvi_bt.executive.monitors.causes import likely_cause
from mpvi_bt.executive.monitors.handoff import Handoff
from mpvi_bt.executive.plan.planners import Planned
from mpvi_bt.executive.ticking.goal_report import GoalReport, conditions_met
from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import shown
from mpvi_bt.ground.human import human_stats
from mpvi_bt.ground.marked_yaml import Amount, Count, Record, Share
from mpvi_bt.ground.version import __version__
from mpvi_bt.ground.writing import unwritable, write_whole
from mpvi_bt.runs.choices.backends import eyes_of, privileged
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.episode.metrics import DIRECTIONS, Measurement, ratio
from mpvi_bt.runs.episode.queries import Queries
from mpvi_bt.runs.episode.result_html import conditions_html, result_html
from mpvi_bt.runs.episode.way import Way

if TYPE_CHECKING:
    from mpvi_bt.house.instances.tasks import Task

_MOST_FAILURES = 12  # listed in a notebook
_IF_ANY = Field(exclude_if=lambda value: value is None)  # a key that most results would have as null


class Score(Record):
    """q at the end of the episode."""

    final: Share


class Time(Record):
    """Control steps, simulated seconds, and human / robot."""

    simulator_steps: Count
    simulator_time: Amount
    normalized_time: Amount | None


class PerHand(Record):
    """A figure for each hand."""

    left: Amount
    right: Amount


class Distances(PerHand):
    """A figure for the base and each hand."""

    base: Amount


class Ratios(Record):
    """Human / robot for the base and each hand; null where the robot did not move, or no human did the task."""

    base: Amount | None
    left: Amount | None
    right: Amount | None


class ConditionRecord(Record):
    """One condition of the goal at the end."""

    condition: str
    satisfied: bool


class FailureRecord(Record):
    """One thing that failed in the world during the episode.

    Attributes:
        node: Path of the node in the tree.
        reason: Stable code, such as "no_path".
        feedback: One line for a person.
        time_s: Simulated time.
    """

    node: str
    reason: str
    feedback: str = ""
    time_s: Amount = 0.0


class ReplanRecord(Record):
    """One time that the planner was asked for a new plan.

    Attributes:
        node: Path of the node that failed.
        segments: Of the new plan; null: there was none, and the old one went on.
        said: Why there was none.
        time_s: Simulated time at which it was asked.
    """

    node: str
    segments: Count | None
    said: str = ""
    time_s: Amount = 0.0


class Grasps(Record):
    """How often a hand closed on nothing, and how often what it held was gone."""

    empty: Count = 0
    lost: Count = 0


class Planning(Record):
    """Cost of making the plan with a language model.

    Attributes:
        answers: How often the model was asked: once, and again for every repair.
        latency_s: Sum of the times that its answers took; of those on file as it was then.
        tokens_in, tokens_out: As the server counts them.
        kept: Answers that were on file.
    """

    answers: Count
    latency_s: Amount
    tokens_in: Count
    tokens_out: Count
    kept: Count

    @classmethod
    def of(cls, planned: Planned | None) -> Planning | None:
        """The cost of a plan; None if no model was asked."""
        if planned is None or not planned.answers:
            return None
        answers = planned.answers
        return cls(
            answers=len(answers),
            latency_s=planned.latency_s,
            tokens_in=sum(answer.tokens_in for answer in answers),
            tokens_out=sum(answer.tokens_out for answer in answers),
            kept=sum(answer.kept for answer in answers),
        )


class PolicyShare(Record):
    """Prompts and control steps of one of two policies in an episode."""

    prompts: Count
    steps: Count


class ActionPace(Record):
    """How the policy's rows of actions were carried out.

    Attributes:
        rate_hz: Rows a second.
        kind: What joints in them are: "absolute", "delta" or "velocity".
        said_by: Who says the rate, such as "--policy-rate" or "the server"; "nobody": it is that of control steps.
    """

    rate_hz: Amount
    kind: str
    said_by: str


class Lateness(Record):
    """What the policy's latency came to, by vla-eval's names.

    Attributes:
        stale_action_ratio: Share of the policy's steps in which the robot held for want of an action.
        effective_control_hz: Actions from chunks a simulated second.
    """

    stale_action_ratio: Share
    effective_control_hz: Amount


class Result(Record):
    """One episode's result; the field names are the file's keys.

    Attributes:
        format: Version of this layout.
        version: Version of mpvi_bt.
        rollout_id: The seed.
        success: The goal was true at the end.
        q_score: Official q: what held at the start earns nothing.
        goal_fraction: q that credits what held at the start, too: share of literals that hold, in the best option.
        conditions_met: The plain fraction: share of `goal` that holds.
        ended: How the episode ended, such as "success", "failure", "time_limit"; "backend_error": what failed is the
            server of the policy or a language model, so that the result says nothing of the policy.
        replans: Requests for a new plan.
        clipped: Actions of the policy that had to be brought within the robot's limits.
        grasps: That failed.
        queries: Of the completion checker.
        planning: Of the language model that made the plan; null if none did.
        policies: By name, of two policies such as "learned+reactive"; absent where one does everything.
        faults: How often each fault that the policy was given came about; absent if it was given none.
        actions: How the policy's rows were carried out; absent where it says that they are absolute, 30 a second.
        lateness: Of the policy; absent if it was not made late.
        handoffs: That a `monitor` watched, with their signals; absent if there was none.
        diagnosis: Every handoff to the policy, with its figures, why it ended, and the likely cause; null where it was
            not kept. Wall times of its answers are under "wall".
        config: Everything that can change the outcome.
        privileged: Backends that read simulator truth, as "kind:name".
        eyes: Kinds of backends that look at pictures, to what they see them by: "labels" of the renderer, or "pixels";
            absent in results of before.
        way: Of the base and of things, for drawing; null where it was not kept.
        directions: What each figure's unit is, and which way is better.
        wall: Every wall-clock figure [s].
    """

    model_config = ConfigDict(strict=True)

    format: Literal[1] = 1
    version: str
    task: str
    instance_id: Count
    rollout_id: int
    steps: Count
    success: bool
    q_score: Score
    goal_fraction: Share
    time: Time
    agent_distance: Distances
    normalized_agent_distance: Ratios
    agent_distance_base_relative: PerHand
    goal: list[ConditionRecord]
    conditions_met: Share = Field(default_factory=lambda data: conditions_met([c.satisfied for c in data["goal"]]))
    ended: str
    failures: list[FailureRecord]
    replans: list[ReplanRecord] = []
    clipped: Count = 0
    grasps: Grasps = Grasps()
    queries: Queries = Queries()
    planning: Planning | None = None
    policies: Annotated[dict[str, PolicyShare] | None, _IF_ANY] = None
    faults: Annotated[dict[str, Count] | None, _IF_ANY] = None
    actions: Annotated[ActionPace | None, _IF_ANY] = None
    lateness: Annotated[Lateness | None, _IF_ANY] = None
    handoffs: Annotated[list[dict[str, JsonValue]] | None, _IF_ANY] = None
    diagnosis: list[Handoff] | None = None
    config: dict[str, JsonValue]
    privileged: list[str]
    eyes: Annotated[dict[str, str] | None, _IF_ANY] = None
    way: Way | None = None
    directions: dict[str, str]
    wall: dict[str, JsonValue]

    @model_validator(mode="after")
    def _agrees(self) -> Result:
        """A goal is reached where all its conditions hold; then the two exact scores are 1.

        They may be 1 elsewhere, too: where three things are in the sink, and the goal wants exactly two there.
        """
        met = [condition.satisfied for condition in self.goal]
        if all(met) != self.success or (self.success and not self.q == self.goal_fraction == 1.0):
            raise ValueError("success, q and goal_fraction do not agree with the goal's conditions")
        if abs(self.conditions_met - conditions_met(met)) > 1e-9:
            raise ValueError("conditions_met is not the share of the goal's conditions that are satisfied")
        return self

    @property
    def q(self) -> float:
        """Official q."""
        return self.q_score.final

    def __str__(self) -> str:
        """One line for a person."""
        met = sum(condition.satisfied for condition in self.goal)
        return f"{self._about}: q = {self.q:.3f}, {met} of {len(self.goal)} conditions; {self.told}"

    def _repr_html_(self) -> str:
        """The table that notebooks show: q, the goal, the costs, and what failed."""
        failed = [f"{f.time_s:.0f} s: {escape(f.feedback or f.reason)}" for f in self.failures[:_MOST_FAILURES]]
        if len(self.failures) > _MOST_FAILURES:
            failed.append(f"and {len(self.failures) - _MOST_FAILURES} more")
        rows = {
            "goal": conditions_html((c.condition, c.satisfied) for c in self.goal),
            "end": [escape(self.told)],
            "distance": [f"base {self.agent_distance.base:.1f} m"],
            "given up": failed,
            "reads truth": [escape(", ".join(self.privileged))] if self.privileged else [],
        }
        return result_html(f"q = {self.q:.3f}", self._about, self.success, rows)

    @property
    def _about(self) -> str:
        return f"{self.task}, instance {self.instance_id}, seed {self.rollout_id}"

    @property
    def timed_diagnosis(self) -> list[Handoff] | None:
        """`diagnosis` with the wall times of the policy's answers, where they are there."""
        answers: Any = self.wall.get("answers")
        if self.diagnosis is None:
            return None
        try:
            return [
                replace(handoff, wall_mean_s=float(took["mean_s"]), wall_most_s=float(took["most_s"]))
                for handoff, took in zip(self.diagnosis, answers, strict=True)
            ]
        except (KeyError, TypeError, ValueError):  # no digest covers wall times
            return self.diagnosis

    @property
    def gave_up(self) -> int:
        """Units of the plan that were given up."""
        return gave_up(self.ended, len(self.failures))

    @property
    def told(self) -> str:
        """How the plan (or the given tree) ended. The goal is reported separately."""
        return ended(self.ended, self.gave_up, not self.config.get("tree"), self.time.simulator_time)


def make_result(
    config: EpisodeConfig,
    task: Task,
    goal: GoalReport,
    measured: Measurement,
    *,
    ended: str,
    failures: Iterable[FailureRecord] = (),
    replans: Iterable[ReplanRecord] = (),
    clipped: int = 0,
    grasps: Grasps | None = None,
    queries: Queries | None = None,
    planning: Planning | None = None,
    policies: Mapping[str, PolicyShare] | None = None,
    faults: Mapping[str, int] | None = None,
    actions: ActionPace | None = None,
    lateness: Lateness | None = None,
    handoffs: Iterable[WatchedHandoff] = (),
    diagnosis: Iterable[Handoff] | None = None,
    things: Mapping[str, list[list[float]]] | None = None,
    wall: Mapping[str, Any] | None = None,
) -> Result:
    """Put an episode's result together.

    Args:
        config: The episode.
        task: Its task, whose human means normalize time and distances.
        goal: The goal, judged at the end.
        measured: What the meter says.
        ended: How the episode ended.
        failures: What failed on the way, in order.
        replans: Requests for a new plan, in order.
        clipped, grasps, queries, planning, policies, faults, actions, lateness, handoffs, diagnosis: As of `Result`.
        things: As of `Way`.
        wall: Wall-clock figures [s]; may nest.
    """
    human = human_stats().get(task.problem)
    hands = measured.hand_world_m
    return Result(
        version=__version__,
        task=config.task_name,
        instance_id=config.instance,
        rollout_id=config.seed,
        steps=measured.steps,
        success=goal.satisfied,
        q_score=Score(final=goal.q),
        goal_fraction=goal.fraction,
        time=Time(
            simulator_steps=measured.steps,
            simulator_time=measured.time_s,
            normalized_time=ratio(human.steps, measured.steps) if human else None,
        ),
        agent_distance=Distances(base=measured.base_m, left=hands["left"], right=hands["right"]),
        normalized_agent_distance=Ratios(
            base=ratio(human.base_m, measured.base_m) if human else None,
            left=ratio(human.hand_m["left"], hands["left"]) if human else None,
            right=ratio(human.hand_m["right"], hands["right"]) if human else None,
        ),
        agent_distance_base_relative=PerHand(left=measured.hand_base_m["left"], right=measured.hand_base_m["right"]),
        goal=[ConditionRecord(condition=c.text, satisfied=c.satisfied) for c in goal.conditions],
        conditions_met=goal.conditions_met,
        ended=ended,
        failures=list(failures),
        replans=list(replans),
        clipped=clipped,
        grasps=grasps or Grasps(),
        queries=queries or Queries(),
        planning=planning,
        policies=dict(policies) if policies else None,
        faults=None if faults is None else dict(faults),
        actions=actions,
        lateness=lateness,
        handoffs=[asdict(handoff) for handoff in handoffs] or None,
        diagnosis=None if diagnosis is None else [kept_handoff(handoff) for handoff in diagnosis],
        config=config.record(),
        privileged=privileged(config.backends),
        eyes=eyes_of(config.backends),
        way=Way(base=measured.way, things=dict(things or {})),
        directions=dict(DIRECTIONS),
        wall=dict(wall or {}),
    )


def kept_handoff(handoff: Handoff) -> Handoff:
    """A handoff with its likely cause, and without wall times, of which the same config gives others."""
    cause = likely_cause(handoff)
    return replace(handoff, cause=cause.sentence if cause else "", wall_mean_s=0.0, wall_most_s=0.0)


def other_run(path: Path, config: EpisodeConfig) -> str:
    """Settings of the result at a path that this run has otherwise, such as "policy 'reactive'"; "": none."""
    if (there := read_result(path)) is None:
        return ""
    now = json.loads(json.dumps(config.record()))
    differ = [key for key in now if there.config.get(key, now[key]) != now[key]]  # a version before may lack some
    return ", ".join(f"{key} {shown(there.config[key])}" for key in differ[:3])


def write_result(path: Path, result: Result | Mapping[str, Any]) -> None:
    """Write a result so that the file is whole or not there, whatever happens.

    Raises:
        ValidationError: A mapping that is no result.
        ValueError: A number under "wall" that JSON does not have.
    """
    checked = result if isinstance(result, Result) else Result.model_validate(dict(result))
    data = checked.model_dump(mode="json")
    write_json(path, {**data, "digest": _digest(data)})


def read_result(path: Path) -> Result | None:
    """The result in a file; None if there is no such file, or it is cut short, changed by hand or no result.

    Files of versions that wrote no digest are taken if they agree with themselves.
    """
    if not paths.is_file(path):  # a pipe, say, which nobody may ever write to
        return None
    try:
        data = json.loads(path.read_bytes())
        digest = data.pop("digest", None)
        return Result.model_validate(data) if digest in (None, _digest(data)) else None
    except (OSError, ValueError, TypeError, AttributeError, RecursionError):
        return None


def _digest(data: Mapping[str, Any]) -> str:
    """Of all of a result's file but wall times."""
    told = {key: value for key, value in data.items() if key != "wall"}
    return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()[:16]


def write_json(path: Path, data: Any) -> None:
    """Write strict JSON, whole or not at all. Raises as `write_whole`."""
    text = json.dumps(data, indent=1, allow_nan=False, ensure_ascii=False) + "\n"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise unwritable(path, error) from None
    write_whole(path, text)
