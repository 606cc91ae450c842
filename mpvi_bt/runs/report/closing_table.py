"""A suite's closing table, as text for a terminal."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from mpvi_bt.executive.drawing.cells import WIDEST, WIDTH, columns, cut, one_line, wrapped
from mpvi_bt.executive.drawing.endings import ENDED
from mpvi_bt.executive.drawing.text_table import aligned, fitting
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.episode.result import Result
from mpvi_bt.runs.report.figures import Figures, Group, MethodFigures
from mpvi_bt.runs.report.runs import BY_KEY, Runs
from mpvi_bt.runs.report.tables import NONE, chance_text, comparison_text, house_table, told
from mpvi_bt.runs.suite.store import Fault

_NAME = 24  # columns of a method's name
# Figures of an episode, the most telling first: head, measure. What a terminal has no room for is left out.
FIGURES = (
    ("q", "q_score"), ("met", "goal_fraction"), ("time s", "simulator_time"), ("base m", "base"), ("left m", "left"),
    ("right m", "right"), ("human/robot", "normalized_time"), ("conditions", "conditions_met"),
    ("left/base m", "left_base_relative"), ("right/base m", "right_base_relative"),
)  # fmt: skip
_NO_BREAK = "\N{NO-BREAK SPACE}"
_ALWAYS = 2  # of these, however narrow the terminal
_SAID = {  # of heads that do not speak for themselves
    "met": "met (share of the goal's literals)",
    "human/robot": "human/robot (people's time over the robot's)",
    "conditions": "conditions (share of the goal's conditions)",
    "left/base m": "left/base and right/base (ways of the hands as seen from the base)",
}


def report_text(figures: Figures, runs: Sequence[Runs], width: int = WIDTH) -> str:
    """The report for people: a table a task, what failed, the means, and a line a house.

    Args:
        figures: What to tell.
        runs: Of each method.
        width: Columns of the terminal: lines are no longer, and tables have the figures that fit.
    """
    named = len(runs) > 1
    which = ("house", "instance", "seed") if any(figures.houses) else ("instance", "seed")
    head = (*which, *(head for head, _ in FIGURES), "ended")
    told = []
    for run, method in zip(runs, figures.methods, strict=True):
        for task, group in method.tasks.items():
            configs = [c for c in run.episodes if c.task_name == task]
            rows = [_row(c, run.results.get(c), run.faults.get(c))[-len(head) :] for c in configs]
            title = f"{run.method}: {task}" if named else task
            told.append((title, [*rows, _mean_row(group, len(which))], _failures(configs, run.results, run.faults)))
    every = [head, *(row for _, rows, _ in told for row in rows)]
    shown = fitting(every, range(len(which) + _ALWAYS, len(which) + len(FIGURES)), width - 2)
    tables = _tables(every, shown, [len(rows) for _, rows, _ in told])
    blocks = []
    for (title, _, failed), lines in zip(told, tables, strict=True):
        blocks.append("\n".join([title, *lines, *(line for text in failed for line in _prose(text, width, 2, 6))]))
    for run, method in zip(runs, figures.methods, strict=True):
        closing = _closing(f"{figures.suite}, {run.method}" if named else figures.suite, run, method)
        blocks.append("\n".join(line for text in closing for line in _prose(text, width, 0, 4)))
    blocks += ["\n".join(_prose(comparison_text(found), width)) for found in figures.comparisons]
    if named:
        blocks.append("\n".join(_methods(figures, width)))
    if (houses := house_table(figures)).rows:
        cells = [[cut(one_line(cell), _NAME) for cell in row] for row in (houses.head, *houses.rows)]
        blocks.append("\n".join(aligned(cells, {0})))
    blocks += ["\n".join(_prose(" ".join(figures.notes), width))] if figures.notes else []
    figured = [i - len(which) for i in shown[len(which) : -1]]
    blocks.append("\n".join(_prose(_legend(figured), width)))
    return "\n\n".join(blocks)


def _legend(shown: Sequence[int]) -> str:
    """The better direction of each figure, and the columns left out."""
    higher = [head for i, (head, key) in enumerate(FIGURES) if i in shown and BY_KEY[key].better == "higher"]
    lower = "time and distances" + (f", {_SAID['left/base m']}" if len(shown) == len(FIGURES) else "")
    said = f"{', '.join(_SAID.get(head, head) for head in higher)}: higher is better; {lower}: lower is better."
    left_out = [head for i, (head, _) in enumerate(FIGURES) if i not in shown]
    return said + (f" Not shown at this width: {', '.join(left_out)}." if left_out else "")


def _prose(text: str, width: int, indent: int = 0, hanging: int = 0) -> list[str]:
    """A text in lines that are not too long to be read, the first one so far in, the others so far."""
    first, *rest = wrapped(text.replace(" %", f"{_NO_BREAK}%"), min(width, WIDEST) - max(indent, hanging))
    lines = [" " * indent + first, *(" " * hanging + line for line in rest)]
    return [line.replace(_NO_BREAK, " ") for line in lines]


def _tables(rows: Sequence[Sequence[str]], shown: Sequence[int], lengths: Sequence[int]) -> Iterator[list[str]]:
    """Tables below each other, their columns in line, from the rows of all behind one head."""
    head, *lines = [f"  {line}" for line in aligned([[row[i] for i in shown] for row in rows], {len(shown) - 1})]
    rule = "  " + "-" * (max(map(columns, [head, *lines])) - 2)
    for length in lengths:
        own, lines = lines[:length], lines[length:]
        yield [head, rule, *own[:-1], rule, own[-1]]


def _methods(figures: Figures, width: int) -> list[str]:
    """A line for each method, beside the baseline."""
    compared = {found.method: found for found in figures.comparisons}
    rows = [["", "episodes", "succeeded", "q", "95 % interval", "difference", "p", "time s", "base m"]]
    for method in figures.methods:
        group, found = method.overall, compared.get(method.name)
        q, _, interval = told(group.measures["q_score"]).partition(" ")
        against = ("baseline" if method.name == figures.baseline else NONE, "")
        if found is not None:
            against = f"{found.overall.difference.mean:+.3f}", chance_text(found.chance).removeprefix("p ").lstrip("= ")
        done = f"{group.finished}/{group.episodes}"
        efforts = [_figure(found.mean if found else None, key) for key in ("simulator_time", "base")
                   for found in [group.measures[key]]]  # fmt: skip
        rows.append([cut(one_line(method.name), _NAME), done, str(group.successes), q, interval, *against, *efforts])
    shown = fitting(rows, (5, 6, 4, 2, 7, 8), width)  # difference, p, interval, ...: the most telling first
    return aligned([[row[i] for i in shown] for row in rows], {0})


def _closing(title: str, run: Runs, method: MethodFigures) -> list[str]:
    """Summary lines of a method: outcomes, and notes on them."""
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
    where = (config.house_name, str(config.instance), str(config.seed))
    if result is None:
        return (*where, *[NONE] * len(FIGURES), fault.kind if fault else "missing")
    return (
        *where,
        *(_figure(BY_KEY[key].of(result), key) for _, key in FIGURES),
        ENDED.get(result.ended, result.ended) + (f", {result.gave_up} given up" if result.gave_up else ""),
    )


def _mean_row(group: Group, places: int) -> tuple[str, ...]:
    means = [(group.measures[key], key) for _, key in FIGURES]
    return ("mean", *[""] * (places - 1), *(_figure(found.mean if found else None, key) for found, key in means), "")


def _figure(value: float | None, key: str) -> str:
    return NONE if value is None else f"{value:.{BY_KEY[key].digits}f}"


def _failures(
    configs: Sequence[EpisodeConfig], results: Mapping[EpisodeConfig, Result], faults: Mapping[EpisodeConfig, Fault]
) -> list[str]:
    lines = []
    for config in configs:
        result = results.get(config)
        which = f"{config.house_name}, instance {config.instance}" if config.house else f"instance {config.instance}"
        if result is None:
            if (fault := faults.get(config)) and fault.backend:
                lines.append(f"{which}: a backend failed, {fault.message}")
            continue
        if felt := troubles(result.clipped, result.grasps.empty, result.grasps.lost):
            lines.append(f"{which}: {felt}")
        for failure in result.failures:
            node = one_line("/".join(failure.node.split("/")[1:2]) or failure.node)  # the segment, right under the root
            why = ": ".join(one_line(text) for text in (failure.reason, failure.feedback) if text)
            lines.append(f"{which} at {failure.time_s:.0f} s: {node} failed, {why}")
        if not result.success:
            unmet = [condition.condition for condition in result.goal if not condition.satisfied]
            lines.append(f"{which} at the end: not met: {'; '.join(unmet)}")
    return lines
