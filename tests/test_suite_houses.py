"""Suites over several houses: their episodes, their results side by side, and what houses do to means."""

from __future__ import annotations

import itertools
import json
from pathlib import Path

import numpy as np
import pytest

from mpvi_bt.apps.cli.group import run
from mpvi_bt.ground.errors import FileProblems, UserError
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.report.closing_table import report_text
from mpvi_bt.runs.report.compare import compare
from mpvi_bt.runs.report.data import report_data
from mpvi_bt.runs.report.figures import figures
from mpvi_bt.runs.report.markdown import report_markdown
from mpvi_bt.runs.report.page import report_page
from mpvi_bt.runs.report.runs import Key, Runs, by_instance, drawn_anew
from mpvi_bt.runs.report.statistics import estimate
from mpvi_bt.runs.report.tables import house_table, method_note
from mpvi_bt.runs.suite.manifest import make_manifest
from mpvi_bt.runs.suite.store import Store
from mpvi_bt.runs.suite.suites import Suite, load_suite
from tests.synthetic_suites import TASKS, synthetic_result

SECRET = "a secret of enough characters"
HOUSES = ("family_house", "generated:1", "generated:2")


def suite(**lists: object) -> Suite:
    """A suite of two tasks and two instances."""
    return Suite.model_validate({"tasks": TASKS[:2], "instances": [0, 1], **lists})


def over_houses(method: str, shares: dict[str, float]) -> Runs:
    """Results in houses in which literals hold with different probabilities."""
    episodes = [EpisodeConfig(*which, house=house) for house in shares for which in itertools.product(TASKS, range(3))]
    return Runs(method, episodes, {c: synthetic_result(c, shares[c.house or ""]) for c in episodes})


def test_each_task_is_played_in_each_house() -> None:
    """No two episodes have files of one name; drawn houses have the seeds from 1 on; an option chooses others."""
    episodes = suite(houses=[*HOUSES]).episodes()
    assert len({c.name for c in episodes}) == len(episodes) == 2 * 3 * 2
    assert {c.house for c in episodes} == {*HOUSES}
    assert episodes[2].name == "picking_up_trash_generated-1_0_0"
    assert [c.house for c in suite(houses=2).episodes()][::2] == ["generated:1", "generated:2"] * 2
    assert {c.house for c in suite(houses=2).episodes(3)} == {f"generated:{seed}" for seed in (1, 2, 3)}
    assert {c.house for c in suite(houses=2).episodes(house="family_house")} == {"family_house"}
    assert {c.name for c in suite().episodes()} >= {"picking_up_trash_0_0"}


def test_hidden_houses_are_drawn_from_the_secret(monkeypatch: pytest.MonkeyPatch) -> None:
    """They are others with another secret, and the first of more with the same; without one there are none."""

    def drawn(count: int) -> list[str | None]:
        return list(dict.fromkeys(c.house for c in suite(houses=count).episodes(split="hidden")))

    monkeypatch.delenv("MPVI_HIDDEN_SEED", raising=False)
    with pytest.raises(UserError, match="MPVI_HIDDEN_SEED"):
        drawn(2)
    monkeypatch.setenv("MPVI_HIDDEN_SEED", SECRET)
    first = drawn(20)
    assert len({*first}) == 20
    assert drawn(5) == first[:5]
    assert not {*first} & {c.house for c in suite(houses=1000).episodes()}
    monkeypatch.setenv("MPVI_HIDDEN_SEED", SECRET[::-1])
    assert not {*first} & {*drawn(20)}
    named = suite(houses=["family_house"]).episodes(split="hidden")
    assert {c.house for c in named} == {"family_house"}


def test_the_manifest_gives_houses_back(tmp_path: Path) -> None:
    """A folder of results knows its houses, and more may be added."""
    episodes = suite(houses=["family_house"]).episodes()
    manifest = make_manifest("mine", episodes)
    assert manifest.episodes() == episodes
    assert manifest.methods[""].get("house") is None
    manifest.claim(tmp_path)
    make_manifest("mine", suite().episodes()).claim(tmp_path)


