"""A suite's results as Markdown, with its plots as SVG files beside it."""

from __future__ import annotations

import re
from collections.abc import Iterator

from mpvi_bt.executive.drawing.cells import one_line
from mpvi_bt.runs.report import tables as t
from mpvi_bt.runs.report.figures import Figures
from mpvi_bt.runs.report.plots import improvement_plot, method_plot
from mpvi_bt.runs.report.tables import Table

# What Markdown or HTML would take for its own: underscores within a word are not, nor are brackets around numbers.
_SPECIAL = re.compile(r"[\\`*<>|&~$]|(?<![A-Za-z0-9])_|_(?![A-Za-z0-9])|\[(?![-+0-9])|\](?=[(:\[])")
_BEGINS = re.compile(r"^(\d*)([-+#=.)])")  # a list, a heading, a line


def report_markdown(figures: Figures, stem: str, running: bool = False) -> tuple[str, dict[str, str]]:
    """The report.

    Args:
        figures: What to tell.
        stem: Of its file: plots are named after it.
        running: Whether more results are on their way.

    Returns:
        The text, and the plots by the names of the files that it shows.
    """
    plots: dict[str, str] = {}
    return "\n\n".join(_blocks(figures, stem, running, plots)) + "\n", plots


def plain(text: str) -> str:
    """Text in which Markdown finds nothing to obey; within a line."""
    return _SPECIAL.sub(lambda found: "\\" + found[0], one_line(text))


def _paragraph(text: str) -> str:
    return _BEGINS.sub(r"\1\\\2", plain(text))


def _blocks(figures: Figures, stem: str, running: bool, plots: dict[str, str]) -> Iterator[str]:
    yield f"# {plain(figures.suite)}"
    yield from filter(None, [_paragraph(figures.about)])
    yield _paragraph(t.standing(figures, running))
    yield from map(_paragraph, figures.notes)
    yield "## Summary"
    yield _table(t.summary_table(figures))
    yield _paragraph(t.truth_text(figures))
    if figures.comparisons:
        yield "## Improvement"
        yield _table(t.comparisons_table(figures.comparisons), titled=False)
    for found in figures.comparisons:
        yield f"### {plain(found.method)} against {plain(found.baseline)}"
        yield _paragraph(t.comparison_text(found))
        yield _picture(f"{stem}.{found.method}.svg", improvement_plot(found, alone=True), "Change of q", plots)
        yield _table(t.comparison_table(found), titled=False)
    if figures.comparisons:
        yield _table(t.effort_table(figures.comparisons))
    if any(method.overall.finished for method in figures.methods):
        yield "## Methods on each task"
        yield _picture(f"{stem}.methods.svg", method_plot(figures, alone=True), "q of every method", plots)
    yield "## Tasks"
    yield _table(t.task_table(figures))
    yield from (_table(table) for method in figures.methods if (table := t.instance_table(method)).rows)
    if (houses := t.house_table(figures)).rows:
        yield "## Houses"
        yield _table(houses, titled=False)
    yield "## Time and distances"
    yield _table(t.efficiency_table(figures))
    for task in figures.tasks:
        yield _table(t.efficiency_table(figures, task))
    yield _table(t.direction_table())
    failures = [table for table in t.failure_tables(figures) if table.rows]
    if failures:
        yield "## Failures"
        yield from map(_table, failures)
        yield from (_table(table) for method in figures.methods if (table := t.failure_table_of(method)).rows)
    yield "## Parts"
    yield _table(t.settings_table(figures), titled=False)
    yield from (_table(table) for table in (t.wall_table(figures), t.missing_table(figures)) if table.rows)


def _picture(name: str, svg: str, title: str, plots: dict[str, str]) -> str:
    file = re.sub(r"[^A-Za-z0-9._-]", "_", name)
    plots[file] = svg + "\n"
    return f"![{title}]({file})"


def _table(table: Table, titled: bool = True) -> str:
    lines = [f"| {' | '.join(map(plain, row))} |" for row in (table.head, *table.rows)]
    lines.insert(1, "|" + "".join("---:|" if figures else "---|" for figures in table.figures))
    title = f"### {plain(table.title)}\n\n" if table.title and titled else ""
    note = f"\n\n{_paragraph(table.note)}" if table.note else ""
    return title + "\n".join(lines) + note
