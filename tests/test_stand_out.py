"""Round things with a handle at one side, and a spout at the other, from the points that a picture shows of them."""

from __future__ import annotations

import numpy as np
import pytest

from mpvi_bt.finding.shapes.fit import fit
from mpvi_bt.ground.geometry.solids import Array

EYE = np.array([-1.0, 0.0, 1.3])
RADIUS_M, HEIGHT_M, ON_M = 0.045, 0.17, 0.9


def round_thing(rng: np.random.Generator, radius: float = RADIUS_M) -> Array:
    """Points of the side toward the eye and of the top of a cylinder, off by noise."""
    turn = np.pi + rng.uniform(-1.4, 1.4, 900)
    side = np.stack([radius * np.cos(turn), radius * np.sin(turn), rng.uniform(0, HEIGHT_M, 900)], -1)
    r, about = radius * np.sqrt(rng.uniform(0, 1, 300)), rng.uniform(0, 2 * np.pi, 300)
    top = np.stack([r * np.cos(about), r * np.sin(about), np.full(300, HEIGHT_M)], -1)
    return np.concatenate([side, top]) + [0, 0, ON_M] + rng.normal(0, 0.0008, (1200, 3))


def handle(rng: np.random.Generator, bearing: float, far: float = 0.035) -> Array:
    """Points of an upright bar beside it, and of what it hangs on."""
    out = RADIUS_M + np.append(rng.uniform(far - 0.01, far, 150), rng.uniform(0, far, 30))
    z = ON_M + np.append(rng.uniform(0.03, 0.15, 150), rng.uniform(0.13, 0.15, 30))
    return np.stack([out * np.cos(bearing), out * np.sin(bearing) + rng.uniform(-0.006, 0.006, 180), z], -1)


@pytest.mark.parametrize(
    ("bearing", "spout"), [(1.6, False), (1.6, True), (-1.6, False), (-1.6, True), (2.2, False), (-2.6, False)]
)
def test_the_body_is_as_wide_as_it_is_without_the_handle(bearing: float, spout: bool) -> None:
    """A hand goes around the body, wherever the handle points that is seen beside it, and a spout across from it."""
    rng = np.random.default_rng(0)
    points = [round_thing(rng), handle(rng, bearing), *([handle(rng, bearing + np.pi, 0.022)] if spout else [])]
    shape = fit(np.concatenate(points), np.zeros((0, 3)), EYE, ON_M)
    assert shape is not None
    body, bar = shape.solids[:2]
    assert len(shape.solids) == 2 + spout
    assert body.kind == "cylinder"
    assert body.half_m[0] == pytest.approx(RADIUS_M, abs=0.005)
    np.testing.assert_allclose(body.T[:2, 3], 0.0, atol=0.006)
    assert (RADIUS_M - 0.01) * np.array([np.cos(bearing), np.sin(bearing)]) @ bar.T[:2, 3] > 0


@pytest.mark.parametrize("radius", [0.03, 0.045, 0.06, 0.09])
def test_what_has_no_handle_gets_none(radius: float) -> None:
    """A can, a jar and a pot stay one solid."""
    shape = fit(round_thing(np.random.default_rng(0), radius), np.zeros((0, 3)), EYE, ON_M)
    assert shape is not None
    assert len(shape.solids) == 1
    assert shape.solids[0].half_m[0] == pytest.approx(radius, abs=0.005)


def test_a_box_is_no_round_thing_with_a_handle() -> None:
    """Two faces and the top of one that is wider than a hand."""
    rng = np.random.default_rng(0)
    p = rng.uniform(-1, 1, (1500, 3)) * [0.06, 0.06, 0.085]
    face = rng.integers(0, 3, 1500)
    p[face == 0, 0], p[face == 1, 1], p[face == 2, 2] = -0.06, -0.06, 0.085
    shape = fit(p + [0, 0, ON_M + 0.085], np.zeros((0, 3)), np.array([-1.0, -0.8, 1.3]), ON_M)
    assert shape is not None
    assert [s.kind for s in shape.solids] == ["box"]


@pytest.mark.parametrize("height", [0.0, 0.004, 0.02])
def test_what_is_flat_has_nothing_that_stands_out(height: float) -> None:
    """Of a disc nothing but its top may be seen."""
    rng = np.random.default_rng(0)
    r, about = 0.07 * np.sqrt(rng.uniform(0, 1, 600)), rng.uniform(0, 2 * np.pi, 600)
    disc = np.stack([r * np.cos(about), r * np.sin(about), ON_M + np.full(600, height)], -1)
    shape = fit(disc, np.zeros((0, 3)), EYE, ON_M)
    assert shape is not None
    assert len(shape.solids) == 1
