"""Laws of the benchmark that compares triggers with polling."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from benchmarks.rows import append
from benchmarks.triggers.__main__ import main, table, text
from benchmarks.triggers.play import Job, Row
from mpvi_bt.runs.episode.queries import Queries

FIRST, POLLING = "proprioceptive", "periodic:300"


def row(task: str, instance: int, trigger: str, q: float, asked: int = 4, false_yes: int = 0, problem: str = "") -> Row:
    """An episode of two units."""
    counted = Queries(units=2, asked=asked, yes=2, false_yes=false_yes)
    return Row(Job(task, instance, trigger, "visual:fp=0.1", "reactive"), q, q == 1, "success", 100.0, counted, problem)


ROWS = [
    row("trash", 0, FIRST, 1.0),
    row("trash", 1, FIRST, 0.5),
    row("trash", 0, POLLING, 0.5, 12, 1),
    row("trash", 1, POLLING, 0.25, 20, 2),
    row("eggs", 0, FIRST, 0.0),
    row("eggs", 0, POLLING, 0.25, 8),
    row("eggs", 1, FIRST, 1.0),  # not played with polling yet
]


def test_the_table_compares_the_same_instances() -> None:
    """Of each task and of all: q, its change, and what was asked and wrongly granted a unit."""
    records = {(r["task"], r["trigger"]): r for r in table(ROWS)}
    trash = records["trash", POLLING]
    assert (trash["n"], trash["q"], trash["queries"], trash["false_yes"]) == (2, 0.375, 8.0, 0.75)
    assert trash["q_change"] == pytest.approx(-0.5)
    assert records["trash", FIRST]["q_change"] is None
    assert records["eggs", FIRST]["n"] == 1
    assert records["eggs", POLLING]["q_change"] is None, "there is nothing to compare with"
    assert (records["all", FIRST]["n"], records["all", FIRST]["q"]) == (3, 0.5)
    assert records["all", POLLING]["q_change"] == pytest.approx(1 / 3 / 0.5 - 1)


def test_the_papers_figure_stands_beside_the_table() -> None:
    """Line by line, all tasks first."""
    lines = text(table(ROWS)).splitlines()
    assert lines[0] == "checker visual:fp=0.1, policy reactive, detector segmentation, map prior"
    assert lines[4].startswith("| all | proprioceptive | 3 | 0.500 |  | 2.00 | 0.00 |")
    assert lines[5].startswith("| all | periodic:300 | 3 | 0.333 | -33% | 6.67 | 0.50 |")
    assert lines[-1] == "the paper's change of q: -47%"


def test_an_episode_that_broke_counts_as_nothing_and_is_told() -> None:
    """As a missing one does in a suite."""
    (record,) = [r for r in table([row("trash", 0, FIRST, 0.0, 0, problem="went away")]) if r["task"] == "all"]
    assert (record["q"], record["broken"]) == (0.0, 1)
    assert "1, 1 broken" in text([record])


def test_rows_are_kept_and_read_back(tmp_path: Path) -> None:
    """A killed run goes on where it stopped; the table needs nothing else."""
    out = tmp_path / "rows.jsonl"
    for r in ROWS:
        assert Row.of(json.loads(json.dumps(r.data()))) == r
        append(out, r.data())
    done = CliRunner().invoke(main, ["--table", "--json", "--out", str(out)])
    assert json.loads(done.output) == table(ROWS)
    append(out, {"task": "trash"})
    done = CliRunner().invoke(main, ["--table", "--out", str(out)])
    assert done.exit_code == 2
    assert done.output.startswith(f"error: {out}:8: no result of an episode")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--tasks", "picking_up_trsh"], "Did you mean 'picking_up_trash'"),
        (["--triggers", "periodic:0"], "whole number of steps"),
        (["--checker", "visual:fp=2"], "fp is 0 to 1"),
        (["--instances", "99"], "instance 99 is out of range"),
    ],
)
def test_what_cannot_be_is_refused_before_the_first_episode(options: list[str], said: str, tmp_path: Path) -> None:
    """In one line."""
    done = CliRunner().invoke(main, [*options, "--out", str(tmp_path / "rows.jsonl")])
    assert done.exit_code == 2
    assert said in done.output
    assert not list(tmp_path.iterdir())
