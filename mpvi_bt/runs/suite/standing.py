"""Progress of a running suite, read from its folder."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import Any

from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.episode.result import Result
from mpvi_bt.runs.suite.at_work import read
from mpvi_bt.runs.suite.schedule import EpisodeTimes, budgets_s, in_rounds
from mpvi_bt.runs.suite.store import Store


def under_way(
    store: Store, episodes: Sequence[EpisodeConfig], results: Mapping[EpisodeConfig, Result]
) -> tuple[list[dict[str, Any]], tuple[float, float] | None]:
    """Each worker's episode, and the remaining wall time [s] (from, to) if it can be estimated."""
    budget_s = budgets_s(episodes)
    pace = EpisodeTimes(budget_s)
    for config, result in results.items():
        if isinstance(wall := result.wall.get("total_s"), int | float):
            pace.learn(config, wall)
    named = {(c.method or "", c.name): c for c in episodes if c not in results}
    works = [(w, named[w.method, w.episode]) for w in read(store.out) if (w.method, w.episode) in named]
    running = {config: max(0.0, time.time() - work.since) for work, config in works}
    waiting = [c for c in in_rounds(episodes, budget_s) if c not in results and c not in running]
    told = [
        {"worker": work.worker, "episode": spoken(c), "since_s": running[c], "expected_s": pace.expected_s(c)}
        for work, c in works
    ]
    return told, pace.left_s(waiting, running, len(works))


def spoken(config: EpisodeConfig) -> str:
    """An episode for a person: its method, if the suite names one, and its name."""
    return f"{config.method} {config.name}" if config.method else config.name
