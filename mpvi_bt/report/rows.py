"""Every episode of a report as a row of CSV, for spreadsheets, pandas and R."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence

from mpvi_bt.drawing.cells import one_line
from mpvi_bt.report.runs import MEASURES, Runs

_NAMES = {"success_rate": "success"}  # of measures of which a row has a single one


def report_csv(runs: Sequence[Runs]) -> str:
    """The episodes of all methods, in order.

    Returns:
        A head, then a row an episode: method, task, instance, seed, ended, and every measure by its key ("success" is
        1 or 0). Cells are empty where there is no figure; "ended" of an episode without a result says why.
    """
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(["method", "task", "instance", "seed", "ended", *(_NAMES.get(m.key, m.key) for m in MEASURES)])
    for run in runs:
        for config in run.episodes:
            result, fault = run.results.get(config), run.faults.get(config)
            ended = result.ended if result else fault.kind if fault else "missing"
            figures = [measure.of(result) if result else None for measure in MEASURES]
            table.writerow(
                [one_line(run.method), one_line(config.task_name), config.instance, config.seed, one_line(ended)]
                + ["" if figure is None else f"{figure:.10g}" for figure in figures]
            )
    return text.getvalue()
