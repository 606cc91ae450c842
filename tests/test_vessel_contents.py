"""What is seen in a vessel and was not asked for."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mpvi_bt.finding.scene.contents import contents
from mpvi_bt.finding.scene.remembered import Remembered
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.solids import Array, Solid, bounds
from tests.depth_pictures import picture

ROOM = Solid("box", np.array([0.15, 0.1, 0.1]), kin.transform(kin.rot_z(0.4), (1.0, 0.5, 0.2)))
BOTTOM = Solid("box", np.array([0.15, 0.1, 0.004]), kin.transform(kin.rot_z(0.4), (1.0, 0.5, 0.096)))


def block(middle: tuple[float, float, float], size: tuple[float, float, float]) -> Array:
    """Points (n, 3) all through a block, as the vessel lies."""
    axes = [np.linspace(-s / 2, s / 2, max(2, round(s / 0.01))) for s in size]
    local = np.stack(np.meshgrid(*axes), -1).reshape(-1, 3) + middle
    return np.asarray(local @ ROOM.T[:3, :3].T + ROOM.T[:3, 3])


CARTON = block((0.05, 0.0, 0.03), (0.06, 0.06, 0.2))  # sticks out by 3 cm
BESIDE = block((0.25, 0.0, 0.0), (0.1, 0.1, 0.2))
ABOVE = block((0.0, 0.0, 0.2), (0.2, 0.2, 0.02))  # a board


def test_what_stands_in_a_vessel_is_in_it_also_above_its_rim() -> None:
    """Not what stands beside it, nor the board above it, nor its own bottom."""
    bottom = block((0.0, 0.0, -0.1), (0.3, 0.2, 0.01))
    found = contents(np.concatenate([CARTON, BESIDE, ABOVE, bottom]), ROOM, [BOTTOM])
    low, high = bounds(found)
    assert low == pytest.approx(CARTON.min(0), abs=0.03)
    assert high == pytest.approx(CARTON.max(0), abs=0.03)
    assert not contents(np.concatenate([BESIDE, ABOVE, bottom]), ROOM, [BOTTOM])
    assert not contents(np.empty((0, 3)), ROOM, [BOTTOM])


@given(st.integers(0, 2**32 - 1))
def test_each_point_of_it_is_in_one_of_its_cubes(seed: int) -> None:
    """So that it can be told again in the pictures that showed it."""
    points = np.random.default_rng(seed).permutation(CARTON)[:200]
    found = contents(points, ROOM, [])
    middles = np.stack([cube.T[:3, 3] for cube in found])
    gaps = np.abs(points[:, None] - middles).max(-1).min(1)
    assert gaps.max() <= found[0].half_m[0] + 1e-9


def test_what_was_taken_away_is_remembered_no_more() -> None:
    """Of two boxes the one that was taken; before anything was seen there is nothing to forget."""
    memory = Remembered()
    memory.forget(np.zeros(3), np.ones(3))
    image = picture((0.0, 0.0, 0.0), [((1.0, -0.6, 0.0), (1.3, -0.2, 0.8)), ((1.0, 0.2, 0.0), (1.3, 0.6, 0.8))])
    for _ in range(3):
        memory.see(image, image.depth > 0)
    x, z = np.array([1.0125]), np.arange(0.1, 0.75, 0.025)
    left, right = np.arange(0.25, 0.55, 0.025), np.arange(-0.55, -0.25, 0.025)
    assert memory.around(x, left, z)[1].any()
    memory.forget(np.array([0.9, 0.1, 0.0]), np.array([1.4, 0.7, 0.9]))
    assert not memory.around(x, left, z)[1].any()
    assert memory.around(x, right, z)[1].any()
