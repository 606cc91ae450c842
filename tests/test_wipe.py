"""Wiping and spraying: strokes leave nothing out, and a top is really gone over."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from mpvi_bt.manipulation.skills.wipe import strokes_over

sizes = st.tuples(st.floats(0.02, 0.25), st.floats(0.02, 0.25))


@given(sizes, sizes)
def test_strokes_cover_a_patch_with_any_tool(half: tuple[float, float], reach: tuple[float, float]) -> None:
    """Every point of the patch is under the tool at some place between two turning points."""
    patch, tool = np.array(half), np.array(reach)
    points = np.stack(strokes_over(patch, tool))
    between = [a + (b - a) * u for a, b in pairwise(points) for u in np.linspace(0, 1, 30)]
    way = np.stack([points[0], *between, points[-1]])
    grid = np.stack(np.meshgrid(*(np.linspace(-h, h, 9) for h in half)), -1).reshape(-1, 2)
    step = np.abs(np.diff(way, axis=0)).max() if len(way) > 1 else 0.0
    under = (np.abs(grid[:, None] - way[None]) <= tool + step + 1e-9).all(-1).any(1)
    assert under.all()


@given(sizes, sizes)
def test_strokes_stay_within_the_patch(half: tuple[float, float], reach: tuple[float, float]) -> None:
    """The tool does not hang over an edge unless it is larger than the patch, and then it stays in the middle."""
    patch, tool = np.array(half), np.array(reach)
    for point in strokes_over(patch, tool):
        assert (np.abs(point) + np.minimum(tool, patch) <= patch + 1e-9).all()


@given(sizes, sizes)
def test_no_stroke_is_made_twice(half: tuple[float, float], reach: tuple[float, float]) -> None:
    """Turning points differ from each other."""
    points = [tuple(np.round(p, 9)) for p in strokes_over(np.array(half), np.array(reach))]
    assert len(set(points)) == len(points)
