"""Suites on a Ray cluster: the same results, nodes that go, nodes that are not alike."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from mpvi_bt.ground.errors import BackendError, UserError
from mpvi_bt.ground.extras import install
from mpvi_bt.runs.suite.manifest import make_manifest
from mpvi_bt.runs.suite.ray_engine import RayEngine, play_far
from mpvi_bt.runs.suite.runner import run_suite
from mpvi_bt.runs.suite.store import Store
from tests.suite_runs import EPISODES, FAKE, Heard, launch, processes, running, started, wait_until, without_wall

needs_ray = pytest.mark.skipif(importlib.util.find_spec("ray") is None, reason="Ray is not installed")


def go(log: Path) -> Path:
    """The file for which the episodes on `cluster` wait."""
    return log.parent / "go"


@pytest.fixture
def cluster(log: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """A cluster whose head has one core and whose second node has two; no episode ends before there is `go(log)`."""
    monkeypatch.setenv("FAKE_UNTIL", str(go(log)))
    monkeypatch.setenv("RAY_worker_niceness", "0")  # at 15, beside other tests, a start takes minutes
    from ray.cluster_utils import Cluster

    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
    cluster.add_node(num_cpus=2)
    yield cluster
    cluster.shutdown()


@pytest.mark.rare
@needs_ray
@pytest.mark.slow
def test_ray_gives_the_results_and_files_that_processes_give(tmp_path: Path, log: Path) -> None:
    """Wall times apart; what an episode writes on its node is beside its result."""
    stores = {}
    for name in ("ray", "processes"):
        out = tmp_path / name
        done = launch(out, log, "--engine", name)
        _, said = done.communicate(timeout=120)
        assert done.returncode == 0, said
        stores[name] = Store(out)
    for config in EPISODES:
        ours, theirs = (without_wall(store.path(config)) for store in stores.values())
        assert ours == theirs
        ours, theirs = ((store.out / "traces" / f"{config.name}.jsonl").read_text() for store in stores.values())
        assert ours == theirs == f"the trace of {config.name}\n"


@pytest.mark.rare
@needs_ray
@pytest.mark.slow
def test_a_node_that_is_lost_costs_no_episode(tmp_path: Path, log: Path, cluster: Any) -> None:
    """One of two is killed while both play: ten valid results, each episode finished once."""
    out = tmp_path / "out"
    run = launch(out, log, "--engine", "ray", "--ray-address", cluster.address, workers=3)
    wait_until(lambda: started(log).total() - started(log, "end").total() == 3, seconds=120)  # two of them there
    (node,) = (node for node in cluster.list_all_nodes() if node is not cluster.head_node)
    cluster.remove_node(node, allow_graceful=False)
    wait_until(lambda: len(running(log)) == 1)  # a process outlives its node for a moment, and would still answer
    go(log).touch()
    text, said = run.communicate(timeout=120)
    assert run.returncode == 0, said
    assert "trash10: 10/10 episodes" in text
    assert "trying once more" in said
    assert sorted(path.name for path in (out / "json").iterdir()) == sorted(f"{c.name}.json" for c in EPISODES)
    assert all(Store(out).result(config) is not None for config in EPISODES)
    assert started(log).keys() == {config.name for config in EPISODES}
    assert said.count(" s simulated") == 10


@pytest.mark.rare
@needs_ray
@pytest.mark.slow
def test_a_killed_suite_goes_on_and_leaves_no_process(tmp_path: Path, log: Path) -> None:
    """The cluster that it started ends with it; what had a result is not played again."""
    out = tmp_path / "out"
    run = launch(out, log, "--engine", "ray", FAKE_SLEEP="1")
    wait_until(lambda: len(list((out / "json").glob("*.json"))) >= 2, seconds=120)
    run.kill()
    run.communicate()
    wait_until(lambda: not running(log), seconds=60)
    kept, before = {path.stem: path.read_bytes() for path in (out / "json").glob("*.json")}, started(log)
    assert 2 <= len(kept) < 10
    run = launch(out, log, "--engine", "ray", FAKE_SLEEP="0")
    text, said = run.communicate(timeout=120)
    assert run.returncode == 0, said
    assert "trash10: 10/10 episodes" in text
    assert {name: (out / "json" / f"{name}.json").read_bytes() for name in kept} == kept
    assert all(started(log)[name] == before[name] for name in kept)


@pytest.mark.rare
@needs_ray
@pytest.mark.slow
def test_what_hangs_or_dies_on_a_node_is_tried_again(
    tmp_path: Path, log: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its process is ended at the wall limit; a death and an exception cost one attempt each."""
    for name, instance in (("FAKE_HANG", "0"), ("FAKE_DIE", "1"), ("FAKE_RAISE", "2")):
        monkeypatch.setenv(name, instance)
    heard = Heard()
    outcome = run_suite(EPISODES[:4], Store(tmp_path / "out"), RayEngine(None, 2, FAKE, wall_limit_s=10.0), heard)
    assert sorted(outcome.results, key=str) == EPISODES[:4]
    assert sorted(heard.faults) == [(0, True), (1, True), (2, True)]


@pytest.mark.rare
@needs_ray
@pytest.mark.slow
def test_a_cluster_of_our_own_does_not_give_way() -> None:
    """Its processes have the niceness of this one, as those of the other engine have."""
    import ray

    engine = RayEngine(None, 1)
    engine.open()
    try:
        assert ray.get(ray.remote(lambda: os.nice(0)).remote()) == os.nice(0)
    finally:
        engine.close()


@needs_ray
def test_a_cluster_that_is_not_there_is_told_in_a_line() -> None:
    """Its address, and that nobody answers there."""
    with pytest.raises(BackendError, match=r"^no Ray cluster at 127\.0\.0\.1:1: "):
        RayEngine("127.0.0.1:1").open()


def test_without_ray_the_extra_is_named() -> None:
    """One line, before anything starts."""
    code = "import sys; sys.modules['ray'] = None; from mpvi_bt.apps.cli import main; main()"
    command = [sys.executable, "-c", code, "suite", "run", "trash10", "--engine", "ray"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == UserError.exit_code
    assert done.stderr == f"mpvi: --engine ray needs Ray, which is not installed: {install('ray')}\n"


def test_a_node_with_other_data_or_another_version_is_refused(log: Path) -> None:
    """No episode is played there, and the difference is named."""
    here = make_manifest("trash10", EPISODES)
    sent = play_far(FAKE, EPISODES[0], 60.0, str(Path.cwd()), here)
    assert sent.played.fault is None
    other = here.model_copy(update={"version": "9.9", "files": {**here.files, "skills/pick.yaml": "0"}})
    from mpvi_bt.runs.suite import ray_engine

    ray_engine._looked_at.clear()
    fault = play_far(FAKE, EPISODES[1], 60.0, str(Path.cwd()), other).played.fault
    assert fault is not None
    assert (fault.hopeless, fault.exit_code) == (True, 2)
    assert f"version was 9.9, is {here.version}; skills/pick.yaml has changed" in fault.message
    assert set(started(log)) == {EPISODES[0].name}


def test_one_engine_or_another_is_no_other_configuration(tmp_path: Path, log: Path) -> None:
    """A suite begun with processes has nothing left for Ray to do, which then is not even started."""
    store = Store(tmp_path / "out")
    run_suite(EPISODES[:2], store, processes(1), Heard())
    heard = Heard()
    run_suite(EPISODES[:2], store, RayEngine("127.0.0.1:1"), heard)
    assert (heard.kept, heard.todo) == (2, 0)
