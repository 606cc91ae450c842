"""A suite's closing table, as data and as text. Pure: from results to words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from mpvi_bt.suite.config import EpisodeConfig
from mpvi_bt.suite.metrics import DIRECTIONS
from mpvi_bt.suite.queries import queries_text
from mpvi_bt.suite.result import Result
from mpvi_bt.suite.store import Fault

_HEAD = ("instance", "seed", "q", "met", "time s", "base m", "left m", "right m", "ended")


def report_data(
    name: str,
    episodes: Sequence[EpisodeConfig],
    results: Mapping[EpisodeConfig, Result],
    faults: Mapping[EpisodeConfig, Fault],
) -> dict[str, Any]:
    """The report for programs.

    Args:
        name: Of the suite.
        episodes: All of it, in order.
        results: Those that are there.
        faults: What broke the others.

    Returns:
        Keys "suite", "episodes" (each result without its way and wall times), "missing", "tasks" and "overall" (means),
        "privileged", "directions". "q_score" counts missing episodes as 0, as BEHAVIOR's leaderboard does;
        "q_score_of_finished" leaves them out.
    """
    tasks = {config.task_name: [c for c in episodes if c.task_name == config.task_name] for config in episodes}
    return {
        "suite": name,
        "episodes": [
            results[c].model_dump(mode="json", exclude={"wall", "directions", "way"}) for c in episodes if c in results
        ],
        "missing": [
            {"episode": c.name, "fault": fault.message if (fault := faults.get(c)) else None}
            | ({"backend": fault.backend} if fault and fault.backend else {})
            for c in episodes
            if c not in results
        ],
        "tasks": {task: _means(configs, results) for task, configs in tasks.items()},
        "overall": _means(episodes, results),
        "privileged": sorted({backend for r in results.values() for backend in r.privileged}),
        "directions": dict(DIRECTIONS),
    }


def report_text(
    name: str,
    episodes: Sequence[EpisodeConfig],
    results: Mapping[EpisodeConfig, Result],
    faults: Mapping[EpisodeConfig, Fault],
) -> str:
    """The report for people: a table a task, what failed, and the means; in 80 columns."""
    data = report_data(name, episodes, results, faults)
    blocks = []
    for task, means in data["tasks"].items():
        configs = [c for c in episodes if c.task_name == task]
        rows = [_row(c, results.get(c), faults.get(c)) for c in configs]
        rows.append(_mean_row(means))
        blocks.append("\n".join([task, *_table(rows), *_failures(configs, results, faults)]))
    overall = data["overall"]
    lines = [f"{name}: {overall['finished']}/{overall['episodes']} episodes, {overall['successes']} succeeded"]
    if overall["finished"]:
        lines[0] += f", mean q {overall['q_score']:.3f}"
        if overall["finished"] < overall["episodes"]:
            lines[0] += f" with missing ones as 0, {overall['q_score_of_finished']:.3f} without"
    if failed := [config.name for config, fault in faults.items() if fault.backend and config not in results]:
        lines.append(f"failed by a backend, not by the robot: {', '.join(failed)}; run again, or leave out")
    if data["privileged"]:
        lines.append(f"backends that read simulator truth: {', '.join(data['privileged'])}")
    if asked := queries_text(result.queries for result in results.values()):
        lines.append(f"completion: {asked}")
    judges = {(config.checker, config.trigger) for config in episodes}
    if judges != {(EpisodeConfig.checker, EpisodeConfig.trigger)}:
        lines += [f"judged by {checker}, asked by {trigger} triggers" for checker, trigger in sorted(judges)]
    if any(config.assisted for config in episodes):
        lines.append("assisted grasping: a closing hand fixed what it pinched to itself")
    lines.append("q, met (share of the goal's literals): higher is better; time and distances: lower is better")
    return "\n\n".join([*blocks, "\n".join(lines)])


def troubles(clipped: int, empty: int, lost: int) -> str:
    """What was noticed of actions and grasps, such as "3 actions clipped, 1 closing on nothing", or ""."""
    parts = [(clipped, "action", " clipped"), (empty, "closing", " on nothing"), (lost, "lost grasp", "")]
    return ", ".join(f"{n} {what}{'s' * (n > 1)}{after}" for n, what, after in parts if n)


def _means(configs: Sequence[EpisodeConfig], results: Mapping[EpisodeConfig, Result]) -> dict[str, Any]:
    done = [results[c] for c in configs if c in results]
    times = [r.time.normalized_time for r in done if r.time.normalized_time is not None]
    return {
        "episodes": len(configs),
        "finished": len(done),
        "successes": sum(r.success for r in done),
        "q_score": sum(r.q for r in done) / len(configs),
        "q_score_of_finished": _mean([r.q for r in done]),
        "success_rate": sum(r.success for r in done) / len(configs),
        "goal_fraction": _mean([r.goal_fraction for r in done]),
        "simulator_time": _mean([r.time.simulator_time for r in done]),
        "normalized_time": _mean(times),
        "agent_distance": {
            part: _mean([getattr(r.agent_distance, part) for r in done]) for part in ("base", "left", "right")
        },
        "agent_distance_base_relative": {
            part: _mean([getattr(r.agent_distance_base_relative, part) for r in done]) for part in ("left", "right")
        },
    }


def _mean(values: Sequence[float]) -> float | None:
    return sum(values) / len(values) if values else None


def _row(config: EpisodeConfig, result: Result | None, fault: Fault | None) -> tuple[str, ...]:
    where = (str(config.instance), str(config.seed))
    if result is None:
        return (*where, *["-"] * 6, fault.kind if fault else "missing")
    d = result.agent_distance
    return (
        *where,
        f"{result.q:.3f}",
        f"{result.goal_fraction:.3f}",
        f"{result.time.simulator_time:.1f}",
        f"{d.base:.1f}",
        f"{d.left:.1f}",
        f"{d.right:.1f}",
        result.ended,
    )


def _mean_row(means: Mapping[str, Any]) -> tuple[str, ...]:
    d = means["agent_distance"]
    figures = [(means["q_score_of_finished"], 3), (means["goal_fraction"], 3), (means["simulator_time"], 1)]
    figures += [(d[part], 1) for part in ("base", "left", "right")]
    return ("mean", "", *["-" if x is None else f"{x:.{digits}f}" for x, digits in figures], "")


def _table(rows: Sequence[tuple[str, ...]]) -> list[str]:
    widths = [max(len(row[i]) for row in [_HEAD, *rows]) for i in range(len(_HEAD))]
    lines = []
    for row in [_HEAD, *rows]:
        cells = [cell.rjust(width) for cell, width in zip(row[:-1], widths, strict=False)]
        lines.append("  " + "  ".join([*cells, row[-1]]).rstrip())
    lines.insert(1, "  " + "-" * (sum(widths) + 2 * (len(widths) - 1)))
    lines.insert(-1, lines[1])
    return lines


def _failures(
    configs: Sequence[EpisodeConfig], results: Mapping[EpisodeConfig, Result], faults: Mapping[EpisodeConfig, Fault]
) -> list[str]:
    lines = []
    for config in configs:
        result = results.get(config)
        if result is None:
            if (fault := faults.get(config)) and fault.backend:
                lines.append(f"  instance {config.instance}: a backend failed, {fault.message}")
            continue
        if felt := troubles(result.clipped, result.grasps.empty, result.grasps.lost):
            lines.append(f"  instance {config.instance}: {felt}")
        for failure in result.failures:
            node = "/".join(failure.node.split("/")[1:2]) or failure.node  # the segment, right under the root
            why = f": {failure.feedback}" if failure.feedback else ""
            lines.append(
                f"  instance {config.instance} at {failure.time_s:.0f} s: {node} failed, {failure.reason}{why}"
            )
        if not result.success:
            unmet = [condition.condition for condition in result.goal if not condition.satisfied]
            lines.append(f"  instance {config.instance} at the end: not met: {'; '.join(unmet)}")
    return lines
