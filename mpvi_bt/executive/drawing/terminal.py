"""Safe output to a terminal: control sequences from files, models or servers have no effect.

While a command runs, `guarded` filters its output: everything printed goes through `cells.harmless`, whether to a
terminal or a pipe. There are two exceptions: `draw` for our own colors and cursor moves, and `give` for unchanged data
to programs.

The standard output is for results: `tell`, `give`, and `draw` to `results()`. Within `results_alone` what is printed
otherwise, such as by a user's part, goes to standard error.
"""

from __future__ import annotations

import codecs
import contextlib
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, TextIO, cast

from mpvi_bt.executive.drawing.cells import WIDTH, escape, harmless
from mpvi_bt.ground.errors import bounded

_ESCAPED = "mpvi_bt.escaped"  # what becomes of characters that an encoding lacks


def _escaped(error: UnicodeError) -> tuple[str, int]:
    assert isinstance(error, UnicodeEncodeError)
    return "".join(map(escape, error.object[error.start : error.end])), error.end


codecs.register_error(_ESCAPED, _escaped)


class GuardedStream:
    """A text stream that is safe for terminals: it escapes control sequences and characters missing in the encoding.

    Args:
        stream: Where to.
        short: Whether lines are kept short, as no diagnosis needs a screen full, and lost where nobody takes them: that
            is no reason to end a run.
    """

    encoding = "utf-8"  # any text will do; where the stream says ASCII, click would write past us

    def __init__(self, stream: TextIO, short: bool = False) -> None:
        self.stream, self._short = stream, short

    def write(self, text: str) -> int:
        """Write it."""
        with contextlib.suppress(*([OSError] if self._short else [])):
            self.stream.write(_encodable(harmless(bounded(text) if self._short else text), self.stream))
        return len(text)

    def flush(self) -> None:
        """Hand on what is written."""
        with contextlib.suppress(*([OSError] if self._short else [])):
            self.stream.flush()

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)


@contextmanager
def guarded() -> Iterator[None]:
    """Put a guard before this process's output, once, for as long as the context lasts."""
    before = sys.stdout, sys.stderr
    if not isinstance(before[0], GuardedStream):
        sys.stdout, sys.stderr = (
            cast("TextIO", GuardedStream(before[0])),
            cast("TextIO", GuardedStream(before[1], short=True)),
        )
    try:
        yield
    finally:
        sys.stdout, sys.stderr = before


_results: TextIO | None = None


@contextmanager
def results_alone() -> Iterator[None]:
    """Keep standard output for results: all other prints go to standard error meanwhile."""
    global _results
    before = sys.stdout, _results
    _results, sys.stdout = results(), sys.stderr
    try:
        yield
    finally:
        sys.stdout, _results = before


def results() -> TextIO:
    """Where results go: the standard output."""
    return sys.stdout if _results is None else _results


def size() -> os.terminal_size:
    """Columns and lines of the terminal that results go to, or as COLUMNS and LINES say; else 80 by 24."""
    columns, lines = WIDTH, 24
    with contextlib.suppress(OSError, ValueError):
        columns, lines = os.get_terminal_size(results().fileno())
    given = [os.environ.get(name, "") for name in ("COLUMNS", "LINES")]
    told = [int(text) if text.isdecimal() else 0 for text in given]
    return os.terminal_size((told[0] or columns or WIDTH, told[1] or lines or 24))


def tell(text: str = "", nl: bool = True) -> None:
    """Write text of a result, and the end of its line unless `nl` is false."""
    stream = results()
    stream.write(text + "\n" * nl)
    stream.flush()


def draw(stream: TextIO, text: str) -> None:
    """Write text with our own escape sequences in it. All that is not ours went through `cells.one_line` before."""
    stream = _behind(stream)
    stream.write(_encodable(text, stream))
    stream.flush()


def give(text: str) -> None:
    """Write data to the standard output: to a program as they are, to a terminal so that it obeys nothing in them."""
    stream = _behind(results())
    draw(stream, harmless(text) if stream.isatty() else text)


def _behind(stream: TextIO) -> TextIO:
    return stream.stream if isinstance(stream, GuardedStream) else stream


def _encodable(text: str, stream: TextIO) -> str:
    encoding = getattr(stream, "encoding", None) or "utf-8"
    return text.encode(encoding, _ESCAPED).decode(encoding)
