"""Plays one suite: from its file and options to the outcome of each episode."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

from mpvi_bt.ground.errors import UnknownName, UserError
from mpvi_bt.runs.choices.config import EPISODE, EpisodeConfig, SuiteBudget
from mpvi_bt.runs.episode.prepare import Prepared, check_episode, check_watched
from mpvi_bt.runs.suite.manifest import Manifest, make_manifest
from mpvi_bt.runs.suite.processes import WALL_LIMIT_S, ProcessEngine
from mpvi_bt.runs.suite.runner import Engine, RunListener, SuiteOutcome, run_suite
from mpvi_bt.runs.suite.schedule import EpisodeTimes, budgets_s, in_rounds
from mpvi_bt.runs.suite.store import Store


@dataclass(frozen=True)
class Where:
    """What plays the episodes.

    Attributes:
        engine: Processes of this machine, or a Ray cluster.
        workers: Episodes at work at once; None: one a core.
        wall_limit_s: Wall time after which an episode counts as hung.
        ray_address: Of the cluster; None: one is started on this machine.
        function: "module:name" of what runs one episode.
    """

    engine: Literal["processes", "ray"] = "processes"
    workers: int | None = None
    wall_limit_s: float = WALL_LIMIT_S
    ray_address: str | None = None
    function: str = EPISODE


@dataclass(frozen=True)
class Kept:
    """What is written of every episode, besides its result.

    Attributes:
        trace, picture, mcap, demonstrations: Whether these are.
        video: Films of all, or of those that miss their goal; None: of none.
        demonstration_fps: Rows and pictures of a demonstration a second.
        planned: Whether plans are, that language models make.
    """

    trace: bool = True
    video: Literal["all", "failures"] | None = None
    picture: bool = False
    mcap: bool = False
    demonstrations: bool = False
    demonstration_fps: int = 10
    planned: bool = True

    def of(self, config: EpisodeConfig, folder: Path) -> EpisodeConfig:
        """The episode, with these written in a folder."""
        places = {
            "trace": (self.trace, "traces", ".jsonl"),
            "video": (self.video is not None, "videos", ".mp4"),
            "picture": (self.picture, "pictures", ".png"),
            "mcap": (self.mcap, "mcap", ".mcap"),
            "demonstration": (self.demonstrations, "demonstrations", ""),
            "planned": (self.planned, "plans", ".json"),
        }
        told = {"demonstration_fps": self.demonstration_fps, "only_failures": self.video == "failures"}
        kept: dict[str, Any] = told | {
            field: folder / below / f"{config.name}{suffix}"
            for field, (wanted, below, suffix) in places.items()
            if wanted
        }
        return replace(config, **kept)


def play(
    title: str,
    store: Store,
    episodes: Sequence[EpisodeConfig],
    listen: Callable[[EpisodeTimes], RunListener],
    *,
    tasks: Sequence[str] = (),
    instances: Sequence[int] = (),
    where: Where = Where(),
    kept: Kept = Kept(),
    calls: int | None = None,
    tokens: int | None = None,
    about: str = "",
) -> SuiteOutcome:
    """Run the episodes that have no result.

    Args:
        title: Name of the suite.
        store: Where results are and go.
        episodes: All of the suite.
        listen: Makes what is told how it goes.
        tasks, instances: Only of these, if any are given.
        where: What plays them.
        kept: What is written of each.
        calls, tokens: How much all runs in this folder together may ask of language models; None: any number.
        about: The suite in one line, for who is given its results only.

    Raises:
        UserError: The suite has no such task or instance, something that its episodes name does not exist or is wrong,
            or as of `runner.run_suite`.
        BackendError: As of `runner.run_suite`.
    """
    if where.ray_address is not None and where.engine != "ray":
        raise UserError("--ray-address is where --engine ray plays episodes; it is not chosen.")
    if where.ray_address is not None and (calls is not None or tokens is not None):
        raise UserError("The nodes of a cluster cannot count calls and tokens together; give --calls or --tokens.")
    manifest, budget_s = make_manifest(title, episodes, about), budgets_s(episodes)
    budget = SuiteBudget(store.out / "asked.json", calls, tokens)
    ready: dict[str | None, list[Prepared | None]] = {}  # by the thresholds that they name
    for config in (replace(c, suite_budget=budget) for c in _kinds(episodes)):
        # what is wrong with a tree or a plan is said once, and before workers start
        ready.setdefault(config.calibration, []).append(check_episode(config))
    for config in {c.calibration: c for c in episodes}.values():
        known = [one for one in ready[config.calibration] if one is not None]
        if len(known) == len(ready[config.calibration]):
            check_watched(config, known)
    chosen = [
        kept.of(replace(config, suite_budget=budget), store.folder(config))
        for config in _part(episodes, tasks, instances)
    ]
    engine = _engine(where, manifest)
    return run_suite(
        chosen, store, engine, listen(EpisodeTimes(budget_s)), partial(in_rounds, budget_s=budget_s), manifest
    )


def _kinds(episodes: Sequence[EpisodeConfig]) -> list[EpisodeConfig]:
    """One episode of each task and method, and one of each task and house, house by house."""
    by_method = {(c.task, c.method): c for c in episodes}
    by_house = {(c.house or "", c.task): c for c in episodes}
    return list(dict.fromkeys([*by_method.values(), *(by_house[key] for key in sorted(by_house))]))


def _part(episodes: Sequence[EpisodeConfig], tasks: Sequence[str], instances: Sequence[int]) -> list[EpisodeConfig]:
    """Those of some tasks and instances; of all where none are given. Raises UnknownName if the suite lacks one."""
    for kind, given in (("task", tasks), ("instance", instances)):
        known = list(dict.fromkeys(str(getattr(config, kind)) for config in episodes))
        for one in map(str, given):
            if one not in known:
                raise UnknownName(f"{kind} of this suite", one, known)
    return [c for c in episodes if (not tasks or c.task in tasks) and (not instances or c.instance in instances)]


def _engine(where: Where, manifest: Manifest) -> Engine:
    """What plays the episodes. Raises UserError if it is not installed."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    if where.engine == "ray":
        from mpvi_bt.runs.suite.ray_engine import RayEngine

        return RayEngine(where.ray_address, where.workers, where.function, where.wall_limit_s, manifest)
    return ProcessEngine(where.workers or cores, where.function, where.wall_limit_s)
