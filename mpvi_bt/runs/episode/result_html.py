"""A result as a notebook shows it: q and the verdict first, then the goal, the costs, and what failed."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mpvi_bt.runs.episode.result import Result

_MET, _MISSED = "#1a7f37", "#b42318"
_MOST = 12  # failures that are listed


def result_html(result: Result) -> str:
    """A table that needs no style sheet, its texts escaped."""
    color = _MET if result.success else _MISSED
    rows = [
        _row(
            "goal",
            "<br>".join(_condition(c.condition, c.satisfied) for c in result.goal),
        ),
        _row("end", escape(result.told)),
        _row("distance", f"base {result.agent_distance.base:.1f} m"),
    ]
    if result.failures:
        told = [f"{f.time_s:.0f} s: {escape(f.feedback or f.reason)}" for f in result.failures[:_MOST]]
        told += [f"and {len(result.failures) - _MOST} more"] if len(result.failures) > _MOST else []
        rows.append(_row("given up", "<br>".join(told)))
    if result.privileged:
        rows.append(_row("reads truth", escape(", ".join(result.privileged))))
    return (
        f'<table><caption style="text-align:left"><b style="color:{color}">q = {result.q:.3f}</b> '
        f"{escape(result.task)}, instance {result.instance_id}, seed {result.rollout_id}</caption>"
        f"<tbody>{''.join(rows)}</tbody></table>"
    )


def result_line(result: Result) -> str:
    """The same in a line of text."""
    met = sum(condition.satisfied for condition in result.goal)
    return (
        f"{result.task}, instance {result.instance_id}, seed {result.rollout_id}: q = {result.q:.3f}, "
        f"{met} of {len(result.goal)} conditions; {result.told}"
    )


def _row(name: str, html: str) -> str:
    return f'<tr><th style="text-align:left">{name}</th><td style="text-align:left">{html}</td></tr>'


def _condition(text: str, met: bool) -> str:
    return f'<span style="color:{_MET if met else _MISSED}">{"✓" if met else "✗"} {escape(text)}</span>'
