"""When a path is where: within its limits, along its legs, from rest to rest."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import CONTROL_HZ
from mpvi_bt.ground.robot.timing import timed
from mpvi_bt.hands.robots import r1

seeds = st.integers(0, 2**32 - 1)
SPEED, ACCELERATION = r1.ARM_SPEED, r1.ARM_ACCELERATION


def path(seed: int) -> Array:
    """Two to six random postures."""
    rng = np.random.default_rng(seed)
    low, high = r1.ARM_LIMITS["left"].T
    return rng.uniform(low, high, (rng.integers(2, 7), 7)) * rng.uniform(0.05, 1.0)


def derivatives(points: Array, done: Array) -> tuple[Array, Array, Array]:
    """Speeds, accelerations and jerks of a path that was at rest before and is after."""
    rest = [points[:1].repeat(3, 0), done, points[-1:].repeat(3, 0)]
    velocity = np.diff(np.concatenate(rest), axis=0) * CONTROL_HZ
    return velocity, np.diff(velocity, axis=0) * CONTROL_HZ, np.diff(velocity, n=2, axis=0) * CONTROL_HZ**2


@given(seeds)
def test_no_limit_is_broken_and_nothing_jerks(seed: int) -> None:
    """No column is faster than its speed or speeds up faster than its acceleration, start and end included."""
    points = path(seed)
    velocity, acceleration, jerk = derivatives(points, timed(points, SPEED, ACCELERATION))
    assert (np.abs(velocity) <= SPEED * 1.01).all()
    assert (np.abs(acceleration) <= ACCELERATION * 1.1).all()
    assert np.abs(jerk).max() < 25 * ACCELERATION.max()


@given(seeds)
def test_it_keeps_to_the_path(seed: int) -> None:
    """Every point on the way is within 0.02 of a leg, it passes within 0.02 of each corner, and it ends at the end."""
    points = path(seed)
    done = timed(points, SPEED, ACCELERATION)
    np.testing.assert_allclose(done[-1], points[-1], atol=1e-9)
    legs = np.concatenate([a + (b - a) * np.linspace(0, 1, 600)[:, None] for a, b in pairwise(points)])
    off = np.abs(done[:, None] - legs[None]).max(-1).min(1)
    assert off.max() < 0.02 + 0.01
    step = SPEED.max() / CONTROL_HZ
    assert max(np.abs(done - p).max(1).min() for p in points) < 0.02 + step / 2


@given(seeds)
def test_it_is_not_slower_than_it_has_to_be(seed: int) -> None:
    """Straight from rest to rest takes what a ramp up, the highest speed and a ramp down take, and little more."""
    points = path(seed)[:2]
    way = np.abs(points[1] - points[0])
    peak = np.minimum(SPEED, np.sqrt(way * ACCELERATION))
    least = float((way / peak + peak / ACCELERATION).max())
    done = timed(points, SPEED, ACCELERATION)
    assert least - 0.05 < len(done) / CONTROL_HZ < 1.1 * least + 0.3


def test_corners_are_not_stopped_at() -> None:
    """A path with many slight corners takes hardly longer than the straight one."""
    straight = np.array([[0.0, 0.0], [2.0, 0.0]])
    wavy = np.stack([np.linspace(0, 2, 9), 0.01 * (np.arange(9) % 2)], 1)
    limits = np.array([1.0, 1.0]), np.array([4.0, 4.0])
    assert len(timed(wavy, *limits)) < 1.4 * len(timed(straight, *limits))


def test_a_path_without_length_takes_no_time() -> None:
    """One point, or the same one again, is nothing to do."""
    for points in (np.zeros((1, 7)), np.zeros((3, 7))):
        assert timed(points, SPEED, ACCELERATION).shape == (0, 7)
