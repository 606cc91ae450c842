"""All figures of a report, computed in one place; pages and JSON only show them."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from mpvi_bt.ground.errors import UnknownName
from mpvi_bt.runs.choices.backends import privileged
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.episode.queries import queries_text
from mpvi_bt.runs.episode.result import Result
from mpvi_bt.runs.report.compare import MethodComparison, compare
from mpvi_bt.runs.report.failures import Failures, count_failures
from mpvi_bt.runs.report.paper import paper_mean, paper_scores
from mpvi_bt.runs.report.runs import MEASURES, Runs, drawn_anew, key_of
from mpvi_bt.runs.report.statistics import LEVEL, RESAMPLES, Estimate, estimate

BASELINE = "e2e"  # what the paper compares with, where it is among the methods
_UNLIKE = (
    "Not every method was given the same tasks: a mean over all tasks is over a method's own; comparisons are over "
    "episodes that both have finished."
)
_ACTIVITIES = {  # of wall time, by what the loop counts apart
    "physics": ("stepping",),
    "rendering": ("rendering",),
    "planning": ("navigation", "motion"),
    "models": ("policy", "checker", "planner"),
    "tree": ("ticking", "triggers"),
    "recording": ("watching",),
    "paused": ("paused",),
}


@dataclass(frozen=True)
class Group:
    """The episodes of a method in a task, or in all.

    Attributes:
        episodes: That there are to be.
        finished: That have a result.
        successes: Of these.
        q_with_missing: Mean q, episodes without a result counted as 0, as BEHAVIOR's leaderboard does.
        measures: Means of what was measured over seeds, instances, tasks, then houses, of episodes that have a result.
    """

    episodes: int
    finished: int
    successes: int
    q_with_missing: float
    measures: dict[str, Estimate | None]


@dataclass(frozen=True)
class MethodFigures:
    """What came out for one method.

    Attributes:
        name, about: Of the method.
        settings: Of its episodes, where all are alike.
        privileged: Backends that read simulator truth.
        assisted: Whether grasps were assisted.
        overall: All its episodes.
        tasks: Those of each task.
        houses: Those in each house that was named; "" is a task's own.
        instances: Mean q of each instance that has a result, by task.
        paper: The paper's mean q of the method of that name over these tasks, or None.
        failures: Over all its results.
        failures_by_task: Those of each task.
        wall: Share of wall time by activity; empty where nothing was timed.
        wall_s: Mean wall time of an episode [s], or None.
        queries: What the checker was asked, in a line.
        missing: Episodes without a result, with what broke them, or "" if nothing did.
        to_run: How many of each task nothing broke, and that have no result.
    """

    name: str
    about: str
    settings: dict[str, Any]
    privileged: list[str]
    assisted: bool
    overall: Group
    tasks: dict[str, Group]
    houses: dict[str, Group]
    instances: dict[str, dict[int, float]]
    paper: float | None
    failures: Failures
    failures_by_task: dict[str, Failures]
    wall: dict[str, float]
    wall_s: float | None
    queries: str
    missing: dict[str, str]
    to_run: dict[str, int]


@dataclass(frozen=True)
class Figures:
    """A report's figures.

    Attributes:
        suite: Its name.
        about: One line for people.
        methods: In order.
        baseline: Name of the method that others are compared with.
        comparisons: Each other method with that.
        level: Of confidence of all intervals.
        resamples: Behind each.
        paper: The paper's q by method and task, of tasks of this suite.
        notes: Sentences on what is to be known of methods that stand side by side.
    """

    suite: str
    about: str
    methods: list[MethodFigures]
    baseline: str
    comparisons: list[MethodComparison]
    level: float
    resamples: int
    paper: dict[str, dict[str, float]]
    notes: list[str]

    @property
    def tasks(self) -> list[str]:
        """Names of the tasks, in order."""
        return list(dict.fromkeys(task for method in self.methods for task in method.tasks))

    @property
    def houses(self) -> list[str]:
        """Names of the houses, in order; "" is a task's own."""
        return list(dict.fromkeys(house for method in self.methods for house in method.houses))

    def data(self) -> dict[str, Any]:
        """For programs: plain data of JSON."""
        return asdict(self)


def figures(
    suite: str, runs: Sequence[Runs], about: str = "", baseline: str | None = None, notes: Sequence[str] = ()
) -> Figures:
    """Compute a report's figures.

    Args:
        suite: Its name.
        runs: Of each method, at least one.
        about: The suite, in one line.
        baseline: Name of the method that others are compared with; None: `e2e`, or else the first.
        notes: As of `Figures`.

    Raises:
        UnknownName: No method has the baseline's name.
    """
    names = [run.method for run in runs]
    if baseline is not None and baseline not in names:
        raise UnknownName("method", baseline, names, "--baseline")
    first = baseline or (BASELINE if BASELINE in names else names[0])
    base = runs[names.index(first)]
    methods = [_method(run) for run in runs]
    tasks = {task for method in methods for task in method.tasks}
    return Figures(
        suite=suite,
        about=about,
        methods=methods,
        baseline=first,
        comparisons=[found for run in runs if run is not base and (found := compare(base, run)) is not None],
        level=LEVEL,
        resamples=RESAMPLES,
        paper={
            method: known
            for method, scores in paper_scores().items()
            if (known := {task: q for task, q in scores.items() if task in tasks})
        },
        notes=[*notes, *([_UNLIKE] if any(set(method.tasks) != tasks for method in methods) else [])],
    )


