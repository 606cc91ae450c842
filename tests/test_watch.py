"""The live page of a run: what it is fed, who may ask, and how it does in Chromium."""

from __future__ import annotations

import json
import os
import re
import signal
import socket
import subprocess
import sys
import tempfile
import time
import urllib.parse
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from starlette.testclient import TestClient

from mpvi_bt.apps.cli import INTERRUPTED
from mpvi_bt.apps.watch.address import Address
from mpvi_bt.apps.watch.channel import DEBUGGING
from mpvi_bt.apps.watch.guard import PageGuard
from mpvi_bt.apps.watch.watched_run import WatchedRun
from mpvi_bt.executive.trace.growing_trace import Follow, Restarted
from mpvi_bt.executive.trace.read import Trace
from mpvi_bt.executive.tree.yaml_io import expanded
from mpvi_bt.ground.errors import UserError
from tests.browser import BROWSER, Browser, browser
from tests.test_html import Tags, hostile_lines, traces

TREE = """\
tree: slow
root:
  sequence: all of it
  memory: true
  children:
    - wait: 1
    - retry: 2
      child:
        sequence: two steps
        memory: true
        children:
          - wait: 2
          - fail: nothing_there
"""


@pytest.mark.parametrize(
    ("text", "host", "port"), [("", "127.0.0.1", 0), ("81", "127.0.0.1", 81), ("0.0.0.0:82", "0.0.0.0", 82)]
)
def test_an_address_is_a_port_or_host_and_port(text: str, host: str, port: int) -> None:
    """This machine alone unless a host is given."""
    assert Address.parse(text) == Address(host, port)


@pytest.mark.parametrize("text", ["eighty", "70000", ":80", "host:", "picking_up_trash"])
def test_what_is_no_address_is_named(text: str) -> None:
    """With what would be one."""
    with pytest.raises(UserError, match=re.escape(repr(text))):
        Address.parse(text)


def test_a_port_in_use_names_the_next_free_one() -> None:
    """Where it was asked for; without a port the next free one is taken."""
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(UserError, match=f"port {port} is in use; the next free one is (\\d+)"):
            Address(port=port).bound()


def test_other_machines_need_the_token() -> None:
    """A port that they can reach has one, which the address printed brings; the cookie does from then on."""
    bound = Address("0.0.0.0", 0).bound()
    bound.listener.close()
    assert bound.token
    client = TestClient(PageGuard(WatchedRun(Path("none")).app, bound.token), base_url=f"http://robot:{bound.port}")
    assert client.get("/").status_code == 403
    assert client.get("/?token=wrong").status_code == 403
    assert client.get("/", headers={"authorization": f"Bearer {bound.token}"}).status_code == 200
    assert client.get(f"/?token={bound.token}", headers={"accept": "text/html"}).url.query == b""
    assert client.get("/").status_code == 200


@pytest.mark.parametrize("path", ["/../pyproject.toml", "/picture/..%2fpyproject.toml", "/page/live.js", "/etc/passwd"])
def test_no_file_is_served(path: str) -> None:
    """Nothing is looked up by the name of a path: there is the page, its events, its pictures."""
    assert TestClient(WatchedRun(Path("none")).app).get(path).status_code == 404


@st.composite
def written_traces(draw: st.DrawFn) -> tuple[bytes, Trace]:
    """A trace with the bytes of its file."""
    trace = draw(traces())
    lines = [*trace.ticks._lines]
    header = json.dumps({"trace": 1, "mpvi_bt": "0", "tree": expanded(trace.tree)}).encode() + b"\n"
    end = [] if trace.end is None else [
        json.dumps({"end": "success", "tick": trace.end.tick, "time_s": trace.end.time_s}).encode() + b"\n"
    ]  # fmt: skip
    return header + b"".join(lines) + b"".join(end), trace


