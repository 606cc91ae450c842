"""Trees drawn as text, for Graphviz and as SVG."""

from __future__ import annotations

import colorsys
import json
import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st
from wcwidth import wcswidth

from mpvi_bt.apps.cli.render import render
from mpvi_bt.executive.behaviors.parameters import Limit, MemoryFlag, NavigateTo, OnFailure
from mpvi_bt.executive.behaviors.registry import node_types
from mpvi_bt.executive.drawing.cells import columns, cut, one_line, wrapped
from mpvi_bt.executive.drawing.dot import dot_tree
from mpvi_bt.executive.drawing.svg import svg_tree
from mpvi_bt.executive.drawing.symbols import _SIGNS, MARKS, outcome, standing, state_style
from mpvi_bt.executive.drawing.text import ascii_tree, time_text, tree_lines, unicode_tree, where
from mpvi_bt.executive.ticking.dry import dry_tree, run_dry
from mpvi_bt.executive.ticking.loop import Watcher, World
from mpvi_bt.executive.trace.html import tree_page
from mpvi_bt.executive.tree.build import Tree
from mpvi_bt.executive.tree.spec import NodeSpec, TreeSpec
from mpvi_bt.executive.tree.state import NodeState
from mpvi_bt.executive.tree.yaml_io import expanded, parse_tree
from mpvi_bt.ground.errors import UserError
from tests.tree_strategies import trees

ROOT = Path(__file__).parent.parent
GOLDEN = ROOT / "tests" / "golden"
SVG = "{http://www.w3.org/2000/svg}"

SMALL = parse_tree(
    """
tree: fetch
instruction: Bring a cup & a <plate>.
root:
  sequence: fetch
  memory: true
  children:
    - attempt: greet
      child:
        fail: nobody_home
    - selector: find the cup
      memory: false
      children:
        - test: cups
          at_least: 1
        - timeout: 90
          child:
            navigate: 青いコップ
            room: kitchen
    - parallel: carry
      policy: success_on_one
      children:
        - manipulate: hold the "cup"
        - wait: 30 steps
    - say: done
"""
)
_STATES = {
    "fetch": NodeState("RUNNING"),
    "fetch/greet": NodeState("SUCCESS", "gave up: nobody_home", gave_up=True),
    "fetch/greet/fail": NodeState("FAILURE", "nobody_home", reason="nobody_home", origin="fetch/greet/fail"),
    "fetch/find the cup": NodeState("RUNNING"),
    "fetch/find the cup/test": NodeState("FAILURE", "cups has no value"),
    "fetch/find the cup/timeout": NodeState("RUNNING", "", 12.34, 90.0),
    "fetch/find the cup/timeout/navigate": NodeState("RUNNING", "asked: 不是它\x1b[31m是空的"),
    "fetch/carry": NodeState("SUCCESS"),
    "fetch/carry/manipulate": NodeState("INVALID", interrupted=True),
    "fetch/carry/wait": NodeState("SUCCESS", "", 1.0, 1.0),
}

# Words as they may come from models: of any width, invisible, broken, controlling.
anything = st.text(max_size=60) | st.text("a 不👩‍🚀é\u0301\u202e\x1b\n\t\ud800/&<>\"'\\", max_size=60)
times = st.none() | st.floats(0, 1e5)
node_states = st.builds(
    NodeState,
    st.sampled_from(["RUNNING", "SUCCESS", "FAILURE", "INVALID"]),
    feedback=anything,
    elapsed_s=times,
    limit_s=times,
    gave_up=st.booleans(),
    interrupted=st.booleans(),
    reason=anything,
    evidence=anything,
)
wide_words = st.text("ab 不是👍é", min_size=1, max_size=40).map(str.strip).filter(bool)


@st.composite
def pictures(draw: st.DrawFn) -> tuple[TreeSpec, dict[str, NodeState] | None]:
    """A tree with states of some of its nodes, or without."""
    inner = st.builds(lambda t: NodeSpec("navigate", NavigateTo(target=t)), wide_words)
    wide = st.builds(
        lambda name, below: TreeSpec(name, NodeSpec("sequence", MemoryFlag(memory=True), name, tuple(below))),
        wide_words,
        st.lists(inner, min_size=1, max_size=4),
    )
    tree = draw(trees | wide)
    if draw(st.booleans()):
        return tree, None
    return tree, {node.path: draw(node_states) for node in tree.nodes if draw(st.integers(0, 5))}


