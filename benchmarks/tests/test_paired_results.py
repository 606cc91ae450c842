"""Results in pairs: only the same task and start state is compared."""

from __future__ import annotations

import click
import numpy as np
import pytest

from benchmarks.paired_results import change, paired
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
