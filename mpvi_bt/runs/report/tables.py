"""The tables and sentences of a report, in words: the HTML page and the Markdown show the same."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from mpvi_bt.executive.drawing.endings import ENDED, WELL
from mpvi_bt.ground.human import Human, human_stats
from mpvi_bt.ground.robot.protocol import CONTROL_HZ
from mpvi_bt.runs.report.compare import MethodComparison
from mpvi_bt.runs.report.failures import Failures
from mpvi_bt.runs.report.figures import Figures, Group, MethodFigures
from mpvi_bt.runs.report.paper import MATCHED, RELATIVE, paper_scores
from mpvi_bt.runs.report.runs import BY_KEY, MEASURES
from mpvi_bt.runs.report.statistics import FLIPS, Chance, Estimate

NONE = "-"
_FIGURE = re.compile(r"[-+]?\d|< \d|-?$|no bound")  # how a cell begins that holds a figure, or none
_EFFICIENCY = ("simulator_time", "normalized_time", "base", "normalized_base", "left", "normalized_left", "right",
               "normalized_right", "left_base_relative", "right_base_relative")  # fmt: skip


@dataclass(frozen=True)
class Table:
    """A table of text, its first column naming the rows.

    Attributes:
        title: Above it; "" for none.
        head: Of the columns.
        rows: As long as the head.
        note: Below it, a sentence or two; "" for none.
    """

    title: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    note: str = ""

    @property
    def figures(self) -> list[bool]:
        """Which columns hold nothing but figures, and are right-aligned therefore."""
        cells = [[row[i] for row in self.rows] for i in range(len(self.head))]
        return [any(cell != NONE for cell in column) and all(map(_FIGURE.match, column)) for column in cells]


def told(found: Estimate | None, digits: int = 3) -> str:
    """An estimate, such as "0.712 [0.650, 0.780]"; "-" where there is none."""
    if found is None:
        return NONE
    mean, *bounds = (None if x is None else f"{round(x, digits) + 0.0:.{digits}f}"  # never "-0.000"
                     for x in (found.mean, found.low, found.high))  # fmt: skip
    return f"{mean}" if None in bounds else f"{mean} [{', '.join(map(str, bounds))}]"


def percent(found: Estimate | None) -> str:
    """A relative change, such as "+113 % [+90 %, +140 %]"."""
    if found is None:
        return NONE
    mean, low, high = ("no bound" if x is None else f"{round(x, 2) + 0.0:+.0%}".replace("%", " %")
                       for x in (found.mean, found.low, found.high))  # fmt: skip
    return mean if found.low is None and found.high is None else f"{mean} [{low}, {high}]"


def chance_text(found: Chance) -> str:
    """How probable a difference is by chance, such as "p = 0.031", or "p < 0.001"."""
    return f"p = {found.p:.3f}" if found.p >= 0.001 else "p < 0.001"


def standing(figures: Figures, running: bool = False) -> str:
    """How far the suite is, in a sentence or two."""
    done = sum(method.overall.finished for method in figures.methods)
    total = sum(method.overall.episodes for method in figures.methods)
    broken = sum(bool(fault) for method in figures.methods for fault in method.missing.values())
    parts = [f"{done} of {total} episodes have a result"]
    parts += [f"{broken} broke and are run again by the next run"] if broken else []
    parts += ["a run is at work now"] if running else []
    return "; ".join(parts) + "."


def method_note(figures: Figures) -> str:
    """How means and intervals come about."""
    over, drawn, what = "then tasks", "instances are drawn anew within each task", "instances"
    if len(figures.houses) > 1:
        over, drawn, what = "tasks, then houses", "houses are drawn anew, each with all its instances", "houses"
    return (
        f"Means are over seeds, then instances, {over}. Brackets are {figures.level:.0%} bootstrap intervals: "
        f"{drawn}, {figures.resamples} times; tasks are not. Where all {what} "
        "score alike the interval has no width; that says that no spread was seen, not that there is none."
    ).replace("%", " %")


def summary_table(figures: Figures) -> Table:
    """Each method's scores over all tasks."""
    paper = any(method.paper is not None for method in figures.methods)
    head = ["method", "finished", "succeeded", "q ↑", "missing as 0 ↑", "with what held at the start ↑",
            "share of conditions ↑", *(["the paper's q"] if paper else [])]  # fmt: skip
    rows = []
    for method in figures.methods:
        group = method.overall
        scores = [told(group.measures[key]) for key in ("q_score", "goal_fraction", "conditions_met")]
        row = [method.name, f"{group.finished}/{group.episodes}", _successes(group), scores[0],
               f"{group.q_with_missing:.3f}", *scores[1:]]  # fmt: skip
        rows.append(row + ([NONE if method.paper is None else f"{method.paper:.3f}"] if paper else []))
    return Table("", head, rows, method_note(figures))


