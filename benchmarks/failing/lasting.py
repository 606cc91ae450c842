"""How long `stall` or `grip` stays past its threshold in handoffs that went well: what the trees' `alone` stands on.

    python -m benchmarks.failing.lasting CALIBRATION FOLDER [--keep NAME --command ... --date ...]

FOLDER holds the episodes that CALIBRATION was made of. Handoffs count of policies without faults and of skills with
thresholds.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import click

from benchmarks.failing.keeping import keeping, tell
from benchmarks.tables import Cell, Column
from mpvi_bt.executive.monitors.alarms import OUTCOMES, Alarms
from mpvi_bt.executive.monitors.calibration import Calibration, Run, load_calibration
from mpvi_bt.runs.episode.handoffs import read_handoffs

COLUMNS = (
    Column(head="signal"),
    Column(head="past its threshold in so many handoffs"),
    Column(head="longest, s", format=".1f"),
    Column(head="second, s", format=".1f"),
)


def longest_s(known: Calibration, run: Run) -> dict[str, float]:
    """The longest that each of `OUTCOMES` that ever was past its threshold stayed so without a break [s]."""
    alarms, longest = Alarms(), dict[str, float]()
    for sample, values in enumerate(run.samples):
        alarms.update([name for name, _, _ in known.alarms(run.skill, sample, list(values))])
        longest |= {name: max(seconds, longest.get(name, 0.0)) for name, seconds in alarms.lasting_s.items()}
    return longest


def rows(known: Calibration, runs: Sequence[Run]) -> list[list[Cell]]:
    """A row for each signal."""
    found = [longest_s(known, run) for run in runs]
    table: list[list[Cell]] = []
    for name in sorted(OUTCOMES):
        times = sorted((of[name] for of in found if name in of), reverse=True)
        table.append([name, (len(times), len(runs)), *(times + [None, None])[:2]])
    return table


@click.command()
@click.argument("calibration", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.argument("folder", type=click.Path(exists=True, file_okay=False, path_type=Path))
@keeping
def main(calibration: Path, folder: Path, **kept: str) -> None:
    """Print how long single signals last in the handoffs of FOLDER that went well."""
    found = read_handoffs(folder)
    known = load_calibration(calibration, found.policy, found.robot)
    tell(COLUMNS, rows(known, [run for run in found.went_well if run.skill in known.skills]), **kept)


if __name__ == "__main__":
    main()
