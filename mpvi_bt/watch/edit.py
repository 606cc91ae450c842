"""A tree that is edited: its text, its problems as it changes on disk or on the page, and a dry run of it."""

from __future__ import annotations

import asyncio
import hashlib
import json
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, PlainTextResponse, Response, StreamingResponse
from starlette.routing import Route
from starlette.types import ASGIApp

from mpvi_bt.authoring.checking import problems_in
from mpvi_bt.errors import MpviError, Problem, UserError
from mpvi_bt.executive.dry import dry_tree, run_dry
from mpvi_bt.plan.skills import load_skills
from mpvi_bt.recording.recorder import Recorder
from mpvi_bt.trace.html import asset, digest, embedded, filled, trace_page, tree_page
from mpvi_bt.trace.read import read_trace
from mpvi_bt.tree.spec import TreeSpec
from mpvi_bt.tree.yaml_io import parse_tree
from mpvi_bt.watch.feed import Feed
from mpvi_bt.watch.run import body, file
from mpvi_bt.writing import write_whole

_LOOK_S = 0.05  # between two looks at the file: a fraction of the 0.3 s in which its problems are to be shown
_DRY_S, _DRY_WALL_S = 600.0, 3.0  # simulated and wall time that a dry run may take. Our choice
_MOST_BYTES = 2_000_000


class Edited:
    """Implements `Watching` of a tree's file."""

    def __init__(self, path: Path) -> None:
        """Read it. Raises UserError if that is impossible."""
        self.feed = Feed()
        self._path = path
        self._version = 0
        self._problems: list[Problem] = []
        self._pages: dict[int, str] = {}
        self._looking: asyncio.Task[None] | None = None
        self._stamp: object = None
        self._text = ""
        self._look()
        self.app: ASGIApp = Starlette(
            routes=[
                Route("/", self.page),
                Route("/events", self.events),
                Route("/drawing", self.drawing),
                Route("/text", self.save, methods=["POST"]),
            ]
        )

    async def page(self, request: Request) -> Response:
        """Text, problems and drawing."""
        self._look()
        return HTMLResponse(edit_page(self._path.name, self._data()))

    async def events(self, request: Request) -> StreamingResponse:
        """Text and problems whenever the file has changed."""
        since = request.headers.get("last-event-id") or request.query_params.get("since", "")
        if self._looking is None or self._looking.done():
            self._looking = asyncio.create_task(self._keep_looking())
        return self.feed.response(since, self._news)

    async def drawing(self, request: Request) -> Response:
        """The page of a dry run of the text as it is now, or of its tree alone where it cannot be run."""
        version = self._version
        if version not in self._pages:
            page = await asyncio.to_thread(_drawn, self._text, self._path, lambda: version != self._version)
            self._pages = {version: page}
        return HTMLResponse(self._pages[version])

    async def save(self, request: Request) -> Response:
        """Take over the page's text, unless the file has changed meanwhile."""
        try:
            said = json.loads(await body(request, _MOST_BYTES))
            text, base = said["text"], said["base"]
            if not isinstance(text, str):
                raise ValueError
        except (ValueError, TypeError, KeyError):
            return PlainTextResponse('wanted: {"text": TEXT, "base": DIGEST}\n', 400)
        self._look()
        if base != _digest(self._text):
            return PlainTextResponse("the file has changed on disk since\n", 409)
        try:
            write_whole(self._path, text)
        except MpviError as error:
            return PlainTextResponse(f"{error}\n", 409)
        self._look()
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

    def _data(self) -> dict[str, Any]:
        problems = [
            {"line": p.line, "column": p.column, "code": p.code, "severity": p.severity, "message": p.message,
             "file": "" if p.file == str(self._path) else p.file}
            for p in self._problems
        ]  # fmt: skip
        return {"since": str(self._version), "text": self._text, "base": _digest(self._text), "problems": problems}

    def _news(self, since: str) -> tuple[str, dict[str, Any]]:
        now = str(self._version)
        return now, self._data() if now != since else {}

    async def _keep_looking(self) -> None:
        while True:
            if await asyncio.to_thread(self._look):
                self.feed.tell()
            await asyncio.sleep(_LOOK_S)
            if not self.feed.visitors:
                return

    def _look(self) -> bool:
        """Read and check the file if it has changed; whether it has. The first time it raises UserError."""
        try:
            stat = self._path.stat()
            if (stamp := (stat.st_mtime_ns, stat.st_size, stat.st_ino)) == self._stamp:
                return False
            text = self._path.read_text(encoding="utf-8")
        except (OSError, UnicodeError) as error:
            if self._stamp is None:
                raise UserError(f"{self._path}: cannot be read: {error}") from None
            return False  # an editor is about to write it anew
        self._stamp, self._text = stamp, text
        self._problems = problems_in(str(self._path), text=text)
        self._version += 1
        return True


def _drawn(text: str, path: Path, outdated: Callable[[], bool]) -> str:
    """A dry run as a page; the tree where it has parameters without a value; a sentence where it is none."""
    try:
        spec = parse_tree(text, str(path), load_skills())
    except MpviError:
        return _sentence("There is no drawing while the tree has errors.")
    try:
        return _dry_page(spec, outdated)
    except MpviError:
        return tree_page(spec)


def _dry_page(spec: TreeSpec, outdated: Callable[[], bool]) -> str:
    end = time.monotonic() + _DRY_WALL_S
    with tempfile.TemporaryDirectory() as folder:
        trace = Path(folder, "dry.trace.jsonl")
        run_dry(
            dry_tree(spec), load_skills(), [Recorder(trace)], _DRY_S,
            stop=lambda: outdated() or time.monotonic() > end,
        )  # fmt: skip
        return trace_page(read_trace(trace))


def _sentence(text: str) -> str:
    style = asset("page.css")
    policy = f"default-src 'none'; style-src '{digest(style)}'"
    head = f'<!doctype html><meta charset="utf-8"><meta http-equiv="Content-Security-Policy" content="{policy}">'
    return f"{head}<style>{style}</style><header><p>{text}</p></header>"


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def edit_page(name: str, data: dict[str, Any]) -> str:
    """The page, with the text as it is now."""
    script, style = file("edit.js"), "\n".join((asset("page.css"), file("edit.css")))
    allows = "connect-src 'self'; frame-src 'self'"
    return filled(file("edit.html"), name, script, style, allows, embedded({"name": name, **data}))