def truth_text(figures: Figures) -> str:
    """For each method: backends that read simulator truth, and assisted grasping."""
    parts = [f"{m.name}: {', '.join(m.privileged) or 'nothing'}" for m in figures.methods]
    assisted = [m.name for m in figures.methods if m.assisted]
    text = f"Backends that read simulator truth: {'; '.join(parts)}."
    return text + (f" Assisted grasping: {', '.join(assisted)}." if assisted else "")


def task_table(figures: Figures) -> Table:
    """Mean q of each method on each task, and the paper's of the methods of those names."""
    theirs = [name for name in figures.paper if figures.paper[name] and name in _names(figures)]
    theirs = theirs or [name for name in ("e2e", "mpvi") if figures.paper.get(name)]
    head = ["task", *_names(figures), *(f"paper: {name}" for name in theirs)]
    rows = []
    for task in figures.tasks:
        cells = [_scored(method.tasks.get(task)) for method in figures.methods]
        papers = [f"{q:.2f}" if (q := figures.paper[name].get(task)) is not None else NONE for name in theirs]
        rows.append([task, *cells, *papers])
    note = "In brackets: episodes that reached the whole goal, of those that have a result."
    if theirs:
        note += (
            " The paper's figures are from OmniGibson with another robot, another policy and other instances: "
            "they stand beside ours, and are no target."
        )
    return Table("", head, rows, note)


def house_table(figures: Figures) -> Table:
    """Mean q of each method in each house; no rows if there is only one house."""
    rows = [
        [house or "the task's own", *(_scored(method.houses.get(house)) for method in figures.methods)]
        for house in figures.houses
        if len(figures.houses) > 1
    ]
    note = (
        "In parentheses: episodes that reached the whole goal, of those that have a result. Brackets in a house's row: "
        "instances are drawn anew within each task."
    )
    return Table("Houses", ["house", *_names(figures)], rows, note)


def instance_table(method: MethodFigures) -> Table:
    """A method's q on every instance, hidden by a bare mean; no rows if there is only one instance."""
    instances = sorted({instance for scores in method.instances.values() for instance in scores})
    rows = [
        [task, *(f"{round(scores[i], 2):g}" if i in scores else NONE for i in instances)]
        for task, scores in method.instances.items()
        if scores and len(instances) > 1
    ]
    return Table(f"{method.name}, instance by instance", ["task", *map(str, instances)], rows)


def efficiency_table(figures: Figures, task: str | None = None) -> Table:
    """Time and distances of each method, on one task with people's beside them, or over all."""
    measures = [BY_KEY[key] for key in _EFFICIENCY]
    rows = []
    for method in figures.methods:
        group = method.overall if task is None else method.tasks.get(task)
        if group is not None:
            rows.append([method.name, *(told(group.measures[m.key], m.digits) for m in measures)])
    if task is not None and (human := human_stats().get(task)) is not None:
        rows.append(["people", *(_human(human, m.key) for m in measures)])
    head = ["method", *(measure.title for measure in measures)]
    return Table("" if task is None else task, head, rows)


def comparison_text(found: MethodComparison) -> str:
    """A comparison in a few sentences."""
    pairs, whole = found.overall, found.relative
    count = f"{pairs.pairs} episode{'s' * (pairs.pairs != 1)}"
    text = (
        f"{found.method} against {found.baseline}, on {count} that both have finished: mean q "
        f"{pairs.method:.3f} against {pairs.baseline:.3f}, a difference of {told(pairs.difference)}, "
        f"{chance_text(found.chance)}"
    )
    text += f", {percent(whole)} of the baseline's. " if whole else "; nothing to divide by. "
    text += (
        f"Tasks: {found.gains} gained, {found.equal} equal, {found.regressions} regressed. "
        f"Episodes: {pairs.wins} won, {pairs.ties} tied, {pairs.losses} lost."
    )
    if _as_in_the_paper(found):
        text += f" The paper's, on 50 tasks: {RELATIVE:+.0%}, 31 gained, 16 equal, 3 regressed.".replace("%", " %")
    return text


