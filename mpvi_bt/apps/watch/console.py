"""Where the debugger asks and is answered while a page is served: at the terminal and on the page alike."""

from __future__ import annotations

import contextlib
import queue
import threading
from typing import TextIO

from mpvi_bt.apps.watch.channel import Page
from mpvi_bt.executive.ticking.debugger import Debugger
from mpvi_bt.ground.errors import UserError


class Console:
    """Source and stream of a `Debugger`: whichever of terminal and page answers first is heard.

    The page is told why the run pauses; it has buttons, so the keys of the terminal are none of its matter. The end of
    the input ends nothing: the page can still answer.
    """

    def __init__(self, source: TextIO, stream: TextIO, page: Page) -> None:
        """Read `source`, write to `stream`; `page` has the buttons."""
        self._source, self._stream, self._page = source, stream, page
        self._lines: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._asking = False
        self._debugger: Debugger | None = None
        page.heard = self._hear

    def attend(self, debugger: Debugger) -> None:
        """Whose console it is."""
        self._debugger = debugger
        threading.Thread(target=self._read, daemon=True).start()

    def isatty(self) -> bool:
        """Whether a terminal shows what is typed."""
        return self._source.isatty()

    def write(self, text: str) -> int:
        """To the terminal."""
        return self._stream.write(text)

    def flush(self) -> None:
        """Of the terminal."""
        self._stream.flush()

    def readline(self) -> str:
        """The next answer."""
        news = self._debugger.news if self._debugger else ()
        self._page.send({"paused": "\n".join(news) or "paused"})
        self._asking = True
        try:
            return self._lines.get()
        finally:
            self._asking = False
            self._page.send({"paused": ""})

    def _read(self) -> None:
        with contextlib.suppress(OSError, ValueError):
            for line in self._source:
                self._lines.put(line)

    def _hear(self, said: dict[str, str]) -> None:
        """What the page's buttons say."""
        assert self._debugger is not None
        if "break" in said:
            with contextlib.suppress(UserError):
                self._debugger.break_at(said["break"])
        elif "pause" in said:
            self._debugger.pause()
        elif self._asking:  # of a page that is behind: there is no question
            self._lines.put(said.get("line", "") + "\n")
