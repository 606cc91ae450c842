"""`mpvi run --resume`: an episode that was stopped goes on, its trace and its distances too."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from mpvi_bt.executive.trace.read import read_trace
from tests.conftest import Shell

TREE = """\
tree: laps
blackboard: {laps: 0}
root:
  repeat: 4
  child:
    sequence: one lap
    memory: true
    children:
      - {navigate: kitchen}
      - {set: laps, add: 1}
"""


@pytest.mark.rare
@pytest.mark.parametrize("changes", [1, 4, 7])
def test_a_stopped_dry_run_goes_on(changes: int, mpvi: Shell, tmp_path: Path) -> None:
    """Stopped at any change, it ends as if it had not been, and its trace tells the whole of it."""
    (tmp_path / "laps.yaml").write_text(TREE)
    words = ["run", "--dry", "--tree", "./laps.yaml", "--no-watch"]
    assert mpvi(*words, "--out", "whole").returncode == 0
    stopped = mpvi(*words, "--step", stdin="n\n" * (changes - 1) + "q\n")
    assert stopped.returncode == 130
    assert stopped.stdout.startswith("STOPPED  dry run")
    assert stopped.stdout.endswith("  go on     mpvi run --resume runs/laps_dry.saved.json\n")
    done = mpvi("run", "--resume", "runs/laps_dry.saved.json", "--no-watch")
    assert (done.returncode, done.stderr) == (0, "")
    assert "8.1 s simulated, 244 ticks" in done.stdout
    assert mpvi("diff", "whole/laps_dry.trace.jsonl", "runs/laps_dry.trace.jsonl").returncode == 0
    whole, resumed = (read_trace(tmp_path / folder / "laps_dry.trace.jsonl") for folder in ("whole", "runs"))
    assert [tick.tick for tick in resumed.ticks if tick.nodes] == [tick.tick for tick in whole.ticks]
    assert resumed.blackboard(-1) == {"laps": 4}
    walls = [tick.wall_s for tick in resumed.ticks]
    assert walls == sorted(walls)


@pytest.mark.rare
def test_it_can_be_stopped_and_resumed_again(mpvi: Shell, tmp_path: Path) -> None:
    """The file that it went on from is replaced by the newer one."""
    (tmp_path / "laps.yaml").write_text(TREE)
    resume = ["run", "--resume", "runs/laps_dry.saved.json", "--no-watch"]
    assert mpvi("run", "--dry", "--tree", "./laps.yaml", "--no-watch", "--step", stdin="n\nq\n").returncode == 130
    assert mpvi(*resume, "--step", stdin="n\nn\nn\nq\n").returncode == 130
    ticks = json.loads((tmp_path / "runs/laps_dry.saved.json").read_text())["run"]["tree"]["ticks"]
    assert 61 < ticks < 244
    assert mpvi(*resume).returncode == 0


def test_the_tree_is_the_one_that_was_stopped(mpvi: Shell, tmp_path: Path) -> None:
    """Whatever became of its file since."""
    (tmp_path / "laps.yaml").write_text(TREE)
    assert mpvi("run", "--dry", "--tree", "./laps.yaml", "--no-watch", "--step", stdin="q\n").returncode == 130
    (tmp_path / "laps.yaml").unlink()
    done = mpvi("run", "--resume", "runs/laps_dry.saved.json", "--no-watch", "--json")
    assert json.loads(done.stdout)["ticks"] == 244


@pytest.mark.parametrize(
    ("content", "more", "said"),
    [
        (None, [], "x.json: no such file"),
        ("{", [], "not valid JSON"),
        ("{}", [], "missing key 'config'"),
        ('{"saved": 99}', [], "x.json:1:11: format 99; this mpvi_bt ("),
        (None, ["--seed", "0"], "--seed can't be given beside it"),
        (None, ["picking_up_trash"], "TASK can't be given beside it"),
    ],
)
def test_what_cannot_be_resumed_is_one_clear_error(
    content: str | None, more: list[str], said: str, mpvi: Shell, tmp_path: Path
) -> None:
    """Exit code 2, what is wrong, no traceback."""
    if content is not None:
        (tmp_path / "x.json").write_text(content)
    done = mpvi("run", "--resume", "x.json", *more)
    assert done.returncode == 2
    assert said in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.rare
def test_it_goes_on_from_another_folder(mpvi: Shell, tmp_path: Path) -> None:
    """With the rules that it was begun with; once it has come to its end nothing is left to go on from."""
    (tmp_path / "laps.yaml").write_text(TREE)
    (tmp_path / "rules.yaml").write_text("substitute:\n  - nodes: '*/navigate'\n    run: 0.1\n")
    words = ["run", "--dry", "--tree", "./laps.yaml", "--no-watch", "--substitute", "rules.yaml"]
    (tmp_path / "other").mkdir()
    here: tuple[Path, list[str]] = (tmp_path, ["runs/laps_dry.saved.json"])
    for folder, file in (here, (tmp_path / "other", ["../runs/laps_dry.saved.json", "--out", "../runs"])):
        assert mpvi(*words, "--step", stdin="n\nq\n").returncode == 130
        done = mpvi("run", "--resume", *file, "--no-watch", cwd=folder)
        assert (done.returncode, done.stderr) == (0, "")
        assert not (tmp_path / "runs/laps_dry.saved.json").exists()


@pytest.mark.rare
@pytest.mark.slow
@pytest.mark.render
def test_an_episode_goes_on_in_the_simulator(mpvi: Shell, tmp_path: Path) -> None:
    """Ctrl-C while a hand is busy; then the rest, to the task's goal, with the whole way counted."""
    command = [sys.executable, "-c", "from mpvi_bt.apps.cli import main; main()", "run", "picking_up_trash"]
    command += ["--detector", "oracle"]  # it is not the search that is tried here
    process = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, text=True, env=os.environ)
    assert process.stdout
    for line in process.stdout:
        if "4 pick up a can of soda" in line and "[*]" in line:
            break
    time.sleep(0.2)
    process.send_signal(signal.SIGINT)
    rest = process.communicate()[0]
    assert process.returncode == 130, rest
    assert "mpvi run --resume runs/picking_up_trash_0_0.saved.json" in rest
    before = json.loads((tmp_path / "runs/picking_up_trash_0_0.json").read_text())
    done = mpvi("run", "--resume", "runs/picking_up_trash_0_0.saved.json", "--no-watch", "--json", timeout=300)
    result = json.loads(done.stdout)
    assert (done.returncode, result["success"], result["q_score"]["final"]) == (0, True, 1.0)
    assert result["time"]["simulator_time"] > before["time"]["simulator_time"] + 10
    assert result["agent_distance"]["base"] > before["agent_distance"]["base"]
    ticks = [tick.tick for tick in read_trace(tmp_path / "runs/picking_up_trash_0_0.trace.jsonl").ticks]
    assert ticks[0] == 1
    assert ticks == sorted(ticks)
