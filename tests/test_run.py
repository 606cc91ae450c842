"""`mpvi run`: what it refuses at once, and what it prints."""

from __future__ import annotations

import contextlib
import json
import os
import pty
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from mpvi_bt.apps.cli.score import score
from mpvi_bt.executive.drawing.symbols import MARKS
from mpvi_bt.ground import paths
from tests.conftest import Shell


def result(**changes: Any) -> dict[str, Any]:
    """The parts of a result that are printed."""
    usual: dict[str, Any] = {
        "success": False,
        "q_score": {"final": 2 / 3},
        "goal_fraction": 3 / 4,
        "conditions_met": 1 / 2,
        "ended": "time_limit",
        "goal": [
            {"condition": "inside(can__of__soda.n.01_1, ashcan.n.01_1)", "satisfied": True},
            {"condition": "inside(can__of__soda.n.01_2, ashcan.n.01_1)", "satisfied": False},
        ],
        "time": {"simulator_time": 351.2, "normalized_time": 0.5},
        "agent_distance": {"left": 11.0, "right": 16.0, "base": 6.6},
        "failures": [
            {
                "node": "tidy/4 pick up a can" + ", then another" * 8 + "/timeout",
                "reason": "timeout",
                "feedback": "",
                "time_s": 2.0,
            }
        ],
        "wall": {"total_s": 10.0, "setup_s": 1.0, "loop": {"stepping": 6.0, "watching": 0.01, "total": 9.0}},
        "privileged": ["policy:expert"],
    }
    return usual | changes


@pytest.mark.parametrize(
    ("args", "said"),
    [
        (["picking_up_trsh"], "unknown task 'picking_up_trsh'. Did you mean 'picking_up_trash'?"),
        (["picking_up_trash", "--instance", "10"], "instance 10 is out of range: the task has instances 0 to 9"),
        (["picking_up_trash", "--tree", "picking_up_trahs"], "Did you mean 'picking_up_trash'?"),
        (["picking_up_trash", "--tree", "no/such.yaml"], "no/such.yaml: there is no such file"),
        (["picking_up_trash", "--plan", "no.json"], "no.json: there is no such file"),
        (["picking_up_trash", "--instance", "-1"], "-1 is not in the range x>=0"),
        (["picking_up_trash", "--policy", "exprt"], "'exprt'"),
    ],
)
def test_bad_input_is_one_clear_error(args: list[str], said: str, mpvi: Shell) -> None:
    """Exit code 2, what was given and what would be valid, no traceback."""
    done = mpvi("run", *args)
    assert done.returncode == 2
    assert said in done.stderr
    assert "Traceback" not in done.stderr


def test_a_broken_tree_file_is_said_with_its_place(mpvi: Shell, tmp_path: Path) -> None:
    """A tree with a typing error is refused with file, line and column."""
    (tmp_path / "mine.yaml").write_text("tree: mine\nroot:\n  navigte: trash can\n")
    done = mpvi("run", "picking_up_trash", "--tree", "mine.yaml")
    assert done.returncode == 2
    assert "mine.yaml:3:3:" in done.stderr
    assert "Traceback" not in done.stderr


ROOM = "tree: mine\ninstruction: Go to the kitchen.\nroot:\n  navigate: trash can\n  room: {}\n"


def test_a_room_that_the_house_does_not_have_is_refused(mpvi: Shell, tmp_path: Path) -> None:
    """Before a world is built, in a dry run too, with its place and the nearest."""
    (tmp_path / "mine.yaml").write_text(ROOM.format("kitchn"))
    for dry in ([], ["--dry"]):
        done = mpvi("run", "picking_up_trash", "--tree", "mine.yaml", *dry)
        assert done.returncode == 2
        assert "mine.yaml:5:9: unknown room 'kitchn'. Did you mean 'kitchen'?" in done.stderr
        assert "setting up" not in done.stderr


