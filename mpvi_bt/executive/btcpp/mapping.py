"""Our trees in the words of BehaviorTree.CPP 4: nodes, ports and references, both ways.

A kind is written as one of BehaviorTree.CPP's own nodes where that does the same, and else as a node of ours, which the
file describes under <TreeNodesModel>. What a node of theirs does differently at the edges is said in `differs`, and
both directions warn of it. docs/btcpp.md has the table and how it was checked.
"""

from __future__ import annotations

import functools
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

from mpvi_bt.executive.behaviors import references
from mpvi_bt.executive.behaviors.parameters import Value
from mpvi_bt.executive.behaviors.registry import NodeType, node_types
from mpvi_bt.executive.btcpp.format import NODES
from mpvi_bt.ground.marked_yaml import plain_scalar

THEIRS = frozenset({*NODES, "SubTree"})  # every node that BehaviorTree.CPP 4.10 registers by itself
_NAV2 = """
    " AppendGoalPoseToGoals AreErrorCodesPresent ArePosesNear AssistedTeleop BackUp CancelAssistedTeleop CancelBackUp
    CancelComputeAndTrackRoute CancelControl CancelDriveOnHeading CancelFollowObject CancelSpin CancelWait
    CheckPoseOccupancy CheckStopStatus ClearCostmapAroundPose ClearCostmapAroundRobot ClearCostmapExceptRegion
    ClearEntireCostmap ComputeAndTrackRoute ComputePathThroughPoses ComputePathToPose ComputeRoute ConcatenatePaths
    ControllerSelector DistanceController DistanceTraveled DockRobot DriveOnHeading ExtractRouteNodesAsGoals
    FollowObject FollowPath GetCurrentPose GetNextFewGoals GetPoseFromPath GlobalUpdatedGoal GoalCheckerSelector
    GoalReached GoalUpdated GoalUpdatedController GoalUpdater InitialPoseReceived IsBatteryCharging IsBatteryLow
    IsGoalNearby IsPathValid IsPoseOccupied IsStopped IsStuck IsWithinPathTrackingBounds NavigateThroughPoses
    NavigateToPose NonblockingSequence PathExpiringTimer PathHandlerSelector PathLongerOnApproach PauseResumeController
    PersistentSequence PipelineSequence PlannerSelector ProgressCheckerSelector RateController RecoveryNode
    ReinitializeGlobalLocalization RemoveInCollisionGoals RemovePassedGoals RoundRobin SingleTrigger SmoothPath
    SmootherSelector SpeedController Spin TimeExpired ToggleCollisionMonitor TransformAvailable TruncatePath
    TruncatePathLocal UndockRobot ValidatePath WouldAControllerRecoveryHelp WouldAPlannerRecoveryHelp
    WouldARouteRecoveryHelp WouldASmootherRecoveryHelp
"""
NAV2 = frozenset(_NAV2.split())  # nodes of ROS's Nav2; "Wait" is one too, and ours
KEPT = frozenset({"Action", "Condition", "Control", "Decorator", "BehaviorTree", "TreeNodesModel", "root", "Root"})
KEY = re.compile(r"[a-z][a-z0-9_]*")
FIRST_VALUES = "first values of the blackboard"  # name of the Sequence that sets them, then ticks the tree
MAX_MSEC = 2**32 - 1


@dataclass(frozen=True)
class Builtin:
    """One of BehaviorTree.CPP's nodes that is one of our kinds.

    Attributes:
        tag, kind: Theirs and ours.
        fixed: Parameters that the tag stands for.
        constant: Ports with the values that stand for those parameters.
        port, parameter: The one port that holds a parameter; "name" is the node's name.
        differs: What it does otherwise at the edges, or "".
        partly: It does only for some values of the parameters; the others are a node of ours.
    """

    tag: str
    kind: str
    fixed: Mapping[str, Any] = field(default_factory=dict)
    constant: Mapping[str, str] = field(default_factory=dict)
    port: str = ""
    parameter: str = ""
    differs: str = ""
    partly: bool = False


_AGAIN = "BehaviorTree.CPP begins a child that took more than one tick again within the same tick, mpvi_bt at the next"
_AT_ONCE = "BehaviorTree.CPP ticks its next child at the next tick, mpvi_bt within the same one"
BUILTINS = (
    Builtin("Sequence", "sequence", {"memory": True}),
    Builtin("ReactiveSequence", "sequence", {"memory": False}),
    Builtin("Fallback", "selector", {"memory": True}),
    Builtin("ReactiveFallback", "selector", {"memory": False}),
    Builtin(
        "AsyncSequence", "sequence", {"memory": True}, differs=_AT_ONCE
    ),  # read only, as the first of a kind is written
    Builtin("AsyncFallback", "selector", {"memory": True}, differs=_AT_ONCE),
    Builtin(
        "Parallel",
        "parallel",
        {"policy": "success_on_all"},
        {"success_count": "-1", "failure_count": "1"},
        differs="when a child fails, BehaviorTree.CPP does not tick those after it any more, mpvi_bt does",
    ),
    Builtin(
        "Parallel",
        "parallel",
        {"policy": "success_on_one"},
        {"success_count": "1", "failure_count": "1"},
        differs="in BehaviorTree.CPP the first child that ends settles it; mpvi_bt ticks all, and a failure wins",
    ),
    Builtin("Inverter", "invert"),
    Builtin(
        "ForceSuccess",
        "attempt",
        {"on_failure": "advance"},
        differs="BehaviorTree.CPP keeps no record of what was given up",
        partly=True,
    ),
    Builtin(
        "Timeout",
        "timeout",
        port="msec",
        parameter="limit",
        differs="BehaviorTree.CPP counts wall-clock time and halts the child between ticks; mpvi_bt counts simulated "
        "time, and a child that ends at the last tick has its way",
        partly=True,
    ),
    Builtin("RetryUntilSuccessful", "retry", port="num_attempts", parameter="tries", differs=_AGAIN),
    Builtin("Repeat", "repeat", port="num_cycles", parameter="times", differs=_AGAIN),
    Builtin(
        "Sleep",
        "wait",
        port="msec",
        parameter="duration",
        differs="BehaviorTree.CPP counts wall-clock time, mpvi_bt simulated time",
        partly=True,
    ),
    Builtin("AlwaysSuccess", "succeed"),
    Builtin("AlwaysFailure", "fail", port="name", parameter="reason"),
)


