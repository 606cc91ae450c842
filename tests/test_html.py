"""The page of a tree or a run: what is in it, and what it does in a browser and in node where there is one."""

from __future__ import annotations

import base64
import hashlib
import json
import re
import shutil
import subprocess
import tempfile
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mpvi_bt.executive.behaviors.references import escaped
from mpvi_bt.executive.drawing.cells import one_line
from mpvi_bt.executive.drawing.symbols import standing
from mpvi_bt.executive.trace import html
from mpvi_bt.executive.trace.html import embedded, trace_page, tree_page
from mpvi_bt.executive.trace.read import Trace, read_trace
from mpvi_bt.executive.tree.spec import TreeSpec
from mpvi_bt.executive.tree.yaml_io import expanded, parse_tree
from tests.test_render import SMALL

PLAYBACK = Path(html.__file__).parent / "page" / "playback.js"
NODE = shutil.which("node")
BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)

ATTACK = "document.title='evil'"
EVIL = f'</script><script>{ATTACK}</script><img src=x onerror="{ATTACK}"><!--<script>{{{{data}}}}&lt;\'`${{x}}'
_NAME, _TEXT = json.dumps(escaped(EVIL)), json.dumps(EVIL)
HOSTILE = parse_tree(
    f"tree: {_TEXT}\nroot:\n  sequence: {_NAME}\n  memory: true\n  children:\n"
    f"    - attempt: {_NAME}\n      child: {{manipulate: {_TEXT}}}\n    - wait: 5\n"
)


# One, and the same with a part swapped, so that some of its paths stay; and one that shares nothing.
_SWAPPED = replace(SMALL, root=replace(SMALL.root, children=(HOSTILE.root, *SMALL.root.children[1:])))
TREES = [SMALL, _SWAPPED, HOSTILE]


class Tags(HTMLParser):
    """What a page consists of, as a browser reads it."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.inside: dict[str, list[str]] = {}
        self.open = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        self.open = tag
        if tag in ("script", "style"):
            self.inside.setdefault(tag, []).append("")

    def handle_endtag(self, tag: str) -> None:
        self.open = ""

    def handle_data(self, data: str) -> None:
        if self.open in ("script", "style"):
            self.inside[self.open][-1] += data

    @property
    def data(self) -> dict[str, Any]:
        """The embedded data."""
        read: dict[str, Any] = json.loads(self.inside["script"][0])
        return read


def written(lines: list[dict[str, Any]]) -> Trace:
    """The trace of these lines."""
    with tempfile.NamedTemporaryFile("w", suffix=".jsonl", encoding="utf-8") as file:
        file.write("".join(json.dumps(line) + "\n" for line in lines))
        file.flush()
        return read_trace(file.name)


def head(tree: TreeSpec, **config: Any) -> dict[str, Any]:
    """The first line of a trace."""
    return {"trace": 1, "mpvi_bt": "0", "tree": expanded(tree), "config": config, "seed": 3}


def hostile_lines() -> list[dict[str, Any]]:
    """The trace of a run in which every word is an attack."""
    paths = [node.path for node in HOSTILE.nodes]
    bad = {"status": "FAILURE", "feedback": EVIL, "reason": EVIL, "evidence": EVIL, "origin": paths[-1]}
    return [
            head(HOSTILE, task=EVIL, inner={EVIL: [EVIL]}),
            {"tick": 1, "time_s": 0.0, "nodes": dict.fromkeys(paths, bad), "blackboard": {EVIL: EVIL},
             "queries": [{"criterion": EVIL, "event": EVIL, "complete": True, "reason": EVIL, "path": EVIL}]},
            {"end": "failure", "tick": 1, "time_s": 0.0,
             "failure": {"reason": EVIL, "path": paths[-1], "time_s": 0.0, "evidence": EVIL}},
    ]  # fmt: skip


def hostile_run() -> Trace:
    """That run."""
    return written(hostile_lines())


words = st.text(st.characters(exclude_categories=["Cs"]), max_size=12) | st.just(EVIL)
seconds = st.none() | st.floats(0, 100)


@st.composite
def states(draw: st.DrawFn) -> dict[str, Any]:
    """A node's state as a trace holds it."""
    state = {
        "status": draw(st.sampled_from(["RUNNING", "SUCCESS", "FAILURE", "INVALID"])),
        "feedback": draw(words),
        "elapsed_s": draw(seconds),
        "limit_s": draw(seconds),
        "gave_up": draw(st.booleans()),
        "interrupted": draw(st.booleans()),
    }
    return {key: value for key, value in state.items() if value}


