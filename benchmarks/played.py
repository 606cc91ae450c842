"""Every episode of a suite as data, and what is shown of them: tables of tasks and of methods, and a plot.

`python -m benchmarks.collecting` makes such a file of a suite's results. A page names what it shows of it:

    <!-- results: behavior50 tasks expert -->      q of each instance, and why units were given up
    <!-- results: behavior50 methods -->           mean q of each task and method, and the paper's
    <!-- results: behavior50 summary -->           the last rows of `methods`: a row a method
    <!-- results: behavior50 parts behavior30 -->  how far each method came in that suite's tasks, and in the others
    <!-- results: behavior50 reasons -->           why units were given up where a goal was missed, of each method
    <!-- results: behavior50 answers -->           what the completion checker answered, and how often that was false
    <!-- results: behavior50 plot -->              the same as `methods` as a picture, docs/behavior50.svg
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, JsonValue, model_validator

from benchmarks.origin import Data, Results, grid
from mpvi_bt.ground.errors import UserError
from mpvi_bt.runs.report.compare import SAME_Q
from mpvi_bt.runs.report.paper import paper_mean, paper_scores
from mpvi_bt.runs.report.plot_svg import Drawing
from mpvi_bt.runs.report.statistics import Estimate, estimate, permutation_test
from mpvi_bt.runs.suite.suites import load_suite

NAMED = 6  # reasons that a table names for each task,
FREQUENT = 12  # and for each method, at the most
HALF = 0.5  # a table of parts counts the episodes with a lower q
DONE = "done"  # the reason of a unit that the policy took for done and the checker did not
_ROW, _LABEL, _RIGHT, _WIDE = 18.0, 300.0, 16.0, 832


class Episode(Data):
    """What came of one episode.

    Attributes:
        method, task, instance, seed: Which one.
        q: BEHAVIOR's score at its end.
        ended: How: "success", "failure", "time_limit", ...
        time_s: Simulated.
        reasons: Why units were given up, in their order, such as "pick: no_grasp".
        steps: Of control that each of several policies had.
        answers: Of the completion checker, counted as `mpvi_bt.runs.episode.queries.Queries` names them; {}: not kept.
        run: Place of the run that played it in the file's runs.
    """

    method: str
    task: str
    instance: int
    seed: int = 0
    q: Annotated[float, Field(ge=0, le=1)]
    ended: str
    time_s: Annotated[float, Field(ge=0)]
    reasons: tuple[str, ...] = ()
    steps: dict[str, int] = {}
    answers: dict[Literal["asked", "yes", "false_yes", "false_no"], Annotated[int, Field(ge=0)]] = {}
    run: Annotated[int, Field(ge=0)] = 0

    @property
    def key(self) -> tuple[str, str, int, int]:
        """What no other episode of the file has."""
        return self.method, self.task, self.instance, self.seed


class Played(Results):
    """Episodes of one suite.

    Attributes:
        methods: What each method is, as the suite's manifest has it.
        tasks: In BEHAVIOR's order.
        episodes: Each once.
    """

    kind: Literal["suite"]
    methods: Annotated[dict[str, dict[str, JsonValue]], Field(min_length=1)]
    tasks: Annotated[tuple[str, ...], Field(min_length=1)]
    episodes: Annotated[tuple[Episode, ...], Field(min_length=1)]

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        """Raises ValueError for an episode of no run, task or method of the file, and for one that is there twice."""
        for i, one in enumerate(self.episodes):
            if one.run >= len(self.runs) or one.task not in self.tasks or one.method not in self.methods:
                raise ValueError(f"episodes[{i}] is of a run, task or method that the file does not have")
        (key, count), *_ = Counter(one.key for one in self.episodes).most_common(1)
        if count > 1:
            raise ValueError(f"{key} is there {count} times")
        return self

    def of(self, method: str) -> dict[str, list[Episode]]:
        """The episodes of a method by task, in the file's order of tasks, then by instance and seed.

        Raises:
            UserError: The file has none of it.
        """
        if method not in self.methods:
            raise UserError(f"there is no method {method!r}; there are {', '.join(self.methods)}")
        mine = sorted((one for one in self.episodes if one.method == method), key=lambda one: one.key)
        return {task: found for task in self.tasks if (found := [one for one in mine if one.task == task])}

    def render(self, view: str = "methods") -> str:
        """As Markdown.

        Args:
            view: "methods", "summary", "reasons", "answers", "tasks METHOD" or "parts SUITE".

        Raises:
            UserError: There is no such view, method or suite.
        """
        what, _, name = view.partition(" ")
        if what == "tasks" and name:
            return f"{self._tasks(name)}\n\n*{self.source()}*"
        if what == "parts" and name:
            return f"{self._parts(name)}\n\n*{self.source()}*"
        if view == "methods":
            return f"{self._methods()}\n\n*{self.source()}*"
        if view == "summary":
            return f"{self._summary()}\n\n*{self.source()}*"
        if view == "reasons":
            return f"{self._reasons()}\n\n*{self.source()}*"
        if view == "answers":
            runs = {one.run for one in self.episodes if one.answers}
            return f"{self._answers()}\n\n*{self.source(runs)}*"
        raise UserError(
            f"there is no view {view!r} of a suite; there are 'methods', 'summary', 'reasons', 'answers', "
            "'tasks METHOD', 'parts SUITE' and 'plot'"
        )

    def _tasks(self, method: str) -> str:
        """Headline and table of one method."""
        tasks = self.of(method)
        instances = sorted({one.instance for found in tasks.values() for one in found})
        rows = []
        for task, found in tasks.items():
            q = dict(zip(sorted({one.instance for one in found}), _by_instance(found), strict=True))
            each = ", ".join(_short(q[i]) if i in q else "." for i in instances)
            whole = f"{sum(one.q == 1.0 for one in found)}/{len(found)}"
            rows.append([f"{_number(task)}", f"`{task}`", f"{np.mean([*q.values()]):.2f}", whole, each, gave_up(found)])
        heads = ["id", "task", "mean q", "q = 1", f"q of instances {', '.join(map(str, instances))}",
                 "given up because of"]  # fmt: skip
        return f"{self._headline(method, tasks)}\n\n{grid(heads, rows)}"

    def _headline(self, method: str, tasks: Mapping[str, Sequence[Episode]]) -> str:
        scores = [_by_instance(found) for found in tasks.values()]
        count, whole = sum(map(len, tasks.values())), sum(one.q == 1.0 for found in tasks.values() for one in found)
        return (
            f"**`{method}`: mean q {_told(estimate(scores))} over {len(tasks)} tasks; {whole} of {count} episodes met "
            "the whole goal.**"
        )

    def _methods(self) -> str:
        """Tasks in rows, methods in columns; the rows below are over the start states that all methods played."""
        each = {method: self.of(method) for method in self.methods}
        rows = []
        for task in self.tasks:
            cells = [_cell(tasks.get(task, [])) for tasks in each.values()]
            if any(cells):
                rows.append([task, *(cell or "not played" for cell in cells)])
        columns, tasks, starts = self._shared()
        rows += [[head, *(column[head] for column in columns)] for head in columns[0] if any(c[head] for c in columns)]
        note = f"The rows below the tasks are over the {starts} start states of {tasks} tasks that all played."
        return f"{grid(['task', *(f'`{method}`' for method in self.methods)], rows)}\n\n{note}"

    def _summary(self) -> str:
        """Methods in rows, over the start states that all of them played."""
        columns, tasks, starts = self._shared()
        heads = [head for head in columns[0] if any(column[head] for column in columns)]
        rows = [
            [f"`{method}`", *(column[head] for head in heads)]
            for method, column in zip(self.methods, columns, strict=True)
        ]
        titles = [head.strip("*") for head in heads]
        return f"{grid(['method', *titles], rows)}\n\nOver {starts} start states of {tasks} tasks."

    def _shared(self) -> tuple[list[dict[str, str]], int, int]:
        """What is told of each method over the start states that all played; how many tasks and start states."""
        each = {method: self.of(method) for method in self.methods}
        common = set.intersection(*({one.key[1:] for one in self.episodes if one.method == m} for m in self.methods))
        shared = [
            {t: kept for t, found in tasks.items() if (kept := [one for one in found if one.key[1:] in common])}
            for tasks in each.values()
        ]
        tasks = [task for task in self.tasks if task in shared[0]]
        columns: list[dict[str, str]] = []
        for method, of in zip(self.methods, shared, strict=True):
            mean = estimate([_by_instance(found) for found in of.values()]) if tasks else None
            theirs = paper_mean(method, tasks) if tasks else None
            higher, chance = _compared(shared[0], of) if of is not shared[0] and tasks else ("", "")
            columns.append({
                "**mean q**": f"**{mean.mean:.2f}**" if mean else "",
                "95 % interval": f"{mean.low:.2f} to {mean.high:.2f}" if mean and mean.low is not None else "",
                f"q = 1, of {len(common)}": str(sum(one.q == 1.0 for found in of.values() for one in found)) * bool(of),
                f"higher, lower than `{next(iter(self.methods))}`": higher,
                "chance of so great a difference": chance,
                f"*the paper's mean of these {len(tasks)}*": "" if theirs is None else f"*{theirs:.2f}*",
            })  # fmt: skip
        return columns, len(tasks), len(common)

    def _parts(self, suite: str) -> str:
        """Two rows a method: of the tasks that are in a suite, and of the others."""
        inside, rows = {*load_suite(suite).tasks}, []
        for method in self.methods:
            for name, part in ((f"`{suite}`", inside), ("the others", {*self.tasks} - inside)):
                found = {task: episodes for task, episodes in self.of(method).items() if task in part}
                if not found:
                    continue
                every = [one for episodes in found.values() for one in episodes]
                low = [one for one in every if one.q < HALF]
                mean = _told(estimate([_by_instance(episodes) for episodes in found.values()]))
                rows.append([
                    f"`{method}`", f"{name}: {len(found)}", mean,
                    f"{sum(one.q == 1.0 for one in every)} of {len(every)}", f"{len(low)}",
                    f"{sum(one.ended == 'time_limit' for one in low)}",
                ])  # fmt: skip
        heads = ["method", "tasks", "mean q", "q = 1", f"q below {HALF:g}", "of these out of time"]
        return grid(heads, rows)

    def _reasons(self) -> str:
        """Reasons in rows, methods in columns: of how many episodes that missed something they are told."""
        missed = [[one for one in self.episodes if one.method == method and one.q < 1.0] for method in self.methods]
        counts = [Counter(code for one in found for code in {*one.reasons}) for found in missed]
        common = sorted(sum(counts, Counter()).items(), key=lambda pair: (-pair[1], pair[0]))
        late = [sum(one.ended == "time_limit" for one in found) for found in missed]
        silent = [sum(not one.reasons and one.ended != "time_limit" for one in found) for found in missed]
        rows = [["out of time", *map(str, late)]]
        rows += [[f"`{code}`", *(str(count[code]) for count in counts)] for code, _ in common[:FREQUENT]]
        rows += [["nothing given up", *map(str, silent)]]
        total = Counter(one.method for one in self.episodes)
        heads = [f"`{m}`, {len(found)} of {total[m]} below q 1" for m, found in zip(self.methods, missed, strict=True)]
        rest = len(common) - FREQUENT
        note = f"\n\n{rest} rarer reasons are left out; an episode may have several." if rest > 0 else ""
        return grid(["given up because of", *heads], rows) + note

    def _answers(self) -> str:
        """A row for each method whose episodes keep what its checker answered.

        Raises:
            UserError: None does.
        """
        rows = []
        for method in self.methods:
            kept = [one for one in self.episodes if one.method == method and one.answers]
            if not kept:
                continue
            total = sum((Counter(one.answers) for one in kept), Counter[str]())
            taken = [
                one for one in kept if one.q < 1.0 and any(code.rpartition(": ")[2] == DONE for code in one.reasons)
            ]
            right = sum(not one.answers["false_no"] for one in taken)
            rows.append([
                f"`{method}`", f"{len(kept)}", f"{total['yes']}", f"{total['false_yes']}",
                f"{total['asked'] - total['yes']}", f"{total['false_no']}", f"{right} of {len(taken)}",
            ])  # fmt: skip
        if not rows:
            raise UserError("no episode of the file keeps what its checker answered")
        heads = ["method", "episodes", "yes", "of these false", "no", "of these false",
                 "below q 1, given up as `done`, without a false no"]  # fmt: skip
        return grid(heads, rows)

    def plot(self) -> str:
        """An SVG file: the mean q of each task as a bar for every method that has it, and the paper's as a diamond."""
        drawing = Drawing("q of each task", _WIDE)
        theirs = paper_scores().get("mpvi", {})
        y = drawing.legend(
            0, [*((f"m{i + 1}", name) for i, name in enumerate(self.methods)), ("diamond", "the paper's mpvi")]
        )
        top, left, right = y + 8, _LABEL, _WIDE - _RIGHT
        each = {method: self.of(method) for method in self.methods}
        shown = [task for task in self.tasks if any(task in tasks for tasks in each.values())]
        bottom = top + _ROW * len(shown)

        def px(q: float) -> float:
            return left + q * (right - left)

        for q in (0.0, 0.25, 0.5, 0.75, 1.0):
            drawing.line(px(q), top, px(q), bottom, "grid" if q else "axis")
            drawing.text(px(q), bottom + 14, f"{q:g}", "dim small", "middle")
        for row, task in enumerate(shown):
            middle = top + _ROW * (row + 0.5)
            drawing.text(0, middle + 4, f"{_number(task)}  {task}", "small", room=_LABEL - 8)
            drawing.line(px(0), middle, px(1), middle, "grid")
            for i, tasks in enumerate(each.values()):
                if found := tasks.get(task):
                    mean = float(np.mean([one.q for one in found]))
                    at = middle - 6 + 12 * (i + 0.5) / len(each)
                    drawing.rect(px(0), at - 2, max(2.0, px(mean) - px(0)), 4, f"m{i + 1}", f"{[*each][i]}: {mean:.2f}")
            if task in theirs:
                drawing.diamond(px(theirs[task]), middle, 4, "theirs")
        return drawing.svg(bottom + 22, alone=True) + "\n"


