"""An episode's result depends on its config alone: not on the worker, the order or the engine."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path

import pytest

from mpvi_bt.ground import paths
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.suite.processes import ProcessEngine
from mpvi_bt.runs.suite.ray_engine import RayEngine
from mpvi_bt.runs.suite.runner import Engine, run_suite
from mpvi_bt.runs.suite.store import Store
from tests.suite_runs import Heard, without_wall


def beginning(task: str, folder: Path) -> EpisodeConfig:
    """An episode of the first drive and the first grasp of a task, so that it takes seconds."""
    plan = json.loads(paths.find("tasks/plans", task).read_text())
    plan["segments"] = plan["segments"][:2]
    (folder / f"{task}.json").write_text(json.dumps(plan))
    return EpisodeConfig(task, policy="reactive", plan=str(folder / f"{task}.json"))


@pytest.mark.rare
@pytest.mark.slow
@pytest.mark.render
def test_real_episodes_do_not_depend_on_worker_order_or_engine(tmp_path: Path) -> None:
    """Two tasks, seen by cameras: after one another in one process, in either order, in two processes, on Ray."""
    episodes = [beginning(task, tmp_path) for task in ("picking_up_trash", "putting_shoes_on_rack")]
    runs: list[tuple[Engine, list[EpisodeConfig]]] = [
        (ProcessEngine(1), episodes),
        (ProcessEngine(1), episodes[::-1]),
        (ProcessEngine(2), episodes),
    ]
    if importlib.util.find_spec("ray") is not None:
        runs.append((RayEngine(None, 2), episodes))
    stores = [Store(tmp_path / str(number)) for number in range(len(runs))]
    for store, (engine, order) in zip(stores, runs, strict=True):
        outcome = run_suite(order, store, engine, Heard())
        assert not outcome.faults
    for config in episodes:
        results = [without_wall(store.path(config)) for store in stores]
        assert results[0]["steps"] > 30, "it did something"
        assert all(result == results[0] for result in results[1:])
