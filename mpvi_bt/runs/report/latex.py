"""A report's tables as LaTeX; they need the package booktabs only."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import replace

from mpvi_bt.executive.drawing.cells import one_line
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.report import tables as t
from mpvi_bt.runs.report.chosen_columns import MEASURED, PAPER, WHICH, rows_of
from mpvi_bt.runs.report.figures import Figures, Group, group_of
from mpvi_bt.runs.report.paper import paper_mean
from mpvi_bt.runs.report.runs import Runs
from mpvi_bt.runs.report.tables import Table

_SPECIAL = {
    **{sign: f"\\{sign}" for sign in "&%$#_{}"},
    "[": "{[}",  # which a row must not begin with
    "\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "<": r"\textless{}",
    ">": r"\textgreater{}", "|": r"\textbar{}", "↑": r"$\uparrow$", "↓": r"$\downarrow$",
}  # fmt: skip
_ANY = re.compile("|".join(map(re.escape, _SPECIAL)))
_HEAD = 12  # characters of a line of a head
_COMMENT = 100  # of a line of a comment
_MINUS = re.compile(r"(?<![\w.])-(?=[\d.])")


def report_latex(figures: Figures, runs: Sequence[Runs] = (), columns: Sequence[str] = ()) -> str:
    """The tables: scores, q on each task, in each house, comparisons, effort, time and distances; or chosen columns.

    Args:
        figures: What to tell. The paper's are left out unless a column asks for them.
        runs: Of each method, for chosen columns.
        columns: Names of `chosen_columns`; none: the usual tables.
    """
    head = "% Tables of mpvi_bt; in the preamble: \\usepackage{booktabs}"
    own = replace(figures, paper={}, methods=[replace(method, paper=None) for method in figures.methods])
    tables = [_chosen(figures, runs, columns)] if columns else _tables(own)
    return "\n\n".join([head, *tables]) + "\n"


def plain(text: str) -> str:
    """Text in which LaTeX finds nothing to obey; within a line."""
    return _MINUS.sub("$-$", _ANY.sub(lambda found: _SPECIAL[found[0]], one_line(text)))


def _tables(figures: Figures) -> Iterator[str]:
    on, level = f"on {figures.suite}", f"{figures.level:.0%}"
    yield _table(t.summary_table(figures), f"Scores {on}: means with {level} bootstrap intervals.", "scores")
    yield _table(
        t.task_table(figures),
        f"Mean q on each task of {figures.suite}, and how many of the episodes with a result reached the whole goal.",
        "tasks",
    )
    if (houses := t.house_table(figures)).rows:
        yield _table(houses, f"Mean q in each house of {figures.suite}.", "houses")
    if figures.comparisons:
        compared = t.comparisons_table(figures.comparisons)
        yield _table(compared, f"Methods {on}, compared by a paired, two-sided permutation test.", "comparisons")
        effort = t.effort_table(figures.comparisons, paper=False)
        yield _table(_turned(effort), f"Effort {on} where both methods have the same q above 0.", "effort")
    yield _table(_turned(t.efficiency_table(figures)), f"Time and distances {on}.", "efficiency")


def _chosen(figures: Figures, runs: Sequence[Runs], columns: Sequence[str]) -> str:
    """A row for each method, or for each group of its episodes with equal values in the chosen columns."""
    rows = [
        [_cell(name, run, alike, group_of(run, alike)) for name in columns]
        for run in runs
        for alike in rows_of(run, columns)
    ]
    which = [i for i, name in enumerate(columns) if name in WHICH]
    seen = {i: list(dict.fromkeys(row[i] for row in rows)) for i in which}
    rows.sort(key=lambda row: [seen[i].index(row[i]) for i in which])  # the first column counts most
    titles = {**{name: measure.title for name, measure in MEASURED.items()}, PAPER: "q of the MPVI paper"}
    head = [titles.get(name, name) for name in columns]
    caption = f"Means on {figures.suite} with {figures.level:.0%} bootstrap intervals."
    return _table(Table("", head, rows, t.method_note(figures)), caption, "columns")


def _cell(name: str, run: Runs, alike: Sequence[EpisodeConfig], group: Group) -> str:
    if name in WHICH:
        return WHICH[name](run, alike[0])
    if name != PAPER:
        return t.told(group.measures[MEASURED[name].key], MEASURED[name].digits)
    q = paper_mean(run.method, dict.fromkeys(config.task_name for config in alike))
    return t.NONE if q is None else f"{q:.3f}"


def _turned(table: Table) -> Table:
    """Rows for columns: a page of a paper is narrow."""
    head, *rows = zip(table.head, *table.rows, strict=True)
    return Table(table.title, ["", *head[1:]], rows, table.note)


def _stacked(text: str) -> str:
    """A head in lines of a few words, so that its column is no wider than its figures need."""
    lines = textwrap.wrap(one_line(text), _HEAD, break_on_hyphens=False)
    stacked = r"\\".join(map(plain, lines))
    return rf"\shortstack[r]{{{stacked}}}" if len(lines) > 1 else stacked


def _table(table: Table, caption: str, label: str) -> str:
    """A table under a caption of one sentence; what else is to be known of it is a comment above."""
    head = " & ".join(map(_stacked, table.head)) + r" \\"
    rows = [" & ".join(map(plain, row)) + r" \\" for row in table.rows]
    columns = "".join("r" if figures else "l" for figures in table.figures)
    lines = [
        *(f"% {line}" for line in textwrap.wrap(one_line(table.note), _COMMENT)),
        r"\begin{table}",
        r"\centering\footnotesize\setlength{\tabcolsep}{4pt}",
        rf"\caption{{{plain(caption)}}}",
        rf"\label{{tab:mpvi-{label}}}",
        rf"\begin{{tabular}}{{{columns}}}",
        r"\toprule",
        head,
        r"\midrule",
        *rows,
        r"\bottomrule",
        r"\end{tabular}",
        r"\end{table}",
    ]
    return "\n".join(lines)
