"""The server of a page: uvicorn on a socket that is open already."""

from __future__ import annotations

import logging
import socket
from collections.abc import Callable

import uvicorn
from starlette.types import ASGIApp

from mpvi_bt.apps.watch.guard import PageGuard

_GRACE_S = 1  # for answers that are under way when it stops


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
