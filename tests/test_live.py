"""The live view of a tree, on a terminal and piped."""

from __future__ import annotations

import contextlib
import io
import os
import pty
import re
import threading

import pytest

from mpvi_bt.executive.drawing.symbols import MARKS, legend
from mpvi_bt.executive.drawing.text import LEGEND, ascii_tree, unicode_tree
from mpvi_bt.executive.ticking.live import LiveTree
from mpvi_bt.executive.ticking.loop import run_episode
from mpvi_bt.executive.tree.build import Tree
from mpvi_bt.executive.tree.state import NodeState
from mpvi_bt.executive.tree.yaml_io import parse_tree
from mpvi_bt.testing import KinematicWorld
from tests.test_executive import SPEC, scene


@pytest.fixture(autouse=True)
def _terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    """One that obeys, wherever the tests run."""
    monkeypatch.setenv("TERM", "xterm")


def test_piped_it_prints_changes_only() -> None:
    """The whole tree stands at the start and the end, and each line between tells of a node whose status changed."""
    stream = io.StringIO()
    tree, world, context = scene()
    outcome = run_episode(tree, world, context, [LiveTree(stream, "picking_up_trash, instance 0")])
    text = stream.getvalue()
    lines = text.splitlines()
    assert "\x1b" not in text
    assert max(map(len, lines)) <= 80
    assert text.startswith("picking_up_trash, instance 0\n" + ascii_tree(SPEC))
    assert text.endswith(ascii_tree(SPEC, tree.states()) + f"\nplan finished after {outcome.time_s:.1f} s\n")
    changes = [line for line in lines if re.match(r" *\d+\.\d s  ", line)]
    assert len(lines) == len(changes) + 2 * len(SPEC.nodes) + 2
    assert len(changes) < 4 * len(SPEC.nodes)


def screen(data: str, height: int) -> list[str]:
    """What a terminal that scrolls shows after the text, for the few escapes that are used."""
    rows, at = [""], 0
    data = re.sub(r"\x1b\[[\d;]*m", "", data.replace("\r\n", "\n"))  # colors
    for part in re.findall(r"\x1b\[\d*[FKJ]|\n|[^\x1b\n]+", data):
        if part == "\n":
            at += 1
            rows += [""] * (at + 1 - len(rows))
        elif part.endswith("F") and part.startswith("\x1b"):
            up = int(part[2:-1])
            assert up < height, "goes up beyond what is on screen"
            at -= up
        elif part == "\x1b[K":
            pass
        elif part == "\x1b[J":
            del rows[at + 1 :]
            rows[at] = ""
        else:
            rows[at] = part
    return rows


