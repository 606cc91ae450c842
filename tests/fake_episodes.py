"""An episode that takes no simulator, for the suite runner's tests; told by the environment how to behave."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path
from typing import Any

from mpvi_bt.executive.ticking.goal_report import GoalCondition, GoalReport
from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.robot.protocol import Side
from mpvi_bt.ground.writing import write_whole
from mpvi_bt.house.instances.tasks import Task
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.episode.metrics import Measurement
from mpvi_bt.runs.episode.result import FailureRecord, make_result

TASK = Task(
    instruction="Put the cans in the bin.",
    problem="picking_up_trash",
    house="any",
    bindings={},
    plan="any",
    tree="any",
)


def run(config: EpisodeConfig) -> dict[str, Any]:
    """An episode whose odd instances fail.

    FAKE_LOG: Folder in which every start and every end is noted. FAKE_SLEEP: seconds that an episode takes.
    FAKE_UNTIL: file before which none ends.
    FAKE_DIE, FAKE_HANG, FAKE_RAISE: an instance whose first attempt dies, hangs or raises; with FAKE_ALWAYS every one.
    FAKE_USER_ERROR: an instance that raises a user error. FAKE_BACKEND: one whose policy's server fails.
    """
    log = Path(os.environ["FAKE_LOG"])
    first = not list(log.glob(f"{config.name}.start.*"))
    note(log, config, "start")
    if os.environ.get("FAKE_USER_ERROR") == str(config.instance):
        raise UserError("the tree is missing")
    for name, act in (("FAKE_DIE", die), ("FAKE_HANG", hang), ("FAKE_RAISE", break_)):
        if os.environ.get(name) == str(config.instance) and (first or "FAKE_ALWAYS" in os.environ):
            act()
    time.sleep(float(os.environ.get("FAKE_SLEEP", "0")))
    while (until := os.environ.get("FAKE_UNTIL")) and not Path(until).exists():
        time.sleep(0.05)
    backend = os.environ.get("FAKE_BACKEND") == str(config.instance) and (first or "FAKE_ALWAYS" in os.environ)
    data = fake_result(config, backend=backend)
    if config.trace is not None:
        config.trace.parent.mkdir(parents=True, exist_ok=True)
        write_whole(config.trace, f"the trace of {config.name}\n")
    note(log, config, "end")
    return data


def fake_result(config: EpisodeConfig, steps: int = 900, backend: bool = False) -> dict[str, Any]:
    """A result that depends on nothing but the config."""
    success = config.instance % 2 == 0
    conditions = (GoalCondition("inside(can, bin)", success),)
    goal = GoalReport(
        satisfied=success, q=1.0 if success else 0.5, fraction=1.0 if success else 0.5, conditions=conditions
    )
    hands: dict[Side, float] = {"left": 3.0, "right": 4.0}
    failures = (
        []
        if success
        else [FailureRecord(node="task/2 pick/timeout", reason="timeout", feedback="still reaching", time_s=12.0)]
    )
    measured = Measurement(steps, 2.0, hands, {"left": 1.0, "right": 2.0})
    ended = "success" if success else "failure"
    if backend:
        ended, failures = (
            "backend_error",
            [FailureRecord(node="task/pick", reason="server_closed", feedback="it went away")],
        )
    wall = {"total_s": float(os.environ.get("FAKE_SLEEP", "1"))}
    result = make_result(config, TASK, goal, measured, ended=ended, failures=failures, wall=wall)
    return result.model_dump(mode="json")


def note(log: Path, config: EpisodeConfig, what: str) -> None:
    """Leave a file that says so."""
    (log / f"{config.name}.{what}.{os.getpid()}.{time.time_ns()}").touch()


def die() -> None:
    """As the kernel ends a process that takes too much memory."""
    os.kill(os.getpid(), signal.SIGKILL)


def hang() -> None:
    """As a backend that never answers."""
    time.sleep(600)


def break_() -> None:
    """As a backend that breaks, with an exception that cannot be pickled."""

    class Unpicklable(Exception):
        def __init__(self, a: int, b: int) -> None:
            super().__init__(f"broke at {a}, {b}")

    raise Unpicklable(1, 2)
