"""Results of episodes in folders, in pairs: the same task and start state, played in two ways."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import click
import numpy as np

from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.runs.episode.result import Result, read_result

_DRAWS = 4000  # for an interval


def results(folder: Path) -> list[Result]:
    """Results of runs, in any folders below one; without those that are no result."""
    found = (read_result(file) for file in sorted(folder.rglob("*.json")))
    return sorted((one for one in found if one is not None), key=lambda one: (one.task, one.instance_id))


def paired(some: Sequence[Result], others: Sequence[Result]) -> list[tuple[Result, Result]]:
    """Pairs, without those that have no partner. Raises click.UsageError if none has one."""
    partners = {(one.task, one.instance_id): one for one in others}
    found = [(one, partners[key]) for one in some if (key := (one.task, one.instance_id)) in partners]
    if not found:
        raise click.UsageError(f"{len(some)} and {len(others)} results have no task and start state in common")
    return found


def change(differences: Array) -> str:
    """The mean of differences (n,) with its interval, by drawing them anew."""
    drawn = np.random.default_rng(0).choice(differences, (_DRAWS, len(differences))).mean(1)
    low, high = np.quantile(drawn, (0.025, 0.975))
    return f"{differences.mean():+.2f}, 95 % {low:+.2f} to {high:+.2f}"
