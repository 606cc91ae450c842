"""Tables of measurements are what their data make, and data of several origins are not mixed in silence."""

from __future__ import annotations

import json
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.suite.manifest import make_manifest
from mpvi_bt.runs.suite.store import Store
from tests import warm
from tests.fake_episodes import fake_result

ROOT = Path(__file__).parent.parent
RUN: dict[str, Any] = {"command": "python -m benchmarks.x", "commit": "0123abc", "date": "2026-11-25", "processor": "p"}
TABLE: dict[str, Any] = {
    "kind": "table",
    "runs": [RUN],
    "columns": [{"head": "a"}, {"head": "b", "format": ".2f"}],
    "rows": [["x", 0.5]],
}
PAGE = "# P\n\n<!-- results: one -->\n<!-- end of results -->\n"


def command(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """A module of the benchmarks, as a user calls it in `folder`."""
    return warm.python("-m", *words, cwd=folder)


@pytest.fixture
def clone(tmp_path: Path) -> Path:
    """A clone with one page and no results yet."""
    for name in ("tables.py", "collecting.py", "origin.py", "played.py"):
        (tmp_path / "benchmarks").mkdir(exist_ok=True)
        shutil.copy(ROOT / "benchmarks" / name, tmp_path / "benchmarks" / name)
    (tmp_path / "benchmarks" / "results").mkdir()
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs" / "page.md").write_text(PAGE)
    return tmp_path


def put(clone: Path, data: object, name: str = "one") -> None:
    """A data file."""
    (clone / "benchmarks" / "results" / f"{name}.json").write_text(json.dumps(data))


def test_the_docs_are_what_the_data_make() -> None:
    """`make results` would change nothing."""
    done = command(ROOT, "benchmarks.tables", "--check")
    assert (done.returncode, done.stdout) == (0, ""), done.stdout + done.stderr


def test_a_table_is_written_and_a_stale_one_is_found(clone: Path) -> None:
    """The page gets the table with its origin below it; a figure that was changed by hand is found and put back."""
    put(clone, TABLE)
    assert command(clone, "benchmarks.tables", "--check").returncode == 1
    assert command(clone, "benchmarks.tables").returncode == 0
    page = clone / "docs" / "page.md"
    text = page.read_text()
    assert "| x | 0.50 |" in text
    assert "commit 0123abc, 2026-11-25; p" in text
    page.write_text(text.replace("0.50", "0.90"))
    done = command(clone, "benchmarks.tables", "--check")
    assert (done.returncode, done.stdout.split(":")[0]) == (1, "docs/page.md")
    command(clone, "benchmarks.tables")
    assert page.read_text() == text


def test_scores_make_means_and_counts(clone: Path) -> None:
    """Of a suite's scores the mean, the successes and an interval follow; an episode that broke counts as 0."""
    put(clone, {"kind": "episodes", "runs": [RUN], "tasks": {"t": {"q": [1, 0.5, None]}, "u": {"q": [1, 1, 1]}}})
    command(clone, "benchmarks.tables")
    text = (clone / "docs" / "page.md").read_text()
    assert "**Mean q 0.75 (" in text
    assert "; 4 of 6 episodes met the whole goal; 1 of 2 tasks did in all instances.**" in text
    assert "| 0 | `t` | 0.50 | 1 | 1, 0.50, - | |".replace("0.50, -", "0.5, -") in text


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ({**TABLE, "runs": [RUN, {**RUN, "commit": "fedcba9"}]}, "2 commits or processors"),
        ({**TABLE, "runs": [RUN, {**RUN, "processor": "q"}]}, "2 commits or processors"),
        ({**TABLE, "rows": [["x"]]}, "1 cells for 2 columns"),
        ({**TABLE, "row": []}, "row: Extra inputs are not permitted"),
        ({**TABLE, "runs": [{**RUN, "commit": "main"}]}, "runs.0.commit"),
    ],
)
def test_bad_data_end_in_a_line(clone: Path, data: object, words: str) -> None:
    """Data of mixed origin or wrong form are refused by name, and the page stays as it was."""
    put(clone, data)
    done = command(clone, "benchmarks.tables")
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert done.stderr.startswith("tables: benchmarks/results/one.json: ")
    assert words in done.stderr
    assert (clone / "docs" / "page.md").read_text() == PAGE


