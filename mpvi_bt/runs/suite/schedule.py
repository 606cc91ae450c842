"""The order of a suite's episodes, and a forecast of the remaining time."""

from __future__ import annotations

import heapq
import math
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from operator import itemgetter
from types import MappingProxyType

from mpvi_bt.house.instances.tasks import load_task
from mpvi_bt.runs.choices.config import EpisodeConfig

# Of the range of the time left. Our choice: nine of ten suites should end in it, and of made-up ones at least four of
# five do (tests/test_progress.py). Spreads are of the logarithm of wall time over what was expected.
_SURE = 1.64  # standard deviations
_FIRST = {True: 0.4, False: 0.8}  # of a task that ran before, and of a new one; counts as one episode among those seen
_LOAD = 0.1  # of all that is left: the machine's other work changes
Kind = tuple[str | None, str]  # method and task: episodes that take about as long


def budgets_s(episodes: Iterable[EpisodeConfig]) -> dict[str, float]:
    """The time budget [simulated s] of every task. Raises as `load_task`."""
    return {task: load_task(task).budget_s for task in dict.fromkeys(config.task for config in episodes)}


def in_rounds(episodes: Sequence[EpisodeConfig], budget_s: Mapping[str, float]) -> list[EpisodeConfig]:
    """First one episode of every task and method, then another of each; in a round, the longest budget first.

    Our choice: what is there at any time says something of every task, and nothing long begins last, when other workers
    have nothing left to do.
    """
    begun: Counter[Kind] = Counter()
    keyed = []
    for config in episodes:
        kind = (config.method, config.task)
        keyed.append((begun[kind], -budget_s[config.task], config))
        begun[kind] += 1
    return [config for *_, config in sorted(keyed, key=itemgetter(0, 1))]


class EpisodeTimes:
    """Learns the wall time of episodes from finished ones.

    Args:
        budget_s: Time budget [simulated s] of every task. A task of which no episode ran is told by it.
    """

    def __init__(self, budget_s: Mapping[str, float]) -> None:
        self._budget_s = budget_s
        self._walls: defaultdict[Kind, list[float]] = defaultdict(list)
        self._errors = {ran: [spread] for ran, spread in _FIRST.items()}

    def learn(self, config: EpisodeConfig, wall_s: float) -> None:
        """An episode took that long."""
        wall_s = max(wall_s, 1e-3)
        if (expected_s := self.expected_s(config)) is not None:
            self._errors[self._ran(config)].append(math.log(wall_s / expected_s))
        self._walls[config.method, config.task].append(wall_s)

    def expected_s(
        self, config: EpisodeConfig, running_s: Mapping[EpisodeConfig, float] = MappingProxyType({})
    ) -> float | None:
        """Wall time [s] that an episode takes, as its task did; None before any ran.

        Of a task that is new the time goes by its budget, at the rate of its method, or of all. The first to end are
        the short ones: the rate counts the time that others have been running, too.
        """
        if self._ran(config):
            own = self._walls[config.method, config.task]
            return sum(own) / len(own)
        alike = {kind: walls for kind, walls in self._walls.items() if kind[0] == config.method} or self._walls
        if not alike:
            return None
        methods = {method for method, _ in alike}
        spent_s = sum(map(sum, alike.values())) + sum(s for c, s in running_s.items() if c.method in methods)
        return self._budget_s[config.task] * spent_s / sum(self._budget_s[t] * len(w) for (_, t), w in alike.items())

    def left_s(
        self, waiting: Iterable[EpisodeConfig], running_s: Mapping[EpisodeConfig, float], workers: int
    ) -> tuple[float, float] | None:
        """Wall time [s] until all are through, from and to; None before any ran.

        Args:
            waiting: Episodes that have not begun, in their order: each begins with the worker that is free first.
            running_s: Those that have, with the time since.
            workers: How many can be at work at once.
        """
        if not self._walls:
            return None
        waiting = list(waiting)
        at_once = max(1, workers, len(running_s))
        factor = self._factor([*waiting, *running_s], at_once)
        return self.ends_s(waiting, running_s, at_once, 1 / factor), self.ends_s(waiting, running_s, at_once, factor)

    def ends_s(
        self, waiting: Iterable[EpisodeConfig], running_s: Mapping[EpisodeConfig, float], workers: int, factor: float
    ) -> float:
        """As `left_s`, where every episode takes its expected time by a factor."""
        known: dict[Kind, float] = {}

        def takes_s(config: EpisodeConfig) -> float:
            kind = (config.method, config.task)
            if kind not in known:
                known[kind] = factor * (self.expected_s(config, running_s) or 0.0)
            return known[kind]

        # Who is late already is expected to take as much again as a quarter of that. Our choice.
        ends = [max(takes_s(config) - since, factor * since / 4) for config, since in running_s.items()]
        free = [*ends, *[0.0] * (max(1, workers) - len(ends))]
        heapq.heapify(free)
        for config in waiting:
            heapq.heapreplace(free, free[0] + takes_s(config))
        return max(free)

    def _ran(self, config: EpisodeConfig) -> bool:
        """Whether an episode of its task and method did."""
        return bool(self._walls.get((config.method, config.task)))

    def _factor(self, left: Sequence[EpisodeConfig], at_once: int) -> float:
        """By how much these episodes may take longer or shorter than expected.

        By as much as earlier ones did; the mean of several is surer than one.
        """
        square = {ran: sum(error**2 for error in errors) / len(errors) for ran, errors in self._errors.items()}
        spread = math.sqrt(sum(square[self._ran(config)] for config in left) / max(len(left), 1))
        through = sum(map(len, self._walls.values()))
        spread *= math.sqrt(1 / max(len(left) / at_once, 1) + 1 / through)
        return math.exp(_SURE * math.hypot(spread, _LOAD))