@pytest.mark.rare
def test_a_tree_of_another_task_is_doubted(mpvi: Shell, tmp_path: Path) -> None:
    """In one line on stderr, and it runs; none where the instruction is the task's or the tree has none."""
    (tmp_path / "mine.yaml").write_text(ROOM.format("kitchen"))
    doubted = mpvi("run", "picking_up_trash", "--dry", "--no-watch", "--tree", "mine.yaml")
    assert doubted.stderr == (
        "mpvi: tree 'mine' was made for another instruction than the task's: 'Go to the kitchen.'\n"
    )
    for tree in ("picking_up_trash", "patrol"):
        assert mpvi("run", "picking_up_trash", "--dry", "--no-watch", "--tree", tree).stderr == ""


@pytest.mark.parametrize("word", ["success", "failures"])
def test_the_score_ends_with_the_command_that_says_why(word: str) -> None:
    """After a failure, and after a success in which a part was given up; not after a clean success."""
    told = result(success=True, failures=[])
    assert "why" not in score(told, Path("runs/x.trace.jsonl"))
    worse = told | {word: result()[word]}
    assert score(worse, Path("runs/x.trace.jsonl")).endswith("\n  why       mpvi explain runs/x.trace.jsonl")
    assert "why" not in score(worse)


def test_a_task_is_needed_without_dry(mpvi: Shell) -> None:
    """A tree alone has no house to run in."""
    done = mpvi("run", "--tree", "hello")
    assert done.returncode == 2
    assert "Missing argument 'TASK'; only with --dry" in done.stderr


@pytest.mark.slow
def test_single_nodes_are_replaced_in_the_simulator(mpvi: Shell, tmp_path: Path) -> None:
    """A rule fails every drive: the tree goes on as it would, the result says so, and the trace explains it."""
    (tmp_path / "rules.yaml").write_text("substitute:\n  - nodes: '*/navigate'\n    fail: no_path\n")
    words = [
        "--checker",
        "oracle",
        "--detector",
        "oracle",
        "--tree",
        "throw_away_cans",
        "--substitute",
        "rules.yaml",
        "--json",
    ]
    done = mpvi("run", "picking_up_trash", *words, timeout=600, VK_DRIVER_FILES="/nowhere")
    assert done.returncode == 1, done.stderr
    told = json.loads(done.stdout)
    assert told["config"]["substitute"] == "rules.yaml"
    assert told["ended"] == "failure"
    explained = mpvi("explain", "runs/picking_up_trash_0_0.trace.jsonl")
    assert "substituted by rules.yaml:2" in " ".join(explained.stdout.split())


@pytest.mark.rare
def test_a_suite_with_a_tree_that_is_not_there_fails_before_workers_start(mpvi: Shell, tmp_path: Path) -> None:
    """Once, not once an episode; parameters without a value and rooms likewise."""
    (tmp_path / "mine.yaml").write_text(ROOM.format("kitchn"))
    for tree, said in {"nope": "unknown tree 'nope'", "pick_up": "object", "mine.yaml": "mine.yaml:5:9"}.items():
        done = mpvi("suite", "run", paths.names("tasks/suites")[0], "--tree", tree)
        assert done.returncode == 2
        assert done.stderr.count(said) == 1
    assert not (tmp_path / "runs").exists()


def test_the_score_says_what_matters_within_80_columns() -> None:
    """q, every goal condition, time, distances, failures, where the wall time went, and who read the truth."""
    text = score(result())
    assert max(map(len, text.splitlines())) <= 80
    assert not any(mark.ascii in text for mark in MARKS.values()), "a cross is a node's failure"
    for part in (
        "q = 0.667  goal not met; ",
        "1 of 2 conditions (0.500); q = 0.750 with what held at the start",
        "met      inside(can__of__soda.n.01_1, ashcan.n.01_1)",
        "not met  inside(can__of__soda.n.01_2, ashcan.n.01_1)",
        "351.2 s simulated\n",
        "base 6.6 m, left hand 11.0 m, right hand 16.0 m",
        "10.0 s: stepping 60%, setting up 10%\n",
        "read by policy:expert",
        "2.0 s: 4 pick up a can, then another",
    ):
        assert part in text