@given(picture=pictures(), width=st.integers(20, 120), fold=st.booleans(), unicode=st.booleans())
def test_no_line_is_too_wide(
    picture: tuple[TreeSpec, dict[str, NodeState] | None], width: int, fold: bool, unicode: bool
) -> None:
    """Whatever the labels and the feedback, each node has one printable line that keeps to the width."""
    tree, states = picture
    lines = tree_lines(tree, states, width, fold, unicode)
    assert fold or len(lines) == len(tree.nodes)
    for text in [*(line.text for line in lines), where(tree, states or {}, width)]:
        assert 0 <= wcswidth(text) <= width


@pytest.mark.parametrize("unicode", [False, True])
@pytest.mark.parametrize("width", [20, 60, 80])
def test_what_lies_deep_stays_legible(width: int, unicode: bool) -> None:
    """In a narrow or a deep drawing indent and times give way before the label and the mark do."""
    node = NodeSpec("navigate", NavigateTo(target="cup"))
    for _ in range(60):
        node = NodeSpec("timeout", Limit(limit=86400.0), children=(node,))
    tree = TreeSpec("deep", node)
    states = {n.path: NodeState("RUNNING", "", 4000.0, 86400.0) for n in tree.nodes}
    lines = tree_lines(tree, states, width, unicode=unicode)
    assert max(columns(line.text) for line in lines) <= width
    assert all("tim" in line.before for line in lines[:-1])
    assert "Nav" in lines[-1].before
    assert {line.after for line in lines} == {"" if width == 20 else " 4000 s, 82400 s left"}


@pytest.mark.parametrize("unicode", [False, True])
def test_depth_is_seen_as_long_as_there_is_room(unicode: bool) -> None:
    """A child is indented further than its parent in trees of up to forty levels, and siblings alike."""
    node = NodeSpec("navigate", NavigateTo(target="cup"))
    for _ in range(40):
        node = NodeSpec(
            "sequence", MemoryFlag(memory=True), children=(node, node) if node.kind == "navigate" else (node,)
        )
    tree = TreeSpec("deep", node)
    starts = [re.search(r"[-{→N]", line.text.replace("─", " ")) for line in tree_lines(tree, unicode=unicode)]
    indents = [start.start() for start in starts if start]
    assert indents == sorted(indents)
    assert len(set(indents)) == 41
    assert indents[-1] == indents[-2]


@given(picture=pictures())
def test_drawing_never_fails(picture: tuple[TreeSpec, dict[str, NodeState] | None]) -> None:
    """Every tree in every state is drawn for Graphviz and as well-formed SVG, with every node in it."""
    tree, states = picture
    dot = dot_tree(tree, states)
    quoted = r'"(?:[^"\\]|\\.)*"'
    node_or_edge = rf"  n\d+ (-> n\d+|\[\w+={quoted}(, \w+={quoted})*\]);"
    head, *body, tail = dot.splitlines()
    assert (head.endswith(" {"), tail) == (True, "}")
    assert sum(bool(re.fullmatch(node_or_edge, line)) for line in body[3:]) == len(body) - 3 == 2 * len(tree.nodes) - 1
    root = ET.fromstring(svg_tree(tree, states))
    assert len(root.findall(f"{SVG}g")) == len(tree.nodes)
    dot.encode()


def boxes(svg: str) -> list[tuple[float, float, float, float]]:
    """Left, top, right, bottom of every node's shape, in the order of the tree."""
    found = []
    for group in ET.fromstring(svg).findall(f"{SVG}g"):
        if (rect := group.find(f"{SVG}rect")) is not None:
            x, y, w, h = (float(rect.attrib[name]) for name in ("x", "y", "width", "height"))
            found.append((x, y, x + w, y + h))
        elif (polygon := group.find(f"{SVG}polygon")) is not None:
            corners = [tuple(map(float, pair.split(","))) for pair in polygon.attrib["points"].split()]
            xs, ys = zip(*corners, strict=True)
            found.append((min(xs), min(ys), max(xs), max(ys)))
    return found


def _bushy(children: int, depth: int) -> NodeSpec:
    if not depth:
        return NodeSpec("navigate", NavigateTo(target="the table", room="living room"))
    below = tuple(_bushy(children, depth - 1) for _ in range(children))
    return NodeSpec("attempt", OnFailure(), "tidy", (NodeSpec("sequence", MemoryFlag(memory=True), "all", below),))


