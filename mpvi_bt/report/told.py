"""What the commands of suites and `mpvi_bt.run_suite` tell of results: text, JSON, an HTML page, Markdown."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

from mpvi_bt.suite.config import EpisodeConfig

if TYPE_CHECKING:  # what they load is slower than the help of these commands should be
    from mpvi_bt.report.figures import Figures
    from mpvi_bt.report.runs import Runs
    from mpvi_bt.suite.result import Result
    from mpvi_bt.suite.store import Fault, Store


@dataclass(frozen=True)
class Told:
    """A suite's results with their figures.

    Attributes:
        figures: Of all methods.
        runs: Of each.
        store: Where the results are.
    """

    figures: Figures
    runs: list[Runs]
    store: Store

    @classmethod
    def of(
        cls,
        title: str,
        store: Store,
        episodes: Sequence[EpisodeConfig],
        results: Mapping[EpisodeConfig, Result],
        faults: Mapping[EpisodeConfig, Fault],
        suite: str | None = None,
        baseline: str | None = None,
    ) -> Told:
        """Compute the figures.

        Args:
            title: Name of the suite.
            store: Where the results are.
            episodes: All of it, in order.
            results: Those that are there.
            faults: What broke others.
            suite: Name or file of the suite, which says what it is about.
            baseline: Name of the method that others are compared with.

        Raises:
            UnknownName: No method has the baseline's name.
        """
        from mpvi_bt.report.figures import figures
        from mpvi_bt.report.runs import runs_of
        from mpvi_bt.suite.tasks import load_suite

        runs = runs_of(episodes, results, faults, store)
        return cls(figures(title, runs, load_suite(suite).about if suite else "", baseline), runs, store)

    @property
    def results(self) -> list[Result]:
        """Of every episode that has one, in the suite's order, method by method."""
        return [runs.results[config] for runs in self.runs for config in runs.episodes if config in runs.results]

    @property
    def faults(self) -> dict[str, str]:
        """What broke the episodes that have no result and are run again by the next run: name to message."""
        return {config.name: fault.message for runs in self.runs for config, fault in runs.faults.items()}

    def __str__(self) -> str:
        """The report as text."""
        return self.told(as_json=False)

    def _repr_html_(self) -> str:
        """What notebooks show: the same."""
        return f"<pre>{escape(str(self))}</pre>"

    def told(self, as_json: bool) -> str:
        """The report as text for a terminal, or for programs."""
        if as_json:
            from mpvi_bt.report.data import report_data

            return json.dumps(report_data(self.figures, self.runs), indent=1, allow_nan=False, ensure_ascii=False)
        from mpvi_bt.report.text import report_text

        return report_text(self.figures, self.runs)

    def write_html(self, path: Path) -> list[Path]:
        """Write the page. Raises UserError if that is impossible, BackendError if the disk is full."""
        from mpvi_bt.report.page import report_page
        from mpvi_bt.writing import write_whole

        when = datetime.now().astimezone().strftime("%Y-%m-%d %H:%M")
        write_whole(path, report_page(self.figures, self.runs, path, self.store.running(), when))
        return [path]

    def write_markdown(self, path: Path) -> list[Path]:
        """Write the Markdown and its plots. Raises as `write_html`."""
        from mpvi_bt.report.markdown import report_markdown
        from mpvi_bt.writing import write_whole

        text, plots = report_markdown(self.figures, path.stem, self.store.running())
        for name, svg in plots.items():
            write_whole(path.with_name(name), svg)
        write_whole(path, text)
        return [path, *(path.with_name(name) for name in plots)]
