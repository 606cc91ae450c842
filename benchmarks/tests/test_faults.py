"""Laws of the trials of what may break: they repeat by seed and number, go on where they stopped, and can fail."""

from __future__ import annotations

import functools
import json
import time
from pathlib import Path
from typing import Any

import pytest
import yaml
from click.testing import CliRunner

from benchmarks.faults import plan_answers, server_faults, soak, trials, verdict_answers
from benchmarks.faults.answers import trial, verdict_misread
from benchmarks.faults.kills import Kills, results
from benchmarks.faults.mutants import Mutants, due
from benchmarks.faults.mutations import TEXT, of_yaml
from benchmarks.faults.samples import Kind, kinds
from benchmarks.faults.server_faults import FAULTS, ServerFault
from benchmarks.faults.servers import trial as served
from benchmarks.faults.table import table
from benchmarks.faults.trials import BAD, Outcome, play, summary
from benchmarks.faults.user_samples import user_kinds
from benchmarks.rows import append
from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.protocols import Judgement
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.suite.store import Store
from tests.fake_episodes import fake_result


def rows(trial: trials.Trial, count: int, out: Path, capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    """Exit code and what was printed."""
    with pytest.raises(SystemExit) as ended:
        play(trial, 3, count, out, None, "some")
    return int(ended.value.code or 0), capsys.readouterr().out


def test_trials_go_on_where_they_stopped(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """What has a row is not played again, and the summary tells of all, with how to repeat the first bad one."""
    played: list[int] = []

    def one(number: int) -> Outcome:
        played.append(number)
        return Outcome("a thing", "misread" if number == 1 else "went on", "red for green" if number == 1 else "")

    out = tmp_path / "rows.jsonl"
    assert rows(one, 2, out, capsys)[0] == 1
    code, said = rows(one, 4, out, capsys)
    assert (code, played) == (1, [0, 1, 2, 3])
    assert said.startswith("4 trials: 0 lost, 0 hung, 1 misread, 0 crashed; 0 refused with a reason, 3 went on")
    assert "first misread: a thing: red for green" in said
    assert "benchmarks.faults.some --seed 3 --only 1" in said
    assert "crashed:" not in summary([{"ended": "went on"}], "some")


def test_mutants_are_read_or_refused(tmp_path: Path) -> None:
    """A few of each seed; and the same number gives the same bytes."""
    found = Mutants(0, tmp_path)
    assert {kind.name for kind in found.kinds} >= {"tree", "task", "trace", "result", "weights", "saved run", "plan"}
    assert found.made(5) == found.made(5) != found.made(6)
    ended = [found(number) for number in range(60)]
    assert [outcome for outcome in ended if outcome.ended in BAD] == []
    assert {outcome.ended for outcome in ended} == {"refused", "went on"}


def _crashing(path: Path) -> None:
    yaml.safe_load(path.read_bytes())["width"] + 1


def _waiting(path: Path) -> None:
    time.sleep(60)


def _nameless(path: Path) -> None:
    raise UserError("it is wrong")


@pytest.mark.parametrize(
    ("read", "ended"),
    [(lambda path: None, "misread"), (_crashing, "crashed"), (_waiting, "hung"), (_nameless, "crashed")],
)
def test_a_reader_that_is_broken_is_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, read: Any, ended: str
) -> None:
    """One that believes everything, one that raises whatever comes, one that waits, one that does not say where."""
    monkeypatch.setattr("benchmarks.faults.mutants.WALL_S", 0.3)
    kind = Kind("thing", {"thing.yaml": b"width: 1\nname: x\nsize: 3\n"}, read, [*TEXT, of_yaml], "yaml")
    found = Mutants(0, tmp_path, [kind])
    assert any(found(number).ended == ended for number in range(12))


def test_good_files_are_read(tmp_path: Path) -> None:
    """Of every kind that a user brings: what is broken later was whole."""
    for kind in user_kinds(tmp_path / "made"):
        for place, good in kind.files.items():
            path = tmp_path / place
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(good)
            assert kind.read(path) is None, (kind.name, place)


def test_a_sum_an_archive_and_a_line_are_judged_by_what_was_written(tmp_path: Path) -> None:
    """A number of a result, of an array or of a line that is another one has to be refused."""
    by_name = {kind.name: kind for kind in kinds(tmp_path)}
    result = by_name["result"]
    (good,) = result.files.values()
    assert due(result, "", good, good) == ""
    assert due(result, "", good, good.replace(b'"instance_id": 0', b'"instance_id": 1'))
    weights = by_name["weights"]
    (whole,) = weights.files.values()
    assert due(weights, "", whole, whole) == ""
    assert due(weights, "", whole, whole[:-30])
    trace = by_name["trace"]
    (lines,) = trace.files.values()
    assert due(trace, "", lines, lines) == ""
    assert due(trace, "", lines, lines.replace(b"{", b"<", 1))


def test_answers_are_refused_or_read_as_they_are_meant() -> None:
    """A few of each kind."""
    ended = [trial(0, number) for number in range(60)]
    assert [outcome for outcome in ended if outcome.ended in BAD] == []
    assert {outcome.of.partition(":")[0] for outcome in ended} == {"planner", "checker", "server"}


def test_an_answer_that_is_read_otherwise_is_found() -> None:
    """A checker that believes a doubt or turns a no round; a planner that takes one plan for another."""
    assert verdict_misread(Judgement(True, "yes"), "yes") == ""
    assert verdict_misread(Judgement(False, "", fault="bad_answer"), "yes") == ""
    assert verdict_misread(Judgement(True, "yes"), "unclear")
    assert verdict_misread(Judgement(True, "yes"), "no")
    assert verdict_misread(Judgement(False, "no"), "yes")
    task = plan_answers.TASKS[0]
    good = json.loads(plan_answers.good(task))
    for means in (None, plan_answers.meant(good)[1:]):
        assert plan_answers.read(task, plan_answers.Said("", json.dumps(good), means))[1]
    assert plan_answers.read(task, plan_answers.Said("", json.dumps(good), plan_answers.meant(good), sure=True)) == (
        None,
        "",
    )
    assert plan_answers.read(task, plan_answers.Said("", "no", None, sure=True))[1]


def test_there_are_yeses_noes_and_neither() -> None:
    """Of each many, so that a checker that always says the same would be found."""
    drawn = [verdict_answers.drawn_verdict(trials.drawn(0, k))[2] for k in range(200)]
    assert min(drawn.count(m) for m in ("yes", "no", "unclear")) > 10


def test_there_are_ninety_kinds_of_server_faults() -> None:
    """Each with a name of its own, over both wires."""
    names = [(fault.wire, fault.name) for fault in FAULTS]
    assert len(set(names)) == len(names) >= 90
    assert {wire for wire, _ in names} == {"openpi", "vla_eval"}


QUICK = [
    "openpi: handshake: 404",
    "openpi: actions: nan",
    "openpi: actions: half precision",
    "vla_eval: answer: an error",
]


@pytest.mark.parametrize("name", QUICK)
def test_an_episode_with_a_server_that_fails_ends_as_it_should(name: str) -> None:
    """With a reason, or it goes on."""
    (fault,) = [fault for fault in FAULTS if f"{fault.wire}: {fault.name}" == name]
    outcome = served(0, 0, [fault])
    assert (outcome.of, outcome.ended) == (name, "refused" if fault.due else "went on"), outcome


def test_an_episode_that_ends_otherwise_is_found() -> None:
    """A fault that is passed over, one for another reason, and a mended one that ends the episode."""
    by_name = {f"{fault.wire}: {fault.name}": fault for fault in FAULTS}
    nan, half = by_name["openpi: actions: nan"], by_name["openpi: actions: half precision"]
    for serve, due_ in ((half.serve, ("bad_reply",)), (nan.serve, ("tls",)), (nan.serve, ())):
        assert served(0, 0, [ServerFault("openpi", "x", due_, serve)]).ended == "misread"


def test_a_server_that_waits_for_ever_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """If the client waited with it."""
    monkeypatch.setattr("benchmarks.faults.servers.episode", lambda wire, address: server_faults.OVER.wait(30))
    monkeypatch.setattr("benchmarks.faults.servers.MOST_S", 0.1)
    (fault,) = [fault for fault in FAULTS if fault.name == "nobody listens"]
    assert served(0, 0, [fault]).ended == "hung"


def test_a_trial_repeats() -> None:
    """By its seed and number."""
    one = functools.partial(trial, 4)
    assert [one(k) for k in range(5)] == [one(k) for k in range(5)]


FAKE_SUITE = "methods: [expert, mpvi]\ntasks: [picking_up_trash]\ninstances: [0, 1, 2, 3]\n"


def kills(folder: Path, count: int) -> Kills:
    """Of a suite of fake episodes."""
    return Kills(1, folder, count, suite=FAKE_SUITE, tree="", episode="tests.fake_episodes:run")


@pytest.mark.slow
def test_kills_cost_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two of them, and on to the end; with the results of an undisturbed run."""
    (tmp_path / "log").mkdir()
    monkeypatch.setenv("FAKE_LOG", str(tmp_path / "log"))
    monkeypatch.setenv("FAKE_SLEEP", "0.2")
    monkeypatch.setattr("benchmarks.faults.kills.LATEST_S", 2.0)
    tried = kills(tmp_path / "runs", 2)
    assert [tried(number).ended for number in range(2)] == ["went on"] * 2
    assert len(tried.due()) == 8


def test_a_result_that_is_lost_or_another_is_found(tmp_path: Path) -> None:
    """Half of one, one that is gone, one that was written again, and one that says something else."""
    config = EpisodeConfig("picking_up_trash", 0, method="expert")
    store = Store(tmp_path / "round0")

    def due_now() -> Kills:
        store.write(config, fake_result(config))
        tried = kills(tmp_path, 1)
        tried._due = dict(results(store.out))
        assert tried.look() is None
        return tried

    tried = due_now()
    store.write(config, fake_result(config))
    assert "second time" in str(tried.look())
    tried = due_now()
    store.path(config).unlink()
    assert "is gone" in str(tried.look())
    due_now()
    store.path(config).write_bytes(store.path(config).read_bytes()[:-50])
    assert "no whole result" in str(kills(tmp_path, 1).look())
    tried = due_now()
    tried._kept.clear()
    store.write(config, fake_result(config, steps=901))
    assert (tried.look() or ("",))[0] == "misread"


def test_a_soak_goes_on_draws_and_finds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A row an episode, a drawing, growth told; one that breaks is found."""
    ends: Any = iter(["went on", "went on", "went on", "crashed"])
    monkeypatch.setattr(soak, "episode", lambda config, most_s: Outcome(config.task, next(ends), "x"))
    out = tmp_path / "soak.jsonl"
    for count, code in ((2, 0), (4, 1)):
        done = CliRunner().invoke(soak.main, ["--out", str(out), "--count", str(count), "--method", "expert"])
        assert done.exit_code == code, done.output
    assert len(out.read_text().splitlines()) == 4
    assert "1 crashed" in done.output
    assert "MB an episode over the second half" in done.output
    assert "<svg" in out.with_suffix(".svg").read_text()
    assert soak.slope([{"rss_mb": 100.0 + 2 * k} for k in range(10)]) == pytest.approx(2.0)


def test_an_episode_that_raises_is_a_crash(monkeypatch: pytest.MonkeyPatch) -> None:
    """And one that its method cannot play, too."""
    monkeypatch.setattr("mpvi_bt.runs.episode.episode.run", lambda config, stop: 1 / 0)
    assert soak.episode(EpisodeConfig("picking_up_trash"), 1.0).ended == "crashed"


def test_the_table_has_a_row_for_what_was_tried_and_counts_every_end(tmp_path: Path) -> None:
    """Answers to planner and checker are told apart; a file of something else, or of nothing, is refused."""
    answers = tmp_path / "answers.jsonl"
    for number, (of, ended) in enumerate(
        [("planner: x", "refused"), ("planner: y", "lost"), ("checker: x", "went on")]
    ):
        append(answers, {"seed": 7, "number": number, "of": of, "ended": ended, "told": ""})
    made = table({answers: "0123abc"}, "2026-11-26", "p")
    assert made.rows == (
        ("answers to a planner", 2, 1, 0, 1, 0, 0, 0),
        ("answers to a checker", 1, 0, 1, 0, 0, 0, 0),
    )
    assert made.runs[0].command == "python -m benchmarks.faults.answers --seed 7 --count 3"
    for name in ("hands.jsonl", "kills.jsonl"):
        (tmp_path / name).touch()
        with pytest.raises(UserError, match="no trials"):
            table({tmp_path / name: "0123abc"}, "2026-11-26", "p")
    kills_ = tmp_path / "kills.jsonl"
    append(kills_, {"seed": 7, "number": 0, "of": "SIGINT", "ended": "went on", "told": ""})
    with pytest.raises(UserError, match="say why"):
        table({answers: "0123abc", kills_: "fedcba9"}, "2026-11-26", "p")
    assert len(table({answers: "0123abc", kills_: "fedcba9"}, "2026-11-26", "p", "mended between").runs) == 2
