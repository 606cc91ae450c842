"""A watched run: its growing trace, and its pictures."""

from __future__ import annotations

import asyncio
import base64
import time
from collections.abc import Sequence
from html import escape
from importlib import resources
from pathlib import Path
from typing import Any

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response, StreamingResponse
from starlette.routing import Route
from starlette.types import ASGIApp

from mpvi_bt.apps.watch.channel import WORDS, Tell
from mpvi_bt.apps.watch.feed import EVERY_S, Feed
from mpvi_bt.apps.watch.page_requests import page_response, posted
from mpvi_bt.executive.drawing.endings import ended, is_plan
from mpvi_bt.executive.trace.growing_trace import Follow, Restarted
from mpvi_bt.executive.trace.html import More, PageFrames, page, told_end, told_facts
from mpvi_bt.ground.errors import MpviError

_ALLOWS = "connect-src 'self'; img-src 'self'"
_MOST_BYTES = 10_000  # of what a page's control says


class WatchedRun:
    """Implements `Watching` of one trace, which need not be there yet."""

    def __init__(self, path: Path, tell: Tell | None = None, says: Sequence[str] = ()) -> None:
        self.feed = Feed()
        self._path, self._tell, self._says = path, tell, tuple(says)
        self._follow: Follow | None = None
        self._pictures: dict[str, tuple[int, bytes]] = {}
        self._now: dict[str, Any] = {}
        self._paused = self._reloaded = ""
        self._paused_at = 0.0
        self._over = self._fresh = False
        self._serial = 0  # of what came beside the trace
        self._broken = ""
        self._reading: asyncio.Task[None] | None = None
        self.app: ASGIApp = Starlette(
            routes=[
                Route("/", self.page),
                Route("/events", self.events),
                Route("/picture/{name}", self.picture),
                Route("/control", self.control, methods=["POST"]),
            ]
        )

    # What a browser asks for.

    async def page(self, request: Request) -> Response:
        """The page with all that has happened so far."""
        self._read()
        if self._follow is None:
            return page_response(waiting(self._path.stem, self._broken))
        header = self._follow.header
        facts = list(told_facts(header.config, header.seed, header.started, header.mpvi_bt))
        pictures = {name: at for name, (at, _) in self._pictures.items()}
        live = {
            "since": self._since(),
            "pictures": pictures,
            "paused": self._paused,
            "paused_s": self._paused_s,
            "says": self._says,
            "reloaded": self._reloaded,
        }
        data = {**self._frames.data(), "end": self._end(), "facts": facts, "open": None, "live": live}
        return page_response(page(self._follow.tree, data, MORE))

    async def events(self, request: Request) -> StreamingResponse:
        """What happens from now on."""
        since = request.headers.get("last-event-id") or request.query_params.get("since", "")
        if self._reading is None or self._reading.done():
            self._reading = asyncio.create_task(self._keep_reading())
        return self.feed.response(since, self._news)

    async def picture(self, request: Request) -> Response:
        """The last picture of a camera, or the map."""
        found = self._pictures.get(request.path_params["name"])
        return Response(found[1], media_type="image/jpeg") if found else PlainTextResponse("no such picture\n", 404)

    async def control(self, request: Request) -> Response:
        """What a button says, to the run's debugger."""
        try:
            said = await posted(request, _MOST_BYTES)
            ((word, text),) = said.items()
            if word not in WORDS or not isinstance(text, str) or "\n" in text:
                raise ValueError
        except (ValueError, AttributeError):
            return PlainTextResponse('wanted: {"line": TEXT}, {"pause": ""}, {"break": PATH} or {"reload": ""}\n', 400)
        if self._tell is None or word not in self._says:
            why = "with a tree's file" if word == "reload" else "with --step or --break"
            return PlainTextResponse(f"the run was not started {why}\n", 409)
        self._tell({word: text})
        return Response(status_code=204)

    # What the run says.

    def take(self, words: dict[str, Any]) -> None:
        """Pictures, the time, or that it is paused."""
        self._serial += 1
        for name, data in words.get("pictures", {}).items():
            self._pictures[name] = self._serial, base64.b64decode(data)
        self._now = words.get("now", self._now)
        if "paused" in words:
            self._paused, self._paused_at = words["paused"], time.monotonic()
        self._reloaded = words.get("reloaded", self._reloaded)
        self._fresh = True
        self.feed.tell()

    def settled(self) -> bool:
        """Whether pictures came since this was asked last, or none were ever asked for."""
        settled, self._fresh = self._fresh or not self._now, False
        return settled

    def close(self) -> None:
        """The run is over."""
        self._read()
        self._over, self._paused = True, ""
        self._serial += 1
        self.feed.close()

    # What is told.

    def _since(self) -> str:
        assert self._follow is not None
        run = "".join(self._follow.header.started.split())
        return f"{run or '-'} {len(self._frames.frames)} {len(self._frames.trees)} {self._serial}"

    def _news(self, since: str) -> tuple[str, dict[str, Any]]:
        """News since `since`: run, numbers of frames, trees and the rest for a visitor."""
        if self._follow is None:
            return since, {"reload": True} if self._broken else {}
        now = self._since()
        if since == now:
            return since, {}
        try:
            run, *numbers = since.split()
            frames, trees, serial = map(int, numbers)
        except ValueError:
            return since, {"reload": True}
        if run != now.split()[0] or frames > len(self._frames.frames):
            return since, {"reload": True}
        pictures = {name: at for name, (at, _) in self._pictures.items() if at > serial}
        told = {"end": self._end(), "pictures": pictures, "paused": self._paused, "paused_s": self._paused_s}
        told |= {"reloaded": self._reloaded}
        return now, {**self._frames.data(trees, frames), **told, "over": self._over}

    def _end(self) -> dict[str, Any]:
        assert self._follow is not None
        if (end := self._follow.end) is not None:
            told = ended(end.ending, self._gave_up, is_plan(self._follow.tree), end.time_s, end.q)
            return told_end(end, told, self._gave_up)
        last = self._frames.frames[-1] if self._frames.frames else {"tick": 0, "time": 0.0}
        at = max((last["tick"], last["time"]), (self._now.get("tick", 0), self._now.get("time", 0.0)))
        if self._over:
            return {"text": "the trace breaks off here", "is": "interrupted", "tick": at[0], "time": at[1]}
        paused = bool(self._paused)
        return {
            "text": "paused" if paused else "running",
            "is": "running",
            "paused": paused,
            "tick": at[0],
            "time": at[1],
        }

    @property
    def _paused_s(self) -> float:
        """For how long it has been paused, in wall time."""
        return time.monotonic() - self._paused_at if self._paused else 0.0

    # The trace.

    async def _keep_reading(self) -> None:
        """As long as somebody watches."""
        while True:
            if self._read():
                self.feed.tell()
            await asyncio.sleep(EVERY_S)
            if not self.feed.visitors:
                return

    def _read(self) -> bool:
        """Take in what was written; whether anything was."""
        try:
            if self._follow is None:
                if not self._path.is_file():
                    return False
                self._follow = Follow(self._path)
                self._frames, self._gave_up, self._broken = PageFrames(self._follow.tree), 0, ""
            before = self._follow.end
            ticks = self._follow.new()
        except Restarted:
            self._broken, self._follow = "another run is written there now", None
            return True
        except MpviError as error:
            self._broken, self._follow = str(error), None
            return False
        self._frames.add(ticks)
        self._gave_up += sum(state.gave_up for tick in ticks for state in tick.nodes.values())
        return bool(ticks) or self._follow.end is not before


def waiting(name: str, why: str) -> str:
    """A page that asks again by itself."""
    return (
        '<!doctype html><html lang="en"><meta charset="utf-8"><meta http-equiv="refresh" content="1">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(name)}</title><p>{escape(name)}: {escape(why or 'waiting for the first tick')}</p></html>"
    )


def file(name: str) -> str:
    """A file of the pages."""
    return (resources.files("mpvi_bt.apps.watch") / "page" / name).read_text(encoding="utf-8")


MORE = More(file("live.js"), file("live.css"), _ALLOWS)
