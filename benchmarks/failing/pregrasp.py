"""What planned pre-grasps do to picks of the hands benchmark: the same trials with and without.

    python -m benchmarks.hands -s pick -p learned --pregrasp --out picks.jsonl      # and without --pregrasp
    python -m benchmarks.failing.pregrasp picks.jsonl [--keep NAME --command ... --date ...]

Only trials count that are there both ways. The interval of a difference is that of `mpvi suite report`: seeds are drawn
anew within each case.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import click
import numpy as np

from benchmarks.failing.keeping import keeping, tell
from benchmarks.hands.rows import Job, Row, read_rows
from benchmarks.tables import Cell, Column
from mpvi_bt.runs.report.statistics import difference, estimate

ALL = "all"
COLUMNS = (
    Column(head="policy"),
    Column(head="case"),
    Column(head="without"),
    Column(head="with"),
    Column(head="won"),
    Column(head="lost"),
    Column(head="difference, 95 %"),
    Column(head="simulated s without", format=".0f"),
    Column(head="s with", format=".0f"),
)


def rows(found: Mapping[Job, Row]) -> list[list[Cell]]:
    """A row for each policy and case, and one for all cases of a policy."""
    pairs: dict[tuple[str, str], list[tuple[Row, Row]]] = {}
    for job, with_ in found.items():
        if job.pregrasp and (without := found.get(replace(job, pregrasp=False))) is not None:
            for case in (job.case, ALL):
                pairs.setdefault((job.policy, case), []).append((without, with_))
    policies = dict.fromkeys(policy for policy, _ in pairs)
    table: list[list[Cell]] = []
    for name in policies:
        cases = [case for policy, case in pairs if policy == name and case != ALL]
        for case in (*cases, ALL):
            table.append([None if len(table) and case != cases[0] else name, case, *_row(pairs[name, case])])
    return table


def _row(pairs: Sequence[tuple[Row, Row]]) -> list[Cell]:
    ok = np.array([[without.ok, with_.ok] for without, with_ in pairs], float)
    cases = [without.job.case for without, _ in pairs]
    of = estimate([ok[[c == case for c in cases]] for case in dict.fromkeys(cases)], difference)
    interval = f" ({of.low:+.2f} to {of.high:+.2f})" if of and of.low is not None else ""
    seconds = np.array([[without.simulated_s, with_.simulated_s] for without, with_ in pairs])
    return [
        *((int(n), len(ok)) for n in ok.sum(0)),
        int((ok[:, 1] > ok[:, 0]).sum()),
        int((ok[:, 1] < ok[:, 0]).sum()),
        f"{np.diff(ok.mean(0))[0]:+.2f}{interval}",
        *(float(s) for s in seconds.mean(0)),
    ]


@click.command()
@click.argument("results", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@keeping
def main(results: Path, **kept: str) -> None:
    """Print picks with and without pre-grasps, of the trials in RESULTS that are there both ways."""
    tell(COLUMNS, rows({row.job: row for row in read_rows(results)}), **kept)


if __name__ == "__main__":
    main()