@st.composite
def traces(draw: st.DrawFn) -> Trace:
    """A run of random changes, its tree sometimes swapped, its end sometimes missing."""
    tree = draw(st.sampled_from(TREES))
    lines = [head(tree)]
    tick, time_s = 0, 100.0  # so that every elapsed time has begun after 0
    for _ in range(draw(st.integers(0, 12))):
        tick += draw(st.integers(1, 5))
        time_s += draw(st.floats(0.01, 1))
        line: dict[str, Any] = {"tick": tick, "time_s": time_s}
        if draw(st.integers(0, 3)) == 0:
            tree = draw(st.sampled_from(TREES))
            line["tree"] = expanded(tree)
        paths = st.sampled_from([node.path for node in tree.nodes])
        line["nodes"] = draw(st.dictionaries(paths, states(), max_size=4))
        line["blackboard"] = draw(
            st.dictionaries(st.sampled_from(["a", "b", "__proto__"]), st.none() | words, max_size=2)
        )
        lines.append(line)
    if draw(st.booleans()):
        lines.append({"end": "success", "tick": tick, "time_s": time_s})
    return written(lines)


Shown = dict[str, list[Any]]


def expected(trace: Trace, i: int) -> tuple[Shown, dict[str, str]]:
    """How everything stood after ticks[i]: what is shown of each node, and the blackboard."""
    nodes = {path: [standing(s), one_line(s.feedback), s.elapsed_s] for path, s in trace.states(i).items()}
    return nodes, {key: one_line(json.dumps(v, ensure_ascii=False)) for key, v in trace.blackboard(i).items()}


def same(told: Shown, wanted: Shown) -> bool:
    """Whether they are equal, times nearly so; of a node that has not begun nothing need be told."""
    return all(
        told.get(path, ["idle", "", None])[:2] == shown[:2]
        and told.get(path, ["idle", "", None])[2] == pytest.approx(shown[2], abs=1e-5)
        for path, shown in wanted.items()
    )


@given(trace=traces())
def test_the_page_holds_the_run(trace: Trace) -> None:
    """Applying the embedded changes one after the other gives the states and the blackboard of the trace."""
    data = Tags(trace_page(trace)).data
    nodes: dict[str, dict[str, Any]] = {}
    board: dict[str, str] = {}
    tree = data["trees"][0]
    for i, frame in enumerate(data["frames"]):
        if "tree" in frame:
            tree = data["trees"][frame["tree"]]
            nodes = {node["path"]: nodes[node["path"]] for node in tree if node["path"] in nodes}
        nodes |= {tree[int(number)]["path"]: state for number, state in frame.get("nodes", {}).items()}
        board = {key: value for key, value in (board | frame.get("board", {})).items() if value is not None}
        shown = {
            path: [s["is"], s.get("feedback", ""), frame["time"] - s["began"] if "began" in s else s.get("elapsed")]
            for path, s in nodes.items()
        }
        nodes_then, board_then = expected(trace, i)
        assert same(shown, nodes_then)
        assert shown.keys() <= nodes_then.keys()
        assert board == board_then
    assert len(data["frames"]) == len(trace.ticks)


@given(trace=traces(), picks=st.lists(st.integers(0, 1000), max_size=8))
@settings(max_examples=40)
@pytest.mark.skipif(NODE is None, reason="needs node")
def test_the_script_plays_the_run(trace: Trace, picks: list[int]) -> None:
    """Forward, back and jumping, with the copies close together, the page's script tells what the trace tells."""
    count = len(trace.ticks)
    order = [*range(count), *reversed(range(count)), *(pick % count for pick in picks if count)]
    code = (
        f"const data = JSON.parse({json.dumps(embedded(Tags(trace_page(trace)).data))});\n"
        + PLAYBACK.read_text(encoding="utf-8").replace("const EVERY = 256;", "const EVERY = 3;")
        + """
        const play = new Playback(data);
        const told = ORDER.map((i) => {
          const moment = play.at(play.frameAt(data.frames[i].tick));
          const time = play.timeAt(data.frames[i].tick);
          const nodes = {};
          moment.states.forEach((state, k) => {
            const path = play.trees[moment.tree][k].path;
            nodes[path] = [state.is, state.feedback ?? "", elapsed(state, time) ?? null];
          });
          return { nodes, board: [...moment.board] };
        });
        console.log(JSON.stringify(told));
        """.replace("ORDER", json.dumps(order))
    )
    assert "EVERY = 3" in code
    done = subprocess.run([str(NODE), "-"], input=code, capture_output=True, text=True, encoding="utf-8", check=True)
    for i, told in zip(order, json.loads(done.stdout), strict=True):
        nodes_then, board_then = expected(trace, i)
        assert same(told["nodes"], nodes_then)
        assert told["nodes"].keys() <= nodes_then.keys()
        assert dict(told["board"]) == board_then


@pytest.mark.skipif(NODE is None, reason="needs node")
def test_the_script_parses(tmp_path: Path) -> None:
    """All of the page's script together is JavaScript."""
    file = tmp_path / "script.js"
    file.write_text(Tags(trace_page(hostile_run())).inside["script"][1], encoding="utf-8")
    subprocess.run([str(NODE), "--check", str(file)], check=True)


@given(texts=st.lists(st.text(max_size=20) | st.sampled_from([EVIL, "</script", "<!--", "]]>", "\u2028"])))
def test_embedded_data_is_only_data(texts: list[str]) -> None:
    """Any texts survive, and none of them holds anything that HTML could see."""
    text = embedded(texts)
    assert json.loads(text) == texts
    assert text.isascii()
    assert not re.search("[<>&]", text)


