"""The debugger: where it pauses, what it answers, and that it steers nothing."""

from __future__ import annotations

import contextlib
import io
import os
import pty
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mpvi_bt.executive.ticking.debugger import Debugger
from mpvi_bt.executive.ticking.dry import EmptyWorld, dry_context, dry_tree, run_dry
from mpvi_bt.executive.ticking.loop import Outcome, Watcher, run_episode
from mpvi_bt.executive.ticking.saved_run import SavedRun, restore_world, save_run
from mpvi_bt.executive.tree.yaml_io import parse_tree
from mpvi_bt.ground.errors import UserError
from mpvi_bt.runs.recording.recorder import Recorder
from tests.conftest import Shell
from tests.test_dry import lasting
from tests.test_tutorial import ROOT, play

FETCH = """
tree: fetch
blackboard: {place: sofa}
root:
  sequence: fetch
  memory: true
  children:
    - navigate: cup
    - attempt: take it
      child:
        timeout: 1.0
        child:
          check_complete: the cup is held in a gripper
    - set: tries
      value: 2
    - navigate: $place
"""
SPEC = parse_tree(FETCH)


def said(script: str, breaks: tuple[str, ...] = (), step: bool = False, root: str = "") -> str:
    """What it says."""
    stream = io.StringIO()
    tree = dry_tree(parse_tree(f"tree: t\nroot:\n{root}") if root else SPEC)
    run_dry(tree, subscribers=[Debugger(io.StringIO(script), stream, breaks, step)])
    return stream.getvalue()


def pauses(text: str) -> list[tuple[int, str]]:
    """Tick and news of every pause."""
    return [(int(tick), news) for tick, news in re.findall(r"^tick (\d+), [\d.]+ s: (.*)$", text, re.M)]


def test_it_pauses_where_a_node_begins() -> None:
    """Once for each round of a node that fits, in the tick in which it begins."""
    assert pauses(said("c\nc\nc\n", ("*/navigate",))) == [
        (1, "break at fetch/navigate"),
        (91, "break at fetch/navigate#2"),
    ]


def test_a_node_that_ends_at_once_begins_too() -> None:
    """It never is RUNNING, but it pauses."""
    assert pauses(said("c\n", ("*/set",))) == [(91, "break at fetch/set")]


def test_every_round_of_a_node_begins_anew() -> None:
    """Tried again at the next tick, and ticked again at every tick under a parent without memory."""
    tried = "  retry: 3\n  child:\n    fail: nope\n"
    assert [tick for tick, _ in pauses(said("c\n" * 9, ("*/fail",), root=tried))] == [1, 2, 3]
    reactive = "  sequence:\n  memory: false\n  children:\n    - succeed:\n    - wait: 2 steps\n"
    assert [tick for tick, _ in pauses(said("c\n" * 9, ("*/succeed",), root=reactive))] == [1, 2, 3]
    assert [tick for tick, _ in pauses(said("c\n" * 9, ("*/wait",), root=reactive))] == [1]


def test_a_node_that_is_cut_off_in_the_tick_it_begins_in_is_seen() -> None:
    """A sibling that ends the parallel does not hide it."""
    side = "  parallel:\n  policy: success_on_one\n  children:\n    - wait: 1\n    - succeed:\n"
    assert pauses(said("c\n", ("*/wait",), root=side)) == [(1, "break at parallel/wait")]


def test_step_pauses_wherever_something_changes() -> None:
    """At each tick at which a status or the blackboard changes, and at no other."""
    text = said("\n" * 99, step=True)
    assert [tick for tick, _ in pauses(text)] == [1, 61, 91, 151]
    assert (
        "tick 91, 3.0 s: 6 changes\n"
        "interrupted fetch/take it/timeout/check_complete\n"
        "failure     fetch/take it/timeout\n"
        "success     fetch/take it\n"
        "success     fetch/set\n"
        "running     fetch/navigate#2\n"
        "blackboard\n"
    ) in text


def test_single_ticks() -> None:
    """`t` pauses at the very next tick, changed or not."""
    assert pauses(said("t\nt\nc\n", step=True))[1:] == [(2, "nothing changed"), (3, "nothing changed")]