@given(trace=written_traces(), cuts=st.lists(st.integers(0, 5000), max_size=6))
@settings(max_examples=30)
def test_a_trace_is_followed_as_it_grows(trace: tuple[bytes, Trace], cuts: list[int]) -> None:
    """However its bytes arrive, the ticks told are those of the whole file, each once."""
    data, whole = trace
    first = data.index(b"\n") + 1
    with tempfile.NamedTemporaryFile() as file:
        file.write(data[:first])
        file.flush()
        follow = Follow(Path(file.name))
        told = follow.new()
        for low, high in zip([first, *sorted(first + c for c in cuts)], [*sorted(first + c for c in cuts), len(data)]):  # noqa: B905
            file.write(data[low:high])
            file.flush()
            told += follow.new()
        assert told == list(whole.ticks)
        assert follow.end == whole.end
        file.truncate(first - 1)
        with pytest.raises(Restarted):
            follow.new()
        follow.close()


def events(client: TestClient, since: str) -> Iterator[dict[str, Any]]:
    """What a visitor is told until the run is over."""
    with client.stream("GET", "/events", params={"since": since}) as answer:
        for line in answer.iter_lines():
            if line.startswith("data: {") and line != "data: {}":
                yield json.loads(line[6:])


def test_a_late_visitor_sees_all(tmp_path: Path) -> None:
    """The page brings what happened before, the events what comes after: together every frame, once."""
    file, whole = tmp_path / "t.jsonl", run_of(tmp_path)
    lines = whole.read_bytes().splitlines(keepends=True)
    file.write_bytes(b"".join(lines[:4]))
    watched = WatchedRun(file)
    client = TestClient(watched.app)
    assert "waiting" not in client.get("/").text
    before = Tags(client.get("/").text).data
    file.write_bytes(b"".join(lines))
    watched.close()
    news = list(events(client, before["live"]["since"]))
    frames = before["frames"] + [frame for told in news for frame in told["frames"]]
    assert frames == Tags(client.get("/").text).data["frames"]
    assert len(frames) == len(lines) - 2
    assert news[-1]["end"]["is"] == "failure"
    assert news[-1]["over"]


def run_of(folder: Path) -> Path:
    """The trace of a dry run of `TREE`."""
    (folder / "slow.yaml").write_text(TREE, encoding="utf-8")
    subprocess.run(
        [*MPVI, "run", "--dry", "--tree", "slow.yaml", "--no-watch"], cwd=folder, check=False, capture_output=True
    )
    return folder / "runs" / "slow_dry.trace.jsonl"


def test_another_run_in_the_same_file_reloads_the_page(tmp_path: Path) -> None:
    """What a visitor has of a run is not mixed with the ticks of another."""
    file = run_of(tmp_path)
    client = TestClient((watched := WatchedRun(file)).app)
    since = Tags(client.get("/").text).data["live"]["since"]
    watched.close()
    assert list(events(client, "2020 " + since.split(" ", 1)[1])) == [{"reload": True}]
    assert list(events(client, "nonsense")) == [{"reload": True}]


@pytest.mark.parametrize(
    "body", [b"", b"[]", b"{}", b'{"line": 1}', b'{"shell": "rm"}', b'{"line": "n\\nq"}', b"x" * 20000]
)
def test_only_what_the_buttons_say_is_taken(body: bytes) -> None:
    """A button says one of few words with a text of one line; all else is refused, and nothing is passed on."""
    told: list[dict[str, Any]] = []
    client = TestClient(WatchedRun(Path("none"), told.append, DEBUGGING).app)
    assert client.post("/control", content=body).status_code == 400
    assert not told
    assert client.post("/control", content=b'{"line": "n"}').status_code == 204
    assert told == [{"line": "n"}]
    assert client.post("/control", content=b'{"reload": ""}').status_code == 409  # there is no file
    assert TestClient(WatchedRun(Path("none")).app).post("/control", content=b'{"line": "n"}').status_code == 409


