"""Suites in worker processes: killed, interrupted, broken, resumed."""

from __future__ import annotations

import json
import os
import signal
import time
from dataclasses import replace
from pathlib import Path

import pytest

from mpvi_bt.apps.cli.suite import suite
from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.human import human_stats
from mpvi_bt.runs.episode.result import read_result
from mpvi_bt.runs.suite.at_work import FILE as AT_WORK
from mpvi_bt.runs.suite.processes import WALL_LIMIT_S, ProcessEngine
from mpvi_bt.runs.suite.runner import run_suite
from mpvi_bt.runs.suite.store import Store
from tests.suite_runs import EPISODES, Heard, launch, processes, running, started, wait_until


@pytest.mark.rare
def test_a_killed_run_resumes_with_nothing_lost_and_nothing_twice(tmp_path: Path, log: Path) -> None:
    """SIGKILL half-way, start again: ten valid results, and what was there is untouched and never ran again."""
    out = tmp_path / "out"
    first = launch(out, log, FAKE_SLEEP="0.3")
    wait_until(lambda: len(list((out / "json").glob("*.json"))) >= 3)
    first.kill()
    first.communicate()
    wait_until(lambda: not running(log), seconds=10)
    kept = {path: path.read_bytes() for path in (out / "json").glob("*.json")}
    assert 3 <= len(kept) < 10
    before = started(log)

    second = launch(out, log)
    text, progress = second.communicate(timeout=60)
    assert second.returncode == 0, progress
    assert f"10 episodes, {len(kept)} already there, {10 - len(kept)} to run" in progress
    assert "trash10: 10/10 episodes, 5 succeeded, mean q 0.750" in text
    store = Store(out)
    assert all(store.result(config) is not None for config in EPISODES)
    assert sorted(p.name for p in (out / "json").iterdir()) == sorted(f"{c.name}.json" for c in EPISODES)
    assert {path: path.read_bytes() for path in kept} == kept
    after = started(log)
    for config in EPISODES:
        again = after[config.name] - before[config.name]
        assert again == (0 if store.path(config) in kept else 1), config.name


def test_ctrl_c_while_workers_import_is_one_line(tmp_path: Path, log: Path) -> None:
    """The interpreters of workers have just been started: nothing is heard of them."""
    process = launch(tmp_path / "out", log)
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children")

    def spawned() -> int:
        pids = [pid for task in children.parent.parent.iterdir() for pid in (task / "children").read_text().split()]
        return sum(b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes() for pid in pids)

    wait_until(lambda: spawned() == 2)
    time.sleep(0.15)  # they have begun to import
    os.killpg(process.pid, signal.SIGINT)
    _, said = process.communicate(timeout=20)
    assert process.returncode == 130
    assert "Traceback" not in said
    assert "mpvi: interrupted" in said


def test_ctrl_c_stops_the_workers_and_exits_with_130(tmp_path: Path, log: Path) -> None:
    """As from a terminal it reaches the whole process group: what goes on is told, no traceback, no process left."""
    process = launch(tmp_path / "out", log, FAKE_SLEEP="30")
    wait_until(lambda: started(log).total() >= 2)
    os.killpg(process.pid, signal.SIGINT)
    _, progress = process.communicate(timeout=20)
    assert process.returncode == 130
    assert "Traceback" not in progress
    told, command = progress.splitlines()[-2:]
    assert told == "mpvi: interrupted; this goes on with what is left:"
    assert command.startswith("  mpvi suite run ")
    assert str(tmp_path / "out") in command
    assert not (tmp_path / "out" / AT_WORK).exists()
    wait_until(lambda: not running(log), seconds=10)


