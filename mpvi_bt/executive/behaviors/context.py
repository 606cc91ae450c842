"""The context that behaviors get at setup: backends, clock, log and blackboard of one run. Nothing is global."""

from __future__ import annotations

import math
from collections import defaultdict, deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from types import TracebackType
from typing import Any, Literal, Protocol

from mpvi_bt.executive.behaviors.parameters import Value
from mpvi_bt.executive.behaviors.question import Question
from mpvi_bt.executive.monitors.calibration import Calibration
from mpvi_bt.executive.monitors.handoff import INTERRUPTED, Handoff
from mpvi_bt.executive.monitors.handoff_watch import HandoffWatch
from mpvi_bt.executive.plan.skills import Skill
from mpvi_bt.ground.compiled import compiling
from mpvi_bt.ground.cost import Cost
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.marked_yaml import Amount, Count
from mpvi_bt.ground.protocols import Checker, Clock, Judgement, Memory, Navigator, Policy, Triggers
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, Robot, Side

TRAIL_STEPS = 10 * CONTROL_HZ  # of a handoff's commands that are kept. Our choice: a reach takes less


@dataclass(frozen=True)
class Failure:
    """Why a node failed.

    Attributes:
        reason: Stable code, such as "timeout" or "no_path".
        evidence: What was seen, one line for a person.
        path: Of the node that failed, names from the root joined by "/".
        time_s: When, in simulated time.
        cause: The failure that led to this one, such as that of the last try; None if this is where it began.
    """

    reason: str
    evidence: str
    path: str
    time_s: Amount
    cause: Failure | None = None

    @staticmethod
    def of(data: Mapping[str, Any]) -> Failure:
        """The failure from the data of `dataclasses.asdict`. Raises ValueError if it is not one."""
        match data:
            case {
                "reason": str(reason),
                "evidence": str(evidence),
                "path": str(path),
                "time_s": float(time_s) | int(time_s),
            } if 0.0 <= time_s < math.inf:
                cause = data.get("cause")
                return Failure(reason, evidence, path, time_s, Failure.of(cause) if cause else None)
        raise ValueError(f"a failure has a reason, evidence, path and time_s, not {data!r:.100}")


@dataclass(frozen=True)
class Query:
    """One question to the completion checker.

    Attributes:
        criterion: What was asked.
        event: Kind of the event that prompted it.
        camera: Whose picture it was handed, or None.
        complete: The answer.
        reason: What made it think so.
        path: Of the node that asked.
        time_s: When it was asked, in simulated time.
        latency_s, fault, cost: Of the answer, as in `Judgement`.
    """

    criterion: str
    event: str
    camera: str | None
    complete: bool
    reason: str
    path: str
    time_s: Amount
    latency_s: Amount = 0.0
    fault: str = ""
    cost: Cost | None = None

    @property
    def said(self) -> str:
        """As a person is told it: a question without an answer got no "no"."""
        return "yes" if self.complete else "no answer" if self.fault else "no"


@dataclass(frozen=True)
class Notice:
    """What a hand felt of its grasp.

    Attributes:
        kind: "empty": it closed on nothing. "lost": what it held is gone.
        side: Which hand.
        path: Of the node that was at work.
        time_s: When, in simulated time.
    """

    kind: Literal["empty", "lost"]
    side: Side
    path: str
    time_s: Amount


@dataclass(frozen=True)
class Replan:
    """What came of asking the planner for another plan for the rest of the work.

    Attributes:
        path: Of the `attempt` that failed; the new plan took the place of what followed it.
        segments: Of the new plan, 0 if it says that nothing is left to do; None: there is none, the old one advanced.
        said: Why there is none, one line, or "".
        time_s: When it was asked for, in simulated time.
        latency_s: How long the planner took.
        cost: Of a language model's answers, or None.
    """

    path: str
    segments: Count | None
    said: str
    time_s: Amount
    latency_s: Amount = 0.0
    cost: Cost | None = None


@dataclass
class WatchedHandoff:
    """One stretch of the policy's work that a `monitor` watched.

    Attributes:
        skill: That the policy was at, by name; "": not known.
        path: Of the monitor.
        began_s, ended_s: Simulated time.
        ended: "success", "failure", or "interrupted", which it is until it ends.
        reason: Of a failure, such as "alarm".
        samples: The signals every half second, as of `monitors.signals.SIGNALS`.
    """

    skill: str
    path: str
    began_s: Amount
    ended_s: Amount = 0.0
    ended: Literal["success", "failure", "interrupted"] = "interrupted"
    reason: str = ""
    samples: list[list[Amount]] = field(default_factory=list)


