"""In which order the episodes of a suite begin, and how long those that are left will take."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from operator import itemgetter

from mpvi_bt.suite.config import EpisodeConfig
from mpvi_bt.suite.tasks import load_task

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


class Pace:
    """What episodes take of wall time, learned from those that are through.

    Args:
        budget_s: Time budget [simulated s] of every task: of a task that none is through of, it says how much longer
            than others it takes.
    """

    def __init__(self, budget_s: Mapping[str, float]) -> None:
        self._budget_s = budget_s
        self._walls: defaultdict[Kind, list[float]] = defaultdict(list)

    def learn(self, config: EpisodeConfig, wall_s: float) -> None:
        """An episode took that long."""
        self._walls[config.method, config.task].append(wall_s)

    def expected_s(self, config: EpisodeConfig) -> float | None:
        """Wall time [s] that an episode takes, as far as is known; None: nothing is."""
        if own := self._walls.get((config.method, config.task)):
            return sum(own) / len(own)
        alike = {kind: walls for kind, walls in self._walls.items() if kind[0] == config.method} or self._walls
        simulated = sum(self._budget_s[task] * len(walls) for (_, task), walls in alike.items())
        return self._budget_s[config.task] * sum(map(sum, alike.values())) / simulated if simulated else None

    def left_s(self, waiting: Iterable[EpisodeConfig], running_s: Mapping[EpisodeConfig, float], workers: int) -> float:
        """Wall time [s] until all are through; nan: nobody knows.

        Args:
            waiting: Episodes that have not begun.
            running_s: Those that have, with the time since.
            workers: How many can be at work at once.
        """
        rest = [_or_nan(self.expected_s(config)) for config in waiting]
        begun = [max(0.0, _or_nan(self.expected_s(config)) - since) for config, since in running_s.items()]
        return max([sum(rest + begun) / max(1, workers), *begun])


def _or_nan(value: float | None) -> float:
    return float("nan") if value is None else value
