"""A suite's report for programs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from mpvi_bt.runs.episode.metrics import DIRECTIONS
from mpvi_bt.runs.report.figures import Figures, Group, MethodFigures
from mpvi_bt.runs.report.official import official_summary
from mpvi_bt.runs.report.runs import Runs


def report_data(figures: Figures, runs: Sequence[Runs]) -> dict[str, Any]:
    """The report as plain data of JSON.

    Returns:
        Keys "suite", "episodes" (each result without its way and wall times; of several methods, with its method),
        "missing", "directions"; "tasks", "houses" (where any is named) and "overall" (means), "privileged" and
        "official" (the evaluator's summary), or, where there are several methods, "methods" with these of each;
        "figures", what pages show: means with intervals, comparisons, failures. "q_score" counts missing episodes as
        0, as BEHAVIOR's leaderboard does; "q_score_of_finished" leaves them out.
    """
    each = {
        method.name: _means(method) | {"official": official_summary(run)}
        for method, run in zip(figures.methods, runs, strict=True)
    }
    return {
        "suite": figures.suite,
        "episodes": [
            run.results[c].model_dump(mode="json", exclude={"wall", "directions", "way"})
            | ({"method": run.method} if len(runs) > 1 else {})
            for run in runs
            for c in run.episodes
            if c in run.results
        ],
        "missing": [missing for run in runs for missing in _missing(run, len(runs) > 1)],
        **({"methods": each} if len(runs) > 1 else next(iter(each.values()))),
        "directions": dict(DIRECTIONS),
        "figures": _figures(figures),
    }


def _figures(figures: Figures) -> dict[str, Any]:
    """All but the paper's, and but wall times, which are not the same on every machine."""
    told = figures.data()
    for method in told["methods"]:
        del method["wall"], method["wall_s"]
    return {key: told[key] for key in ("about", "methods", "baseline", "comparisons", "level", "resamples", "notes")}


def _missing(run: Runs, named: bool) -> list[dict[str, Any]]:
    return [
        {"episode": c.name, "fault": fault.message if (fault := run.faults.get(c)) else None}
        | ({"backend": fault.backend} if fault and fault.backend else {})
        | ({"method": run.method} if named else {})
        for c in run.episodes
        if c not in run.results
    ]


def _means(method: MethodFigures) -> dict[str, Any]:
    return {
        "tasks": {task: _group(group) for task, group in method.tasks.items()},
        "overall": _group(method.overall),
        **({"houses": {house: _group(group) for house, group in method.houses.items()}} if any(method.houses) else {}),
        "privileged": method.privileged,
    }


def _group(group: Group) -> dict[str, Any]:
    mean = {key: found.mean if found else None for key, found in group.measures.items()}
    return {
        "episodes": group.episodes,
        "finished": group.finished,
        "successes": group.successes,
        "q_score": group.q_with_missing,
        "q_score_of_finished": mean["q_score"],
        "success_rate": group.successes / group.episodes,
        "goal_fraction": mean["goal_fraction"],
        "conditions_met": mean["conditions_met"],
        "simulator_time": mean["simulator_time"],
        "normalized_time": mean["normalized_time"],
        "agent_distance": {part: mean[part] for part in ("base", "left", "right")},
        "agent_distance_base_relative": {part: mean[f"{part}_base_relative"] for part in ("left", "right")},
    }
