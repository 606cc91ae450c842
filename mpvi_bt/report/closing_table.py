"""A suite's closing table, as text for a terminal."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from mpvi_bt.choices.config import EpisodeConfig
from mpvi_bt.drawing.cells import columns, cut, one_line
from mpvi_bt.drawing.endings import ENDED
from mpvi_bt.episode.result import Result
from mpvi_bt.report.figures import Figures, Group, MethodFigures
from mpvi_bt.report.runs import Runs
from mpvi_bt.report.tables import NONE, chance_text, comparison_text, told
from mpvi_bt.suite.store import Fault

_HEAD = ("instance", "seed", "q", "met", "time s", "base m", "left m", "right m", "ended")
_NAME = 24  # columns of a method's name


def report_text(figures: Figures, runs: Sequence[Runs]) -> str:
    """The report for people: a table a task, what failed, and the means; in 80 columns."""
    named = len(runs) > 1
    blocks = []
    for run, method in zip(runs, figures.methods, strict=True):
        for task, group in method.tasks.items():
            configs = [c for c in run.episodes if c.task_name == task]
            rows = [_row(c, run.results.get(c), run.faults.get(c)) for c in configs]
            rows.append(_mean_row(group))
            title = f"{run.method}: {task}" if named else task
            blocks.append("\n".join([title, *_table(rows), *_failures(configs, run.results, run.faults)]))
    for run, method in zip(runs, figures.methods, strict=True):
        blocks.append("\n".join(_closing(f"{figures.suite}, {run.method}" if named else figures.suite, run, method)))
    blocks += [comparison_text(found) for found in figures.comparisons]
    if named:
        blocks.append("\n".join(_methods(figures)))
    blocks += [" ".join(figures.notes)] if figures.notes else []
    blocks.append("q, met (share of the goal's literals): higher is better; time and distances: lower is better")
    return "\n\n".join(blocks)


def _methods(figures: Figures) -> Iterator[str]:
    """A line for each method, beside the baseline."""
    compared = {found.method: found for found in figures.comparisons}
    rows = [("", "episodes", "q", "95 % interval", "difference", "p")]
    for method in figures.methods:
        group, found = method.overall, compared.get(method.name)
        q, _, interval = told(group.measures["q_score"]).partition(" ")
        against = ("baseline" if method.name == figures.baseline else NONE, "")
        if found is not None:
            against = f"{found.overall.difference.mean:+.3f}", chance_text(found.chance).removeprefix("p ").lstrip("= ")
        done = f"{group.finished}/{group.episodes}"
        rows.append((cut(one_line(method.name), _NAME), done, q, interval, *against))
    widths = [max(columns(row[i]) for row in rows) for i in range(len(rows[0]))]
    for name, *cells in rows:
        right = (cell.rjust(width) for cell, width in zip(cells, widths[1:], strict=True))
        yield "  ".join([name + " " * (widths[0] - columns(name)), *right]).rstrip()


def _closing(title: str, run: Runs, method: MethodFigures) -> list[str]:
    """What came of all episodes of a method, and what has to be known of it."""
    group = method.overall
    line = f"{title}: {group.finished}/{group.episodes} episodes, {group.successes} succeeded"
    if (q := group.measures["q_score"]) is not None:
        line += f", mean q {group.q_with_missing:.3f}"
        if group.finished < group.episodes:
            line += f" with missing ones as 0, {q.mean:.3f} without"
        elif q.low is not None and q.high is not None:
            line += f" [{q.low:.3f}, {q.high:.3f}]"
    lines = [line]
    if failed := [config.name for config, fault in run.faults.items() if fault.backend and config not in run.results]:
        lines.append(f"failed by a backend, not by the robot: {', '.join(failed)}; run again, or leave out")
    if method.privileged:
        lines.append(f"backends that read simulator truth: {', '.join(method.privileged)}")
    if method.queries:
        lines.append(f"completion: {method.queries}")
    judges = {(config.checker, config.trigger) for config in run.episodes}
    if judges != {(EpisodeConfig.checker, EpisodeConfig.trigger)}:
        lines += [f"judged by {checker}, asked by {trigger} triggers" for checker, trigger in sorted(judges)]
    if any(config.assisted for config in run.episodes):
        lines.append("assisted grasping: a closing hand fixed what it pinched to itself")
    return lines


def troubles(clipped: int, empty: int, lost: int) -> str:
    """What was noticed of actions and grasps, such as "3 actions clipped, 1 closing on nothing", or ""."""
    parts = [(clipped, "action", " clipped"), (empty, "closing", " on nothing"), (lost, "lost grasp", "")]
    return ", ".join(f"{n} {what}{'s' * (n > 1)}{after}" for n, what, after in parts if n)


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
        ENDED.get(result.ended, result.ended) + (f", {result.gave_up} given up" if result.gave_up else ""),
    )


def _mean_row(group: Group) -> tuple[str, ...]:
    means = [group.measures[key] for key in ("q_score", "goal_fraction", "simulator_time", "base", "left", "right")]
    figures = zip(means, (3, 3, 1, 1, 1, 1), strict=True)
    return ("mean", "", *["-" if found is None else f"{found.mean:.{digits}f}" for found, digits in figures], "")


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
            node = one_line("/".join(failure.node.split("/")[1:2]) or failure.node)  # the segment, right under the root
            why = ": ".join(one_line(text) for text in (failure.reason, failure.feedback) if text)
            lines.append(f"  instance {config.instance} at {failure.time_s:.0f} s: {node} failed, {why}")
        if not result.success:
            unmet = [condition.condition for condition in result.goal if not condition.satisfied]
            lines.append(f"  instance {config.instance} at the end: not met: {'; '.join(unmet)}")
    return lines