class Request(Protocol):
    """A new plan that an `attempt` waits for.

    Attributes:
        note: How it stands, a few words for a person.
    """

    note: str

    def waits(self) -> bool:
        """Whether it is still to come or to be swapped in; asked once a tick, and no more once it is not."""
        ...


class Replanning(Protocol):
    """Has new plans made, and puts them into the tree."""

    def ask(self, path: str, failure: Failure) -> Request:
        """Ask for a new plan for everything after the failed node at `path`. It never blocks."""
        ...

    def swap(self) -> None:
        """Put the plans into the tree that are there; between two ticks."""
        ...


@dataclass
class Log:
    """What happened in one run.

    Attributes:
        failures: Of segments that were given up (`attempt` writes them), in order.
        queries: Of the completion checker, in the order of their answers.
        notices: Of empty and lost grasps, in order.
        replans: Of requests for another plan, in the order of their answers.
        handoffs: That monitors watched, in order.
        diagnosis: Every handoff to the policy that has ended, in order, with its figures.
        under_way: Handoffs that have not ended.
        clipped: How many actions of the policy had to be brought within the robot's limits.
    """

    failures: list[Failure] = field(default_factory=list)
    queries: list[Query] = field(default_factory=list)
    notices: list[Notice] = field(default_factory=list)
    replans: list[Replan] = field(default_factory=list)
    handoffs: list[WatchedHandoff] = field(default_factory=list)
    diagnosis: list[Handoff] = field(default_factory=list)
    under_way: list[HandoffWatch] = field(default_factory=list)
    clipped: int = 0

    def end_handoffs(self, ending: str, time_s: float) -> None:
        """Name the run's ending as the reason of the handoffs that it has just interrupted."""
        for i, handoff in enumerate(self.diagnosis):
            if handoff.stopped_reason == INTERRUPTED and handoff.ended_s == time_s:
                self.diagnosis[i] = replace(handoff, stopped_reason=ending)


class Stopwatch:
    """Wall time by activity: `with stopwatch("policy"): ...`. An activity inside another counts only as itself.

    Compiling, which only the first run on a machine waits for, is none of them.

    Attributes:
        seconds: Wall time [s] so far of each activity.
    """

    def __init__(self) -> None:
        self.seconds: defaultdict[str, float] = defaultdict(float)
        self._open: list[str] = []
        self._since = 0.0

    def __call__(self, activity: str) -> Stopwatch:
        """Name the activity that the next `with` measures."""
        self._switch()
        self._open.append(activity)
        return self

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._switch()
        self._open.pop()

    def _switch(self) -> None:
        now = compiling.clock()
        if self._open:
            self.seconds[self._open[-1]] += now - self._since
        self._since = now


@dataclass
class Context:
    """The backends of one run.

    Attributes:
        clock: Simulated time.
        robot: What is driven.
        navigator: Drives the base.
        policy: Moves the arms.
        checker: Judges completion.
        triggers: Watch proprioception.
        skills: By name.
        sense: Called before each tick: what the robot notices whatever it does, such as what its hands hold.
        memory: What learns while the run lasts, or None.
        while_asked: What the policy does while the checker has not answered yet: it goes on (Paper, Completion Checker:
            the VLA continues until it is told), or the robot holds still.
        asking: Questions to the checker that are open.
        calibration: Thresholds of monitors; None: they never alarm.
        trail: (A,) commands of the last handoff that a monitor watched, the newest last; at most `TRAIL_STEPS`.
        replanning: Has new plans made where an `attempt` wants one; None: it does without.
        log: Failures and queries so far.
        stopwatch: Where the wall time goes.
        blackboard: Values that nodes leave for each other, by key; of this run alone.
    """

    clock: Clock
    robot: Robot
    navigator: Navigator
    policy: Policy
    checker: Checker
    triggers: Triggers
    skills: Mapping[str, Skill] = field(default_factory=dict)
    sense: Callable[[], None] = lambda: None
    memory: Memory | None = None
    while_asked: Literal["go_on", "hold"] = "go_on"
    asking: set[Question[Judgement]] = field(default_factory=set)
    calibration: Calibration | None = None
    trail: deque[Array] = field(default_factory=lambda: deque(maxlen=TRAIL_STEPS))
    replanning: Replanning | None = None
    log: Log = field(default_factory=Log)
    stopwatch: Stopwatch = field(default_factory=Stopwatch)
    blackboard: dict[str, Value] = field(default_factory=dict)
