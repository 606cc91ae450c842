"""Every episode of a report as a row of CSV, for spreadsheets, pandas and R."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence

from mpvi_bt.executive.drawing.cells import one_line
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.report.chosen_columns import COLUMNS, MEASURED, PAPER, WHICH
from mpvi_bt.runs.report.paper import paper_scores
from mpvi_bt.runs.report.runs import Runs


def report_csv(runs: Sequence[Runs], columns: Sequence[str] = COLUMNS) -> str:
    """The episodes of all methods, in order.

    Args:
        runs: Of each method.
        columns: Names of `chosen_columns`.

    Returns:
        A head, then a row an episode ("success" is 1 or 0). Cells are empty where there is no figure; "ended" of an
        episode without a result says why.
    """
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(columns)
    table.writerows([_cell(name, run, config) for name in columns] for run in runs for config in run.episodes)
    return text.getvalue()


def _cell(name: str, run: Runs, config: EpisodeConfig) -> str:
    if name in WHICH:
        return one_line(WHICH[name](run, config))
    if name == PAPER:
        figure = paper_scores().get(run.method, {}).get(config.task_name)
    else:
        result = run.results.get(config)
        figure = MEASURED[name].of(result) if result else None
    return "" if figure is None else f"{figure:.10g}"
