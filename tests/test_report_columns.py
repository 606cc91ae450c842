"""Tables for one's own paper: chosen columns, nobody else's figures, captions of one sentence."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import pytest

from mpvi_bt.apps.cli.group import run
from mpvi_bt.runs.report.chosen_columns import COLUMNS, KNOWN, PAPER
from mpvi_bt.runs.report.figures import figures
from mpvi_bt.runs.report.latex import report_latex
from mpvi_bt.runs.report.rows import report_csv
from tests.suite_runs import ROOT
from tests.synthetic_suites import synthetic_runs
from tests.test_report_several import folder

RUNS = [synthetic_runs("e2e", 0.3), synthetic_runs("mpvi", 0.8)]  # methods and tasks that the paper has


def table(columns: list[str]) -> tuple[str, list[list[str]]]:
    """How the columns of LaTeX's one table are aligned, and its cells."""
    text = report_latex(figures("s", RUNS), RUNS, columns)
    (found,) = re.findall(r"\\begin\{tabular\}\{([lr]*)\}\n(.*?)\\end\{tabular\}", text, re.DOTALL)
    return found[0], [line.removesuffix(r" \\").split(" & ") for line in found[1].splitlines() if " & " in line]


@pytest.mark.parametrize("columns", [["task", "q_score"], ["q_score", "method"], [*reversed(KNOWN)]])
def test_csv_has_the_chosen_columns_in_their_order(columns: list[str]) -> None:
    """Each cell is that of the whole table, an episode a row."""
    chosen = list(csv.reader(report_csv(RUNS, columns).splitlines()))
    whole = list(csv.DictReader(report_csv(RUNS, KNOWN).splitlines()))
    assert chosen[0] == columns
    assert chosen[1:] == [[row[name] for name in columns] for row in whole]


def test_latex_has_a_row_for_each_group_of_episodes_and_right_aligned_figures() -> None:
    """A method; a task of a method, the first column sorting; an episode, where instance and seed are chosen."""
    assert [len(table(columns)[1]) - 1 for columns in (["method", "q_score"], ["task", "method", "q_score"])] == [2, 8]
    aligned, rows = table(["task", "method", "q_score", "instance"])
    assert aligned == "llrr"
    assert [row[1] for row in rows[1:7]] == ["e2e"] * 3 + ["mpvi"] * 3, "task by task"
    assert [row[3] for row in rows[1:4]] == ["0", "1", "2"]
    (found,) = [row for row in table(["method", "q_score"])[1] if row[0] == "mpvi"]
    assert found[1].startswith(f"{figures('s', RUNS).methods[1].overall.measures['q_score'].mean:.3f} ")  # type: ignore[union-attr]


def test_no_figure_of_the_paper_is_in_tables_that_do_not_ask_for_it() -> None:
    """Neither a column nor a row of LaTeX's, nor a column of CSV's; `paper_q` asks."""
    assert PAPER not in COLUMNS
    assert "paper" not in report_csv(RUNS).splitlines()[0]
    text = "".join(line for line in report_latex(figures("s", RUNS), RUNS).splitlines() if not line.startswith("%"))
    assert "paper" not in text
    cells = [row[-1] for row in table(["task", "method", PAPER])[1]]
    assert "MPVI paper" in cells[0]
    assert cells[1:3] == ["0.630", "0.900"], "of picking_up_trash, tasks/paper_qscores.csv"


@pytest.mark.parametrize("columns", [[], ["method", "q_score"]])
def test_a_caption_is_one_sentence(columns: list[str]) -> None:
    """What else there is to know stands in comments."""
    captions = re.findall(r"\\caption\{(.*)\}", report_latex(figures("s", RUNS), RUNS, columns))
    assert len(captions) == (1 if columns else 5)
    assert all(re.fullmatch(r"[A-Z][^.]*\.", caption) for caption in captions)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--csv", "a.csv", "--columns", "method,q_scor"], "unknown column 'q_scor'. Did you mean 'q_score'?"),
        (["--csv", "a.csv", "--columns", "method,method"], "--columns: method is given twice."),
        (["--csv", "a.csv", "--columns", ""], "unknown column ''."),
        (["--columns", "method"], "--columns chooses those of --csv and --latex; give one of them."),
    ],
)
def test_columns_that_there_are_not_are_told(
    words: list[str], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """With the nearest name; nothing is written."""
    monkeypatch.chdir(tmp_path)
    folder(Path("runs/a"), 0.5)
    assert run(["suite", "report", "a", *words]) == 2
    assert said in capsys.readouterr().err
    assert not Path("a.csv").exists()
    assert run(["suite", "report", "a", "--csv", "a.csv", "--latex", "a.tex", "--columns", "task, q_score"]) == 0
    assert Path("a.csv").read_text().splitlines()[0] == "task,q_score"


def test_every_column_is_documented() -> None:
    """A name behind --columns stands in docs/reports.md."""
    text = (ROOT / "docs" / "reports.md").read_text("utf-8")
    assert all(f"`{name}`" in text for name in KNOWN)
