"""In which order the episodes of a suite begin, and how long those that are left will take."""

from __future__ import annotations

import heapq
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from operator import itemgetter

from mpvi_bt.choices.backends import choose
from mpvi_bt.choices.config import EpisodeConfig
from mpvi_bt.errors import UserError
from mpvi_bt.instances.tasks import load_task

# Wall seconds for a second of the budget, of scripted policies and of those that look: about the medians of four
# tasks with each of three methods, on one core of a machine that others used. Episodes end long before their time.
SCRIPTED, SEEING = 0.03, 0.12
FILMED = 4.0  # as many times as long takes an episode that is filmed
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
    """What episodes take of wall time: guessed from budgets at first, then learned from those that are through.

    Args:
        budget_s: Time budget [simulated s] of every task.
    """

    def __init__(self, budget_s: Mapping[str, float]) -> None:
        self._budget_s = budget_s
        self._walls: defaultdict[Kind, list[float]] = defaultdict(list)
        self._guesses: defaultdict[Kind, list[float]] = defaultdict(list)

    def learn(self, config: EpisodeConfig, wall_s: float) -> None:
        """An episode took that long."""
        kind = (config.method, config.task)
        self._walls[kind].append(wall_s)
        self._guesses[kind].append(self.guess_s(config))

    def guess_s(self, config: EpisodeConfig) -> float:
        """Wall time [s] that an episode takes before anything is known of this machine."""
        try:
            scripted = choose("policy", config.policy).backend.privileged
        except UserError:  # one of another package
            scripted = False
        rate = SCRIPTED if scripted else SEEING
        return rate * self._budget_s[config.task] * (FILMED if config.video is not None else 1.0)

    def expected_s(self, config: EpisodeConfig) -> float:
        """Wall time [s] that an episode takes, as far as is known."""
        if own := self._walls.get((config.method, config.task)):
            return sum(own) / len(own)
        alike = {kind: walls for kind, walls in self._walls.items() if kind[0] == config.method} or self._walls
        guessed = sum(sum(self._guesses[kind]) for kind in alike)
        slower = sum(map(sum, alike.values())) / guessed if guessed else 1.0
        return self.guess_s(config) * slower

    def left_s(self, waiting: Iterable[EpisodeConfig], running_s: Mapping[EpisodeConfig, float], workers: int) -> float:
        """Wall time [s] until all are through: each that waits begins with the worker that is free first.

        Args:
            waiting: Episodes that have not begun, in their order.
            running_s: Those that have, with the time since.
            workers: How many can be at work at once.
        """
        # Who is late already is expected to take as much again as a quarter of that. Our choice.
        ends = [max(self.expected_s(config) - since, since / 4) for config, since in running_s.items()]
        free = [*ends, *[0.0] * (max(1, workers) - len(ends))]
        heapq.heapify(free)
        for config in waiting:
            heapq.heapreplace(free, free[0] + self.expected_s(config))
        return max(free)
