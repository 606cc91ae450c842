"""The results of several folders side by side, as text, CSV, LaTeX and JSON."""

from __future__ import annotations

import csv
import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mpvi_bt.apps.cli.group import run
from mpvi_bt.ground.errors import UserError
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.report.figures import figures
from mpvi_bt.runs.report.latex import plain, report_latex
from mpvi_bt.runs.report.suite_folders import SuiteFolder, notes, together
from mpvi_bt.runs.report.tables import method_note
from mpvi_bt.runs.suite.manifest import make_manifest
from mpvi_bt.runs.suite.store import Store
from tests.synthetic_suites import synthetic_result, synthetic_runs


def folder(out: Path, share: float, count: int = 4, suite: str = "trash10", **settings: object) -> SuiteFolder:
    """A suite's results in a folder."""
    store = Store(out)
    episodes = [EpisodeConfig("picking_up_trash", i, **settings) for i in range(count)]  # type: ignore[arg-type]
    for config in episodes[:3]:
        store.write(config, synthetic_result(config, share).model_copy(update={"config": config.record()}))
    make_manifest(suite, episodes).claim(out)
    return SuiteFolder.read(suite, store, episodes)


@pytest.fixture
def folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Three: of two policies, and one of those again, of more episodes, in a folder of the same name."""
    monkeypatch.chdir(tmp_path)
    folder(Path("runs/a"), 0.2)
    folder(Path("runs/b"), 0.9, policy="reactive")
    folder(Path("old/b"), 0.7, count=5, policy="reactive")
    return tmp_path


def test_several_folders_are_told_side_by_side(folders: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Methods in rows, whatever folder they are of, each with its interval, its difference and its p."""
    assert run(["suite", "report", "runs/a", "runs/b"]) == 0
    text = capsys.readouterr().out
    assert re.search(r"^expert +3/4 +\d +0\.\d+ +\[.*\] +baseline\b", text, re.MULTILINE)
    assert re.search(r"^reactive +3/4 +\d +0\.\d+ +\[.*\] +\+0\.\d+ +0\.\d\d\d\b", text, re.MULTILINE)
    assert "reactive against expert, on 3 episodes that both have finished" in text
    assert "Results of runs/a, runs/b." in text
    assert max(map(len, re.findall(r"^(?:expert|reactive) +\d.*$", text, re.MULTILINE))) <= 80


