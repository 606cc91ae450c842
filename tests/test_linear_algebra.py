"""Products, lengths and small systems give what numpy's give, but for rounding."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from mpvi_bt.ground.geometry.linear_algebra import least_squares, matmul, norm, principal_axes
from mpvi_bt.ground.geometry.rotations import angle, between, matrices, quaternion, rotation

seeds = st.integers(0, 2**32 - 1)
SHAPES = [
    ((4, 4), (4, 4)),
    ((4, 3), (3, 2)),
    ((3, 3), (3,)),
    ((3,), (3, 5)),
    ((3,), (3,)),
    ((7, 4, 4), (4, 4)),
    ((4, 4), (7, 4, 4)),
    ((5, 1, 4, 4), (1, 6, 4, 4)),
    ((2, 3, 3), (3,)),
    ((3,), (2, 3, 4)),
    ((0, 3), (3, 3)),
    ((2, 0), (0, 2)),
]


@pytest.mark.parametrize(("first", "second"), SHAPES)
@given(seed=seeds)
def test_products_are_those_of_numpy(first: tuple[int, ...], second: tuple[int, ...], seed: int) -> None:
    """Matrices, vectors and stacks, strided or not, give the shape and the values that `@` gives."""
    rng = np.random.default_rng(seed)
    a, b = rng.normal(size=first), rng.normal(size=second)
    for x, y in ((a, b), (np.asfortranarray(a), b[..., ::-1]), (a.astype(np.float32), b)):
        np.testing.assert_allclose(matmul(x, y), x @ y, rtol=0, atol=1e-12, strict=True)


def test_a_layout_changes_no_bit() -> None:
    """Sums are in one order, whether the second factor lies row by row, column by column or in strides."""
    rng = np.random.default_rng(0)
    b = rng.normal(size=(40, 30))
    for a in (rng.normal(size=40), rng.normal(size=(20, 40))):
        for same in (np.asfortranarray(b), np.repeat(b, 2, 1)[:, ::2]):
            assert (matmul(a, b) == matmul(a, same)).all()


def test_several_factors_are_taken_from_left_to_right() -> None:
    """A product of four is the products of two, one after the other; lists and integers are taken too."""
    a, b, c = np.random.default_rng(0).normal(size=(3, 3, 3))
    assert (matmul(a, b, c, [1, 0, 2]) == matmul(matmul(matmul(a, b), c), [1, 0, 2])).all()


def test_shapes_that_do_not_go_together_are_refused() -> None:
    """As `@` refuses them."""
    with pytest.raises(ValueError, match="mismatch"):
        matmul(np.eye(3), np.eye(4))


@given(seeds)
def test_lengths_are_those_of_numpy(seed: int) -> None:
    """Of one vector, of rows and of columns."""
    v = np.random.default_rng(seed).normal(size=(5, 3))
    assert norm(v[0]) == pytest.approx(np.linalg.norm(v[0]), abs=1e-14)
    np.testing.assert_allclose(norm(v), np.linalg.norm(v, axis=1), atol=1e-14)
    np.testing.assert_allclose(norm(v, axis=0), np.linalg.norm(v, axis=0), atol=1e-14)


@given(seeds, st.sampled_from([2, 3]))
def test_principal_axes_are_those_of_an_svd(seed: int, d: int) -> None:
    """Deviations and axes of points are those of the SVD, and the largest component of each axis is positive."""
    rng = np.random.default_rng(seed)
    points = matmul(rng.normal(size=(40, d)) * np.array([3.0, 1.0, 0.1])[:d], np.linalg.qr(rng.normal(size=(d, d)))[0])
    spread, axes = principal_axes(points)
    _, singular, rows = np.linalg.svd(points - points.mean(0), full_matrices=False)
    np.testing.assert_allclose(spread, singular / np.sqrt(39), rtol=1e-6)
    np.testing.assert_allclose(np.abs((axes * rows).sum(1)), 1.0, atol=1e-9)
    assert (np.take_along_axis(axes, np.abs(axes).argmax(1)[:, None], 1) > 0).all()


@pytest.mark.parametrize("points", [np.zeros((4, 2)), np.ones((1, 3)), np.outer(np.arange(5.0), [1.0, 0.0, 0.0])])
def test_points_without_extent_have_axes_too(points: np.ndarray) -> None:
    """Points on one place or a line spread by nothing across it, and their axes stay orthogonal."""
    spread, axes = principal_axes(points)
    assert (spread[1:] == 0).all()
    np.testing.assert_allclose(matmul(axes, axes.T), np.eye(points.shape[1]), atol=1e-12)


@given(seeds)
def test_least_squares_are_those_of_numpy(seed: int) -> None:
    """What comes nearest to systems of more rows than columns, such as circles a long way off."""
    rng = np.random.default_rng(seed)
    xy = rng.normal(size=(30, 2)) * 0.05 + 5.0
    A, b = np.c_[2 * xy, np.ones(30)], (xy**2).sum(1)
    np.testing.assert_allclose(least_squares(A, b), np.linalg.lstsq(A, b, rcond=None)[0], rtol=1e-6)


def test_a_column_that_others_make_up_gets_a_zero() -> None:
    """Points on a line lie on no one circle: what is found solves the system all the same."""
    t = np.linspace(0.0, 1.0, 20)
    A, b = np.c_[t, 2 * t, np.ones(20)], 3 * t + 1
    x = least_squares(A, b)
    assert x[1] == 0
    np.testing.assert_allclose(matmul(A, x), b, atol=1e-12)


@given(seeds)
def test_a_rotation_is_that_of_its_matrix(seed: int) -> None:
    """scipy's matrix of a rotation gives that rotation, one or many; half turns too."""
    some = Rotation.random(5, rng=seed)
    assert (rotation(some.as_matrix()).inv() * some).magnitude().max() < 1e-12
    for one in (some[0], *Rotation.from_rotvec(np.pi * np.eye(3))):
        np.testing.assert_allclose(rotation(one.as_matrix()).as_matrix(), one.as_matrix(), atol=1e-12)


@given(seeds)
def test_a_turn_is_that_of_scipy(seed: int) -> None:
    """Angle and places on the way between two rotations are scipy's, to rounding; none and slight ones too."""
    rng, shares = np.random.default_rng(seed), np.linspace(0, 1, 5)
    start = Rotation.random(rng=rng)
    slight = Rotation.from_rotvec(1e-5 * rng.normal(size=3))
    for turn in (Rotation.random(rng=rng), slight, Rotation.identity()):
        p, q = quaternion(start.as_matrix()), quaternion((start * turn).as_matrix())
        way = Slerp([0, 1], Rotation.from_quat([p, q]))(shares)
        np.testing.assert_allclose(matrices(between(p, q, shares)), way.as_matrix(), atol=1e-14)
        assert abs(angle(p, q) - float(turn.magnitude())) < 1e-7
