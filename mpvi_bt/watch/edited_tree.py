"""A tree that is edited: its text, its problems as it changes on disk or on the page, and a dry run of it."""

from __future__ import annotations

import asyncio
import hashlib
import json
from pathlib import Path
from typing import Any

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, PlainTextResponse, Response, StreamingResponse
from starlette.routing import Route
from starlette.types import ASGIApp

from mpvi_bt.authoring.checking import problems_in
from mpvi_bt.errors import MpviError, Problem, UserError
from mpvi_bt.trace.html import asset, embedded, filled
from mpvi_bt.watch.drawer import Drawer, sentence
from mpvi_bt.watch.feed import Feed
from mpvi_bt.watch.watched_run import body, file
from mpvi_bt.writing import write_whole

_LOOK_S = 0.02  # between two looks at the file: a fraction of the 0.3 s in which its problems are to be shown
_MOST_BYTES = 2_000_000


class Edited:
    """Implements `Watching` of a tree's file."""

    def __init__(self, path: Path) -> None:
        """Read it. Raises UserError if that is impossible."""
        self.feed = Feed()
        self._path = path
        self._version = 1
        self._stamp: tuple[int, int, int] | None = None
        self._text = self._new() or ""
        self._problems = self._found(self._text)
        self._checking = asyncio.Lock()
        self._looking: asyncio.Task[None] | None = None
        self._drawer = Drawer(path)
        self._drawing = asyncio.Lock()
        self._drawn: tuple[int, str] = 0, ""
        self.app: ASGIApp = Starlette(
            routes=[
                Route("/", self.page),
                Route("/events", self.events),
                Route("/drawing", self.drawing),
                Route("/check", self.check, methods=["POST"]),
                Route("/text", self.save, methods=["POST"]),
            ]
        )

    async def page(self, request: Request) -> Response:
        """Text, problems and drawing."""
        await self._look()
        return HTMLResponse(edit_page(self._path.name, self._data()))

    async def events(self, request: Request) -> StreamingResponse:
        """Text and problems whenever the file has changed."""
        since = request.headers.get("last-event-id") or request.query_params.get("since", "")
        if self._looking is None or self._looking.done():
            self._looking = asyncio.create_task(self._keep_looking())
        return self.feed.response(since, self._news)

    async def drawing(self, request: Request) -> Response:
        """The page of a dry run of the text as it is now, or of its tree alone where it cannot be run."""
        async with self._drawing:
            await self._look()  # while a new text is checked, a drawing of the old one is wanted by nobody
            version = self._version
            if version != self._drawn[0] and not self.feed.closing:
                page = await asyncio.to_thread(self._drawer.draw, self._text)
                if page is None:
                    return HTMLResponse(sentence("There is no drawing of this text."))
                self._drawn = version, page
            return HTMLResponse(self._drawn[1])

    async def check(self, request: Request) -> Response:
        """The problems of a text that is typed and not saved."""
        said = await _said(request)
        if said is None:
            return PlainTextResponse('wanted: {"text": TEXT}\n', 400)
        return JSONResponse(self._told(await asyncio.to_thread(self._found, said["text"])))

    async def save(self, request: Request) -> Response:
        """Take over the page's text, unless the file has changed meanwhile."""
        said = await _said(request)
        if said is None or "base" not in said:
            return PlainTextResponse('wanted: {"text": TEXT, "base": DIGEST}\n', 400)
        await self._look()
        if said["base"] != _digest(self._text):
            return PlainTextResponse("the file has changed on disk since\n", 409)
        try:
            write_whole(self._path, said["text"])
        except MpviError as error:
            return PlainTextResponse(f"{error}\n", 409)
        await self._look()
        self.feed.tell()
        return JSONResponse(self._data())

    def take(self, words: dict[str, Any]) -> None:
        """Nobody says anything."""

    def settled(self) -> bool:
        """Nothing is asked of anyone."""
        return False

    def close(self) -> None:
        """Let visitors go."""
        self.feed.close()
        self._drawer.close()

    def _data(self) -> dict[str, Any]:
        told = self._told(self._problems)
        return {"since": str(self._version), "text": self._text, "base": _digest(self._text), "problems": told}

    def _told(self, problems: list[Problem]) -> list[dict[str, Any]]:
        return [
            {"line": p.line, "column": p.column, "code": p.code, "severity": p.severity, "message": p.message,
             "file": "" if p.file == str(self._path) else p.file}
            for p in problems
        ]  # fmt: skip

    def _news(self, since: str) -> tuple[str, dict[str, Any]]:
        now = str(self._version)
        return now, self._data() if now != since else {}

    async def _keep_looking(self) -> None:
        while True:
            if self._stamp_now() not in (None, self._stamp):
                await asyncio.sleep(_LOOK_S)  # for its writer: many empty a file before they write it
                if await self._look():
                    self.feed.tell()
            await asyncio.sleep(_LOOK_S)
            if not self.feed.visitors:
                return

    async def _look(self) -> bool:
        """Read and check the file if it has changed; whether it has."""
        async with self._checking:
            text = self._new()
            if text is None:
                return False
            self._drawer.stop()  # of what is not there any more
            problems = await asyncio.to_thread(self._found, text)
            self._text, self._problems, self._version = text, problems, self._version + 1
            return True

    def _found(self, text: str) -> list[Problem]:
        return problems_in(str(self._path), text=text)

    def _new(self) -> str | None:
        """The file's text if it has changed. The first time it raises UserError if it cannot be read."""
        if (stamp := self._stamp_now()) is not None and stamp == self._stamp:
            return None
        try:
            text = self._path.read_text(encoding="utf-8")
        except (OSError, UnicodeError) as error:
            if self._stamp is None:
                raise UserError(f"{self._path}: cannot be read: {error}") from None
            return None  # an editor is about to write it anew
        self._stamp = stamp
        return text

    def _stamp_now(self) -> tuple[int, int, int] | None:
        """What changes when the file does; None while it is not there."""
        try:
            stat = self._path.stat()
        except OSError:
            return None
        return stat.st_mtime_ns, stat.st_size, stat.st_ino


async def _said(request: Request) -> dict[str, Any] | None:
    """What a page sent, its text checked to be one; None if it is none."""
    try:
        said = json.loads(await body(request, _MOST_BYTES))
    except ValueError:
        return None
    return said if isinstance(said, dict) and isinstance(said.get("text"), str) else None


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def edit_page(name: str, data: dict[str, Any]) -> str:
    """The page, with the text as it is now."""
    script, style = file("edit.js"), "\n".join((asset("page.css"), file("edit.css")))
    allows = "connect-src 'self'; frame-src 'self'"
    return filled(file("edit.html"), name, script, style, allows, embedded({"name": name, **data}))