@given(tree=trees | st.builds(lambda n, d: TreeSpec("bushy", _bushy(n, d)), st.integers(1, 5), st.integers(1, 3)))
def test_svg_boxes_stand_apart(tree: TreeSpec) -> None:
    """No two boxes meet, children stand below their parents, and all are on the paper."""
    svg = svg_tree(tree)
    paper = ET.fromstring(svg).attrib
    found = boxes(svg)
    numbers = {node.path: i for i, node in enumerate(tree.nodes)}
    assert len(found) == len(numbers)
    for i, (left, top, right, bottom) in enumerate(found):
        assert left >= 0
        assert top >= 0
        assert right <= float(paper["width"])
        assert bottom <= float(paper["height"])
        assert all(x1 <= left or x0 >= right or y1 <= top or y0 >= bottom for x0, y0, x1, y1 in found[i + 1 :])
        assert all(found[numbers[child]][1] > bottom for child in tree.nodes[i].children)


def test_svg_of_a_hundred_nodes_is_a_page_wide() -> None:
    """What would be too wide goes on in a next row."""
    tree = TreeSpec("bushy", _bushy(7, 2))
    assert len(tree.nodes) > 60
    assert float(ET.fromstring(svg_tree(tree)).attrib["width"]) < 1500


@given(text=anything)
def test_one_line_is_harmless(text: str) -> None:
    """What is printed holds no character that a terminal obeys, and plain text stays as it is."""
    line = one_line(text)
    assert all(c.isprintable() or c in "\u200c\u200d" for c in line)
    assert one_line(line) == line
    line.encode()


@given(text=anything.map(one_line), width=st.integers(0, 30))
def test_cutting_keeps_characters_whole(text: str, width: int) -> None:
    """Cut text fits, begins as the text does, and says that it was cut; text that fits stays."""
    short = cut(text, width)
    assert columns(short) <= width
    if columns(text) <= width:
        assert short == text
    elif width > 3:
        assert short.endswith("...")
        assert text.startswith(short[:-3])


@given(text=anything.map(one_line), width=st.integers(2, 30))
def test_wrapping_keeps_every_word(text: str, width: int) -> None:
    """Wrapped lines fit and hold the text's letters in order."""
    lines = wrapped(text, width)
    assert "".join(lines).replace(" ", "") == text.replace(" ", "")
    assert all(columns(line) <= width for line in lines)
    assert wrapped(text, width, 1) == [cut(" ".join(lines), width)]


def test_wide_characters_take_two_columns() -> None:
    """A Chinese character is never cut in half: with an odd column to spare, the line is one shorter."""
    assert cut("不它是空的不它", 10) == "不它是..."
    assert cut("a不它是空的不它", 10) == "a不它是..."
    assert (columns("不"), columns("e\u0301"), columns("👩\u200d🚀")) == (2, 1, 2)


@pytest.mark.parametrize(
    ("suffix", "drawn"),
    [
        ("txt", f"{ascii_tree(SMALL, _STATES)}\n{where(SMALL, _STATES)}\n\n{unicode_tree(SMALL, _STATES)}"),
        ("dot", dot_tree(SMALL, _STATES)),
        ("svg", svg_tree(SMALL, _STATES)),
    ],
)
def test_drawings_are_golden(suffix: str, drawn: str) -> None:
    """A small tree with a node in each state is drawn as recorded."""
    assert {standing(state) for state in _STATES.values()} | {"idle"} == set(MARKS)
    assert drawn + "\n" == (GOLDEN / f"fetch.{suffix}").read_text(encoding="utf-8")


def test_a_state_has_one_color_everywhere() -> None:
    """Its colors on light and dark paper, of its text and on a terminal are of one hue; pages define no other."""
    names = {"yellow": 45, "green": 130, "red": 5, "bright_blue": 228, 166: 24}

    def hue(color: str) -> float:
        return 360 * colorsys.rgb_to_hls(*(int(color[i : i + 2], 16) / 255 for i in (1, 3, 5)))[0]

    for name, mark in MARKS.items():
        if name == "idle":
            continue
        hues = [hue(mark.light), hue(mark.dark), hue(mark.ink), hue(mark.fill), names[mark.terminal or ""]]
        turned = [(h - hues[0] + 180) % 360 - 180 for h in hues]
        assert max(turned) - min(turned) < 25, (name, hues)
        assert f"--{name.replace('_', '-')}: {mark.light};" in state_style()
        assert svg_tree(SMALL, {"fetch": _standing_so[name]}).count(mark.ink) >= 2
    defined = re.compile(r"--(running|success|failure|gave-up|interrupted|idle|good|bad|warn|busy)\s*:")
    for file in (ROOT / "mpvi_bt").rglob("*.css"):
        assert not defined.search(file.read_text(encoding="utf-8")), file


