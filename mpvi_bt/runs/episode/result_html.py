"""A table of HTML for notebooks, which needs no style sheet."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from html import escape

_MET, _MISSED = "#1a7f37", "#b42318"


def result_html(heading: str, about: str, met: bool, rows: Mapping[str, Sequence[str]]) -> str:
    """A result with its heading in color.

    Args:
        heading: Such as "q = 1.000".
        about: Beside it.
        met: The goal is met: a green heading; or else a red one.
        rows: Names and lines of HTML. A row without lines is left out.
    """
    body = "".join(_row(name, "<br>".join(lines)) for name, lines in rows.items() if lines)
    return (
        f'<table><caption style="text-align:left"><b style="color:{_MET if met else _MISSED}">{escape(heading)}</b> '
        f"{escape(about)}</caption><tbody>{body}</tbody></table>"
    )


def conditions_html(conditions: Iterable[tuple[str, bool]]) -> list[str]:
    """Conditions of a goal and whether each is met, a line each."""
    return [
        f'<span style="color:{_MET if met else _MISSED}">{"✓" if met else "✗"} {escape(text)}</span>'
        for text, met in conditions
    ]


def _row(name: str, html: str) -> str:
    return f'<tr><th style="text-align:left">{name}</th><td style="text-align:left">{html}</td></tr>'
