"""The summary that BEHAVIOR's evaluator makes of its result files, for one method.

The layout and the means are those of its `score_utils.py` of 2025, which the paper's figures go by: episodes without a
result count as 0, and `time_score` is the mean of human over robot time (2026's is 2 - robot / human). Unlike there,
tasks and instances are the suite's own.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from mpvi_bt.runs.episode.result import Result
from mpvi_bt.runs.report.runs import Runs

# Null, of a robot that did not move or a task that no human did, counts as 0.
SCORES: Mapping[str, Callable[[Result], float | None]] = {
    "q_score": lambda r: r.q,
    "time_score": lambda r: r.time.normalized_time,
    "base_distance_score": lambda r: r.normalized_agent_distance.base,
    "left_distance_score": lambda r: r.normalized_agent_distance.left,
    "right_distance_score": lambda r: r.normalized_agent_distance.right,
}


def official_summary(runs: Runs) -> dict[str, Any]:
    """The scores of a method over all tasks, of each task, and of each rollout.

    Returns:
        Keys "overall_scores" (score to its mean), "per_task_scores" (score, task), "per_rollout_scores" (score, task,
        "INSTANCE_SEED", or "HOUSE_INSTANCE_SEED" where a house is named). "task_sr" is the share of rollouts with
        q = 1; higher is better for all.
    """
    tasks = runs.tasks
    rollouts = {task: sum(c.task_name == task for c in runs.episodes) for task in tasks}
    scores: dict[str, dict[str, dict[str, float]]] = {name: {task: {} for task in tasks} for name in SCORES}
    for (task, house, instance, seed), result in runs.by_key.items():
        for name, of in SCORES.items():
            scores[name][task][f"{house}_{instance}_{seed}".removeprefix("_")] = of(result) or 0.0
    of_task = {
        name: {task: sum(found.values()) / rollouts[task] for task, found in per_task.items()}
        for name, per_task in scores.items()
    }
    of_task["task_sr"] = {
        task: sum(q == 1 for q in found.values()) / rollouts[task] for task, found in scores["q_score"].items()
    }
    return {
        "overall_scores": {name: sum(found.values()) / len(tasks) for name, found in of_task.items()},
        "per_task_scores": of_task,
        "per_rollout_scores": scores,
    }