_standing_so = {
    "running": NodeState("RUNNING"),
    "success": NodeState("SUCCESS"),
    "failure": NodeState("FAILURE"),
    "gave_up": NodeState("SUCCESS", gave_up=True),
    "interrupted": NodeState("INVALID", interrupted=True),
}


def test_what_failed_before_is_not_idle() -> None:
    """A step that failed and was reset by a retry stands as failed, and says so, in text, SVG and pages."""
    tree = parse_tree(
        "tree: t\nroot:\n  retry: 2\n  child:\n    sequence: s\n    memory: true\n"
        "    children: [{wait: 0.1}, {fail: no_luck}]\n"
    )
    seen: dict[int, dict[str, NodeState]] = {}

    class Look(Watcher):
        def step(self, tree: Tree, world: World) -> None:
            seen[tree.ticks] = tree.states()

    run_dry(dry_tree(tree), subscribers=[Look()])
    again = next(s for s in seen.values() if s["retry/s/wait"].status == "RUNNING" and s["retry/s/fail"].ended)
    state = again["retry/s/fail"]
    assert (state.status, state.ended, state.reason, standing(state)) == ("INVALID", "FAILURE", "no_luck", "failure")
    assert "fail: no_luck [x]  failed before: no_luck" in ascii_tree(tree, again)
    assert "✕ fail: no_luck" in svg_tree(tree, again)
    done = next(s for s in reversed(seen.values()) if s["retry/s/wait"].status == "SUCCESS")
    assert standing(NodeState(ended="SUCCESS")) == "idle"
    assert outcome(NodeState(ended="SUCCESS")) == "success"
    assert done["retry/s/wait"].ended == ""


def test_what_matters_most_is_named() -> None:
    """The deepest running leaf; after a failure its origin, reason and evidence; nothing after a success."""
    assert where(SMALL, _STATES) == "running: find the cup/timeout/navigate"
    root = {"fetch": NodeState("FAILURE", reason="no_path", evidence="shut", origin="fetch/find the cup")}
    assert where(SMALL, root) == "failed: find the cup: no_path: shut"
    assert where(SMALL, {"fetch": NodeState("SUCCESS")}) == ""


def test_time_is_elapsed_and_left() -> None:
    """Whole seconds while it runs, so that the picture stays still; a tenth once it is over; nothing if not begun."""
    assert time_text(NodeState("RUNNING", "", 12.9, 90.0)) == "12 s, 78 s left"
    assert time_text(NodeState("FAILURE", "", 90.04, 90.0)) == "90.0 s"
    assert time_text(NodeState("INVALID", "", 3.0, 90.0)) == time_text(NodeState("RUNNING")) == ""


# -------------------------------------------------------------------------------------------------- mpvi render

RUN = CliRunner()


def invoke(*args: object) -> str:
    """What `mpvi render` prints. Raises what it raises."""
    done = RUN.invoke(render, [str(arg) for arg in args], standalone_mode=False)
    if done.exception:
        raise done.exception
    return done.output


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """The trace of a run that fails at its second tick."""
    tree = parse_tree(
        "tree: t\nroot:\n  sequence: s\n  memory: true\n  children:\n    - wait: 5\n    - fail: no_luck\n"
    )
    failed = {"status": "FAILURE", "feedback": "no_luck", "reason": "no_luck", "origin": "s/fail"}
    lines = [
        {"trace": 1, "mpvi_bt": "0", "tree": expanded(tree), "config": {"task": "t"}, "seed": 3},
        {"tick": 1, "time_s": 0.0, "nodes": {
            "s": {"status": "RUNNING"}, "s/wait": {"status": "RUNNING", "elapsed_s": 0.0, "limit_s": 5.0}}},
        {"tick": 151, "time_s": 5.0, "nodes": {
            "s": failed, "s/fail": failed, "s/wait": {"status": "SUCCESS", "elapsed_s": 5.0, "limit_s": 5.0}}},
        {"end": "failure", "tick": 151, "time_s": 5.0},
    ]  # fmt: skip
    path = tmp_path / "run.jsonl"
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    return path


