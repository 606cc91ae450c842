"""Two methods compared on the same episodes: pairs of the same task, house, instance and seed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import starmap

import numpy as np

from mpvi_bt.runs.episode.result import Result
from mpvi_bt.runs.report.runs import Key, Runs, drawn_anew
from mpvi_bt.runs.report.statistics import Chance, Estimate, difference, estimate, permutation_test, relative

SAME_Q = 1e-9  # q is a share of whole literals; this is rounding

_Effort = Callable[[Result], float | None]

# What is compared where both methods came equally far. Hands: both together, as in the paper's "end-effector".
EFFORTS: Mapping[str, _Effort] = {
    "normalized time": lambda r: 1 / r.time.normalized_time if r.time.normalized_time else None,  # robot / human
    "time": lambda r: r.time.simulator_time,
    "base distance": lambda r: r.agent_distance.base,
    "hand distance": lambda r: r.agent_distance.left + r.agent_distance.right,
    "hand distance from the base": lambda r: r.agent_distance_base_relative.left + r.agent_distance_base_relative.right,
}


@dataclass(frozen=True)
class TaskPairs:
    """The pairs of one task, or of all.

    Attributes:
        pairs: How many.
        baseline, method: Mean q of each over the pairs.
        difference: Of the method's q less the baseline's.
        wins, ties, losses: Of the method, over its pairs.
    """

    pairs: int
    baseline: float
    method: float
    difference: Estimate
    wins: int
    ties: int
    losses: int


@dataclass(frozen=True)
class MethodComparison:
    """A method beside a baseline.

    Attributes:
        baseline, method: Names.
        overall: Of all pairs: means over instances, tasks, then houses.
        tasks: Of each task that has pairs.
        chance: That such a difference of q comes by chance: a paired permutation test over all pairs.
        relative: Improvement of the mean q, as a share of the baseline's; None where that is 0.
        gains, equal, regressions: How many tasks' mean q is higher, the same, lower.
        matched: How many pairs have the same q > 0. Our choice of "above 0": the paper has 20 matching pairs, and must
            have had many more in which both methods got nothing.
        efforts: Of those pairs, by how much the method's effort is above the baseline's, as a share of it; below 0 is
            less effort. Robot's over human time weighs tasks alike. Our choice: the ratio of the means over the pairs,
            and pairs are drawn anew whatever their task, since each task has few.
    """

    baseline: str
    method: str
    overall: TaskPairs
    tasks: dict[str, TaskPairs]
    chance: Chance
    relative: Estimate | None
    gains: int
    equal: int
    regressions: int
    matched: int
    efforts: dict[str, Estimate | None]


def compare(baseline: Runs, method: Runs) -> MethodComparison | None:
    """Compare the episodes that both have finished; None if there is none."""
    before, after = baseline.by_key, method.by_key
    shared = {key: (before[key], after[key]) for key in before if key in after}
    if not shared:
        return None
    tasks = {
        task: _pairs({key: pair for key, pair in shared.items() if key[0] == task})
        for task in dict.fromkeys(key[0] for key in shared)
    }
    changes = [pairs.difference.mean for pairs in tasks.values()]
    tables = drawn_anew((key, (a.q, b.q)) for key, (a, b) in shared.items())
    matched = [(a, b) for a, b in shared.values() if a.q > 0 and abs(a.q - b.q) < SAME_Q]
    return MethodComparison(
        baseline=baseline.method,
        method=method.method,
        overall=_pairs(shared),
        tasks=tasks,
        chance=permutation_test([table[:, 1] - table[:, 0] for table in tables]),
        relative=estimate(tables, relative),
        gains=sum(change > SAME_Q for change in changes),
        equal=sum(abs(change) <= SAME_Q for change in changes),
        regressions=sum(change < -SAME_Q for change in changes),
        matched=len(matched),
        efforts={name: _effort(matched, of) for name, of in EFFORTS.items()},
    )


def _pairs(shared: Mapping[Key, tuple[Result, Result]]) -> TaskPairs:
    tables = drawn_anew((key, (a.q, b.q)) for key, (a, b) in shared.items())
    means = np.mean([table.mean(0) for table in tables], axis=0)
    changed = estimate(tables, difference)
    assert changed is not None
    gaps = [b.q - a.q for a, b in shared.values()]
    wins, losses = sum(gap > SAME_Q for gap in gaps), sum(gap < -SAME_Q for gap in gaps)
    return TaskPairs(
        len(gaps), float(means[0]), float(means[1]), changed, wins, len(gaps) - wins - losses, losses
    )  # fmt: skip


def _effort(matched: list[tuple[Result, Result]], of: _Effort) -> Estimate | None:
    pairs = [pair for pair in starmap(lambda a, b: (of(a), of(b)), matched) if None not in pair]
    return estimate([np.array(pairs, float)] if pairs else [], relative)
