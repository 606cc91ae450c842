"""Filters of a report page: all episodes, those that miss their goal, or those with a given failure.

They are radio buttons and a style sheet, so the page needs no script.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

from mpvi_bt.executive.drawing.cells import cut, one_line
from mpvi_bt.runs.episode.result import Result
from mpvi_bt.runs.report.failures import reason
from mpvi_bt.runs.report.runs import Runs

MOST = 12  # reasons that can be chosen, the most frequent
_LONG = 40
_SHORT = "short"
_KINDS = (_SHORT, *(f"why{i}" for i in range(MOST)))

# What is not of the chosen kind is not shown; a browser that does not know :has shows all.
CHOICE_STYLE = "".join(f"main:has(#only-{k}:checked) :is(.episode, .task):not(.{k}){{display:none}}\n" for k in _KINDS)


@dataclass(frozen=True)
class ReportChoice:
    """What can be chosen.

    Attributes:
        episodes, short: How many there are, and how many fall short of their goal.
        reasons: Reason codes of failures on the way, with how many episodes have them.
    """

    episodes: int
    short: int
    reasons: dict[str, int]

    @classmethod
    def of(cls, runs: Sequence[Runs]) -> ReportChoice:
        """Of all episodes that have a result."""
        results = [result for run in runs for result in run.results.values()]
        counted = Counter(code for result in results for code in {reason(failure) for failure in result.failures})
        ranked = sorted(counted.items(), key=lambda item: (-item[1], item[0]))
        return cls(len(results), sum(not result.success for result in results), dict(ranked[:MOST]))

    def kinds(self, result: Result) -> list[str]:
        """Classes of an episode."""
        codes = {reason(failure) for failure in result.failures}
        return [_SHORT] * (not result.success) + [f"why{i}" for i, code in enumerate(self.reasons) if code in codes]

    @property
    def html(self) -> str:
        """The buttons; "" where there is nothing to choose."""
        if not self.short and not self.reasons:
            return ""
        entries = [("all", f"all {self.episodes}"), (_SHORT, f"short of the goal {self.short}")]
        entries += [(f"why{i}", f"{code} {count}") for i, (code, count) in enumerate(self.reasons.items())]
        buttons = "".join(
            f'<label><input type="radio" name="only" id="only-{kind}"{" checked" if kind == "all" else ""}> '
            f"{escape(cut(one_line(word), _LONG))}</label>"
            for kind, word in entries
        )
        return f'<div class="choice" role="radiogroup" aria-label="Episodes shown">Show: {buttons}</div>'
