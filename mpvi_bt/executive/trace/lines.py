"""Data models of a trace's lines. `docs/trace.md` is the contract."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any

from pydantic import ConfigDict, Field, TypeAdapter

from mpvi_bt.executive.behaviors.parameters import Value
from mpvi_bt.executive.monitors.handoff import Handoff
from mpvi_bt.executive.tree.state import Ending, NodeState
from mpvi_bt.ground.cost import Cost
from mpvi_bt.ground.marked_yaml import Count

_Time = Annotated[float, Field(ge=0)]


@dataclass(frozen=True)
class CheckerAnswer:
    """What the completion checker said.

    Attributes:
        criterion: What was asked.
        event: Kind of the event that prompted it.
        complete: The answer.
        reason: What made it think so.
        path: Of the node that asked.
        camera: Whose picture it was handed, or None.
        asked_s: When it was asked, in simulated time; None: in the tick that has the answer.
        latency_s, fault, cost: Of the answer, as in `Judgement`.
    """

    criterion: str
    event: str
    complete: bool
    reason: str
    path: str
    camera: str | None = None
    asked_s: _Time | None = None
    latency_s: _Time = 0.0
    fault: str = ""
    cost: Cost | None = None

    @property
    def said(self) -> str:
        """As a person is told it: a question without an answer got no "no"."""
        return "yes" if self.complete else "no answer" if self.fault else "no"


@dataclass(frozen=True)
class Noticed:
    """A bad grasp that a hand felt: it closed on nothing ("empty"), or it lost its payload ("lost").

    Attributes:
        kind: "empty" or "lost".
        side: Which hand.
        path: Of the node that was at work.
    """

    kind: str
    side: str
    path: str


@dataclass(frozen=True)
class Replanned:
    """What came of asking the planner for another plan.

    Attributes:
        path: Of the `attempt` that failed.
        segments: Of the new plan, which took the place of what followed; None: there is none, the old one advanced.
        said: Why there is none.
        asked_s: When it was asked for, in simulated time; None: in the tick that has the answer.
        latency_s, cost: Of the planner's answers.
    """

    path: str
    segments: Count | None = None
    said: str = ""
    asked_s: _Time | None = None
    latency_s: _Time = 0.0
    cost: Cost | None = None


@dataclass(frozen=True)
class Tick:
    """What changed at a tick.

    Attributes:
        tick: Counted from 1.
        time_s, wall_s: Simulated time, and wall time since recording began.
        nodes: New states, by path.
        blackboard: New values, None for a key that is gone.
        queries: The completion checker's answers.
        notices: What hands felt.
        replans: What came of asking for another plan.
        diagnosis: Handoffs to the policy that have ended.
        tree: The tree from this tick on, as `yaml_io.expanded` gives it, if a part of it was swapped.
    """

    __pydantic_config__ = ConfigDict(allow_inf_nan=False)

    tick: Annotated[int, Field(ge=1)]
    time_s: _Time
    wall_s: _Time = 0.0
    nodes: Mapping[str, NodeState] = field(default_factory=dict)
    blackboard: Mapping[str, Value | None] = field(default_factory=dict)
    queries: tuple[CheckerAnswer, ...] = ()
    notices: tuple[Noticed, ...] = ()
    replans: tuple[Replanned, ...] = ()
    diagnosis: tuple[Handoff, ...] = ()
    tree: dict[str, Any] | None = None


@dataclass(frozen=True)
class RootFailure:
    """Why the root failed: a reason code, its evidence, and the node whose failure it was."""

    reason: str
    path: str
    time_s: float
    evidence: str = ""


@dataclass(frozen=True)
class Broken:
    """The exception that ended a run.

    Attributes:
        message: Its type and text.
        path: Of the node that raised it, if one did.
        place: File and line of the behavior's own code, if any was at work.
        reason: Stable code, of a policy's server or a language model that failed.
    """

    message: str
    path: str = ""
    place: str = ""
    reason: str = ""


@dataclass(frozen=True)
class ConditionLine:
    """One condition of the goal, and whether it held at the end."""

    condition: str
    satisfied: bool


@dataclass(frozen=True)
class End:
    """How a run ended, and when: the last tick, simulated time, wall time since recording began; actions clipped.

    Attributes:
        q: Score of the goal; None: there was none.
        goal: Its conditions.
    """

    __pydantic_config__ = ConfigDict(allow_inf_nan=False)

    ending: Annotated[Ending, Field(alias="end")]
    tick: Count
    time_s: _Time
    wall_s: _Time = 0.0
    q: Annotated[float, Field(ge=0, le=1)] | None = None
    goal: tuple[ConditionLine, ...] = ()
    clipped: Count = 0
    failure: RootFailure | None = None
    error: Broken | None = None


@dataclass(frozen=True)
class Header:
    """The head of a trace: version of the format, version of mpvi_bt, the tree, and the run's settings.

    Attributes:
        kinds: Those of the tree's kinds of node that other packages add, and the package of each.
    """

    __pydantic_config__ = ConfigDict(allow_inf_nan=False)

    trace: int
    mpvi_bt: str
    tree: dict[str, Any]
    kinds: Mapping[str, str] = field(default_factory=dict)
    config: dict[str, Any] = field(default_factory=dict)
    seed: int | None = None
    started: str = ""


HEADER, TICK, END = TypeAdapter(Header), TypeAdapter(Tick), TypeAdapter(End)
