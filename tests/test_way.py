"""The way that a result holds."""

from __future__ import annotations

import itertools

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.episode.result import Result
from mpvi_bt.runs.episode.way import TOLERANCE_M, Way, _distances, thinned
from tests.fake_episodes import fake_result


@given(points=arrays.arrays(float, st.tuples(st.integers(1, 60), st.just(2)), elements=st.floats(-20, 20)))
def test_no_point_is_far_from_the_thinned_way(points: Array) -> None:
    """Every point is within the tolerance of a line between two corners, and rounding costs a centimeter at most."""
    corners = np.array(thinned(points))
    lines = list(itertools.pairwise(corners)) or [(corners[0], corners[0])]
    nearest = np.min([_distances(points, a, b) for a, b in lines], axis=0)
    assert nearest.max() <= TOLERANCE_M + 0.01


def test_straight_ways_have_two_corners_and_turns_stay() -> None:
    """However often the robot was looked at on its way."""
    east, north = np.linspace([0, 0], [4, 0], 300), np.linspace([4, 0], [4, 3], 300)
    assert thinned(east) == [[0, 0], [4, 0]]
    assert thinned(np.vstack([east, north])) == [[0, 0], [4, 0], [4, 3]]
    assert thinned(np.zeros((50, 2))) == [[0, 0], [0, 0]]
    assert thinned(np.zeros((0, 2))) == []


def test_results_without_a_way_are_still_results() -> None:
    """Those that were written before ways were kept."""
    data = fake_result(EpisodeConfig("picking_up_trash"))
    assert Result.model_validate(data).way == Way(base=[])
    del data["way"]
    assert Result.model_validate(data).way is None
