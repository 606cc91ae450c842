"""The server of a page: uvicorn on a socket that is open already, and what it can serve."""

from __future__ import annotations

import socket
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Protocol

import uvicorn
from starlette.types import ASGIApp

from mpvi_bt.watch.feed import Feed
from mpvi_bt.watch.guard import PageGuard

_GRACE_S = 1  # for answers that are under way when it stops

Tell = Callable[[dict[str, Any]], None]


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
        says: What they can say: of `mpvi_bt.watch.channel.WORDS`.
    """
    from mpvi_bt.watch.watched_run import WatchedRun
    from mpvi_bt.watch.watched_suite import WatchedSuite

    if what.is_dir():
        return WatchedSuite(what)
    return WatchedRun(what, tell, says)


class Server:
    """Serves until it is stopped, or by Ctrl-C."""

    def __init__(
        self, app: ASGIApp, listener: socket.socket, port: int, token: str = "", lifespan: bool = False
    ) -> None:
        """Serve `app` to whom the guard lets in; `lifespan`: it has to be told when that begins and ends."""
        config = uvicorn.Config(
            PageGuard(app, port, token),
            log_level="error",
            access_log=False,
            lifespan="on" if lifespan else "off",
            ws="none",
            server_header=False,
            timeout_graceful_shutdown=_GRACE_S,
        )
        self._server, self._listener = uvicorn.Server(config), listener

    async def serve(self) -> None:
        """Until then."""
        await self._server.serve(sockets=[self._listener])

    def stop(self) -> None:
        """End it."""
        self._server.should_exit = True
