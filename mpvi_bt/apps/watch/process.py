"""The process that serves the page of a run: `python -m mpvi_bt.apps.watch.process LISTENER CHANNEL`.

Both are file descriptors. It begins with a line on the channel that says what to serve, and ends when the channel does.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import socket
import sys
from collections.abc import Callable
from pathlib import Path

from mpvi_bt.apps.watch.feed import EVERY_S
from mpvi_bt.apps.watch.page_server import Server
from mpvi_bt.apps.watch.watched import Watching, watched

NICE = 5  # Our choice: where cores are few, the run goes first
_LINE_BYTES = 1 << 22
_LAST_S = 1.5  # for visitors to be told the end


async def main(listener: int, channel: int) -> None:
    """Serve until the channel ends."""
    reader, writer = await asyncio.open_connection(sock=socket.socket(fileno=channel), limit=_LINE_BYTES)
    if not (first := await reader.readline()):
        return
    begun = json.loads(first)

    def tell(words: dict[str, str | bool]) -> None:
        writer.write(json.dumps(words).encode() + b"\n")

    watching = watched(Path(begun["what"]), tell, begun["says"])
    server = Server(watching.app, socket.socket(fileno=listener), begun["token"])
    serving = asyncio.create_task(server.serve())
    wanting = asyncio.create_task(_want(watching, tell))
    with contextlib.suppress(ConnectionError):
        while line := await reader.readline():
            watching.take(json.loads(line))
    wanting.cancel()
    watching.close()
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(_LAST_S):
            while watching.feed.visitors:
                await asyncio.sleep(0.02)
    server.stop()
    await serving


async def _want(watching: Watching, tell: Callable[[dict[str, str | bool]], None]) -> None:
    """Ask the run for pictures whenever somebody watches and the last ones are here."""
    while True:
        await asyncio.sleep(EVERY_S)
        if watching.feed.visitors and watching.settled():
            tell({"want": True})


if __name__ == "__main__":
    os.nice(NICE)
    asyncio.run(main(int(sys.argv[1]), int(sys.argv[2])))