def test_mixed_data_say_so(clone: Path) -> None:
    """With a reason figures of several commits stand in one table, which repeats it; one page tells each run."""
    put(clone, {**TABLE, "runs": [RUN, {**RUN, "commit": "fedcba9", "of": "b"}], "mixed": "b was slow"})
    (clone / "docs" / "measurements.md").write_text(PAGE.replace("one -->", "every_run -->"))
    command(clone, "benchmarks.tables")
    told = "Of several runs: b was slow; commits 0123abc, fedcba9, 2026-11-25; [commands and machines]"
    assert f"{told}(measurements.md#one)." in (clone / "docs" / "page.md").read_text()
    every = (clone / "docs" / "measurements.md").read_text()
    assert "| [one](page.md) | [2 runs](#one) | 0123abc, fedcba9 | 2026-11-25 | of each run below |" in every
    assert "## one\n\nB was slow." in every
    assert "| b: `python -m benchmarks.x` | fedcba9 | 2026-11-25 | p |" in every


def test_a_name_without_data_and_data_without_a_page_are_told(clone: Path) -> None:
    """Neither is passed over."""
    done = command(clone, "benchmarks.tables")
    assert (done.returncode, "'one'" in done.stderr) == (2, True)
    put(clone, TABLE)
    put(clone, TABLE, "two")
    done = command(clone, "benchmarks.tables")
    assert (done.returncode, "two.json is on no page" in done.stderr) == (2, True)


WORDS = ["--command", "mpvi suite run trash", "--date", "2026-11-25", "--processor", "p"]


def played(folder: Path, instances: Sequence[int], method: str = "mpvi") -> Path:
    """A suite's folder with results that are none of a policy's."""
    episodes = [EpisodeConfig("picking_up_trash", i, method=method) for i in instances]
    make_manifest("trash", episodes).claim(folder)
    store = Store(folder)
    for config in episodes:
        store.write(config, fake_result(config))
    return folder


def test_the_episodes_of_a_suite_are_kept_for_the_tables(clone: Path) -> None:
    """A folder of results becomes a data file of its episodes, from which tables and a plot follow."""
    suite = played(clone / "runs" / "trash", range(3))
    done = command(clone, "benchmarks.collecting", "one", str(suite), *WORDS, "--commit", "0123abc")
    assert done.stdout == "benchmarks/results/one.json: 1 methods, 1 tasks, 3 episodes\n", done.stderr
    views = ("tasks mpvi", "methods", "plot")
    text = "\n".join(f"<!-- results: one {view} -->\n<!-- end of results -->\n" for view in views)
    (clone / "docs" / "page.md").write_text(text)
    assert command(clone, "benchmarks.tables", "--check").returncode == 1
    assert command(clone, "benchmarks.tables").returncode == 0
    text = (clone / "docs" / "page.md").read_text()
    q = [fake_result(EpisodeConfig("picking_up_trash", i))["q_score"]["final"] for i in range(3)]
    assert f"| 1 | `picking_up_trash` | {np.mean(q):.2f} | {q.count(1.0)}/3 |" in text
    assert f"| picking_up_trash | {np.mean(q):.2f} ({q.count(1.0)}/3) |" in text
    assert "commit 0123abc, 2026-11-25; p" in text
    assert "picking_up_trash" in (clone / "docs" / "one.svg").read_text()
    (clone / "docs" / "one.svg").unlink()
    assert command(clone, "benchmarks.tables", "--check").stdout.startswith("docs/one.svg: ")


def test_a_further_run_adds_what_is_not_there(clone: Path) -> None:
    """Episodes that the file has stay; runs of two commits need a word; a run that brings nothing is told."""
    first, second = played(clone / "a", range(2)), played(clone / "b", range(4))
    command(clone, "benchmarks.collecting", "one", str(first), *WORDS, "--commit", "0123abc")
    more = ["benchmarks.collecting", "one", str(second), *WORDS, "--add", "--commit", "fedcba9"]
    done = command(clone, *more)
    assert (done.returncode, "say why in 'mixed'" in done.stderr) == (2, True)
    assert command(clone, *more, "--mixed", "the second took up what was left").returncode == 0
    data = json.loads((clone / "benchmarks" / "results" / "one.json").read_text())
    assert [one.get("run", 0) for one in data["episodes"]] == [0, 0, 1, 1]
    done = command(clone, *more)
    assert (done.returncode, "no episode that the data file does not have" in done.stderr) == (2, True)


