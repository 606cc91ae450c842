"""Events for a page: only changes since the last event, sent to each visitor at its own pace."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Callable
from typing import Any

from starlette.responses import StreamingResponse

EVERY_S = 0.2  # Our choice: an eye asks for no more
_ALIVE_S = 10.0  # after so long without news a comment is sent: only so is a visitor noticed who has gone


class Feed:
    """Wakes visitors when there is news.

    Nothing is queued for a visitor: each asks for what came after what it has, when it has sent that. So one who is
    slow costs no memory, and no one else any time.

    Attributes:
        visitors: How many are there.
    """

    def __init__(self) -> None:
        self.visitors = 0
        self.closing = False
        self._news = asyncio.Event()

    def tell(self) -> None:
        """There is news."""
        self._news.set()
        self._news = asyncio.Event()

    def close(self) -> None:
        """Let visitors go once they have been told everything."""
        self.closing = True
        self.tell()

    def response(self, since: str, news: Callable[[str], tuple[str, dict[str, Any]]]) -> StreamingResponse:
        """Server-sent events.

        Args:
            since: What the visitor has, as `news` calls it.
            news: Given what a visitor has, what it has after this, and what is new; nothing: {}.
        """
        return StreamingResponse(self._events(since, news), media_type="text/event-stream")

    async def _events(self, since: str, news: Callable[[str], tuple[str, dict[str, Any]]]) -> AsyncIterator[str]:
        self.visitors += 1
        try:
            yield "retry: 1000\n\n"
            while True:
                wake = self._news
                closing = self.closing
                since, data = news(since)
                if data:
                    yield f"id: {since}\ndata: {json.dumps(data, allow_nan=False, separators=(',', ':'))}\n\n"
                    if "reload" in data:
                        return
                    await asyncio.sleep(EVERY_S)
                    continue
                if closing:
                    yield "event: closed\ndata: {}\n\n"
                    return
                try:
                    await asyncio.wait_for(wake.wait(), _ALIVE_S)
                except TimeoutError:
                    yield ": nothing new\n\n"
        finally:
            self.visitors -= 1