def test_a_dead_worker_is_replaced_and_its_episode_tried_again(
    tmp_path: Path, log: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A worker's death and an exception cost one attempt each, never a task failure."""
    monkeypatch.setenv("FAKE_DIE", "1")
    monkeypatch.setenv("FAKE_RAISE", "2")
    heard = Heard()
    outcome = run_suite(EPISODES[:4], Store(tmp_path / "out"), processes(2), heard)
    assert list(outcome.results) == EPISODES[:4]
    assert not outcome.faults
    assert sorted(heard.faults) == [(1, True), (2, True)]
    assert started(log) == {c.name: 2 if c.instance in (1, 2) else 1 for c in EPISODES[:4]}
    assert set(started(log, "end").values()) == {1}
    assert heard.ended


def test_what_breaks_twice_is_a_fault_that_the_next_run_tries_again(
    tmp_path: Path, log: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A machine fault leaves no result, is on file with its traceback, and is gone once the episode is through."""
    store = Store(tmp_path / "out")
    monkeypatch.setenv("FAKE_RAISE", "1")
    monkeypatch.setenv("FAKE_ALWAYS", "1")
    heard = Heard()
    outcome = run_suite(EPISODES[:2], store, processes(1), heard)
    assert list(outcome.results) == EPISODES[:1]
    assert outcome.faults[EPISODES[1]].message == "Unpicklable: broke at 1, 2"
    assert heard.faults == [(1, True), (1, False)]
    fault = store.fault(EPISODES[1])
    assert fault is not None
    assert "raise Unpicklable" in fault.details

    monkeypatch.delenv("FAKE_RAISE")
    heard = Heard()
    outcome = run_suite(EPISODES[:2], store, processes(1), heard)
    assert (heard.kept, heard.todo, heard.done) == (1, 1, EPISODES[1:2])
    assert not outcome.faults
    assert store.fault(EPISODES[1]) is None


def test_a_failure_of_the_policys_backend_is_no_result_and_the_next_run_tries_again(
    tmp_path: Path, log: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is tried once more, then on file with its reason, apart from machine faults and from scores."""
    store = Store(tmp_path / "out")
    monkeypatch.setenv("FAKE_BACKEND", "0")
    heard = Heard()
    outcome = run_suite(EPISODES[:2], store, processes(1), heard)
    assert list(outcome.results) == EPISODES[:2], "the second try went through"
    assert heard.faults == [(0, True)]

    store = Store(tmp_path / "again")
    monkeypatch.setenv("FAKE_ALWAYS", "1")
    outcome = run_suite(EPISODES[:2], store, processes(1), Heard())
    assert list(outcome.results) == EPISODES[1:2]
    fault = store.fault(EPISODES[0])
    assert fault is not None
    assert (fault.backend, fault.kind, fault.message) == (
        "server_closed", "backend failure", "server_closed: it went away",
    )  # fmt: skip
    written = read_result(store.path(EPISODES[0]))
    assert written is not None
    assert written.ended == "backend_error"

    monkeypatch.delenv("FAKE_BACKEND")
    heard = Heard()
    run_suite(EPISODES[:2], store, processes(1), heard)
    assert (heard.kept, heard.done) == (1, EPISODES[:1])
    assert store.fault(EPISODES[0]) is None


@pytest.mark.slow
def test_a_hung_episode_is_stopped_and_tried_again(tmp_path: Path, log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Past its wall-time limit an episode's worker is killed."""
    monkeypatch.setenv("FAKE_HANG", "0")
    heard = Heard()
    outcome = run_suite(EPISODES[:2], Store(tmp_path / "out"), processes(1, wall_limit_s=4.0), heard)
    assert list(outcome.results) == EPISODES[:2]
    assert heard.faults == [(0, True)]


def test_bad_input_ends_the_run_at_once(tmp_path: Path, log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What would break every episode alike is raised as what it is."""
    monkeypatch.setenv("FAKE_USER_ERROR", "0")
    monkeypatch.setenv("FAKE_SLEEP", "30")
    with pytest.raises(UserError, match=r"^the tree is missing$"):
        run_suite(EPISODES, Store(tmp_path / "out"), processes(1), Heard())
    assert not started(log, "end")


def test_nothing_is_started_when_all_is_there(tmp_path: Path, log: Path) -> None:
    """A finished suite costs no process, and a corrupt or cut file is run again."""
    from tests.fake_episodes import fake_result

    store = Store(tmp_path / "out")
    for config in EPISODES[:3]:
        store.write(config, fake_result(config))
    heard = Heard()
    run_suite(EPISODES[:3], store, ProcessEngine(2, "no.such.module:run"), heard)
    assert (heard.kept, heard.todo) == (3, 0)

    whole = store.path(EPISODES[0]).read_text()
    store.path(EPISODES[0]).write_text(whole[: len(whole) // 2])
    other = json.loads(store.path(EPISODES[1]).read_text()) | {"task": "another"}
    store.path(EPISODES[1]).write_text(json.dumps(other))
    heard = Heard()
    run_suite(EPISODES[:3], store, processes(1), heard)
    assert (heard.kept, sorted(c.instance for c in heard.done)) == (1, [0, 1])
    assert [path.relative_to(store.out).parent.as_posix() for path in heard.moved] == ["quarantine"] * 2
    assert {path.read_text() for path in heard.moved} == {whole[: len(whole) // 2], json.dumps(other)}
    assert read_result(store.path(EPISODES[0])) is not None


def test_a_resumed_run_keeps_the_order_of_the_whole(tmp_path: Path, log: Path) -> None:
    """What is left begins in the order that it had: a task without a result comes before another's second one."""
    from mpvi_bt.runs.suite.schedule import in_rounds
    from tests.fake_episodes import fake_result

    store, budget_s = Store(tmp_path / "out"), {"picking_up_trash": 10.0, "turning_on_radio": 1.0}
    episodes = [replace(config, task=task) for task in budget_s for config in EPISODES[:2]]
    store.write(episodes[0], fake_result(episodes[0]))
    heard = Heard()
    run_suite(episodes, store, processes(1), heard, lambda episodes: in_rounds(episodes, budget_s))
    assert [(c.task, c.instance) for c in heard.done] == [
        ("turning_on_radio", 0),
        ("picking_up_trash", 1),
        ("turning_on_radio", 1),
    ]


def test_no_task_played_at_the_pace_of_life_counts_as_hung() -> None:
    """Planning takes time, too: twice the time of the longest task is the least."""
    assert WALL_LIMIT_S > 2 * max(human.time_budget_s for human in human_stats().values())
    asked = {parameter.name: parameter.default for parameter in suite.commands["run"].params}
    assert asked["wall_limit"] == WALL_LIMIT_S
