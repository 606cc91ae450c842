"""Results in pairs: only the same task and start state is compared."""

from __future__ import annotations

import click
import numpy as np
import pytest

from benchmarks.paired_results import change, paired
from benchmarks.played import Episode
from benchmarks.since import rows
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.episode.result import Result
from tests.fake_episodes import fake_result


def result(instance: int) -> Result:
    return Result.model_validate(fake_result(EpisodeConfig("picking_up_trash", instance)))


def test_what_has_no_partner_is_left_out() -> None:
    """And if nothing has one, that is told."""
    some = [result(i) for i in (0, 1)]
    (pair,) = paired(some, [result(1)])
    assert [one.instance_id for one in pair] == [1, 1]
    with pytest.raises(click.UsageError, match="1 and 1 results have no task and start state in common"):
        paired(some[:1], [result(1)])


def test_an_interval_is_about_the_mean() -> None:
    """The same differences have no spread; mixed ones have one that holds their mean."""
    assert change(np.full(5, 0.25)) == "+0.25, 95 % +0.25 to +0.25"
    assert change(np.array([-0.5, 0.5])) == "+0.00, 95 % -0.50 to +0.50"


def test_what_fell_since_is_told_first() -> None:
    """Then what rose, then the mean of all pairs. Only changes have rows."""
    now = [result(i) for i in (0, 1, 3, 4)]  # q is 1 and, of odd ones, 0.5
    now = [one.model_copy(update={"config": {**one.config, "method": "mpvi"}}) for one in now]
    before = [
        Episode(method="mpvi", task="picking_up_trash", instance=i, q=was, ended="success", time_s=1.0)
        for i, was in ((0, 0.25), (1, 0.5), (3, 0.75))
    ]
    fell, rose, mean = rows(before, now)
    assert [fell[2], rose[2]] == ["3", "0"]
    assert mean[0].startswith("mean of 3; difference")
    with pytest.raises(click.UsageError, match="4 results and 1 on file have no episode in common"):
        list(rows([before[0].model_copy(update={"instance": 9})], now))
