"""Outlines: what things cover, seen from above."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from mpvi_bt.finding.shapes.from_above import disc, outline, points
from mpvi_bt.ground.geometry.kinematics import transform
from mpvi_bt.ground.geometry.solids import Solid, box, pose

halves = st.floats(0.01, 0.2)
angles = st.floats(-3.1, 3.1)


@st.composite
def solids(draw: st.DrawFn) -> list[Solid]:
    out = []
    for kind in draw(st.lists(st.sampled_from(["box", "cylinder", "sphere"]), min_size=1, max_size=3)):
        a, b, c = draw(halves), draw(halves), draw(halves)
        half = {"box": (a, b, c), "cylinder": (a, a, c), "sphere": (a, a, a)}[kind]
        R = Rotation.from_euler("xyz", [draw(angles) for _ in range(3)]).as_matrix()
        out.append(Solid(kind, np.array(half), transform(R, (draw(halves), draw(halves), 0.0))))  # type: ignore[arg-type]
    return out


@settings(deadline=None)
@given(solids())
def test_points_reach_as_far_as_the_solids(given_solids: list[Solid]) -> None:
    """The points' bounding box is that of the solids, or hardly larger where they are round."""
    boxes = np.stack([s.aabb() for s in given_solids])
    low, high = boxes[:, 0].min(0), boxes[:, 1].max(0)
    p = points(given_solids)
    size = max(float(s.half_m.max()) for s in given_solids)
    for axis in (0, 1):
        assert low[axis] - 0.06 * size < p[:, axis].min() < low[axis] + 1e-6 + 0.04 * size
        assert high[axis] - 1e-6 - 0.04 * size < p[:, axis].max() < high[axis] + 0.06 * size


@settings(deadline=None)
@given(solids())
def test_an_outline_is_dense_and_within_its_disc(given_solids: list[Solid]) -> None:
    """Neighbors of an outline are at most 1.5 cm apart, and the covering disc holds all of it."""
    edge = outline(given_solids)
    assert (np.linalg.norm(edge - np.roll(edge, -1, axis=0), axis=1) < 0.0151).all()
    middle, radius = disc(given_solids)
    assert (np.linalg.norm(edge - middle, axis=1) < radius * 1.05).all()


def test_a_narrow_thing_has_a_narrow_outline() -> None:
    """A book on its edge is as narrow as it is, whichever way it is turned: no square around it counts."""
    for turn in (0.0, 0.4, 1.2):
        edge = outline([box((0.0, 0.0, 0.1), (0.15, 0.035, 0.21)).moved(pose((0.3, 0.2, 0.0), turn))])
        across = (edge - [0.3, 0.2]) @ [-np.sin(turn), np.cos(turn)]
        assert np.abs(across).max() == pytest.approx(0.0175, abs=1e-6)
