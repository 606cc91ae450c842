"""The trace of a run that goes on: appended to what the file tells of it before, and to nothing else."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from mpvi_bt.executive.ticking.dry import EmptyWorld, dry_tree, run_dry
from mpvi_bt.executive.ticking.saved_run import SavedRun, save_run
from mpvi_bt.executive.trace.read import read_trace
from mpvi_bt.executive.tree.yaml_io import parse_tree
from mpvi_bt.runs.recording.recorder import Recorder

TREE = """\
tree: laps
blackboard: {laps: 0}
root:
  repeat: 4
  child:
    sequence: lap
    memory: true
    children:
      - {timeout: 0.3, child: {wait: 0.2}}
      - {set: laps, add: 1}
      - {say: lap $laps}
"""
CONFIG = {"dry": True, "folder": Path("here")}


def play(
    file: Path,
    stop_after: int = 10**9,
    saved: SavedRun | None = None,
    text: str = TREE,
    config: Mapping[str, Any] = CONFIG,
    seed: int = 1,
) -> SavedRun:
    """Run and record until the end, or for so many ticks; how it stood then."""
    tree, world = dry_tree(parse_tree(text)), EmptyWorld()
    kept: list[SavedRun] = []

    def stop() -> bool:
        if tree.ticks < stop_after:
            return False
        kept.append(save_run(tree, world))
        return True

    run_dry(tree, subscribers=[Recorder(file, config, seed, saved)], stop=stop, world=world, saved=saved)
    return kept[0] if kept else save_run(tree, world)


@pytest.mark.parametrize("ticks", [1, 5, 7, 8, 20])
@pytest.mark.parametrize("more", [0, 3, 100])
def test_what_the_file_tells_of_the_run_is_continued(ticks: int, more: int, tmp_path: Path) -> None:
    """Whatever it tells beyond the point from which the run goes on is replaced."""
    play(tmp_path / "whole")
    saved = play(tmp_path / "t", ticks)
    play(tmp_path / "t", ticks + more)
    play(tmp_path / "t", saved=saved)
    whole, resumed = read_trace(tmp_path / "whole"), read_trace(tmp_path / "t")
    assert [(t.tick, t.time_s, t.blackboard) for t in resumed.ticks] == [
        (t.tick, t.time_s, t.blackboard) for t in whole.ticks
    ]
    for i in range(len(whole.ticks)):
        assert resumed.states(i) == whole.states(i)


@pytest.mark.parametrize(
    "other",
    [
        {"seed": 2},
        {"config": {"dry": True, "folder": Path("there")}},
        {"text": TREE.replace("timeout: 0.3", "timeout: 0.4")},
        {"text": TREE.replace("repeat: 4", "repeat: 5")},
    ],
)
def test_the_trace_of_another_run_is_not_continued(other: dict[str, Any], tmp_path: Path) -> None:
    """Of another seed, other settings or another tree: the file begins anew, where the run goes on."""
    saved = play(tmp_path / "t", 9)
    play(tmp_path / "t", **other)
    play(tmp_path / "t", saved=saved)
    trace = read_trace(tmp_path / "t")
    assert (trace.ticks[0].tick, trace.seed, trace.config) == (10, 1, {"dry": True, "folder": "here"})
    assert trace.states(-1)["repeat"].status == "SUCCESS"


def other_feedback(data: dict[str, Any]) -> None:
    """It was in another round."""
    data["tree"]["nodes"]["repeat"]["feedback"] = "2 of 4 done"


def other_status(data: dict[str, Any]) -> None:
    """Another child was running."""
    del data["tree"]["nodes"]["repeat/lap/timeout/wait"]


def other_value(data: dict[str, Any]) -> None:
    """It had counted otherwise."""
    data["blackboard"]["laps"] = 2


@pytest.mark.parametrize("change", [other_feedback, other_status, other_value])
def test_a_run_that_stood_otherwise_at_that_tick_is_another(change: Any, tmp_path: Path) -> None:
    """Though tree, settings and seed are the same: what was saved is not what the trace says of that tick."""
    data = play(tmp_path / "t", 10).model_dump(mode="json")
    change(data)
    play(tmp_path / "t", saved=SavedRun.model_validate(data))
    assert read_trace(tmp_path / "t").ticks[0].tick == 11


@pytest.mark.parametrize("off", [0, 1, 2, 30])
def test_a_trace_that_was_cut_is_continued_on_a_line_of_its_own(off: int, tmp_path: Path) -> None:
    """Cut right before its last line end, too, where the last line is whole."""
    saved = play(tmp_path / "t", 13)
    lines = (tmp_path / "t").read_bytes().splitlines(keepends=True)[:-1]
    raw = b"".join(lines)
    (tmp_path / "t").write_bytes(raw[: len(raw) - off])
    play(tmp_path / "t", saved=saved)
    trace = read_trace(tmp_path / "t")
    assert trace.end is not None
    assert trace.blackboard(-1) == {"laps": 4}
    assert trace.ticks[0].tick == (1 if off < 2 else 14)
