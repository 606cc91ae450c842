"""mpvi replay, explain, diff."""

from __future__ import annotations

import json
import os
import pty
import re
import select
import subprocess
import sys
import time
from pathlib import Path

import pytest
from click.testing import CliRunner
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mpvi_bt.apps.cli.render import render
from mpvi_bt.apps.cli.replay import Player, replay
from mpvi_bt.apps.cli.trace import diff_, explain_
from mpvi_bt.executive.drawing.cells import columns
from mpvi_bt.executive.drawing.text import ascii_tree
from mpvi_bt.executive.trace.read import read_trace
from mpvi_bt.ground.errors import FileProblems
from tests.conftest import Shell
from tests.test_trace import FETCH, episode

RUN = CliRunner()


@pytest.fixture
def trace(tmp_path: Path) -> Path:
    """Of a fetch that fails."""
    episode(FETCH, tmp_path / "t.jsonl", answers=(False,), seed=3)
    return tmp_path / "t.jsonl"


def test_replay_piped_prints_every_change(trace: Path) -> None:
    """The tree, then a line a change with its simulated time, then how it ended; 80 columns at most."""
    lines = RUN.invoke(replay, [str(trace)]).output.splitlines()
    size = len(FETCH.nodes)
    assert lines[:size] == ascii_tree(FETCH).splitlines()
    run = read_trace(trace)
    changes = [line for line in lines[size:-1] if "blackboard:" not in line]
    assert len(changes) == sum(len(tick.nodes) for tick in run.ticks)
    assert all(re.match(r" +\d+\.\d s  ", line) for line in lines[size:-1])
    assert "    0.0 s  blackboard: cups = 0" in lines
    assert lines[-1] == "plan failed after 5.0 s, 1 unit given up"
    assert all(columns(line) <= 80 for line in lines)


def test_replay_of_a_cut_trace_says_so(trace: Path) -> None:
    """A reader must not take the last line for the end."""
    trace.write_bytes(trace.read_bytes()[:-40])
    assert RUN.invoke(replay, [str(trace)]).output.splitlines()[-1].startswith("the trace was cut off here")
    assert "the trace breaks off after 5.0 s" in RUN.invoke(explain_, [str(trace)]).output


def test_replay_shows_a_tick(trace: Path) -> None:
    """--tick draws the whole tree as it stood at that very tick; tick 0 is before the first, and beyond none is."""
    run = read_trace(trace)
    i = run.index_at(100)
    assert run.ticks[i].tick < 100 < run.ticks[i + 1].tick
    for options, draw in (([], "[x]"), (["--unicode"], "✕")):
        shown = RUN.invoke(replay, [str(trace), "--tick", "100", *options]).output
        assert f"change {i + 1} of {len(run.ticks)}: tick 100, 3.3 s" in shown
        assert len(shown.splitlines()) == len(FETCH.nodes) + 4  # title, where, blackboard, legend
        assert draw in shown
    assert ascii_tree(FETCH, run.states_at(100)) in RUN.invoke(replay, [str(trace), "--tick", "100"]).output
    assert ascii_tree(FETCH, {}) in RUN.invoke(replay, [str(trace), "--tick", "0"]).output
    for command in (replay, render):
        beyond = RUN.invoke(command, [str(trace), "--tick", "99999"])
        assert str(beyond.exception).endswith(f"t.jsonl: there is no tick 99999; the last is {run.last_tick}.")
    last = RUN.invoke(replay, [str(trace), "--tick", str(run.last_tick)]).output
    assert "plan failed after 5.0 s" in last
    assert "failed: " in last


def test_replay_as_json(trace: Path) -> None:
    """Every tick's changes, or all that held at one."""
    run = read_trace(trace)
    ticks = json.loads(RUN.invoke(replay, [str(trace), "--json"]).output)
    assert [tick["tick"] for tick in ticks] == [tick.tick for tick in run.ticks]
    assert ticks[0]["nodes"]["fetch"]["status"] == "RUNNING"
    assert sum(len(tick["queries"]) for tick in ticks) == 1
    assert [handoff for tick in ticks for handoff in tick["diagnosis"]]
    held = json.loads(RUN.invoke(replay, [str(trace), "--json", "--tick", "100"]).output)
    assert held["nodes"] == {path: vars(state) for path, state in run.states_at(100).items()}
    assert (held["tick"], held["time_s"]) == (100, pytest.approx(99 / 30))
    assert held["blackboard"] == {"cups": 0}


def test_keys_move_through_a_trace(trace: Path) -> None:
    """Forward, back, by ten, to either end, to the next failure; never beyond."""
    run = read_trace(trace)
    player = Player(run)
    last = len(run.ticks) - 1
    assert last > 3
    path = []
    for key in ("n", "\x1b[C", " ", "p", "\x1b[D", "\x1b[D", "p", "\x1b[6~", "n", "\x1b[5~", "\x1b[F", "\x1b[H", "?"):
        player.press(key)
        path.append(player.i)
    assert path == [1, 2, 3, 2, 1, 0, 0, min(10, last), last, max(0, last - 10), last, 0, 0]
    player.press("f")
    assert player.i == next(
        i for i in range(1, last + 1) if any(s.status == "FAILURE" or s.gave_up for s in run.ticks[i].nodes.values())
    )
    player.press("\x1b[F")
    player.press("f")
    assert player.i == last