def test_methods_are_compared_where_all_have_played(clone: Path) -> None:
    """Each cell is of what its method played; the mean over tasks is of the start states that all methods have."""
    episode = {"task": "picking_up_trash", "ended": "success", "time_s": 1.0}
    episodes = [
        {**episode, "method": "mpvi", "instance": 0, "q": 1.0},
        {**episode, "method": "mpvi", "instance": 1, "q": 0.0},
        {**episode, "method": "e2e", "instance": 0, "q": 0.5},
    ]
    data = {"kind": "suite", "runs": [RUN], "methods": {"mpvi": {}, "e2e": {}}, "tasks": ["picking_up_trash"]}
    put(clone, {**data, "episodes": episodes})
    assert command(clone, "benchmarks.tables").returncode == 0
    text = (clone / "docs" / "page.md").read_text()
    assert "| picking_up_trash | 0.50 (1/2) | 0.50 (0/1) |" in text
    assert "| **mean q** | **1.00** | **0.50** |" in text
    assert "| higher, lower than `mpvi` | | 0, 1 |" in text
    assert "| chance of so great a difference | | 1 |" in text  # one pair tells nothing
    (clone / "docs" / "page.md").write_text(PAGE.replace("one -->", "one summary -->"))
    command(clone, "benchmarks.tables")
    text = (clone / "docs" / "page.md").read_text()
    assert "| `e2e` | **0.50** | 0 | 0, 1 | 1 |" in text
    assert "Over 1 start states of 1 tasks." in text
    for bad, words in [
        ([*episodes, episodes[0]], "is there 2 times"),
        ([{**episodes[0], "run": 1}], "episodes[0] is of a run"),
        ([{**episodes[0], "q": 2}], "episodes.0.q"),
    ]:
        put(clone, {**data, "episodes": bad})
        done = command(clone, "benchmarks.tables")
        assert (done.returncode, words in done.stderr) == (2, True), done.stderr


def test_the_tasks_of_a_suite_are_told_apart_from_the_others(clone: Path) -> None:
    """Of each part: mean q, whole goals, episodes below half, those of them out of time; an unknown suite is told."""
    episode = {"ended": "time_limit", "time_s": 1.0, "method": "mpvi", "instance": 0}
    episodes = [
        {**episode, "task": "picking_up_trash", "q": 1.0, "ended": "success"},
        {**episode, "task": "can_meat", "q": 0.25},
        {**episode, "task": "can_meat", "q": 0.5, "instance": 1},
        {**episode, "task": "make_pizza", "q": 0.0, "ended": "failure"},
    ]
    tasks = ["picking_up_trash", "can_meat", "make_pizza"]
    data = {"kind": "suite", "runs": [RUN], "methods": {"mpvi": {}}, "tasks": tasks}
    put(clone, {**data, "episodes": episodes})
    (clone / "docs" / "page.md").write_text(PAGE.replace("one -->", "one parts behavior30 -->"))
    done = command(clone, "benchmarks.tables")
    assert done.returncode == 0, done.stderr
    rows = [line for line in (clone / "docs" / "page.md").read_text().splitlines() if line.startswith("| `mpvi`")]
    assert [row.split(" | ")[1] for row in rows] == ["`behavior30`: 2", "the others: 1"]
    assert [row.split(" | ")[2][:4] for row in rows] == ["0.69", "0.00"]
    assert [row.split(" | ", 3)[3] for row in rows] == ["1 of 3 | 1 | 1 |", "0 of 1 | 1 | 0 |"]
    (clone / "docs" / "page.md").write_text(PAGE.replace("one -->", "one parts behavior31 -->"))
    done = command(clone, "benchmarks.tables")
    assert (done.returncode, "behavior30" in done.stderr) == (2, True)