MPVI = [sys.executable, "-c", "from mpvi_bt.apps.cli import main; main()"]


@contextmanager
def serving(*args: str, cwd: Path) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """A command that serves a page, and its address; what it says goes to `said.txt`."""
    process = subprocess.Popen(
        [*MPVI, *args], cwd=cwd, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )  # fmt: skip
    assert process.stderr is not None
    try:
        for line in process.stderr:
            if found := re.search(r"http://[^\s;]+", line):
                break
        else:
            raise AssertionError("it said no address")
        yield found[0], process
    finally:
        process.kill()
        process.wait()


@pytest.mark.slow
def test_a_visitor_who_reads_nothing_slows_nothing(tmp_path: Path) -> None:
    """A run ends as soon as without one, though a visitor asked for the events and never reads them."""
    (tmp_path / "long.yaml").write_text("tree: long\nroot:\n  repeat: 3000\n  child: {wait: 0.1}\n", encoding="utf-8")
    with serving("run", "--dry", "--tree", "long.yaml", "--no-watch", "--serve=0", cwd=tmp_path) as (url, process):
        port = int(url.rsplit(":", 1)[1].rstrip("/"))
        idle = socket.create_connection(("127.0.0.1", port))
        idle.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1024)
        idle.sendall(f"GET / HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n\r\n".encode())
        began = time.monotonic()
        assert process.wait(60) == 0
        assert time.monotonic() - began < 30
        idle.close()


@pytest.mark.slow
@pytest.mark.parametrize(("command", "asked"), [("watch", "events"), ("edit", "events"), ("edit", "drawing")])
def test_ctrl_c_ends_an_open_page_without_a_word(command: str, asked: str, tmp_path: Path) -> None:
    """Its events, or a drawing that takes long, are cut short, and that is no error."""
    served = run_of(tmp_path) if command == "watch" else tmp_path / "long.yaml"
    (tmp_path / "long.yaml").write_text(TREE + "    - wait: 7\n" * 2000, encoding="utf-8")
    with serving(command, str(served), "--serve=0", cwd=tmp_path) as (url, process):
        with urllib.request.urlopen(url) as page:
            data = Tags(page.read().decode()).data
        since = urllib.parse.quote(data["live"]["since"] if command == "watch" else data["since"])
        with socket.create_connection(("127.0.0.1", int(url.rsplit(":", 1)[1].rstrip("/")))) as page:
            page.sendall(f"GET /{asked}?since={since} HTTP/1.1\r\nHost: {url.split('/')[2]}\r\n\r\n".encode())
            if asked == "events":
                assert page.recv(4096).startswith(b"HTTP/1.1 200")
            else:
                time.sleep(0.5)  # for it to begin
            process.send_signal(signal.SIGINT)
            _, said = process.communicate(timeout=20)
        assert (process.returncode, said) == (INTERRUPTED, "")


