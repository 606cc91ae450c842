"""The server of a page: uvicorn on an open socket, with its routes."""

from __future__ import annotations

import logging
import socket
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Protocol

import uvicorn
from starlette.types import ASGIApp

from mpvi_bt.apps.watch.feed import Feed
from mpvi_bt.apps.watch.guard import PageGuard

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
        says: What they can say: of `mpvi_bt.apps.watch.channel.WORDS`.
    """
    from mpvi_bt.apps.watch.watched_run import WatchedRun
    from mpvi_bt.apps.watch.watched_suite import WatchedSuite

    if what.is_dir():
        return WatchedSuite(what)
    return WatchedRun(what, tell, says)


class Server:
    """Serves until it is stopped, or by Ctrl-C."""

    def __init__(
        self,
        app: ASGIApp,
        listener: socket.socket,
        token: str = "",
        lifespan: bool = False,
        stopping: Callable[[], None] = lambda: None,
    ) -> None:
        """Serve `app` to whom the guard lets in.

        Args:
            app: Answers requests.
            listener: Open already.
            token: What visitors must bring; "": nothing.
            lifespan: `app` has to be told when serving begins and ends.
            stopping: Called as soon as it is to end, so that answers under way can end by themselves.
        """
        config = uvicorn.Config(
            PageGuard(app, token),
            log_level="error",
            access_log=False,
            lifespan="on" if lifespan else "off",
            ws="none",
            server_header=False,
            timeout_graceful_shutdown=_GRACE_S,
        )
        self._server, self._listener = _EndingServer(config, stopping), listener

    async def serve(self) -> None:
        """Until then."""
        await self._server.serve(sockets=[self._listener])

    def stop(self) -> None:
        """End it."""
        self._server.should_exit = True


class _EndingServer(uvicorn.Server):
    """A server that announces its stop. Open requests, such as event streams, are then cut without an error."""

    def __init__(self, config: uvicorn.Config, stopping: Callable[[], None]) -> None:
        super().__init__(config)
        self._stopping = stopping

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """End within the time of grace."""
        logging.getLogger("uvicorn.error").setLevel(logging.CRITICAL)
        self._stopping()
        await super().shutdown(sockets)