@pytest.mark.parametrize("size", [(80, 24), (80, 8), (40, 12), (200, 60)])
def test_a_screen_fits_the_terminal(trace: Path, size: tuple[int, int]) -> None:
    """At every tick; it names the tick, marks what changed and shows the running path and the blackboard."""
    run = read_trace(trace)
    player = Player(run)
    for i, tick in enumerate(run.ticks):
        player.i = i
        lines = [re.sub(r"\x1b\[[0-9;]*m", "", line) for line in player.screen(os.terminal_size(size))]
        assert len(lines) <= size[1]
        assert all(columns(line) <= size[0] for line in lines)
        assert f"change {i + 1} of {len(run.ticks)}" in lines[0]
        if size == (80, 24):
            assert any(line.startswith("> ") for line in lines)
            assert any(line.startswith("blackboard: ") for line in lines)
            assert ("*cups" in "".join(lines)) == ("cups" in tick.blackboard)


def test_a_trace_without_a_tick_is_shown(trace: Path) -> None:
    """One that was cut right after its first line has the tree, before the first tick."""
    trace.write_bytes(trace.read_bytes().splitlines(keepends=True)[0])
    player = Player(read_trace(trace))
    for key in ("n", "p", "f", "\x1b[F", "\x1b[H", "\x1b[6~"):
        player.press(key)
        assert "change 0 of 0: before the first tick" in player.screen(os.terminal_size((80, 24)))[0]
    assert "cut off" in RUN.invoke(replay, [str(trace)]).output
    assert json.loads(RUN.invoke(replay, [str(trace), "--json"]).output) == []
    assert RUN.invoke(explain_, [str(trace)]).output == "fetch: the trace breaks off after 0.0 s, tick 0\n"
    assert RUN.invoke(diff_, [str(trace), str(trace)]).output.endswith("they went the same way\n")


def test_replay_on_a_terminal(trace: Path) -> None:
    """A person steps through it, and gets the screen back on q."""
    ours, theirs = pty.openpty()
    code = "from mpvi_bt.apps.cli import main; main()"
    process = subprocess.Popen(
        [sys.executable, "-c", code, "replay", str(trace)],
        stdin=theirs,
        stdout=theirs,
        env={**os.environ, "LINES": "24", "COLUMNS": "80", "TERM": "xterm"},
    )
    os.close(theirs)
    shown = ""

    def until(text: str) -> None:
        nonlocal shown
        end = time.monotonic() + 20
        while text not in shown:
            assert select.select([ours], [], [], max(0.0, end - time.monotonic()))[0], f"no {text!r} in {shown!r}"
            shown += os.read(ours, 65536).decode()
        shown = shown.split(text, 1)[1]

    until("change 1 of")
    os.write(ours, b"n")
    until("change 2 of")
    os.write(ours, b"\x1b[C\x1b[C")  # typed ahead
    until("change 4 of")
    os.write(ours, b"\x1b[D")
    until("change 3 of")
    os.write(ours, b"\x1b[F")
    until("plan failed after")
    os.write(ours, b"q")
    until("\x1b[?1049l")
    assert process.wait(timeout=20) == 0
    os.close(ours)


def test_explain_prints_the_chain(trace: Path) -> None:
    """Root to leaf, for people and for programs."""
    done = RUN.invoke(explain_, [str(trace)])
    assert done.exit_code == 0
    assert done.output.startswith("fetch: plan failed after 5.0 s, 1 unit given up, tick 152\n")
    told = json.loads(RUN.invoke(explain_, [str(trace), "--json"]).output)
    assert (told["ending"], told["cause"]["path"], told["error"]) == ("failure", "fetch", None)
    assert told["cause"]["below"][0]["reason"] == "all_failed"


def test_diff_exits_with_whether_runs_differ(trace: Path, tmp_path: Path) -> None:
    """0 the same, 1 different."""
    episode(FETCH, tmp_path / "same.jsonl", answers=(False,), seed=4)
    episode(FETCH, tmp_path / "other.jsonl", answers=(True,), seed=3)
    same = RUN.invoke(diff_, [str(trace), str(tmp_path / "same.jsonl")], standalone_mode=False)
    assert same.return_value == 0
    assert same.output.endswith("they went the same way\n")
    other = RUN.invoke(diff_, [str(trace), str(tmp_path / "other.jsonl")], standalone_mode=False)
    assert other.return_value == 1
    assert "they part at" in other.output
    told = json.loads(RUN.invoke(diff_, [str(trace), str(tmp_path / "other.jsonl"), "--json"]).output)
    assert (told["same"], told["tick"]) == (False, read_trace(trace).ticks[-2].tick)


