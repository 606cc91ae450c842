"""A watched suite: the contents of its folder, read again after changes."""

from __future__ import annotations

import asyncio
import json
import threading
from pathlib import Path
from typing import Any

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response, StreamingResponse
from starlette.routing import Mount, Route
from starlette.types import ASGIApp, Receive, Scope, Send

from mpvi_bt.apps.watch.feed import Feed
from mpvi_bt.apps.watch.page_requests import page_response
from mpvi_bt.apps.watch.watched_run import WatchedRun, file, waiting
from mpvi_bt.executive.trace.html import embedded, filled, page_style
from mpvi_bt.ground.errors import MpviError
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.report.data import report_data
from mpvi_bt.runs.report.suite_folders import SuiteFolder
from mpvi_bt.runs.report.suite_report import SuiteReport
from mpvi_bt.runs.suite.manifest import FILE, read_manifest
from mpvi_bt.runs.suite.standing import spoken, under_way
from mpvi_bt.runs.suite.store import Store

_EVERY_S = 1.0  # the folder is looked at
_FAILURES = 200  # shown, the last


class WatchedSuite:
    """Implements `Watching` of the folder of a suite's results, which may be empty yet.

    The figures are those of `mpvi suite report --json`, made by the same code. They are read by a thread, and only
    while somebody watches.
    """

    def __init__(self, folder: Path) -> None:
        self.feed = Feed()
        self._folder, self._store = folder, Store(folder)
        self._runs: dict[tuple[str, str], WatchedRun] = {}
        self._data: dict[str, Any] = {}
        self._seen: tuple[list[tuple[str, int]], bool] | None = None
        self._version, self._over = 0, False
        self._one = threading.Lock()  # who reads: the page, the feed and the end of the run ask for it side by side
        self._reading: asyncio.Task[None] | None = None
        self.app: ASGIApp = Starlette(
            routes=[
                Route("/", self.page),
                Route("/events", self.events),
                Mount("/run/{method}/{name}", self.run),
            ]
        )

    async def page(self, request: Request) -> Response:
        """The page as the suite stands now."""
        await asyncio.to_thread(self._read)
        if not self._data:
            return page_response(waiting(self._folder.name, "waiting for the first episode"))
        return page_response(suite_page({"since": str(self._version), **self._data}))

    async def events(self, request: Request) -> StreamingResponse:
        """The whole again whenever anything has changed."""
        since = request.headers.get("last-event-id") or request.query_params.get("since", "")
        if self._reading is None or self._reading.done():
            self._reading = asyncio.create_task(self._keep_reading())
        return self.feed.response(since, self._news)

    async def run(self, scope: Scope, receive: Receive, send: Send) -> None:
        """The page of one episode's trace, and what belongs to it."""
        asked = scope["path_params"]
        key = "" if asked["method"] == "-" else asked["method"], asked["name"]
        if key not in self._runs and (config := self._episodes().get(key)) is not None:
            self._runs[key] = WatchedRun(self._store.folder(config) / "traces" / f"{config.name}.jsonl")
        found = self._runs.get(key)
        answer = PlainTextResponse("no such episode\n", 404) if found is None else found.app
        await answer(scope, receive, send)

    def take(self, words: dict[str, Any]) -> None:
        """A suite says nothing but in its folder."""

    def settled(self) -> bool:
        """Nothing is asked of it."""
        return False

    def close(self) -> None:
        """The run of the suite is over."""
        self._over = True
        self._read()
        for run in self._runs.values():
            run.close()
        self.feed.close()

    def _news(self, since: str) -> tuple[str, dict[str, Any]]:
        now = str(self._version)
        return now, self._data if now != since else {}

    async def _keep_reading(self) -> None:
        while True:
            if await asyncio.to_thread(self._read):
                self.feed.tell()
            await asyncio.sleep(_EVERY_S)
            if not self.feed.visitors:
                return

    def _episodes(self) -> dict[tuple[str, str], EpisodeConfig]:
        manifest = read_manifest(self._folder)
        return {(c.method or "", c.name): c for c in manifest.episodes()} if manifest else {}

    def _read(self) -> bool:
        """Read the folder, if it has changed; whether it has."""
        with self._one:
            running = self._store.running() and not self._over
            files = sorted(self._folder.glob("**/json/*.json")) + sorted(self._folder.glob("**/faults/*.json"))
            seen = [(str(path), path.stat().st_mtime_ns) for path in [*files, self._folder / FILE] if path.exists()]
            if (seen, running) == self._seen and not running:
                return False
            try:
                manifest = read_manifest(self._folder)
                if manifest is None:
                    return False
                if self._seen is None or seen != self._seen[0]:
                    part = SuiteFolder.of(self._store, manifest)
                    self._part, self._figures = part, _figures(part)
                self._data = _stand(self._part, running) | self._figures
            except MpviError as error:
                self._data = {**self._data, "problem": str(error)} if self._data else {}
            self._seen = (seen, running)
            self._version += 1
            return True


def _figures(part: SuiteFolder) -> dict[str, Any]:
    """Figures as the report has them."""
    if not part.results:
        return {"methods": [], "level": 0.95}
    told = SuiteReport.of([part])
    figures = json.loads(json.dumps(report_data(told.figures, told.runs)["figures"], allow_nan=False))
    return {"methods": [_method(method) for method in figures["methods"]], "level": figures["level"]}


def _method(figures: dict[str, Any]) -> dict[str, Any]:
    """What the page shows of a method's figures."""
    return {
        "name": figures["name"],
        "overall": _group(figures["overall"]),
        "tasks": {task: _group(group) for task, group in figures["tasks"].items()},
    }


def _group(group: dict[str, Any]) -> dict[str, Any]:
    counts = {key: group[key] for key in ("episodes", "finished", "successes")}
    return counts | {"q": group["measures"]["q_score"]}


def _stand(part: SuiteFolder, running: bool) -> dict[str, Any]:
    """Progress of a suite: done, broken and running episodes, and failures."""
    works, left_s = under_way(part.store, part.episodes, part.results) if running else ([], None)
    done = list(part.results.values())
    links = {spoken(config): f"run/{config.method or '-'}/{config.name}/" for config in part.episodes}
    failed = [(config, result) for config, result in part.results.items() if not result.success]
    return {
        "suite": part.suite,
        "folder": str(part.store.out),
        "running": running,
        "total": len(part.episodes),
        "done": len(done),
        "succeeded": sum(result.success for result in done),
        "mean_q": sum(result.q for result in done) / len(done) if done else None,
        "left_s": left_s,
        "at_work": [work | {"link": links[work["episode"]]} for work in works],
        "broke": [
            {"episode": spoken(config), "kind": fault.kind, "message": fault.message}
            for config, fault in part.faults.items()
        ],
        "failures": [
            {
                "episode": spoken(config),
                "link": links[spoken(config)],
                "q": result.q,
                "why": "; ".join(f"{f.node.rpartition('/')[2]}: {f.reason}" for f in result.failures) or result.ended,
            }
            for config, result in failed[-_FAILURES:]
        ],
        "problem": "",
    }


def suite_page(data: dict[str, Any]) -> str:
    """The page, with how the suite stands in it."""
    script, style = file("suite.js"), "\n".join((page_style(), file("suite.css")))
    return filled(file("suite.html"), data["suite"], script, style, "connect-src 'self'", embedded(data))