def test_a_counter_that_changes_is_a_change() -> None:
    """Also where no status does, as under a repeat."""
    counting = "  repeat: 3\n  child:\n    set: n\n    add: 1\n"
    assert [tick for tick, _ in pauses(said("\n" * 9, step=True, root=counting))] == [1, 2, 3]


def test_a_run_that_goes_on_begins_nothing_anew() -> None:
    """Restored in the middle of a drive, it pauses where the next node begins, with the number of that tick."""
    tree, world = dry_tree(SPEC), EmptyWorld()
    kept: list[SavedRun] = []

    def stop() -> bool:
        if tree.ticks == 30:
            kept.append(save_run(tree, world))
        return bool(kept)

    run_episode(tree, world, dry_context(world, tree), stop=stop)
    again, fresh, stream = dry_tree(SPEC), EmptyWorld(), io.StringIO()
    context = dry_context(fresh, again)
    restore_world(kept[0], fresh, context)
    debugger = Debugger(io.StringIO("c\n" * 9), stream, ["*/navigate", "*/take it"])
    run_episode(again, fresh, context, [debugger], saved=kept[0].tree)
    assert [tick for tick, _ in pauses(stream.getvalue())] == [61, 91]


def test_it_pauses_before_the_world_moves() -> None:
    """At the first pause no step was taken."""
    moved = []

    class Stream(io.StringIO):
        def write(self, text: str, /) -> int:
            moved.append(tree.context.clock.steps)
            return super().write(text)

    tree = dry_tree(SPEC)
    run_dry(tree, subscribers=[Debugger(io.StringIO("c\n"), Stream(), ["fetch"])])
    assert set(moved) == {0}


def test_what_it_shows() -> None:
    """The tree, the blackboard, the failures, a new break, help for what it does not know."""
    text = said("s\nk\ne\nb */nope\nb fetch/navigate#2\nwhat?\nc\ne\ns\nk\nc\n", ("fetch",))
    first, second = text.split("break at fetch/navigate#2")
    assert "--> Navigate(cup) [*] 0 s, 2 s left" in first
    assert "place = 'sofa'" in first
    assert "tries = 2\n" not in first
    assert "no failure so far" in first
    assert "b: no node of tree 'fetch' fits '*/nope'." in first
    assert "breaks at fetch/navigate#2" in text
    assert first.count("Enter, n  go on to the next change") == 2
    assert "3.0 s: fetch/take it/timeout: timeout: not done within 1 s" in second
    assert "-^- attempt: take it [!]" in second
    assert "tries = 2\n" in second
    assert max(map(len, text.splitlines())) <= 80


def test_quit_is_ctrl_c() -> None:
    """The loop ends as interrupted, and all is closed."""
    ends: list[str] = []

    class Last(Watcher):
        def end(self, outcome: Outcome) -> None:
            ends.append(outcome.ending)

    with pytest.raises(KeyboardInterrupt):
        run_dry(dry_tree(SPEC), subscribers=[Debugger(io.StringIO("q\n"), io.StringIO(), step=True), Last()])
    assert ends == ["interrupted"]


def test_where_the_input_ends_it_goes_on_to_the_end() -> None:
    """Said once, and nothing pauses any more."""
    text = said("", ("*",), step=True)
    assert len(pauses(text)) == 1
    assert text.count("no more input: going on to the end") == 1


def test_a_break_that_fits_nothing_is_refused() -> None:
    """With the nearest that does."""
    with pytest.raises(UserError, match=r"--break: no node .* fits 'fetch/navigat'\. Did you mean 'fetch/navigate'"):
        said("c\n", ("fetch/navigat",))


def test_a_kind_is_answered_with_the_path_of_such_a_node() -> None:
    """Paths are made of names; a node that has one of its own is not found by its kind."""
    with pytest.raises(UserError, match=r"Did you mean 'fetch/take it'\?"):
        said("", ("*/fetch/attempt",))


