"""The report of a suite in every form, for the commands and for `mpvi_bt.run_suite`."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

from mpvi_bt.executive.drawing.cells import WIDTH

if TYPE_CHECKING:  # what they load is slower than the help of these commands should be
    from mpvi_bt.runs.episode.result import Result
    from mpvi_bt.runs.report.figures import Figures
    from mpvi_bt.runs.report.runs import Runs
    from mpvi_bt.runs.report.suite_folders import SuiteFolder
    from mpvi_bt.runs.suite.store import Store


@dataclass(frozen=True)
class SuiteReport:
    """The results of suites with their figures.

    Attributes:
        figures: Of all methods.
        runs: Of each.
        stores: Where the results are.
    """

    figures: Figures
    runs: list[Runs]
    stores: list[Store]

    @classmethod
    def of(cls, parts: Sequence[SuiteFolder], baseline: str | None = None) -> SuiteReport:
        """Compute the figures.

        Args:
            parts: The results of each folder; several are compared.
            baseline: Name of the method that others are compared with.

        Raises:
            UnknownName: No method has the baseline's name.
            UserError: The folders cannot be compared.
        """
        from mpvi_bt.runs.report.figures import figures
        from mpvi_bt.runs.report.suite_folders import notes, together

        runs = together(parts)
        title = ", ".join(dict.fromkeys(part.suite for part in parts))
        about = " ".join(dict.fromkeys(filter(None, (part.about for part in parts))))
        return cls(figures(title, runs, about, baseline, notes(parts)), runs, [part.store for part in parts])

    @property
    def running(self) -> bool:
        """Whether more results are on their way."""
        return any(store.running() for store in self.stores)

    @property
    def results(self) -> list[Result]:
        """Of every episode that has one, in the suite's order, method by method."""
        return [runs.results[config] for runs in self.runs for config in runs.episodes if config in runs.results]

    @property
    def faults(self) -> dict[str, str]:
        """Errors of episodes without a result, by name. The next run plays these again."""
        return {config.name: fault.message for runs in self.runs for config, fault in runs.faults.items()}

    def __str__(self) -> str:
        """The report as text."""
        return self.told(as_json=False)

    def _repr_html_(self) -> str:
        """What notebooks show: the same."""
        return f"<pre>{escape(str(self))}</pre>"

    def told(self, as_json: bool, width: int = WIDTH) -> str:
        """The report as text for a terminal of so many columns, or for programs."""
        if as_json:
            from mpvi_bt.runs.report.data import report_data

            return json.dumps(report_data(self.figures, self.runs), indent=1, allow_nan=False, ensure_ascii=False)
        from mpvi_bt.runs.report.closing_table import report_text

        return report_text(self.figures, self.runs, width)

    def write_html(self, path: Path) -> list[Path]:
        """Write the page. Raises UserError if that is impossible, BackendError if the disk is full."""
        from mpvi_bt.ground.writing import write_whole
        from mpvi_bt.runs.report.page import report_page

        when = datetime.now().astimezone().strftime("%Y-%m-%d %H:%M")
        write_whole(path, report_page(self.figures, self.runs, path, self.running, when))
        return [path]

    def write_markdown(self, path: Path) -> list[Path]:
        """Write the Markdown and its plots. Raises as `write_html`."""
        from mpvi_bt.ground.writing import write_whole
        from mpvi_bt.runs.report.markdown import report_markdown

        text, plots = report_markdown(self.figures, path.stem, self.running)
        for name, svg in plots.items():
            write_whole(path.with_name(name), svg)
        write_whole(path, text)
        return [path, *(path.with_name(name) for name in plots)]

    def write_csv(self, path: Path, columns: Sequence[str] = ()) -> list[Path]:
        """Write a row for every episode, of all columns or of those of these names. Raises as `write_html`."""
        from mpvi_bt.ground.writing import write_whole
        from mpvi_bt.runs.report.chosen_columns import COLUMNS
        from mpvi_bt.runs.report.rows import report_csv

        write_whole(path, report_csv(self.runs, columns or COLUMNS))
        return [path]

    def write_latex(self, path: Path, columns: Sequence[str] = ()) -> list[Path]:
        """Write the tables of a paper, or one with the columns of these names. Raises as `write_html`."""
        from mpvi_bt.ground.writing import write_whole
        from mpvi_bt.runs.report.latex import report_latex

        write_whole(path, report_latex(self.figures, self.runs, columns))
        return [path]
