"""Inputs of a report: the episodes of each method, their results, and the measures of a result."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np

from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import MpviError
from mpvi_bt.ground.marked_yaml import load_marked
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.choices.methods import FOLDER, check_method
from mpvi_bt.runs.episode.result import Result
from mpvi_bt.runs.report.statistics import Array
from mpvi_bt.runs.suite.store import Fault, Store

Key = tuple[str, str, int, int]  # task, house that was named or "", instance, seed


@dataclass(frozen=True)
class Runs:
    """How the episodes of one method stand.

    Attributes:
        method: Its name.
        episodes: All of it, in order.
        results: Those that are there.
        faults: What broke others.
        folder: Of the results, with their traces and videos; None: there are none to look at.
        about: One line for people.
    """

    method: str
    episodes: Sequence[EpisodeConfig]
    results: Mapping[EpisodeConfig, Result]
    faults: Mapping[EpisodeConfig, Fault] = field(default_factory=dict)
    folder: Path | None = None
    about: str = ""

    @property
    def tasks(self) -> list[str]:
        """Their names, in order."""
        return list(dict.fromkeys(config.task_name for config in self.episodes))

    @property
    def by_key(self) -> dict[Key, Result]:
        """The results, as another method's can be looked up beside them."""
        return {key_of(c): self.results[c] for c in self.episodes if c in self.results}


def key_of(config: EpisodeConfig) -> Key:
    """What tells an episode from the others of its method."""
    return config.task_name, config.house_name, config.instance, config.seed


def runs_of(
    episodes: Iterable[EpisodeConfig],
    results: Mapping[EpisodeConfig, Result],
    faults: Mapping[EpisodeConfig, Fault],
    store: Store | None = None,
) -> list[Runs]:
    """A suite's episodes by method; those that name none go by their policy.

    Args:
        episodes: All of it, in order.
        results: Those that are there.
        faults: What broke others.
        store: Where they lie; None: there are no files to look at.
    """
    methods: dict[str | None, list[EpisodeConfig]] = {}
    for config in episodes:
        methods.setdefault(config.method, []).append(config)
    return [
        Runs(
            method or configs[0].policy,
            configs,
            {c: results[c] for c in configs if c in results},
            {c: faults[c] for c in configs if c in faults},
            store.folder(configs[0]) if store else None,
            _about(method),
        )
        for method, configs in methods.items()
    ]


def _about(method: str | None) -> str:
    """What a method's file says of it, if it is still there."""
    try:
        return check_method(*load_marked(paths.find_or_file(FOLDER, method, "method"))).about if method else ""
    except MpviError:
        return ""


@dataclass(frozen=True)
class Measure:
    """Something that is measured of every episode.

    Attributes:
        key: Its name for programs.
        label: Its name for people.
        unit: "" of ratios.
        better: Which way.
        of: Its value in a result; None where the result has none.
        digits: Behind the point.
    """

    key: str
    label: str
    unit: str
    better: Literal["higher", "lower"]
    of: Callable[[Result], float | None]
    digits: int = 2

    @property
    def title(self) -> str:
        """The label with its unit and an arrow to where it is better."""
        unit = f" [{self.unit}]" if self.unit else ""
        return f"{self.label}{unit} {'↑' if self.better == 'higher' else '↓'}"


MEASURES: tuple[Measure, ...] = (
    Measure("q_score", "q", "", "higher", lambda r: r.q, 3),
    Measure("success_rate", "success", "", "higher", lambda r: float(r.success)),
    Measure("goal_fraction", "q with what held at the start", "", "higher", lambda r: r.goal_fraction, 3),
    Measure("conditions_met", "share of conditions", "", "higher", lambda r: r.conditions_met, 3),
    Measure("simulator_time", "time", "s", "lower", lambda r: r.time.simulator_time, 1),
    Measure("normalized_time", "human time / robot time", "", "higher", lambda r: r.time.normalized_time),
    Measure("base", "base", "m", "lower", lambda r: r.agent_distance.base, 1),
    Measure("left", "left hand", "m", "lower", lambda r: r.agent_distance.left, 1),
    Measure("right", "right hand", "m", "lower", lambda r: r.agent_distance.right, 1),
    Measure("normalized_base", "human / robot, base", "", "higher", lambda r: r.normalized_agent_distance.base),
    Measure("normalized_left", "human / robot, left hand", "", "higher", lambda r: r.normalized_agent_distance.left),
    Measure("normalized_right", "human / robot, right hand", "", "higher", lambda r: r.normalized_agent_distance.right),
    Measure(
        "left_base_relative", "left hand from the base", "m", "lower", lambda r: r.agent_distance_base_relative.left, 1
    ),
    Measure(
        "right_base_relative", "right hand from the base", "m", "lower",
        lambda r: r.agent_distance_base_relative.right, 1,
    ),
)  # fmt: skip
BY_KEY = {measure.key: measure for measure in MEASURES}


def by_instance(rows: Iterable[tuple[Key, Sequence[float]]]) -> dict[str, Array]:
    """Task to (instances, k): figures of its instances, means over their seeds."""
    tasks: dict[str, dict[int, list[Sequence[float]]]] = {}
    for (task, _, instance, _), values in rows:
        tasks.setdefault(task, {}).setdefault(instance, []).append(values)
    return {
        task: np.array([np.mean(seeds, axis=0) for seeds in instances.values()]) for task, instances in tasks.items()
    }


def drawn_anew(rows: Iterable[tuple[Key, Sequence[float]]]) -> list[Array]:
    """What a bootstrap draws anew: within each task its instances, or houses where there are several.

    Returns:
        For each task (instances, k), means over their seeds; or a single (houses, k), means over instances, then tasks.
    """
    houses: dict[str, list[tuple[Key, Sequence[float]]]] = {}
    for row in rows:
        houses.setdefault(row[0][1], []).append(row)
    tables = [list(by_instance(of_house).values()) for of_house in houses.values()]
    if len(tables) < 2:
        return [table for of_house in tables for table in of_house]
    return [np.array([np.mean([table.mean(0) for table in of_house], axis=0) for of_house in tables])]
