"""The paper's figures, for comparison with ours."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping
from functools import cache

from mpvi_bt.ground.paths import shipped

RELATIVE = 1.13  # Paper, Experiments: mean q of MPVI over that of the end-to-end VLA, on all 50 tasks
MATCHED = {"base distance": -0.045, "normalized time": -0.098, "hand distance": -0.13}  # Paper, Experiments: 20 pairs


@cache
def paper_scores() -> Mapping[str, Mapping[str, float]]:
    """Method to q by task, from tasks/paper_qscores.csv, which names its source; our names of methods."""
    with (shipped() / "tasks" / "paper_qscores.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    methods = [name for name in rows[0] if name not in ("index", "task")]
    return {method: {row["task"]: float(row[method]) for row in rows if row[method]} for method in methods}


def paper_mean(method: str, tasks: Iterable[str]) -> float | None:
    """The paper's mean q of a method over tasks; None unless it gives all of them."""
    scores, tasks = paper_scores().get(method, {}), list(tasks)
    return sum(scores[task] for task in tasks) / len(tasks) if tasks and scores.keys() >= set(tasks) else None