@pytest.fixture(scope="module")
def chromium(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    if BROWSER is None:
        pytest.skip("needs Chromium")
    with browser(tmp_path_factory.mktemp("browser")) as running:
        yield running


@pytest.mark.slow
def test_the_page_follows_a_run(chromium: Browser, tmp_path: Path) -> None:
    """The running node is shown; the page steps, breaks and goes on; a late visitor and a reload see all.

    A click opens a node, two visitors see the same, and the end of the server is said.
    """
    (tmp_path / "slow.yaml").write_text(TREE, encoding="utf-8")
    command = ("run", "--dry", "--tree", "slow.yaml", "--no-watch", "--step", "--serve=0")
    with serving(*command, cwd=tmp_path) as (url, process):
        tab = chromium.tab(url)
        running = "document.querySelector('.leaf[data-is=running] .label')?.textContent"
        tab.until("document.querySelector('#connection')?.textContent === 'live'")
        tab.until(f"{running} === 'wait 1 s'")
        tab.until("document.querySelector('.paused') !== null")
        next_ = "[title='Go on to the next change']"
        tab.click(next_)
        tab.until(f"{running} === 'wait 2 s'")
        assert "wait" in tab.text(".said")
        late = chromium.tab(url)
        late.until(f"{running} === 'wait 2 s'")
        assert late.eval("play.frames.length") == tab.eval("play.frames.length") == 2
        late.click("[data-number='4'] .label")
        late.until("document.querySelector('#node .path').textContent === 'all of it/retry/two steps/wait'")
        tab.eval("outline.pick('all of it/retry/two steps/fail')")
        tab.click("[title='Pause where the node that is picked begins']")
        tab.until("document.querySelector('.said').textContent.startsWith('breaks at')")
        tab.click("[title='Go on to the next break']")
        tab.until("document.querySelector('.said').textContent.includes('break at all of it/retry/two steps/fail')")
        late.until("play.failures.length === 1")
        late.reload()
        late.until("document.querySelector('#log')?.textContent.includes('nothing_there')")
        late.size(400, 800)
        late.until("document.documentElement.scrollWidth <= 400")  # once it is laid out anew
        for _ in range(2):
            tab.until("document.querySelector('.paused') !== null")
            tab.click("[title='Go on to the next break']")
            time.sleep(0.3)
        for visitor in (tab, late):
            visitor.until("document.querySelector('#outcome').textContent.includes('tree failed')")
            visitor.until("document.querySelector('#connection').textContent.includes('server is gone')")
        assert process.wait(20) == 1


@pytest.mark.slow
def test_a_run_takes_the_new_text_of_its_tree(chromium: Browser, tmp_path: Path) -> None:
    """Between two ticks, when the page asks: what has changed is in the tree; what cannot be is told, and why."""
    file = tmp_path / "slow.yaml"
    file.write_text(TREE, encoding="utf-8")
    with serving("run", "--dry", "--tree", "slow.yaml", "--no-watch", "--step", "--serve=0", cwd=tmp_path) as (url, _):
        tab = chromium.tab(url)
        took, take = (
            "[...document.querySelectorAll('.said')].at(-1).textContent",
            "[title^='What has changed in the file']",
        )

        def asked() -> None:
            tab.until("document.querySelector('.paused') !== null")
            tab.click(take)
            tab.until(f"{took}.startsWith('asked')")
            tab.click("[title='Go on to the next tick']")

        file.write_text(TREE.replace("wait: 2", "wiat: 2"), encoding="utf-8")
        asked()
        tab.until(f"{took}.startsWith('not taken: slow.yaml:12:13: unknown node')")
        file.write_text(TREE.replace("wait: 2", "wait: 3"), encoding="utf-8")
        asked()
        tab.until(f"{took} === 'taken: all of it/retry/two steps/wait'")
        tab.until("document.querySelector('.paused') !== null")
        tab.click("[title='Go on to the next change']")
        tab.until("document.querySelector('.leaf[data-is=running] .label')?.textContent === 'wait 3 s'")


@pytest.mark.slow
def test_a_lost_server_is_said(chromium: Browser, tmp_path: Path) -> None:
    """A page whose server is killed says so, and goes on when it is there again."""
    file = run_of(tmp_path)
    with socket.create_server(("127.0.0.1", 0)) as free:  # a port that no other test takes in between
        port = free.getsockname()[1]
    with serving("watch", str(file), f"--serve={port}", cwd=tmp_path) as (url, process):
        tab = chromium.tab(url)
        tab.until("document.querySelector('#connection')?.textContent === 'the run is over'")
        process.send_signal(signal.SIGKILL)
        tab.until("document.querySelector('#connection').textContent.includes('no connection')")
    with serving("watch", str(file), f"--serve={port}", cwd=tmp_path):
        tab.until("document.querySelector('#connection')?.textContent === 'the run is over'")


@pytest.mark.slow
def test_hostile_text_is_inert_in_the_live_page(chromium: Browser, tmp_path: Path) -> None:
    """No attack in the texts of a trace runs, be it in the page or in what the page is fed later."""
    first, *rest = (json.dumps(line) + "\n" for line in hostile_lines())
    file = tmp_path / "hostile.trace.jsonl"
    file.write_text(first, encoding="utf-8")
    with serving("watch", str(file), "--serve=0", cwd=tmp_path) as (url, _):
        tab = chromium.tab(url)
        tab.until("document.querySelector('#connection')?.textContent === 'live'")
        with file.open("a", encoding="utf-8") as more:
            more.write("".join(rest))
        tab.until("document.querySelector('#log').textContent.includes('document.title')")
        time.sleep(0.5)
        assert tab.eval("document.title") != "evil"
        assert tab.eval("document.querySelectorAll('img').length") == 0


@pytest.mark.slow
@pytest.mark.render
def test_pictures_of_an_episode_change(chromium: Browser, tmp_path: Path) -> None:
    """While an episode goes on its page shows the head camera and the map, and then other pictures of them."""
    command = ("run", "picking_up_trash", "--instance", "1", "--no-watch", "--serve=0")
    with serving(*command, cwd=tmp_path) as (url, process):
        tab = chromium.tab(url)
        for name in ("head", "map"):
            shown = f"document.querySelector('#picture-{name}')"
            tab.until(f"{shown}?.naturalWidth", 240)
            first = tab.eval(f"{shown}.src")
            tab.until(f"{shown}.src !== {json.dumps(first)} && {shown}.naturalWidth", 120)
        process.send_signal(signal.SIGINT)
        assert process.wait(60) == 130
        tab.until("document.querySelector('#outcome').textContent.includes('interrupted')")


@pytest.mark.slow
@pytest.mark.parametrize("width", [1200, 390])
def test_the_debugger_is_above_the_pictures_and_keeps_the_focus(chromium: Browser, width: int, tmp_path: Path) -> None:
    """Its buttons have words, are above all else that is shown, and can be pressed again and again by the keyboard."""
    (tmp_path / "slow.yaml").write_text(TREE, encoding="utf-8")
    command = ("run", "--dry", "--tree", "slow.yaml", "--no-watch", "--step", "--serve=0")
    with serving(*command, cwd=tmp_path) as (url, _):
        tab = chromium.tab(url)
        tab.size(width, 900)
        tab.until("document.querySelector('.paused') !== null")
        top = "document.querySelector({!r}).getBoundingClientRect().top"
        assert tab.eval(top.format(".controls")) < tab.eval(top.format("#player")) < tab.eval(top.format("#outline"))
        assert tab.eval("live.images.compareDocumentPosition(live.controls) & Node.DOCUMENT_POSITION_PRECEDING")
        words = tab.eval("[...document.querySelectorAll('.controls button, #player button')].map(b => b.innerText)")
        assert len(words) >= 11
        assert all(re.search("[A-Za-z]{2}", text) for text in words)
        assert "Enter" not in tab.text(".said")  # the keys of the terminal are not the page's
        assert tab.text("#outcome").endswith("paused")
        tab.eval("live.steps[0].focus()")
        for ticks in (1, 2, 3):
            tab.until(f"play.frames.length >= {ticks} && document.querySelector('.paused') !== null")
            for kind in ("keyDown", "keyUp"):
                tab.call(
                    "Input.dispatchKeyEvent", type=kind, key="Enter", code="Enter", windowsVirtualKeyCode=13, text="\r"
                )
        tab.until("play.frames.length >= 4")
        assert tab.eval("document.activeElement === live.steps[0]")
        tab.until("document.querySelector('.paused') !== null")
        tab.until("/paused for [1-9]/.test(live.stands.innerText)")  # in wall time, which goes on
        assert tab.eval("document.documentElement.scrollWidth") <= width