@pytest.mark.parametrize(
    ("houses", "words"),
    [
        ("[family_house, famly_house]", "1:24: unknown house 'famly_house'. Did you mean 'family_house'?"),
        ("[family_house, family_house]", "'family_house' is in houses twice"),
        ("[generated:x]", "generated:7"),
        ("-3", "should be greater than or equal to 1"),
        ("true", "houses"),
        ("ten", "houses"),
    ],
)
def test_houses_that_cannot_be_are_placed(tmp_path: Path, houses: str, words: str) -> None:
    """By line and column, with what is right."""
    file = tmp_path / "suite.yaml"
    file.write_text(f"houses: {houses}\ntasks: [picking_up_trash]\ninstances: [0]\n")
    with pytest.raises(FileProblems, match=r"suite\.yaml:1") as caught:
        load_suite(str(file))
    assert words in str(caught.value)
    assert len(caught.value.problems) == 1, "of a number and a list, what was meant is told"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--houses", "0"], "1 to 1000 houses"),
        (["--houses", "famly_house"], "family_house"),
        (["--houses", "family_house,family_house"], "given twice"),
        (["--houses", "2", "--house", "family_house"], "give one of them"),
    ],
)
def test_a_wrong_choice_of_houses_is_one_line(words: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    """And nothing is played."""
    assert run(["suite", "run", "smoke", *words]) == 2
    assert said in capsys.readouterr().err


def test_a_mean_over_houses_is_of_the_means_in_each() -> None:
    """A house in which more was finished does not weigh more; houses are what its interval draws anew."""
    rows: list[tuple[Key, tuple[float]]] = [
        *((("t", "a", i, 0), (1.0,)) for i in range(9)),
        (("t", "b", 0, 0), (0.0,)),
        (("u", "b", 0, 0), (0.5,)),
    ]
    (table,) = drawn_anew(rows)
    assert table.tolist() == [[1.0], [0.25]]
    alone = [(key, values) for key, values in rows if key[1] == "a"]
    assert [of_task.tolist() for of_task in drawn_anew(alone)] == [[[1.0]] * 9]
    assert drawn_anew([]) == []


def test_intervals_hold_the_mean_over_houses_that_nobody_played() -> None:
    """Nine of ten do, of suites of 10 houses, 4 tasks and 3 instances; drawing instances alone, less than half do."""
    rng = np.random.default_rng(5)
    held = {"houses": 0, "instances": 0}
    for _ in range(200):
        rows: list[tuple[Key, tuple[float]]] = []
        for house in range(10):
            of_house = rng.normal(0.5, 0.15)
            for task, instance in itertools.product(range(4), range(3)):
                rows.append(((str(task), str(house), instance, 0), (float(of_house + rng.normal(0, 0.1)),)))
        pooled = [((task, "", 3 * int(house) + i, 0), values) for (task, house, i, _), values in rows]
        for kind, tables in (("houses", drawn_anew(rows)), ("instances", list(by_instance(pooled).values()))):
            found = estimate(tables, resamples=400)
            assert found is not None
            assert found.low is not None
            assert found.high is not None
            held[kind] += found.low <= 0.5 <= found.high
    assert held["houses"] / 200 == pytest.approx(0.92, abs=0.03)
    assert held["instances"] / 200 < 0.5


def test_a_report_has_a_row_a_house() -> None:
    """As text, Markdown and a page, beside the mean over houses; with a single house there is no such table."""
    runs = [over_houses("a", {"family_house": 0.9, "generated:1": 0.5}), over_houses("b", {"family_house": 0.2})]
    told = figures("mine", runs)
    table = house_table(told)
    assert [row[0] for row in table.rows] == ["family_house", "generated:1"]
    assert table.rows[1][2] == "-", "b was not played there"
    assert "then houses" not in method_note(figures("one", runs[1:]))
    assert "tasks, then houses" in method_note(told)
    method = told.methods[0]
    means = [method.houses[house].measures["q_score"] for house in told.houses]
    assert all(mean is not None for mean in means)
    q = method.overall.measures["q_score"]
    assert q is not None
    assert q.mean == pytest.approx(np.mean([mean.mean for mean in means if mean]))
    text = report_text(told, runs, 100)
    for shown in (text, report_markdown(told, "mine")[0], report_page(told, runs)):
        assert "generated:1" in shown
    assert any(line.split()[:3] == ["generated:1", "0", "0"] for line in text.splitlines()), "an episode, in its table"
    assert not house_table(figures("one", runs[1:])).rows
    assert {*report_data(told, runs)["methods"]["a"]["houses"]} == {"family_house", "generated:1"}
    assert (
        "generated:1_2_0"
        in report_data(told, runs)["methods"]["a"]["official"]["per_rollout_scores"]["q_score"][TASKS[0]]
    )


def test_pairs_are_of_the_same_house() -> None:
    """An episode in another house is no pair; of several houses each weighs alike."""
    shares = {"generated:1": 0.3, "generated:2": 0.6}
    found = compare(over_houses("a", shares), over_houses("b", {"generated:2": 0.6, "generated:3": 0.9}))
    assert found is not None
    assert found.overall.pairs == 12
    assert found.overall.ties == 12
    both = compare(over_houses("a", shares), over_houses("b", dict.fromkeys(shares, 1.0)))
    assert both is not None
    assert both.chance.p == 0.5, "of two houses nothing is sure"


def test_status_and_report_read_results_of_houses(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The folder tells its houses; CSV has a column for them."""
    store, episodes = Store(tmp_path / "out"), suite(houses=["family_house"]).episodes()
    for config in episodes[:3]:
        store.write(config, synthetic_result(config, 0.5).model_copy(update={"config": config.record()}))
    make_manifest("mine", episodes).claim(store.out)
    assert run(["suite", "status", str(store.out)]) == 0
    out = capsys.readouterr().out
    assert out.startswith("mine: 3/4 done")
    assert "to do: hiding_Easter_eggs_family_house_1_0" in out
    table = tmp_path / "rows.csv"
    assert run(["suite", "report", str(store.out), "--csv", str(table), "--columns", "task,house,instance"]) == 0
    assert table.read_text().splitlines()[1] == "picking_up_trash,family_house,0"
    assert run(["suite", "report", str(store.out), "--json"]) == 0
    told = json.loads(capsys.readouterr().out.split("\n", 1)[1])
    assert told["houses"]["family_house"]["finished"] == 3
    assert {one["config"]["house"] for one in told["episodes"]} == {"family_house"}
