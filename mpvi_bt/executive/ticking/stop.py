"""Asks a run to end between two ticks, where it can be saved."""

from __future__ import annotations

import signal
import threading
from types import FrameType, TracebackType
from typing import Any


class Stop:
    """Whether a run is asked to end before its next tick; as a context manager, by Ctrl-C.

    The first Ctrl-C asks, so that nothing is cut off in the middle; a second one raises KeyboardInterrupt at once.

    Attributes:
        requested: Whether that was asked.
    """

    requested = False

    def __enter__(self) -> Stop:
        """Take Ctrl-C over, which only the main thread can."""
        self._before: Any = None
        if threading.current_thread() is threading.main_thread():
            self._before = signal.signal(signal.SIGINT, self._ask)
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        """Give it back."""
        if self._before is not None:
            signal.signal(signal.SIGINT, self._before)

    def __call__(self) -> bool:
        """Whether to end now; the loop asks before every tick."""
        return self.requested

    def request(self) -> None:
        """Ask for it, as the first Ctrl-C does."""
        self.requested = True

    def _ask(self, number: int, frame: FrameType | None) -> None:
        if self.requested:
            raise KeyboardInterrupt
        self.requested = True