def test_what_is_no_trace_ends_with_2(mpvi: Shell, tmp_path: Path) -> None:
    """Each command says where and what, shortly, without a traceback."""
    (tmp_path / "t.jsonl").write_text('{"tree": "t"}\n')
    for words in (["replay", "t.jsonl"], ["explain", "t.jsonl"], ["diff", "t.jsonl", "t.jsonl"], ["explain", "none"]):
        done = mpvi(*words)
        assert done.returncode == 2
        assert re.match(r"t\.jsonl:1:1: no trace|mpvi: none: no such file", done.stderr)
        assert (done.stdout, "Traceback" in done.stderr) == ("", False)


def test_nothing_heavy_loads(trace: Path) -> None:
    """The three commands need neither py_trees nor numpy."""
    code = f"""
import sys
from mpvi_bt.apps.cli.group import run
for words in (["replay", {str(trace)!r}], ["explain", {str(trace)!r}], ["diff", {str(trace)!r}, {str(trace)!r}]):
    assert run(words) == 0
print("LOADED", [m for m in ("py_trees", "numpy", "sapien", "numba", "scipy") if m in sys.modules])
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "LOADED []"


def test_text_from_elsewhere_does_not_reach_the_terminal(tmp_path: Path) -> None:
    """Escape sequences in feedback, reasons, values and names are shown, not obeyed."""
    evil = "\x1b[2J\x07 \n gone"
    state = {"status": "FAILURE", "feedback": evil, "reason": evil, "evidence": evil, "origin": "say"}
    query = {"criterion": evil, "event": evil, "complete": False, "reason": evil, "path": "say", "camera": evil}
    lines = [
        {"trace": 1, "mpvi_bt": evil, "tree": {"tree": "t", "root": {"say": "x"}}, "config": {evil: evil}},
        {"tick": 1, "time_s": 0, "nodes": {"say": state}, "blackboard": {evil: evil}, "queries": [query]},
        {"end": "failure", "tick": 1, "time_s": 0, "failure": {"reason": evil, "path": evil, "time_s": 0}},
    ]
    one, other = tmp_path / "a.jsonl", tmp_path / "b.jsonl"
    one.write_text("".join(json.dumps(line) + "\n" for line in lines))
    lines[2] = {"end": "error", "tick": 1, "time_s": 0, "error": {"message": evil, "path": evil}}
    lines[0] |= {"config": {}}
    other.write_text("".join(json.dumps(line) + "\n" for line in lines))
    for command, words in (
        (replay, [one]),
        (replay, [other, "--tick", "1"]),
        (explain_, [one]),
        (explain_, [other]),
        (diff_, [one, other]),
    ):
        done = RUN.invoke(command, list(map(str, words)), standalone_mode=False)
        assert done.exception is None
        assert "gone" in done.output or command is replay
        assert not re.search(r"[\x00-\x09\x0b-\x1f\x7f]", done.output)
    for line in Player(read_trace(one)).screen(os.terminal_size((80, 24))):
        assert not re.search(r"[\x00-\x1a\x1c-\x1f]|\x1b\[2J", line)


@given(data=st.data())
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=150)
def test_a_damaged_trace_is_shown_or_refused(tmp_path: Path, data: st.DataObject) -> None:
    """Whatever bytes are changed, lines lost or values replaced: every command works, or names problems of the file."""
    whole = tmp_path / "whole.jsonl"
    if not whole.exists():
        episode(FETCH, whole, answers=(False,), seed=3)
    lines = whole.read_bytes().splitlines(keepends=True)
    at = data.draw(st.integers(0, len(lines) - 1))
    match data.draw(st.sampled_from(["byte", "value", "line", "swap"])):
        case "byte":
            i = data.draw(st.integers(0, len(lines[at]) - 1))
            lines[at] = lines[at][:i] + data.draw(st.binary(max_size=2)) + lines[at][i + 1 :]
        case "value":
            words = re.split(rb'("[^"]*"|[0-9.]+)', lines[at])
            i = data.draw(st.integers(0, len(words) // 2 - 1)) * 2 + 1
            words[i] = data.draw(st.sampled_from([b"null", b"-1", b"1e999", b'"FAILURE"', b'"fetch"', b"{}", b"true"]))
            lines[at] = b"".join(words)
        case "line":
            del lines[at]
        case "swap":
            lines[at - 1], lines[at] = lines[at], lines[at - 1]
    damaged = tmp_path / "damaged.jsonl"
    damaged.write_bytes(b"".join(lines))
    more: list[str]
    for command, more in ((replay, []), (replay, ["--tick", "70"]), (explain_, []), (diff_, [str(whole)])):
        done = RUN.invoke(command, [str(damaged), *more], standalone_mode=False)
        assert done.exception is None or isinstance(done.exception, FileProblems), done.exc_info


def test_a_broken_middle_line_is_named(trace: Path) -> None:
    """Its number, not the end's."""
    lines = trace.read_text().splitlines(keepends=True)
    lines[3] = lines[3][:20] + "\n"
    trace.write_text("".join(lines))
    done = RUN.invoke(explain_, [str(trace)])
    assert isinstance(done.exception, FileProblems)
    assert [problem.line for problem in done.exception.problems] == [4]
