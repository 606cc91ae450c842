"""Plans of the symbolic planner beside those on file: `python -m benchmarks.symbolic_plans [TASK...]`."""

from __future__ import annotations

import sys
import time

from mpvi_bt.executive.plan.schema import Navigation, Plan
from mpvi_bt.ground.errors import MpviError
from mpvi_bt.house.instances.tasks import load_task
from mpvi_bt.runs.symbolic.symbolic_planner import SymbolicPlanner
from tests.symbolic_state import CannotBe
from tests.test_plans50 import TASKS, plan_of, unmet


def main(tasks: list[str]) -> None:
    """Print a row for each task: seconds, segments and drives, each beside those on file, and what paper says."""
    print("| task | seconds | segments | on file | drives | on file | on paper |\n|---|---|---|---|---|---|---|")
    for task in tasks:
        print(_row(task), flush=True)


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


if __name__ == "__main__":
    main(sys.argv[1:] or TASKS)
