"""A report's tables as LaTeX; they need the package booktabs only."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterator

from mpvi_bt.drawing.cells import one_line
from mpvi_bt.report import tables as t
from mpvi_bt.report.figures import Figures
from mpvi_bt.report.tables import Table

_SPECIAL = {
    **{sign: f"\\{sign}" for sign in "&%$#_{}"},
    "[": "{[}",  # which a row must not begin with
    "\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "<": r"\textless{}",
    ">": r"\textgreater{}", "|": r"\textbar{}", "↑": r"$\uparrow$", "↓": r"$\downarrow$",
}  # fmt: skip
_ANY = re.compile("|".join(map(re.escape, _SPECIAL)))
_HEAD = 12  # characters of a line of a head
_MINUS = re.compile(r"(?<![\w.])-(?=[\d.])")


def report_latex(figures: Figures) -> str:
    """The tables: scores, q on each task, comparisons, effort, time and distances."""
    return "\n\n".join(["% Tables of mpvi_bt; in the preamble: \\usepackage{booktabs}", *_tables(figures)]) + "\n"


def plain(text: str) -> str:
    """Text in which LaTeX finds nothing to obey; within a line."""
    return _MINUS.sub("$-$", _ANY.sub(lambda found: _SPECIAL[found[0]], one_line(text)))


def _tables(figures: Figures) -> Iterator[str]:
    suite = figures.suite
    yield _table(t.summary_table(figures), f"Scores on {suite}.", "scores")
    yield _table(t.task_table(figures), f"q on each task of {suite}.", "tasks")
    if figures.comparisons:
        yield _table(t.comparisons_table(figures.comparisons), f"Methods compared on {suite}.", "comparisons")
        yield _table(_turned(t.effort_table(figures.comparisons)), f"Effort at the same q on {suite}.", "effort")
    yield _table(_turned(t.efficiency_table(figures)), f"Time and distances on {suite}.", "efficiency")


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
    head = " & ".join(map(_stacked, table.head)) + r" \\"
    rows = [" & ".join(map(plain, row)) + r" \\" for row in table.rows]
    columns = "l" + "r" * (len(table.head) - 1)
    lines = [
        r"\begin{table}",
        r"\centering\footnotesize\setlength{\tabcolsep}{4pt}",
        rf"\caption{{{plain(' '.join(filter(None, (caption, table.note))))}}}",
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