def gave_up(episodes: Sequence[Episode]) -> str:
    """Why units were given up in the episodes that missed something, the most frequent reason first."""
    missed = [one for one in episodes if one.q < 1.0]
    common = Counter(code for one in missed for code in one.reasons).most_common(NAMED)
    text = ", ".join(code if count == 1 else f"{code} {count}" for code, count in common)
    late = sum(one.ended == "time_limit" for one in missed)
    return "; ".join(filter(None, [text, f"out of time {late}" if late else ""]))


def _number(task: str) -> int | str:
    """BEHAVIOR's number of a task, where it is one of its fifty."""
    order = [*paper_scores().get("mpvi", {})]
    return order.index(task) if task in order else ""


def _by_instance(episodes: Sequence[Episode]) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """(instances,) q of each instance, the mean of its seeds."""
    instances = sorted({one.instance for one in episodes})
    return np.array([np.mean([one.q for one in episodes if one.instance == i]) for i in instances])


def _cell(episodes: Sequence[Episode]) -> str:
    """Mean q, and in brackets how many of how many met the whole goal."""
    if not episodes:
        return ""
    return f"{np.mean(_by_instance(episodes)):.2f} ({sum(one.q == 1.0 for one in episodes)}/{len(episodes)})"


def _compared(first: Mapping[str, Sequence[Episode]], other: Mapping[str, Sequence[Episode]]) -> tuple[str, str]:
    """How often a method came further than the first one and how often less far, and the chance of that."""
    gaps = [_by_instance(other[task]) - _by_instance(found) for task, found in first.items()]
    every = np.concatenate(gaps)
    return f"{(every > SAME_Q).sum()}, {(every < -SAME_Q).sum()}", f"{permutation_test(gaps).p:.2g}"


def _told(found: Estimate | None) -> str:
    if found is None:
        return "unknown"
    return f"{found.mean:.2f}" + ("" if found.low is None else f" ({found.low:.2f} to {found.high:.2f})")


def _short(q: float) -> str:
    return f"{q:.2f}".rstrip("0").rstrip(".")