def test_on_a_terminal_it_redraws_in_place(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each drawing lands on the one before and fits the screen; the last, the whole tree, is all that stays."""
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setenv("LINES", "24")
    monkeypatch.setattr("mpvi_bt.executive.ticking.live._REDRAWS_PER_S", 400.0)
    parent, child = pty.openpty()
    received: list[bytes] = []

    def drain() -> None:
        with contextlib.suppress(OSError):  # how a terminal that was closed ends
            while data := os.read(parent, 1 << 16):
                received.append(data)

    reader = threading.Thread(target=drain)
    reader.start()
    with os.fdopen(child, "w") as stream:
        live = LiveTree(stream, "demo")
        live.show(SPEC)
        tree, world, context = scene()
        outcome = run_episode(tree, world, context, [live])
    reader.join()
    os.close(parent)
    text = b"".join(received).decode()
    assert text.count("\x1b[J") > 3
    assert screen(text, 24) == [
        f"demo  plan finished after {outcome.time_s:.1f} s",
        *ascii_tree(SPEC, tree.states()).splitlines(),
        LEGEND,
        "",
    ]


class Terminal(io.StringIO):
    """A stream that says it is a terminal."""

    def isatty(self) -> bool:
        return True


LONG = parse_tree(
    "tree: long\nroot:\n  sequence: long\n  memory: true\n  children:\n"
    + "".join(f"    - {{timeout: {n}, child: {{wait: {n}}}}}\n" for n in range(10, 90))
)


@pytest.mark.parametrize("at", [0, 1, 20, 60, 79])
@pytest.mark.parametrize("height", [6, 24])
def test_the_running_node_is_on_screen(at: int, height: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """However long the tree and wherever it runs, the running node and the line that names it are on screen."""
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setenv("LINES", str(height))
    tree, world, stream = Tree(LONG), KinematicWorld(), Terminal()
    states = {placed.path: NodeState() for placed in LONG.nodes}
    timeout = LONG.nodes[0].children[at]
    leaf = next(placed for placed in LONG.nodes if placed.path.startswith(timeout + "/"))
    for path in (LONG.nodes[0].path, timeout, leaf.path):
        states[path] = NodeState("RUNNING", elapsed_s=3.0, limit_s=10.0 + at)
    monkeypatch.setattr(tree, "states", lambda: states)
    LiveTree(stream, "demo").step(tree, world)
    rows = screen(stream.getvalue(), height)
    assert len(rows) <= height
    assert sum(f"wait {10 + at} s [*] 3 s, {7 + at} s left" in row for row in rows) == 1
    assert rows[-3] == "running: " + leaf.path.partition("/")[2]
    assert rows[-2] == LEGEND
    assert re.fullmatch(r"\.\.\. ([1-9]\d* lines (above|below)(, (?=.)|$))+", rows[-4])


def test_the_end_tells_what_failed() -> None:
    """After a failure the last lines name the leaf, its reason and its evidence, and when it was over."""
    spec = parse_tree("tree: t\nroot:\n  sequence: s\n  memory: true\n  children:\n    - fail: no_luck\n")
    stream = io.StringIO()
    _, world, context = scene()
    run_episode(Tree(spec), world, context, [LiveTree(stream)])
    assert re.fullmatch(r"failed: fail: no_luck.*", stream.getvalue().splitlines()[-2])
    assert stream.getvalue().splitlines()[-1] == "tree failed after 0.0 s"


@pytest.mark.parametrize(("settings", "colored"), [({}, True), ({"NO_COLOR": "1"}, False), ({"TERM": "dumb"}, False)])
def test_colors_only_where_they_are_wanted(
    settings: dict[str, str], colored: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A terminal gets colors, unless NO_COLOR is set or it can show none; what is piped never does."""
    for name in ("NO_COLOR", "TERM"):
        monkeypatch.delenv(name, raising=False)
    for name, value in settings.items():
        monkeypatch.setenv(name, value)
    terminal, piped = Terminal(), io.StringIO()
    run_episode(*scene(), subscribers=[LiveTree(terminal), LiveTree(piped)])
    assert ("\x1b[33m" in terminal.getvalue()) == colored
    assert "\x1b" not in piped.getvalue()


def test_unicode_is_a_choice() -> None:
    """The same run is shown with the other signs."""
    stream = io.StringIO()
    tree, world, context = scene()
    run_episode(tree, world, context, [LiveTree(stream, unicode=True)])
    text = stream.getvalue()
    assert text.startswith(unicode_tree(SPEC))
    assert unicode_tree(SPEC, tree.states()) in text
    assert not any(mark.ascii in text for mark in MARKS.values())


def test_legends_fit() -> None:
    """Both legends name every mark within 80 columns."""
    for unicode in (False, True):
        text = legend(unicode)
        assert len(text) <= 80
        assert all((mark.unicode if unicode else mark.ascii) in text for mark in MARKS.values())


def test_a_dumb_terminal_is_written_to_line_by_line(monkeypatch: pytest.MonkeyPatch) -> None:
    """As a file: it would show what moves the cursor."""
    monkeypatch.setenv("TERM", "dumb")
    stream = Terminal()
    LiveTree(stream, "demo").show(LONG)
    assert "\x1b" not in stream.getvalue()


class Full(io.StringIO):
    """On a disk without room."""

    def write(self, text: str) -> int:
        """Raises OSError."""
        raise OSError(28, "No space left on device")


def test_a_stream_that_is_full_ends_no_run() -> None:
    """Who watches never steers."""
    LiveTree(Full(), "demo").show(LONG)