def comparisons_table(comparisons: Sequence[MethodComparison]) -> Table:
    """Each comparison in a row."""
    rows = [
        [c.method, c.baseline, str(c.overall.pairs), f"{c.overall.method:.3f}", f"{c.overall.baseline:.3f}",
         told(c.overall.difference), chance_text(c.chance).removeprefix("p ").removeprefix("= "),
         f"{c.overall.wins} / {c.overall.ties} / {c.overall.losses}"]
        for c in comparisons
    ]  # fmt: skip
    head = ["method", "against", "pairs", "q ↑", "its q", "difference ↑", "p", "won / tied / lost"]
    return Table("Methods compared", head, rows, chance_note(comparisons))


def chance_note(comparisons: Sequence[MethodComparison]) -> str:
    """How p comes about."""
    exact = all(c.chance.exact for c in comparisons)
    how = "every choice of signs" if exact else f"{FLIPS} choices of signs, or all where they are fewer"
    return (
        "p: a paired permutation test, two-sided: how often a difference is at least as great where the two figures "
        f"of a pair are swapped at random, by {how}."
    )


def comparison_table(found: MethodComparison) -> Table:
    """A comparison task by task, the greatest gains first."""
    rows = [
        [task, str(p.pairs), f"{p.baseline:.3f}", f"{p.method:.3f}", told(p.difference),
         f"{p.wins} / {p.ties} / {p.losses}"]
        for task, p in sorted(found.tasks.items(), key=lambda item: (-item[1].difference.mean, item[0]))
    ]  # fmt: skip
    head = ["task", "pairs", found.baseline, found.method, "difference of q ↑", "won / tied / lost"]
    return Table(f"{found.method} less {found.baseline}", head, rows)


def effort_table(comparisons: Sequence[MethodComparison], paper: bool = True) -> Table:
    """By how much efforts differ where both methods came equally far.

    Args:
        comparisons: Of each method.
        paper: Whether the paper's stand below, if these two methods are compared on its tasks.
    """
    names = list(comparisons[0].efforts) if comparisons else []
    rows = [
        [f"{c.method} against {c.baseline}", str(c.matched), *(percent(c.efforts[name]) for name in names)]
        for c in comparisons
    ]
    if paper and any(map(_as_in_the_paper, comparisons)):
        rows.append(["the paper's", "20", *(f"{MATCHED[n]:+.1%}".replace("%", " %") if n in MATCHED else NONE
                                            for n in names)])  # fmt: skip
    head = ["methods", "pairs", *(f"{name} ↓" for name in names)]
    note = "Pairs of episodes in which both methods got the same q, above 0: progress does not confound effort there."
    return Table("Effort at the same q", head, rows, note)


def failure_tables(figures: Figures) -> list[Table]:
    """Why episodes fall short: by reason code, by how they ended, by unmet predicate; per method, and per task."""
    counted = {method.name: method.failures for method in figures.methods}
    tables = [
        _counts("Failures on the way, by reason code", "reason", {n: f.reasons for n, f in counted.items()}, figures,
                "A failure that a plan passes over counts; an episode may have many."),
        _counts("How episodes ended", "end", {n: _ends(f) for n, f in counted.items()}, figures,
                "What became of the plan; whether the goal holds is told by the scores."),
        _counts("Conditions of the goal that were not met, by predicate", "predicate",
                {n: f.unmet for n, f in counted.items()}, figures),
    ]  # fmt: skip
    return [table for table in tables if table.rows]


def failure_table_of(method: MethodFigures) -> Table:
    """The failures of one method, task by task: reason codes and unmet predicates, the most frequent first."""
    rows = [
        [task, str(found.episodes), _listed(found.reasons), _listed(found.unmet), _listed(_ends(found))]
        for task, found in method.failures_by_task.items()
        if _short(found)
    ]
    return Table(method.name, ["task", "episodes", "failures on the way", "conditions not met", "ended"], rows)


def wall_table(figures: Figures) -> Table:
    """Shares of wall time."""
    timed = [method for method in figures.methods if method.wall]
    activities = list(timed[0].wall) if timed else []
    rows = [
        [method.name, f"{method.wall_s:.0f}", *(f"{method.wall[name]:.0%}".replace("%", " %") for name in activities)]
        for method in timed
    ]
    note = (
        "Planning: routes, motions of the arms, and what a scripted policy plans and sees. "
        "Models: the rest of the policy, the checker, the planner."
    )
    return Table("Where wall time goes", ["method", "s an episode", *activities], rows, note)


