"""Colors of a tree on a terminal."""

from __future__ import annotations

import os
from typing import TextIO

import click

from mpvi_bt.executive.drawing.symbols import MARKS
from mpvi_bt.executive.drawing.text import Line


def obeys_escapes() -> bool:
    """Whether the terminal, if there is one, obeys escape sequences for cursor and color."""
    return os.environ.get("TERM") != "dumb"


def wants_color(stream: TextIO) -> bool:
    """Whether a stream is a terminal with colors and NO_COLOR is not set (no-color.org)."""
    return stream.isatty() and not os.environ.get("NO_COLOR") and obeys_escapes()


def painted(line: Line) -> str:
    """A node's line, its mark in color; what is idle is dim."""
    if line.standing is None:
        return line.text
    color = MARKS[line.standing].terminal
    if color is None:
        return click.style(line.text, dim=True)
    return line.before + click.style(line.mark, fg=color, bold=True) + line.after