def test_methods_of_one_name_are_named_by_their_folders(folders: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """By as much of the path as tells them apart; --baseline takes these names."""
    assert run(["suite", "report", "runs/a", "runs/b", "old/b", "--baseline", "runs/b", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert list(told["methods"]) == ["runs/a", "runs/b", "old/b"]
    assert [c["baseline"] for c in told["figures"]["comparisons"]] == ["runs/b"] * 2
    assert {episode["method"] for episode in told["episodes"]} == {"runs/a", "runs/b", "old/b"}
    assert told["figures"]["comparisons"][0]["chance"]["exact"] is True
    assert run(["suite", "report", "runs/a", "runs/b", "--baseline", "c"]) == 2
    named = [folder(folders / f"runs/{name}", 0.5, method="mpvi") for name in ("x", "y")]
    assert [one.method for one in together(named)] == ["x: mpvi", "y: mpvi"]


def test_csv_has_a_row_for_every_episode(folders: Path) -> None:
    """With every figure as it was measured; of one without a result the cells are empty."""
    assert run(["suite", "report", "runs/a", "runs/b", "--csv", "all.csv"]) == 0
    rows = list(csv.DictReader(Path("all.csv").read_text().splitlines()))
    assert [row["method"] for row in rows] == ["expert"] * 4 + ["reactive"] * 4
    assert [row["instance"] for row in rows] == ["0", "1", "2", "3"] * 2
    result = SuiteFolder.read(
        "trash10", Store(Path("runs/b")), [EpisodeConfig("picking_up_trash", 1, policy="reactive")]
    )
    (expected,) = result.results.values()
    assert float(rows[5]["q_score"]) == pytest.approx(expected.q)
    assert float(rows[5]["simulator_time"]) == pytest.approx(expected.time.simulator_time)
    assert rows[5]["success"] == str(int(expected.success))
    assert (rows[7]["ended"], rows[7]["q_score"]) == ("missing", "")


def test_folders_that_cannot_be_compared_are_refused(folders: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The same folder twice; hidden instances beside public ones; one --out for several."""
    monkeypatch.setenv("MPVI_HIDDEN_SEED", "a secret that nobody knows")
    public, hidden = folder(folders / "p", 0.5), folder(folders / "h", 0.5, split="hidden")
    with pytest.raises(UserError, match="hidden and public instances"):
        together([public, hidden])
    assert run(["suite", "report", "runs/a", "./runs/../runs/a"]) == 2
    assert run(["suite", "report", "runs/a", "runs/b", "--out", "runs/a"]) == 2


def test_what_was_not_made_alike_is_noted(folders: Path) -> None:
    """Versions and files that differ between folders; of one folder there is nothing to note."""
    parts = [folder(folders / name, 0.5) for name in ("x", "y")]
    assert notes(parts) == [f"Results of {folders}/x, {folders}/y."]
    file = folders / "y/manifest.json"
    data = json.loads(file.read_text())
    changed = next(name for name in data["files"] if name.endswith("picking_up_trash.yaml"))
    file.write_text(json.dumps(data | {"version": "0.0.1", "files": data["files"] | {changed: "other"}}))
    said = notes(parts)
    assert f"0.0.1 ({folders}/y)" in said[1]
    assert said[2] == f"Not the same in all folders: {changed}."
    assert notes(parts[:1]) == []


def test_unlike_tasks_are_noted() -> None:
    """A mean over all tasks is then not over the same ones."""
    a, b = synthetic_runs("a", 0.5), synthetic_runs("b", 0.5, tasks=["tidying_bedroom"])
    assert "Not every method was given the same tasks" in figures("s", [a, b]).notes[0]
    assert figures("s", [a, synthetic_runs("b", 0.5)]).notes == []


@given(st.text() | st.text(r"\&%$#_{}~^<>[]|-0.↑", max_size=20))
def test_latex_finds_nothing_to_obey_in_a_text(text: str) -> None:
    """What is left once its own escapes are taken away has no sign that means anything to it."""
    own = r"\\textbackslash\{\}|\\textasciitilde\{\}|\\textasciicircum\{\}|\\text(?:less|greater|bar)\{\}|\{\[\}|\$-\$"
    own += r"|\$\\(?:up|down)arrow\$|\\[&%$#_{}]"
    assert not re.search(r"[\\&%$#_{}~^<>|\[]", re.sub(own, "", plain(text)))


def test_latex_tables_are_whole(tmp_path: Path) -> None:
    """Every row has as many cells as its table has columns; where LaTeX is installed it makes pages of them."""
    evil = synthetic_runs(r"[a_b] & 100% $x$ \end{table} {~^#", 0.4)
    text = report_latex(figures("s_1 & more", [synthetic_runs("e2e", 0.6), evil]))
    tables = re.findall(r"\\begin\{tabular\}\{([lr]*)\}\n(.*?)\\end\{tabular\}", text, re.DOTALL)
    assert len(tables) == 5
    for columns, body in tables:
        rows = [line for line in body.splitlines() if line.endswith(r"\\")]
        assert len(rows) > 1
        assert {len(re.findall(r"(?<!\\)&", row)) + 1 for row in rows} == {len(columns)}
    comments = " ".join(line.removeprefix("% ") for line in text.splitlines() if line.startswith("% "))
    assert method_note(figures("s", [evil])) in comments
    if shutil.which("pdflatex"):
        (tmp_path / "tables.tex").write_text(text)
        (tmp_path / "page.tex").write_text(
            "\\documentclass{article}\n\\usepackage{booktabs}\n\\begin{document}\n\\input{tables}\n\\end{document}\n"
        )
        done = subprocess.run(
            ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", "page"],
            cwd=tmp_path, capture_output=True, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stdout
