"""Tables of measurements are what their data make, and data of several origins are not mixed in silence."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from mpvi_bt.choices.config import EpisodeConfig
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
    environment = {**os.environ, "PYTHONPATH": f"{folder}{os.pathsep}{ROOT}"}
    return subprocess.run(
        [sys.executable, "-m", *words], cwd=folder, env=environment, capture_output=True, text=True, check=False
    )


@pytest.fixture
def clone(tmp_path: Path) -> Path:
    """A clone with one page and no results yet."""
    for name in ("tables.py", "collecting.py"):
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
    """With a reason figures of several commits stand in one table, which repeats it."""
    put(clone, {**TABLE, "runs": [RUN, {**RUN, "commit": "fedcba9", "of": "b"}], "mixed": "b was slow"})
    command(clone, "benchmarks.tables")
    assert "Of several runs: b was slow." in (clone / "docs" / "page.md").read_text()


def test_a_name_without_data_and_data_without_a_page_are_told(clone: Path) -> None:
    """Neither is passed over."""
    done = command(clone, "benchmarks.tables")
    assert (done.returncode, "'one'" in done.stderr) == (2, True)
    put(clone, TABLE)
    put(clone, TABLE, "two")
    done = command(clone, "benchmarks.tables")
    assert (done.returncode, "two.json is on no page" in done.stderr) == (2, True)


def test_scores_of_a_suite_are_kept_for_the_tables(clone: Path) -> None:
    """A folder of results becomes a data file from which the table follows; a folder without any ends in a line."""
    suite = clone / "runs" / "trash"
    done = command(clone, "benchmarks.collecting", "one", str(clone / "docs"), "--command", "c", "--date", "2026-11-25")
    assert (done.returncode, "there are no results in json/" in done.stderr) == (2, True)
    (suite / "json").mkdir(parents=True)
    for instance in range(3):
        config = EpisodeConfig("picking_up_trash", instance)
        data = json.dumps(fake_result(config))
        (suite / "json" / f"picking_up_trash_{instance}_0.json").write_text(data)
    words = ["--command", "mpvi suite run trash", "--commit", "0123abc", "--date", "2026-11-25"]
    done = command(clone, "benchmarks.collecting", "one", str(suite), *words)
    assert done.stdout == "benchmarks/results/one.json: 1 tasks, 3 episodes\n", done.stderr
    assert command(clone, "benchmarks.tables").returncode == 0
    assert "| 0 | `picking_up_trash` | " in (clone / "docs" / "page.md").read_text()