def test_hostile_text_stays_text() -> None:
    """A page whose every word is an attack has the very elements of a harmless one, and scripts only of ours."""
    harmless = written([head(parse_tree("tree: t\nroot:\n  wait: 1\n"))])
    for hostile, plain in (
        (tree_page(HOSTILE), tree_page(harmless.tree)),
        (trace_page(hostile_run()), trace_page(harmless)),
    ):
        page, wanted = Tags(hostile), Tags(plain)
        assert [tag for tag in page.tags if tag[0] != "meta"] == [tag for tag in wanted.tags if tag[0] != "meta"]
        assert page.inside["script"][1:] == wanted.inside["script"][1:]
        assert EVIL in page.data["trees"][0][0]["label"]


def test_a_page_tells_things_by_their_words() -> None:
    """What a checker or a node says of a thing has no synset on the page."""
    told = "can__of__soda.n.01_1 is seen between the fingers"
    asked = {"criterion": "held", "event": "grasp", "complete": True, "reason": told, "path": "wait"}
    state = {"status": "FAILURE", "feedback": f"lost: {told}", "reason": "lost", "evidence": told, "origin": "wait"}
    lines = [head(parse_tree("tree: t\nroot:\n  wait: 1\n"))]
    lines.append({"tick": 1, "time_s": 0.0, "nodes": {"wait": state}, "queries": [asked]})
    (frame,) = Tags(trace_page(written(lines))).data["frames"]
    assert frame["said"][0]["text"].endswith("can of soda is seen between the fingers")
    assert ".n.01" not in json.dumps(frame)


def test_nothing_else_runs_or_loads() -> None:
    """The policy allows our script and style by their hashes and nothing more; the page names no address."""
    page = Tags(trace_page(hostile_run()))
    policy = next(a["content"] for tag, a in page.tags if a.get("http-equiv") == "Content-Security-Policy") or ""
    for name, text in (("script", page.inside["script"][1]), ("style", page.inside["style"][0])):
        digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
        assert f"{name}-src 'sha256-{digest}';" in policy
    assert policy.startswith("default-src 'none'")
    assert len(page.inside["script"]) == 2
    ours = page.inside["script"][1] + page.inside["style"][0]
    assert not re.search(
        r"https?:|innerHTML|outerHTML|insertAdjacent|document\.write|eval\(|url\(|@import|fetch\(", ours
    )
    assert not [a for _, a in page.tags if {"src", "href", "style"} & a.keys() or any(k.startswith("on") for k in a)]


def in_browser(page: str, tmp_path: Path, fragment: str = "") -> str:
    """What the page has become once its script has run."""
    file = tmp_path / "page.html"
    file.write_text(page, encoding="utf-8")
    command = [str(BROWSER), "--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path / 'profile'}"]
    command += ["--virtual-time-budget=2000", "--dump-dom", file.as_uri() + fragment]
    done = subprocess.run(command, capture_output=True, text=True, encoding="utf-8", check=True, timeout=120)
    return done.stdout


@pytest.mark.skipif(BROWSER is None, reason="needs Chromium")
def test_hostile_text_is_inert_in_a_browser(tmp_path: Path) -> None:
    """No attack runs, and each is shown as it was written."""
    shown = in_browser(trace_page(hostile_run()), tmp_path)
    page = Tags(shown)
    assert "<title>evil</title>" not in shown
    assert "<title>&lt;/script&gt;" in shown
    assert not [tag for tag, _ in page.tags if tag == "img"]
    assert "&lt;/script&gt;&lt;script&gt;document.title='evil'" in shown


@pytest.mark.skipif(BROWSER is None, reason="needs Chromium")
@pytest.mark.parametrize(
    ("fragment", "standings"), [("#tick=1", "running idle"), ("#tick=7", "success running"), ("", "success failure")]
)
def test_a_link_leads_to_a_tick(fragment: str, standings: str, tmp_path: Path) -> None:
    """Behind the address, `#tick=7` opens the run as it stood after tick 7; without it, as it ended."""
    tree = parse_tree("tree: t\nroot:\n  sequence: s\n  memory: true\n  children: [{wait: 1}, {say: hello}]\n")
    run = written(
        [
            head(tree),
            {"tick": 1, "time_s": 0.0, "nodes": {"s": {"status": "RUNNING"}, "s/wait": {"status": "RUNNING"}}},
            {"tick": 5, "time_s": 1.0, "nodes": {"s/wait": {"status": "SUCCESS"}, "s/say": {"status": "RUNNING"}}},
            {"tick": 9, "time_s": 2.0, "nodes": {"s/say": {"status": "FAILURE"}, "s": {"status": "FAILURE"}}},
            {"end": "failure", "tick": 9, "time_s": 2.0},
        ]
    )
    page = Tags(in_browser(trace_page(run), tmp_path, fragment))
    lines = [attributes["data-is"] for _, attributes in page.tags if attributes.get("role") == "treeitem"]
    assert lines[1:] == standings.split()