def test_reasons_are_counted_once_an_episode_that_missed_something(clone: Path) -> None:
    """Not of episodes that met the goal in spite of them; who ran out of time or gave nothing up is counted apart."""
    episode = {"task": "picking_up_trash", "ended": "success", "time_s": 1.0, "q": 0.5, "method": "mpvi"}
    episodes = [
        {**episode, "instance": 0, "reasons": ["pick: no_grasp", "pick: no_grasp", "timeout"]},
        {**episode, "instance": 1, "reasons": ["pick: no_grasp"], "ended": "time_limit"},
        {**episode, "instance": 2, "reasons": ["timeout"], "q": 1.0},
        {**episode, "instance": 3},
    ]
    put(clone, {"kind": "suite", "runs": [RUN], "methods": {"mpvi": {}}, "tasks": ["picking_up_trash"],
                "episodes": episodes})  # fmt: skip
    (clone / "docs" / "page.md").write_text(PAGE.replace("one -->", "one reasons -->"))
    assert command(clone, "benchmarks.tables").returncode == 0
    rows = [line for line in (clone / "docs" / "page.md").read_text().splitlines() if line.startswith("|")]
    assert rows[0] == "| given up because of | `mpvi`, 3 of 4 below q 1 |"
    assert rows[2:] == [
        "| out of time | 1 |", "| `pick: no_grasp` | 2 |", "| `timeout` | 1 |", "| nothing given up | 1 |",
    ]  # fmt: skip


def test_answers_of_the_checker_are_counted_where_they_were_kept(clone: Path) -> None:
    """Yeses and noes apart, each with how many were false; and in how many episodes the policy alone was wrong."""
    episode = {"task": "picking_up_trash", "ended": "failure", "time_s": 1.0, "q": 0.5, "method": "mpvi"}
    right = {"asked": 5, "yes": 2, "false_yes": 1, "false_no": 0}
    wrong = {"asked": 4, "yes": 1, "false_yes": 0, "false_no": 2}
    episodes = [
        {**episode, "instance": 0, "answers": right, "reasons": ["done"]},
        {**episode, "instance": 1, "answers": wrong, "reasons": ["pick: no_grasp", "reactive: done"]},
        {**episode, "instance": 2, "answers": right, "reasons": ["timeout"]},
        {**episode, "instance": 3, "reasons": ["done"]},
    ]
    data = {"kind": "suite", "runs": [RUN], "methods": {"mpvi": {}}, "tasks": ["picking_up_trash"]}
    put(clone, {**data, "episodes": episodes})
    (clone / "docs" / "page.md").write_text(PAGE.replace("one -->", "one answers -->"))
    assert command(clone, "benchmarks.tables").returncode == 0
    (row,) = [line for line in (clone / "docs" / "page.md").read_text().splitlines() if line.startswith("| `mpvi`")]
    assert row == "| `mpvi` | 3 | 5 | 2 | 9 | 2 | 1 of 2 |"
    put(clone, {**data, "episodes": episodes[3:]})
    done = command(clone, "benchmarks.tables")
    assert (done.returncode, "keeps what its checker answered" in done.stderr) == (2, True)


def test_a_view_that_there_is_not_is_told(clone: Path) -> None:
    """So is a folder without a suite's results."""
    put(clone, TABLE)
    (clone / "docs" / "page.md").write_text(PAGE.replace("one -->", "one plots -->"))
    done = command(clone, "benchmarks.tables")
    assert (done.returncode, "not 'plots'" in done.stderr) == (2, True)
    done = command(clone, "benchmarks.collecting", "two", str(clone / "docs"), *WORDS, "--commit", "0123abc")
    assert (done.returncode, "there is no manifest.json" in done.stderr) == (2, True)


def test_every_run_is_listed(clone: Path) -> None:
    """A page can show what made each data file, with a link to its page."""
    put(clone, TABLE)
    (clone / "docs" / "all.md").write_text("<!-- results: every_run -->\n<!-- end of results -->\n")
    assert command(clone, "benchmarks.tables").returncode == 0
    assert (
        "| [one](page.md) | `python -m benchmarks.x` | 0123abc | 2026-11-25 | p |"
        in (clone / "docs" / "all.md").read_text()
    )