@dataclass(frozen=True)
class Port:
    """An input port of a node of ours.

    Attributes:
        type: In C++.
        text: It holds a text as it is. Any other value is written so that its type can be told from it.
        optional: It may be left out.
    """

    type: str
    text: bool
    optional: bool


_CPP = {"string": "std::string", "integer": "int", "number": "double", "boolean": "bool"}


def ports_of(kind: str) -> Mapping[str, Port]:
    """The ports of a kind that is registered."""
    return ports_of_type(node_types()[kind])


@functools.cache
def ports_of_type(node_type: NodeType) -> Mapping[str, Port]:
    """The ports of a type of node: its parameters, by name."""
    schema = node_type.parameters.model_json_schema()
    needed = schema.get("required", [])
    ports = {}
    for name, told in schema.get("properties", {}).items():
        types = [one.get("type") for one in told.get("anyOf", [told]) if one.get("type") != "null"]
        only = types[0] if len(types) == 1 and isinstance(types[0], str) else ""
        optional = name not in needed  # BehaviorTree.CPP's schema wants a default of what may be left out
        ports[name] = Port("std::string" if optional else _CPP.get(only, "std::string"), only == "string", optional)
    return MappingProxyType(ports)


def own_id(kind: str) -> str:
    """The ID of one of our kinds, such as "LookAround"; "TimeoutNode" if BehaviorTree.CPP has a "Timeout"."""
    name = "".join(part.capitalize() for part in kind.split("_"))
    return f"{name}Node" if name in THEIRS | KEPT else name


def own_kinds() -> Mapping[str, str]:
    """The kinds that may become nodes of ours, by ID: all without a full equal in BehaviorTree.CPP."""
    return _own_kinds(tuple(node_types()))


@functools.cache
def _own_kinds(kinds: tuple[str, ...]) -> Mapping[str, str]:
    always = {row.kind for row in BUILTINS if not row.partly} | {"subtree"}
    return MappingProxyType({own_id(kind): kind for kind in kinds if kind not in always})


def model_of(node_type: NodeType) -> str:
    """Whether it is a "Control", "Decorator", "Action" or "Condition" to them."""
    if node_type.kind == "test":
        return "Condition"
    return {"composite": "Control", "decorator": "Decorator", "leaf": "Action"}[node_type.family]


def is_pointer(text: str) -> bool:
    """Whether BehaviorTree.CPP takes a port's text for a reference to the blackboard."""
    stripped = text.strip(" ")
    return text == "=" or (len(stripped) > 2 and stripped[0] == "{" and stripped[-1] == "}")


def to_port(value: Value, text: bool) -> str:
    """A parameter as a port's text. Raises ValueError if no text would be read as that value."""
    if isinstance(value, bool | int | float):
        return number_text(value)
    if not isinstance(value, str):
        raise ValueError("a list or a mapping is not a port's value")
    if name := references.whole(value):
        return f"{{{name}}}"
    if not text and (plain_scalar(value) != value or value[:1] == '"' or is_pointer(value)):
        return json.dumps(value, ensure_ascii=False)
    if is_pointer(value):
        raise ValueError(f"BehaviorTree.CPP takes {value!r:.40} for a reference to its blackboard")
    return value


def from_port(text: str, as_text: bool) -> Any:
    """The parameter that a port's text stands for. Raises ValueError if there is none."""
    if is_pointer(text):
        name = text.strip(" ")[1:-1]
        if not KEY.fullmatch(name):
            raise ValueError(f"{text!r:.40} is no reference here: keys are like 'cup_2'")
        return f"${name}"
    if as_text:
        return text
    return json.loads(text) if text.startswith('"') else plain_scalar(text)


def number_text(value: bool | int | float) -> str:
    """As it is written: true, 3, 0.5."""
    if isinstance(value, bool):
        return str(value).lower()
    return str(int(value)) if float(value).is_integer() and abs(value) < 2**53 else repr(value)


def to_msec(duration: float | str) -> str | None:
    """A duration in whole milliseconds; None if it is not, or is in steps."""
    if isinstance(duration, str):
        return None
    msec = round(duration * 1000)
    return str(msec) if msec / 1000 == duration and 0 < msec <= MAX_MSEC else None


def from_msec(text: str) -> Any:
    """Seconds from milliseconds; any other text is returned as given. Raises ValueError for a reference."""
    if is_pointer(text):
        raise ValueError("a reference would be milliseconds there and seconds here: write the number")
    return int(text) / 1000 if re.fullmatch("[0-9]{1,10}", text) else from_port(text, as_text=True)
