"""How well the monitors' signals tell a policy's own failures, in trials of the hands benchmark.

    python -m benchmarks.hands -s pick -p learned --signals --seeds 2000-2019 --out calibrating.jsonl
    python -m benchmarks.hands -s pick -p learned --signals --seeds 1000-1019 --out tested.jsonl
    python -m benchmarks.failing.own calibrating.jsonl tested.jsonl [--alpha A] [--thresholds FILE] [--keep NAME ...]

A trial is a handoff, and goes well if the simulator's truth says so. Thresholds are those that `mpvi calibrate` would
make of the trials in the first file that went well, and FILE is as it writes them; the figures are of
`benchmarks.failing.detection`.
"""

from __future__ import annotations

from pathlib import Path

import click
import numpy as np

from benchmarks.failing.detection import COLUMNS, rows
from benchmarks.failing.keeping import keeping, tell
from benchmarks.hands.rows import Row, read_rows
from benchmarks.tables import Cell, Column
from mpvi_bt.executive.monitors.calibration import Run, calibrate
from mpvi_bt.executive.monitors.signals import SIGNALS
from mpvi_bt.ground.errors import UserError
from mpvi_bt.runs.episode.handoffs import Watched


def watched(row: Row) -> Watched:
    """A trial as the handoff that it is."""
    run = Run(row.job.skill, np.array(row.samples, float).reshape(-1, len(SIGNALS)))
    ended = "success" if row.ok else "failure"
    return Watched(run, ended, row.cause, False, f"{row.job.skill}/{row.job.case}", row.job.seed)


@click.command()
@click.argument("calibrating", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.argument("tested", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.option("--alpha", type=click.FloatRange(0, 1, min_open=True, max_open=True), default=0.2, show_default=True)
@click.option(
    "--thresholds", type=click.Path(dir_okay=False, path_type=Path), help="Write them here, for --calibration."
)
@keeping
def main(calibrating: Path, tested: Path, alpha: float, thresholds: Path | None, **kept: str) -> None:
    """Print the figures of each skill in TESTED by the thresholds that CALIBRATING yields."""
    before, after = ([row for row in read_rows(path) if row.samples] for path in (calibrating, tested))
    whose = sorted({(row.job.policy, row.job.robot) for row in before})
    if len(whose) != 1:
        told = " and ".join(f"{policy} on {robot}" for policy, robot in whose) or "nobody"
        raise UserError(f"{calibrating}: trials with --signals of {told}: thresholds are of one policy on one robot.")
    policy, robot = whose[0]
    known, _ = calibrate([watched(row).run for row in before if row.ok], policy, robot, alpha)
    if thresholds is not None:
        known.write(thresholds)
    table: list[list[Cell]] = []
    for skill in known.skills:
        played = [watched(row) for row in after if row.job.skill == skill]
        table += rows(skill, known, [each for each in played if each.ended != "success"], played)
    tell((Column(head="skill"), *COLUMNS[1:-1], Column(head="false alarms a trial", format=".2f")), table, **kept)


if __name__ == "__main__":
    main()