@given(st.lists(st.sampled_from(["", "n", "t", "c", "s", "k", "e", "b *", "x"]), max_size=40))
def test_whatever_is_typed_the_run_is_the_same(tmp_path_factory: pytest.TempPathFactory, lines: list[str]) -> None:
    """It steers nothing: the trace is that of a run without it."""
    folder = tmp_path_factory.mktemp("traces")
    script = "".join(f"{line}\n" for line in lines)
    for name, watchers in {"plain": [], "debugged": [Debugger(io.StringIO(script), io.StringIO(), step=True)]}.items():
        run_dry(dry_tree(SPEC), subscribers=[Recorder(folder / name, {}, 0), *watchers])
    assert lasting(folder / "plain") == lasting(folder / "debugged")


def test_from_the_command_line(mpvi: Shell, tmp_path: Path) -> None:
    """Questions go to stderr, so that stdout stays what it is; piped answers are read, then it goes on."""
    words = ["run", "--dry", "--tree", "go_to", "--break", "*/navigate"]
    plain, debugged = mpvi(*words[:-2], stdin=""), mpvi(*words, stdin="k\nc\n")
    assert debugged.returncode == 0
    assert debugged.stdout == plain.stdout
    assert "break at go to the kitchen/timeout/navigate" in debugged.stderr
    assert "the blackboard is empty" in debugged.stderr


def test_quit_from_the_command_line_ends_with_130_and_a_trace(mpvi: Shell, tmp_path: Path) -> None:
    """As Ctrl-C does."""
    done = mpvi("run", "--dry", "--tree", "go_to", "--step", stdin="q\n")
    assert done.returncode == 130
    assert "Traceback" not in done.stderr
    assert '"end": "interrupted"' in (tmp_path / "runs" / "go_to_dry.trace.jsonl").read_text()


def test_on_a_terminal_nothing_is_drawn_over(tmp_path: Path) -> None:
    """With breaks the tree is told line by line, since a drawing in place would cover the questions."""
    parent, child = pty.openpty()
    command = [
        sys.executable,
        "-c",
        "from mpvi_bt.apps.cli import main; main()",
        "run",
        "--dry",
        "--tree",
        "go_to",
        "--step",
    ]
    process = subprocess.Popen(command, cwd=tmp_path, stdin=child, stdout=child, stderr=child)
    os.close(child)
    seen, answers = b"", 0
    deadline = time.monotonic() + 30
    while time.monotonic() < deadline:
        try:
            seen += os.read(parent, 65536)
        except OSError:  # the other end was closed
            break
        if seen.count(b"debug> ") > answers:
            answers += 1
            os.write(parent, b"\n")
    assert process.wait(timeout=60) == 0
    assert answers == 2
    assert b"\x1b[" not in seen
    os.close(parent)


def test_ctrl_c_at_the_question_stops_at_once(tmp_path: Path) -> None:
    """Without Enter after it: the run is saved, and its end told."""
    parent, child = pty.openpty()
    command = [sys.executable, "-c", "from mpvi_bt.apps.cli import main; main()"]
    command += ["run", "--dry", "--tree", "go_to", "--step", "--no-watch"]
    process = subprocess.Popen(command, cwd=tmp_path, stdin=child, stdout=child, stderr=child)
    os.close(child)
    seen = b""
    with contextlib.suppress(OSError):  # the other end was closed
        while data := os.read(parent, 65536):
            if b"debug> " in seen + data and b"debug> " not in seen:
                time.sleep(0.1)
                process.send_signal(signal.SIGINT)
            seen += data
    os.close(parent)
    assert process.wait(timeout=20) == 130
    assert b"STOPPED  dry run" in seen
    assert (tmp_path / "runs/go_to_dry.saved.json").is_file()


@pytest.mark.rare
def test_the_page_about_it_is_true(tmp_path: Path) -> None:
    """Every command of docs/debugging.md prints what stands there."""
    text = (ROOT / "docs" / "debugging.md").read_text(encoding="utf-8")
    assert play(text, tmp_path) == text


def test_pauses_are_apart_in_wall_time() -> None:
    """The time for which a person thinks is that of the pause, and of no subscriber."""

    class Slow(io.StringIO):
        def readline(self, *size: int | None) -> str:  # type: ignore[override]
            time.sleep(0.05)
            return super().readline()

    outcome = run_dry(dry_tree(SPEC), subscribers=[Debugger(Slow("t\nt\nt\nc\n"), io.StringIO(), step=True)])
    assert outcome.wall_s["paused"] >= 0.2
    assert outcome.wall_s["watching"] < 0.1
