"""A run or a suite on a page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol

from starlette.types import ASGIApp

from mpvi_bt.apps.watch.channel import Tell
from mpvi_bt.apps.watch.feed import Feed
from mpvi_bt.apps.watch.watched_run import WatchedRun
from mpvi_bt.apps.watch.watched_suite import WatchedSuite


class Watching(Protocol):
    """What is watched: a run, or a suite.

    Attributes:
        app: Answers requests.
        feed: Of its visitors.
    """

    app: ASGIApp
    feed: Feed

    def take(self, words: dict[str, Any]) -> None:
        """What the run says beside its trace."""
        ...

    def settled(self) -> bool:
        """Whether what was asked of the run last is here."""
        ...

    def close(self) -> None:
        """It has come to its end: let visitors go once they know."""
        ...


def watched(what: Path, tell: Tell | None = None, says: Sequence[str] = ()) -> Watching:
    """A trace, or the folder of a suite.

    Args:
        what: Which.
        tell: Tells the run what the page's controls say.
        says: What they can say: of `mpvi_bt.apps.watch.channel.WORDS`.
    """
    if what.is_dir():
        return WatchedSuite(what)
    return WatchedRun(what, tell, says)