def settings_table(figures: Figures) -> Table:
    """Settings of each method, and its parts that read simulator truth."""
    keys = list(dict.fromkeys(key for method in figures.methods for key in method.settings if key != "method"))
    rows = [["about", *(m.about or NONE for m in figures.methods)]] if any(m.about for m in figures.methods) else []
    rows.append(["reads simulator truth", *(", ".join(m.privileged) or "no part" for m in figures.methods)])
    rows.append(["grasps", *("assisted" if m.assisted else "by friction alone" for m in figures.methods)])
    rows += [[key, *(_value(m.settings.get(key)) for m in figures.methods)] for key in keys if key != "assisted"]
    if any(method.queries for method in figures.methods):
        rows.append(["completion", *(method.queries or NONE for method in figures.methods)])
    return Table("Methods", ["", *_names(figures)], rows)


def missing_table(figures: Figures) -> Table:
    """Episodes without a result: each that broke, and how many of a task are still to be run."""
    rows = [[method.name, name, fault] for method in figures.methods for name, fault in method.missing.items() if fault]
    rows += [
        [method.name, f"{left} of {task}", "not run yet"]
        for method in figures.methods
        for task, left in method.to_run.items()
        if left
    ]
    return Table("Episodes without a result", ["method", "episode", "why"], rows)


def direction_table() -> Table:
    """The measures, with unit and better direction."""
    rows = [[m.label, m.unit or NONE, m.better, m.key] for m in MEASURES]
    note = (
        "Human / robot as BEHAVIOR's evaluator has it: 1 is as good as people. Distances of hands are in the world; "
        "people's were measured from the base, as are the two last."
    )
    return Table("Measures", ["measure", "unit", "better", "key in JSON"], rows, note)


def _as_in_the_paper(found: MethodComparison) -> bool:
    """Whether the paper compares these two methods, and has all the tasks played."""
    theirs = paper_scores().get("mpvi", {}).keys()
    return (found.baseline, found.method) == ("e2e", "mpvi") and found.tasks.keys() <= theirs


def _names(figures: Figures) -> list[str]:
    return [method.name for method in figures.methods]


def _successes(group: Group) -> str:
    return f"{group.successes} ({group.successes / group.finished:.0%})".replace("%", " %") if group.finished else NONE


def _scored(group: Group | None) -> str:
    if group is None or not group.finished:
        return NONE
    mean, _, bounds = told(group.measures["q_score"], 2).partition(" ")
    return f"{mean} ({group.successes}/{group.finished}) {bounds}".strip()


def _human(human: Human, key: str) -> str:
    """People's mean of what can be compared with a measure: their hands were measured from the base."""
    if key == "simulator_time":
        return f"{human.steps / CONTROL_HZ:.1f}"
    if key == "base":
        return f"{human.base_m:.1f}"
    if key.endswith("_base_relative"):
        return f"{human.hand_m['left' if key.startswith('left') else 'right']:.1f}"
    return NONE


def _counts(title: str, what: str, counted: Mapping[str, Mapping[str, int]], figures: Figures, note: str = "") -> Table:
    total = {name: sum(c.get(name, 0) for c in counted.values()) for c in counted.values() for name in c}
    names = sorted(total, key=lambda name: (-total[name], name))
    rows = [[name, *(str(c.get(name, 0) or NONE) for c in counted.values())] for name in names]
    return Table(title, [what, *_names(figures)], rows, note)


def _listed(counted: Mapping[str, int]) -> str:
    return ", ".join(f"{name} {count}" for name, count in counted.items()) or NONE


def _ends(found: Failures) -> dict[str, int]:
    """Episodes by how they ended, in words."""
    words = {**ENDED, "gave_up": "finished, units given up"}
    return {words.get(end, end): count for end, count in found.ended.items()}


def _short(found: Failures) -> bool:
    return bool(found.reasons or found.unmet or set(found.ended) - {*WELL})


def _value(value: object) -> str:
    if value is None:
        return NONE
    if isinstance(value, Mapping):
        return ", ".join(f"{k}={v}" for k, v in value.items()) or NONE
    return str(value)
