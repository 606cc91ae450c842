"""Plans of the symbolic planner beside those on file.

    python -m benchmarks.symbolic_plans [TASK...]
    python -m benchmarks.symbolic_plans --played FOLDER --beside FOLDER

The first prints a row for each task: seconds, segments and drives, each beside those on file, and what paper says. The
second prints, of results of `mpvi run TASK --method expert --planner symbolic --out FOLDER` for some tasks and start
states, q beside that of `--planner recorded`, in pairs.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import click
import numpy as np

from benchmarks.origin import grid
from benchmarks.paired_results import change, paired, results
from mpvi_bt.executive.plan.schema import Navigation, Plan
from mpvi_bt.ground.errors import MpviError
from mpvi_bt.house.instances.tasks import load_task
from mpvi_bt.runs.episode.result import Result
from mpvi_bt.runs.report.compare import SAME_Q
from mpvi_bt.runs.symbolic.symbolic_planner import SymbolicPlanner
from tests.symbolic_state import CannotBe
from tests.test_plans50 import TASKS, plan_of, unmet

_FOLDER = click.Path(path_type=Path, exists=True)


def _row(task: str) -> str:
    begun = time.perf_counter()
    try:
        plan = SymbolicPlanner(load_task(task)).ask(task).plan
    except MpviError as error:
        return f"| {task} | | | | | | {error} |"
    took = time.perf_counter() - begun
    try:
        lacks = ", ".join(unmet(task, plan)) or "goal met"
    except CannotBe as error:
        lacks = str(error)
    filed = plan_of(task)
    counts = f"{len(plan.segments)} | {len(filed.segments)} | {_drives(plan)} | {_drives(filed)}"
    return f"| {task} | {took:.1f} | {counts} | {lacks} |"


def _drives(plan: Plan) -> int:
    return sum(isinstance(segment, Navigation) for segment in plan.segments)


def pairs(played: list[Result], beside: list[Result]) -> Iterator[list[str]]:
    """Rows of a table: task, start state, q by both plans and times where q differs; then the means of all."""
    both = [(old, new) for new, old in paired(played, beside)]
    q: dict[str, list[tuple[float, float]]] = {}
    for old, new in both:
        q.setdefault(new.task, []).append((old.q, new.q))
        times = (f"{one.time.simulator_time:.0f}" for one in (old, new))
        if abs(new.q - old.q) > SAME_Q:
            yield [f"`{new.task}`", f"{new.instance_id}", f"{old.q:.2f}", f"{new.q:.2f}", *times]
    means = np.mean([[o.q, n.q, o.time.simulator_time, n.time.simulator_time] for o, n in both], axis=0)
    changes = np.array([np.subtract(*np.mean(found, axis=0)[::-1]) for found in q.values()])
    higher, lower = (sum(sign * (n.q - o.q) > SAME_Q for o, n in both) for sign in (1, -1))
    told = f"{change(changes)}; {higher} higher, {lower} lower, {len(both) - higher - lower} alike"
    yield [f"mean of {len(q)} tasks; difference {told}", "", *(f"{q:.2f}" for q in means[:2]),
           *(f"{seconds:.0f}" for seconds in means[2:])]  # fmt: skip


@click.command()
@click.argument("tasks", nargs=-1)
@click.option("--played", type=_FOLDER, help="Results of episodes by symbolic plans.")
@click.option("--beside", type=_FOLDER, help="Results by the plans on file, for the same tasks and start states.")
def main(tasks: tuple[str, ...], played: Path | None, beside: Path | None) -> None:
    """Print plans of the symbolic planner beside those on file, or how well they play."""
    if (played is None) != (beside is None):
        raise click.UsageError("--played and --beside go together: one folder of results for each kind of plan")
    if played is not None and beside is not None:
        heads = ["task", "start state", "q on file", "q symbolic", "s on file", "s symbolic"]
        click.echo(grid(heads, list(pairs(results(played), results(beside)))))
        return
    click.echo("| task | seconds | segments | on file | drives | on file | on paper |\n|---|---|---|---|---|---|---|")
    for task in tasks or TASKS:
        click.echo(_row(task))


if __name__ == "__main__":
    main()