def test_a_trace_is_drawn_at_its_end_or_at_a_tick(run: Path) -> None:
    """Without --tick how it ended, with it how it stood then; a tick that was not is named with the last that was."""
    assert invoke(run) == (
        "{-} s [x]  no_luck\n    --> wait 5 s [o] 5.0 s\n    --> fail: no_luck [x]  no_luck\n"
        "failed: fail: no_luck\ntree failed after 5.0 s\n"
    )
    assert invoke(run, "--tick", 100).splitlines()[1:] == [
        "    --> wait 5 s [*] 3 s, 2 s left",
        "    --> fail: no_luck [-]",
        "running: wait",
        "tick 100, 3.3 s",
    ]
    assert "[*]" not in invoke(run, "--tick", 0)
    with pytest.raises(UserError, match="there is no tick 152; the last is 151"):
        invoke(run, "--tick", 152)
    with pytest.raises(UserError, match="--tick needs the trace of a run"):
        invoke("picking_up_trash", "--tick", 1)


def test_a_trace_that_breaks_off_is_drawn(run: Path) -> None:
    """Without its end, and with nothing but its head, a trace still has a picture in every format."""
    whole = run.read_text().splitlines(keepends=True)
    for lines, last in (
        (whole[:3], "the trace breaks off after 5.0 s"),
        (whole[:1], "the trace breaks off after 0.0 s"),
    ):
        run.write_text("".join(lines))
        assert invoke(run).splitlines()[-1] == last
        for form in ("unicode", "dot", "svg", "html"):
            assert "no_luck" in invoke(run, "--format", form)


def test_json_has_the_states(run: Path) -> None:
    """For programs: every node with its state at the tick."""
    told = json.loads(invoke(run, "--json"))
    assert [(n["path"], n["state"]["status"]) for n in told["nodes"]] == [
        ("s", "FAILURE"),
        ("s/wait", "SUCCESS"),
        ("s/fail", "FAILURE"),
    ]
    assert (told["tick"], told["when"]) == (151, "tree failed after 5.0 s")
    assert "state" not in json.loads(invoke("picking_up_trash", "--json"))["nodes"][0]


@pytest.mark.parametrize(
    ("suffix", "begins"),
    [("txt", "{-}"), ("dot", "digraph"), ("gv", "digraph"), ("svg", "<svg"), ("html", "<!doctype")],
)
def test_the_suffix_tells_the_format(suffix: str, begins: str, tmp_path: Path) -> None:
    """--out alone is enough, and its text ends with a newline."""
    out = tmp_path / f"tree.{suffix}"
    assert invoke("picking_up_trash", "--out", out) == ""
    assert out.read_text(encoding="utf-8").startswith(begins)
    assert out.read_text(encoding="utf-8").endswith("\n")
    assert invoke("picking_up_trash", "--out", out, "--format", "ascii") == ""
    assert out.read_text(encoding="utf-8").startswith("{-}")


def test_what_cannot_be_written_is_one_line(tmp_path: Path) -> None:
    """An unknown suffix and a missing folder are named."""
    with pytest.raises(UserError, match=r"tree\.png: its suffix tells no format\. Known: \.txt"):
        invoke("picking_up_trash", "--out", tmp_path / "tree.png")
    with pytest.raises(UserError, match="no such file or directory"):
        invoke("picking_up_trash", "--out", tmp_path / "none" / "tree.svg")


@pytest.mark.parametrize("form", ["ascii", "unicode", "dot", "svg", "html"])
def test_drawing_needs_no_simulator(form: str, run: Path) -> None:
    """A tree and a trace are drawn with none of py_trees, numpy and the simulator."""
    code = (
        "import sys\nfrom mpvi_bt.apps.cli import main\n"
        f"for what in ('picking_up_trash', {str(run)!r}):\n"
        f"    try: main(['render', what, '--format', {form!r}])\n"
        "    except SystemExit as end: assert end.code in (0, None), end.code\n"
        "print('LOADED', [m for m in ('py_trees', 'numpy', 'sapien', 'torch') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, encoding="utf-8")
    assert done.stdout.splitlines()[-1] == "LOADED []"


def test_every_sign_and_mark_is_explained() -> None:
    """In the help, in ASCII, and on the page."""
    told = " ".join(CliRunner().invoke(render, ["--help"]).output.split())
    page = tree_page(parse_tree("tree: t\nroot: {wait: 1}\n"))
    for node_type in node_types().values():
        for memory in (True, False):
            parameters: dict[str, Any] = {"memory": memory} if "memory" in node_type.parameters.model_fields else {}
            assert node_type.glyph_of(node_type.parameters.model_construct(**parameters)) in told
    for mark in MARKS.values():
        assert mark.ascii in told
    for sign in _SIGNS.values():
        assert f"{sign.rstrip('*')} " in page