def test_a_pause_is_wall_time_and_no_work() -> None:
    """How long a person let it wait is told in seconds; shares are of the rest."""
    loop = {"stepping": 6.0, "watching": 1.0, "paused": 990.0, "total": 999.0}
    assert "10.0 s, and 990.0 s paused: stepping 60%, watching 10%, setting up" in " ".join(
        score(result(wall={"total_s": 1000.0, "setup_s": 1.0, "loop": loop})).split()
    )


@pytest.mark.parametrize(
    ("success", "normalized", "said"), [(True, 0.5, True), (False, 0.5, False), (True, None, False)]
)
def test_speed_is_compared_where_it_means_something(success: bool, normalized: float | None, said: bool) -> None:
    """Human speed is named for a success, if a human did the task: giving up early is not fast."""
    text = score(result(success=success, time={"simulator_time": 1.0, "normalized_time": normalized}))
    assert ("0.50 of human speed" in text) is said


@pytest.mark.rare
@pytest.mark.slow
def test_the_result_is_printed_as_json_and_written(mpvi: Shell, tmp_path: Path) -> None:
    """`--json` prints what the result file holds, but its digest; the tree goes to stderr; no pictures are needed."""
    done = mpvi(
        "run",
        "picking_up_trash",
        "--checker",
        "oracle",
        "--detector",
        "oracle",
        "--json",
        timeout=600,
        VK_DRIVER_FILES="/nowhere",
    )
    assert done.returncode in (0, 1), done.stderr
    printed = json.loads(done.stdout)
    written = json.loads((tmp_path / "runs" / "picking_up_trash_0_0.json").read_text())
    assert written.pop("digest")
    assert printed == written
    assert printed["success"] is (done.returncode == 0)
    assert "{-} picking_up_trash" in done.stderr


@pytest.mark.slow
def test_interrupt_ends_with_130_and_a_result(tmp_path: Path) -> None:
    """Ctrl-C in the middle of an episode closes it: a result that says so, no traceback, exit code 130."""
    command = [sys.executable, "-c", "from mpvi_bt.apps.cli import main; main()"]
    command += ["run", "picking_up_trash", "--checker", "oracle", "--detector", "oracle"]
    process = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout
    for line in process.stdout:  # until the tree is ticked
        if "[*]" in line:
            break
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "Traceback" not in said
    assert json.loads((tmp_path / "runs" / "picking_up_trash_0_0.json").read_text())["ended"] == "interrupted"


def test_without_a_rendering_device_one_line_says_so(mpvi: Shell) -> None:
    """Where pictures are needed and cannot be drawn, the command says where help is and ends with 3."""
    done = mpvi("run", "picking_up_trash", VK_DRIVER_FILES="/nowhere")
    assert done.returncode == 3
    (line,) = [line for line in done.stderr.splitlines() if "pictures" in line]
    assert "`mpvi doctor`" in line
    assert "Traceback" not in done.stderr


@pytest.mark.slow
def test_on_a_terminal_nothing_is_written_into_the_drawing(tmp_path: Path) -> None:
    """What is said on stderr comes before the tree is first drawn, so that each drawing covers the one before."""
    parent, child = pty.openpty()
    command = [sys.executable, "-c", "from mpvi_bt.apps.cli import main; main()"]
    command += ["run", "picking_up_trash", "--checker", "oracle", "--detector", "oracle", "--tree", "hello"]
    process = subprocess.Popen(command, cwd=tmp_path, stdin=child, stdout=child, stderr=child)
    os.close(child)
    shown = b""
    with contextlib.suppress(OSError):  # the other end was closed
        while data := os.read(parent, 65536):
            shown += data
    os.close(parent)
    assert process.wait(timeout=60) == 1
    before, _, drawn = shown.decode().partition("\x1b[K")
    assert before.splitlines()[0].endswith("setting up")
    assert drawn.count("\x1b[3F") == drawn.count("\x1b[J") - 1
    assert "mpvi:" not in drawn