def _method(runs: Runs) -> MethodFigures:
    results = list(runs.results.values())
    of_task = {task: [c for c in runs.episodes if c.task_name == task] for task in runs.tasks}
    of_house: dict[str, list[EpisodeConfig]] = {}
    for config in runs.episodes:
        of_house.setdefault(config.house_name, []).append(config)
    wall, wall_s = wall_shares(results)
    return MethodFigures(
        name=runs.method,
        about=runs.about,
        settings=_shared(config.record() for config in runs.episodes),
        privileged=_privileged(runs),
        assisted=any(config.assisted for config in runs.episodes),
        overall=group_of(runs, runs.episodes),
        tasks={task: group_of(runs, configs) for task, configs in of_task.items()},
        houses={house: group_of(runs, configs) for house, configs in of_house.items()},
        instances={task: _instances(runs, configs) for task, configs in of_task.items()},
        paper=paper_mean(runs.method, runs.tasks),
        failures=count_failures(results),
        failures_by_task={
            task: count_failures(runs.results[c] for c in configs if c in runs.results)
            for task, configs in of_task.items()
        },
        wall=wall,
        wall_s=wall_s,
        queries=queries_text(result.queries for result in results),
        missing={
            c.name: fault.message if (fault := runs.faults.get(c)) else ""
            for c in runs.episodes
            if c not in runs.results
        },
        to_run={
            task: sum(c not in runs.results and c not in runs.faults for c in configs)
            for task, configs in of_task.items()
        },
    )


def _privileged(runs: Runs) -> list[str]:
    """Privileged parts, as the results name them (other packages may be gone); else by the settings."""
    told = [result.privileged for result in runs.results.values()]
    return sorted({part for parts in told or [privileged(c.backends) for c in runs.episodes] for part in parts})


def group_of(runs: Runs, configs: Sequence[EpisodeConfig]) -> Group:
    """What came of some episodes of a method."""
    done = [(c, runs.results[c]) for c in configs if c in runs.results]
    rows = [(key_of(c), result) for c, result in done]
    zeros = drawn_anew((key_of(c), (runs.results[c].q if c in runs.results else 0.0,)) for c in configs)
    return Group(
        episodes=len(configs),
        finished=len(done),
        successes=sum(result.success for _, result in done),
        q_with_missing=found.mean if (found := estimate(zeros, resamples=1)) else 0.0,
        measures={
            measure.key: estimate(drawn_anew((key, (x,)) for key, r in rows if (x := measure.of(r)) is not None))
            for measure in MEASURES
        },
    )


def _instances(runs: Runs, configs: Sequence[EpisodeConfig]) -> dict[int, float]:
    """Instance to its mean q over seeds and houses, of one task's episodes that have a result."""
    scores: defaultdict[int, list[float]] = defaultdict(list)
    for config in configs:
        if config in runs.results:
            scores[config.instance].append(runs.results[config].q)
    return {instance: sum(scores[instance]) / len(scores[instance]) for instance in sorted(scores)}


def _shared(configs: Iterable[Mapping[str, Any]]) -> dict[str, Any]:
    """Settings with the same value in all episodes, without those that identify an episode."""
    every = list(configs)
    return {
        key: value
        for key, value in (every[0] if every else {}).items()
        if key not in ("task", "instance", "seed", "arguments") and all(c.get(key) == value for c in every)
    }


def wall_shares(results: Sequence[Result]) -> tuple[dict[str, float], float | None]:
    """Shares of wall time by activity, and its mean [s], of those results that were timed."""
    spent: defaultdict[str, float] = defaultdict(float)
    totals = []
    for result in results:
        loop, total = result.wall.get("loop"), _seconds(result.wall.get("total_s"))
        if not isinstance(loop, dict) or not total:
            continue
        totals.append(total)
        parts = {name: sum(_seconds(loop.get(key)) for key in keys) for name, keys in _ACTIVITIES.items()}
        scripted = min(_seconds(result.wall.get("planning_s")), _seconds(loop.get("policy")))
        parts["planning"] += scripted
        parts["models"] -= scripted
        parts["setting up"] = _seconds(result.wall.get("setup_s"))
        parts["other"] = max(0.0, total - sum(parts.values()))
        for name, seconds in parts.items():
            spent[name] += seconds
    if not totals:
        return {}, None
    if not spent["paused"]:  # as long as nobody debugs, there is nothing to tell of it
        del spent["paused"]
    return {name: seconds / sum(totals) for name, seconds in spent.items()}, sum(totals) / len(totals)


def _seconds(value: object) -> float:
    return float(value) if isinstance(value, int | float) else 0.0
