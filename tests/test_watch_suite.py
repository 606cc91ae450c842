"""The page of a suite: its figures are those of the report, and it follows a run to its end."""

from __future__ import annotations

import json
import os
import re
import subprocess
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from starlette.testclient import TestClient

from mpvi_bt.apps.watch import watched_suite
from mpvi_bt.apps.watch.watched_suite import WatchedSuite, suite_page
from mpvi_bt.runs.suite.manifest import make_manifest
from mpvi_bt.runs.suite.standing import under_way
from mpvi_bt.runs.suite.store import Store
from tests.browser import BROWSER, browser
from tests.fake_episodes import fake_result
from tests.suite_runs import EPISODES, FAKE, ROOT
from tests.test_html import EVIL, Tags
from tests.test_watch import MPVI

SUITE = "tasks: [picking_up_trash, picking_up_toys]\ninstances: [0, 1, 2, 3, 4, 5]\n"


def environment(log: Path, sleep_s: float) -> dict[str, str]:
    """Of a suite of fake episodes."""
    return {**os.environ, "FAKE_LOG": str(log), "FAKE_SLEEP": str(sleep_s), "PYTHONPATH": str(ROOT)}


@pytest.mark.slow
def test_a_suite_is_watched_to_its_end(tmp_path: Path, log: Path) -> None:
    """Twelve episodes: what is at work is shown, then the figures of `mpvi suite report --json`."""
    if BROWSER is None:
        pytest.skip("needs Chromium")
    (tmp_path / "twelve.yaml").write_text(SUITE, encoding="utf-8")
    words = ["suite", "run", "twelve.yaml", "--episode", FAKE, "--workers", "2", "--serve=0"]
    seen = tmp_path / "seen"  # no episode ends before it is there, however slow the first page may be
    process = subprocess.Popen(
        [*MPVI, *words], cwd=tmp_path, env=environment(log, 1.0) | {"FAKE_UNTIL": str(seen)}, text=True,
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
    )  # fmt: skip
    assert process.stderr is not None
    with browser(tmp_path) as chromium:
        url = next(filter(None, (re.search(r"http://\S+", line) for line in process.stderr)))[0]
        tab = chromium.tab(url)
        tab.until("document.querySelectorAll('#at-work td').length > 0", 120)
        seen.touch()
        tab.until("document.querySelector('#standing')?.textContent.startsWith('12 of 12')", 120)
        tab.until("document.querySelector('#connection').textContent.includes('server is gone')")
        process.wait(30)
        table = tab.text("#scores")
        failed = tab.text("#failures")
    told = subprocess.run(
        [*MPVI, "suite", "report", "twelve.yaml", "--json"], cwd=tmp_path, env=environment(log, 0), capture_output=True,
        text=True, check=True,
    )  # fmt: skip
    (method,) = json.loads(told.stdout)["figures"]["methods"]
    for group in (*method["tasks"].values(), method["overall"]):
        q = group["measures"]["q_score"]
        assert f"{q['mean']:.3f} [{q['low']:.3f}, {q['high']:.3f}] {group['finished']}/{group['episodes']}" in table
    assert failed.count("q 0.500") == 6


@pytest.mark.slow
def test_one_episode_is_drawn_without_an_interval(tmp_path: Path) -> None:
    """Of a single episode the reports know no interval; of a task that has not begun, no mean either."""
    if BROWSER is None:
        pytest.skip("needs Chromium")
    q = {"mean": 0.5, "low": None, "high": None}
    group = {"episodes": 2, "finished": 1, "successes": 0, "q": q}
    tasks = {"begun": group, "waiting": {**group, "finished": 0, "q": None}}
    data = {
        "suite": "s", "folder": "s", "running": True, "total": 4, "done": 1, "succeeded": 0, "mean_q": 0.5,
        "left_s": None, "at_work": [], "broke": [], "problem": "", "since": "1", "level": 0.95, "failures": [],
        "methods": [{"name": "mpvi", "overall": {**group, "episodes": 4}, "tasks": tasks}],
    }  # fmt: skip
    page = tmp_path / "page.html"
    page.write_text(suite_page(data), encoding="utf-8")
    with browser(tmp_path) as chromium:
        tab = chromium.tab(page.as_uri())
        tab.until("document.readyState === 'complete'")
        rows = [line.split("\t") for line in tab.text("#scores").splitlines() if "\t" in line]
    assert rows[1:] == [["begun", "0.500 1/2"], ["waiting", "\N{EN DASH} 0/2"], ["all", "0.500 1/4"]]


def test_the_last_result_is_shown_though_it_came_while_the_folder_was_read(
    tmp_path: Path, log: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A reading that began before the run was over never takes the place of the one that the end of the run made."""
    store = Store(tmp_path)
    make_manifest("trash10", EPISODES).claim(tmp_path)
    for config in EPISODES[:-1]:
        store.write(config, fake_result(config))
    suite, reading, over = WatchedSuite(tmp_path), threading.Event(), threading.Event()

    def slow(*which: Any) -> tuple[list[dict[str, Any]], tuple[float, float] | None]:
        told = under_way(*which)
        reading.set()
        over.wait(1)  # longer than the end of the run takes, if it does not wait
        return told

    monkeypatch.setattr(watched_suite, "under_way", slow)
    client = TestClient(suite.app)
    with store.locked(), ThreadPoolExecutor() as pool:
        page = pool.submit(client.get, "/")
        assert reading.wait(60)
        store.write(EPISODES[-1], fake_result(EPISODES[-1]))
        suite.close()
        over.set()
        assert page.result(60).status_code == 200
    first = next(line for line in client.get("/events?since=").text.splitlines() if line.startswith("data: "))
    told = json.loads(first.removeprefix("data: "))
    assert (told["done"], len(told["failures"]), told["running"]) == (10, 5, False)


def test_only_episodes_of_the_suite_are_shown(tmp_path: Path) -> None:
    """A trace is found by the name of an episode of the suite, never by a path."""
    client = TestClient(WatchedSuite(tmp_path).app)
    for path in ("/run/-/../../etc/passwd/", "/run/-/..%2f..%2fetc/", "/run/x/picking_up_trash_0_0/"):
        assert client.get(path).status_code == 404


def test_hostile_names_are_text(tmp_path: Path) -> None:
    """Whatever stands in results, the page has the elements of a harmless one."""
    data = {
        "suite": EVIL, "folder": EVIL, "running": False, "total": 1, "done": 1, "succeeded": 0, "mean_q": 0.5,
        "left_s": None, "at_work": [], "broke": [], "problem": EVIL, "since": "1", "methods": [], "level": 0.95,
        "failures": [{"episode": EVIL, "link": EVIL, "q": 0.5, "why": EVIL}],
    }  # fmt: skip
    hostile, plain = Tags(suite_page(data)), Tags(suite_page({**data, "suite": "s"}))
    assert [tag for tag in hostile.tags if tag[0] != "meta"] == [tag for tag in plain.tags if tag[0] != "meta"]
    assert hostile.inside["script"][1:] == plain.inside["script"][1:]
