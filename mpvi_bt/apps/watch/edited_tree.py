"""An edited tree: its text, its problems after changes on disk or on the page, and a dry run."""

from __future__ import annotations

import asyncio
import secrets
from pathlib import Path
from typing import Any

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, Response, StreamingResponse
from starlette.routing import Route
from starlette.types import ASGIApp

from mpvi_bt.apps.authoring.checking import problems_in
from mpvi_bt.apps.watch.drawer import Drawer, sentence
from mpvi_bt.apps.watch.edited_file import MOST_BYTES, FileText, Unreadable, read_file_text, save_over
from mpvi_bt.apps.watch.feed import Feed
from mpvi_bt.apps.watch.page_requests import page_response, posted
from mpvi_bt.apps.watch.proposals import proposals
from mpvi_bt.apps.watch.watched_run import file
from mpvi_bt.executive.trace.html import embedded, filled, page_style
from mpvi_bt.ground.errors import MpviError, Problem, UserError

_LOOK_S = 0.02  # between two looks at the file: a fraction of the 0.3 s in which its problems are to be shown
_MOST_SENT = 6 * MOST_BYTES  # of a text as JSON, in which a character may take six bytes


class Edited:
    """Implements `Watching` of a tree's file."""

    def __init__(self, path: Path) -> None:
        """Read it. Raises UserError if that is impossible."""
        self.feed = Feed()
        self._path = path
        self._version = 1
        self._stamp = _stamp(path)
        self._unreadable = ""  # why the file on disk is no text now; the last one that was is kept
        try:
            self._file = read_file_text(path) or FileText(b"", "")
        except Unreadable as error:
            raise UserError(f"{path}: {error}") from None
        self._problems = self._found(self._file.text)
        self._checking = asyncio.Lock()
        self._looking: asyncio.Task[None] | None = None
        self._drawer = Drawer(path)
        self._drawing = asyncio.Lock()
        self._drawn: tuple[int, str] = 0, ""
        self.app: ASGIApp = Starlette(
            routes=[
                Route("/", self.page),
                Route("/codemirror.js", self.component),
                Route("/events", self.events),
                Route("/drawing", self.drawing),
                Route("/check", self.check, methods=["POST"]),
                Route("/text", self.save, methods=["POST"]),
            ]
        )

    async def page(self, request: Request) -> Response:
        """Text, problems and drawing."""
        await self._look()
        return page_response(edit_page(self._path, self._data()))

    async def component(self, request: Request) -> Response:
        """The editor that the page's script puts to use."""
        return Response(file("codemirror.js"), media_type="text/javascript")

    async def events(self, request: Request) -> StreamingResponse:
        """Text and problems whenever the file has changed."""
        since = request.headers.get("last-event-id") or request.query_params.get("since", "")
        if self._looking is None or self._looking.done():
            self._looking = asyncio.create_task(self._keep_looking())
        return self.feed.response(since, self._news)

    async def drawing(self, request: Request) -> Response:
        """The page of a dry run of the present text, or of its tree alone if it cannot be run."""
        async with self._drawing:
            await self._look()  # while a new text is checked, a drawing of the old one is wanted by nobody
            version = self._version
            if version != self._drawn[0] and not self.feed.closing:
                page = await asyncio.to_thread(self._drawer.draw, self._file.text)
                if page is None:
                    return page_response(sentence("There is no drawing of this text."))
                self._drawn = version, page
            return page_response(self._drawn[1])

    async def check(self, request: Request) -> Response:
        """The problems of a text that is typed and not saved."""
        said = await _said(request)
        if said is None:
            return PlainTextResponse('wanted: {"text": TEXT}\n', 400)
        return JSONResponse(self._told(await asyncio.to_thread(self._found, said["text"])))

    async def save(self, request: Request) -> Response:
        """Write the page's text, unless the file has changed meanwhile."""
        said = await _said(request)
        if said is None or "base" not in said:
            return PlainTextResponse('wanted: {"text": TEXT, "base": DIGEST}\n', 400)
        try:
            if said["base"] != self._file.base:
                raise UserError("the file has changed on disk since")
            save_over(self._path, self._file, said["text"])
        except MpviError as error:
            await self._look()
            self.feed.tell()
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
        return {
            "since": str(self._version),
            "text": self._file.text,
            "base": self._file.base,
            "problems": told,
            "unreadable": self._unreadable,
        }

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
            if _stamp(self._path) not in (None, self._stamp):
                await asyncio.sleep(_LOOK_S)  # for its writer: many empty a file before they write it
                if await self._look():
                    self.feed.tell()
            await asyncio.sleep(_LOOK_S)
            if not self.feed.visitors:
                return

    async def _look(self) -> bool:
        """Read and check the file if it has changed; whether it has. One that is gone or no text changes no text."""
        async with self._checking:
            stamp = _stamp(self._path)
            if stamp in (None, self._stamp):
                return False
            self._stamp, before = stamp, (self._file.content, self._unreadable)
            try:
                found, self._unreadable = read_file_text(self._path) or self._file, ""
            except Unreadable as error:
                found, self._unreadable = self._file, f"the file on disk {error} now"
            if (found.content, self._unreadable) == before:
                return False
            if found is not self._file:
                self._drawer.stop()  # of what is not there any more
                self._problems = await asyncio.to_thread(self._found, found.text)
            self._file, self._version = found, self._version + 1
            return True

    def _found(self, text: str) -> list[Problem]:
        return problems_in(str(self._path), text=text)


def _stamp(path: Path) -> tuple[int, int, int] | None:
    """What changes when the file does; None while it is not there."""
    try:
        stat = path.stat()
    except OSError:
        return None
    return stat.st_mtime_ns, stat.st_size, stat.st_ino


async def _said(request: Request) -> dict[str, Any] | None:
    """What a page sent, its text checked to be one; None if it is none."""
    try:
        said = await posted(request, _MOST_SENT)
    except ValueError:
        return None
    return said if isinstance(said, dict) and isinstance(said.get("text"), str) else None


def edit_page(path: Path, data: dict[str, Any]) -> str:
    """The page, with the text as it is now."""
    script = "\n".join(map(file, ("completion.js", "palette.js", "edit.js")))
    style = "\n".join((page_style(), file("edit.css")))
    nonce = secrets.token_urlsafe(16)  # for the styles that CodeMirror adds
    allows = "connect-src 'self'; frame-src 'self'; img-src 'self' data:"  # CodeMirror draws its marks from such
    told = embedded({"name": path.name, "nonce": nonce, **proposals(data["text"], path), **data})
    return filled(
        file("edit.html"), path.name, script, style, allows, told, scripts="'self'", styles=f"'nonce-{nonce}'"
    )
