"""What a new plan is worth where a can is lost on the way: picking_up_trash by plans of the symbolic planner.

    python -m benchmarks.lost FOLDER [--method NAME] [--starts N] [--keep NAME ...]

Once an episode, in the middle of a drive, a hand that holds a can opens. The task is played twice from each start
state. After a unit that failed `advance` goes on with the next one of the plan, and `replan` has the symbolic planner
make a new plan. The start states go on beyond the ten of the task, and the time budget is long enough for all that
either does. What FOLDER has of the episodes is not played again.
"""

from __future__ import annotations

import json
import random
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import numpy as np

from benchmarks.failing.keeping import keeping, tell
from benchmarks.tables import Cell, Column
from mpvi_bt.finding.navigation.navigator import KnownPlaceNavigator
from mpvi_bt.ground.geometry.linear_algebra import norm
from mpvi_bt.ground.protocols import Progress, Report
from mpvi_bt.ground.robot.protocol import Robot
from mpvi_bt.ground.robot.robots import robot_named
from mpvi_bt.ground.writing import write_whole
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.choices.methods import load_method
from mpvi_bt.runs.episode.episode import run
from mpvi_bt.runs.episode.prepare import prepare
from mpvi_bt.runs.report.statistics import difference, estimate

TASK, WAYS = "picking_up_trash", ("advance", "replan")
BUDGET_S = 900.0  # twice and a half the task's own
OPEN_STEPS = 15  # of control, which is half a second, in the last of which it closes: the can has fallen by then
DRIVES = 3  # with something in a hand, of which one is drawn
DRIVEN_M = (1.0, 2.5)  # how far that one has come [m]
COLUMNS = (
    Column(head="after a failure"),
    Column(head="mean q, 95 %"),
    Column(head="q = 1"),
    Column(head="simulated s", format=".0f"),
    Column(head="units given up", format=".1f"),
    Column(head="new plans", format=".1f"),
)


class Losing:
    """Our navigator, but for the one time (implements `Navigator`).

    Which drive, where on it and which hand follow from the seed and from where the robot begins. Drives that end before
    are passed over.
    """

    def __init__(self, robot: Robot, ours: KnownPlaceNavigator, seed: int) -> None:
        """Drive by `ours`."""
        self._robot, self._ours = robot, ours
        felt = robot.proprioception()
        self._gripper = robot_named(felt.robot).layout.gripper
        drawn = random.Random(f"{seed} {[round(float(x), 2) for x in felt.base_pose]}")
        self._drives, self._after_m, self._draw = drawn.randrange(DRIVES), drawn.uniform(*DRIVEN_M), drawn.random()
        self._driven_m, self._at = 0.0, felt.base_pose[:2]
        self._open = 0
        self._closed: dict[int, float] = {}  # what is open, and how it was closed

    def start(self, target: str, room: str | None) -> None:
        """Begin to drive."""
        self._driven_m, self._at = 0.0, self._robot.proprioception().base_pose[:2]
        self._ours.start(target, room)

    def leave(self) -> None:
        """As ours."""
        self._ours.leave()

    def step(self) -> Report:
        """As ours, and perhaps open a hand."""
        report = self._ours.step()
        felt = self._robot.proprioception()
        self._driven_m += float(norm(felt.base_pose[:2] - self._at))
        self._at = felt.base_pose[:2]
        full = [side for side in felt.sides if felt.holds(side)]
        if not self._closed and full and self._driven_m >= self._after_m:
            if self._drives == 0:
                side = full[int(self._draw * len(full))]
                self._closed = {self._gripper[side]: float(self._robot.action[self._gripper[side]])}
            self._drives, self._driven_m = self._drives - 1, float("-inf")
        if self._closed and self._open < OPEN_STEPS and report.progress is Progress.RUNNING:
            self._open += 1
            self._command(1.0)
            if self._open == OPEN_STEPS:
                self._command(None)
        return report

    def stop(self) -> None:
        """As ours; the hand closes."""
        self._ours.stop()
        if 0 < self._open < OPEN_STEPS:
            self._open = OPEN_STEPS
            self._command(None)

    def _command(self, value: float | None) -> None:
        """Open the hand, or close it as it was."""
        action = self._robot.action.copy()
        for index, closed in self._closed.items():
            action[index] = closed if value is None else value
        self._robot.act(action)


def play(method: str, way: str, instance: int, folder: Path) -> dict[str, Any]:
    """The result of one episode, played unless it is there already."""
    path = folder / f"{way}_{instance}.json"
    if path.exists():
        return dict(json.loads(path.read_text(encoding="utf-8")))
    own = {"planner": "symbolic", "navigator": "benchmarks.lost:Losing", "on_failure": way}
    trace = folder / f"{way}_{instance}.trace.jsonl"
    config = EpisodeConfig(TASK, instance, **{**load_method(method), **own, "method": None, "trace": trace})
    ready = prepare(config)
    assert ready.task is not None
    longer = {"instances": instance + 1, "time_budget_s": BUDGET_S}
    result = run(config, prepared=replace(ready, task=ready.task.model_copy(update=longer)))
    write_whole(path, json.dumps(result))
    return result


def rows(found: Mapping[str, list[dict[str, Any]]]) -> Iterator[list[Cell]]:
    """A row for each way, and one for the difference."""
    q = np.array([[result["q_score"]["final"] for result in found[way]] for way in WAYS]).T
    for i, way in enumerate(WAYS):
        whole = int((q[:, i] == 1.0).sum())
        counts = [(r["time"]["simulator_time"], len(r["failures"]), len(r["replans"])) for r in found[way]]
        yield [f"`{way}`", _told(q[:, i], None), (whole, len(q)), *map(float, np.mean(counts, axis=0))]
    higher, lower = (int((sign * (q[:, 1] - q[:, 0]) > 0).sum()) for sign in (1, -1))
    yield [f"difference: {higher} higher, {lower} lower", _told(q, difference), *4 * (None,)]


def _told(q: Any, statistic: Any) -> str:
    sign = "" if statistic is None else "+"
    one = estimate([q], statistic)
    assert one is not None
    interval = "" if one.low is None else f" ({one.low:{sign}.2f} to {one.high:{sign}.2f})"
    return f"{one.mean:{sign}.2f}{interval}"


@click.command()
@click.argument("folder", type=click.Path(file_okay=False, path_type=Path))
@click.option("--method", default="expert", show_default=True, help="Everything else, by name.")
@click.option("--starts", type=click.IntRange(1), default=20, show_default=True, help="Start states.")
@keeping
def main(folder: Path, method: str, starts: int, **kept: str) -> None:
    """Play what FOLDER does not have, and print the table."""
    folder.mkdir(parents=True, exist_ok=True)
    found: dict[str, list[dict[str, Any]]] = {way: [] for way in WAYS}
    for instance in range(starts):
        for way in WAYS:
            result = play(method, way, instance, folder)
            found[way].append(result)
            q, took = result["q_score"]["final"], result["time"]["simulator_time"]
            click.echo(f"{instance + 1} of {starts}, {way}: q {q:.2f} after {took:.0f} s", err=True)
    tell(COLUMNS, list(rows(found)), **kept)


if __name__ == "__main__":
    main()
