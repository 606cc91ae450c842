"""Messages on stderr during a long command."""

from __future__ import annotations

import shutil
import sys

import click

from mpvi_bt.executive.drawing.cells import one_line
from mpvi_bt.executive.drawing.terminal import draw


class Status:
    """Permanent lines, and on a terminal one below them that is drawn anew."""

    def __init__(self) -> None:
        self._live, self._drawn = sys.stderr.isatty(), ""

    def say(self, line: str) -> None:
        """A line that stays."""
        self.clear()
        click.echo(f"mpvi: {line}", err=True)

    def draw(self, text: str) -> None:
        """How it stands."""
        line = one_line(text)[: shutil.get_terminal_size().columns - 1]
        if self._live and line != self._drawn:
            draw(sys.stderr, f"\r\x1b[2K{line}")
            self._drawn = line

    def clear(self) -> None:
        """Take the drawn line away."""
        if self._drawn:
            draw(sys.stderr, "\r\x1b[2K")
            self._drawn = ""
