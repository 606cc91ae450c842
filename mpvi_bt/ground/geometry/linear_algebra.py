"""Products, lengths and small systems, summed in one order on every machine.

numpy's `@`, `dot`, `linalg` and `convolve` call a BLAS, which has other loops for other processors: they round
differently, a plan that hangs on a comparison goes another way, and the same seed gives another episode. The matrices
here are small, so plain loops take no longer. Nothing that decides may use BLAS; `tests/test_blas.py` holds this.

The loops are compiled by numba without reassociation or fused multiply-add, so that each operation rounds as IEEE 754
says, in the order in which it is written.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mpvi_bt.ground.compiled import compiled

_Array = NDArray[np.float64]

# Our choice: as little as rounding of double precision leaves.
_SWEEPS = 30  # of Jacobi's method, at the most: a matrix of a few rows takes about five
_NOTHING = 1e-15  # of two eigenvalues: what is left between them is rounding
_DEPENDS = 1e-12  # of its length: as little of a column is left by rounding where others make it up


def matmul(first: ArrayLike, second: ArrayLike, *more: ArrayLike) -> _Array:
    """The product of matrices, from left to right; stacks of them broadcast, and vectors are taken as by `@`.

    Two vectors give a number.

    Raises:
        ValueError: Shapes that do not go together.
    """
    out = _product(np.asarray(first, np.float64), np.asarray(second, np.float64))
    for factor in more:
        out = _product(out, np.asarray(factor, np.float64))
    return out


def norm(vectors: ArrayLike, axis: int = -1) -> Any:
    """Euclidean lengths of vectors (..., n), n along `axis`; a number for a single vector."""
    v = np.asarray(vectors, np.float64)
    if v.ndim == 1:
        return np.sqrt(_loops().vectors(v, v))
    if axis not in (-1, v.ndim - 1):
        v = np.moveaxis(v, axis, -1)
    squares = _loops().squares(v if v.ndim == 2 else v.reshape(math.prod(v.shape[:-1]), v.shape[-1]))
    return np.sqrt(squares.reshape(v.shape[:-1]))


def principal_axes(points: _Array) -> tuple[_Array, _Array]:
    """How far points (n, d) spread about their mean: standard deviations (d,), most first, and (d, d) axes as rows.

    The largest component of each axis is positive.
    """
    off = points - points.mean(0)
    variances, columns = _symmetric((matmul(off.T, off) / max(len(points) - 1, 1)).tolist())
    order = sorted(range(len(variances)), key=lambda k: -variances[k])
    axes = np.array([[row[k] for row in columns] for k in order])
    axes *= np.sign(np.take_along_axis(axes, np.abs(axes).argmax(1)[:, None], 1))
    return np.sqrt([max(variances[k], 0.0) for k in order]), axes


def least_squares(A: _Array, b: _Array) -> _Array:
    """The x (m,) for which A x, A (n, m) of few columns, comes nearest to b (n,).

    By Gram and Schmidt's method, each column freed of those before it. One that depends on them gets a zero.
    """
    rest, m = np.column_stack([A, b]), A.shape[1]
    R, lengths = np.zeros((m, m + 1)), norm(A, axis=0)
    for k in range(m):
        length = norm(rest[:, k])
        if length <= _DEPENDS * lengths[k]:
            continue
        direction = rest[:, k] / length
        R[k, k], R[k, k + 1 :] = length, matmul(direction, rest[:, k + 1 :])
        rest[:, k + 1 :] -= direction[:, None] * R[k, k + 1 :]
    x = np.zeros(m)
    for k in reversed(range(m)):
        x[k] = (R[k, m] - matmul(R[k, :m], x)) / R[k, k] if R[k, k] else 0.0
    return x


def _symmetric(S: list[list[float]]) -> tuple[list[float], list[list[float]]]:
    """Eigenvalues of a symmetric matrix and the eigenvectors, as columns, by Jacobi's rotations."""
    d = len(S)
    V = [[float(i == j) for j in range(d)] for i in range(d)]
    pairs = [(p, q) for p in range(d) for q in range(p + 1, d)]
    for _ in range(_SWEEPS):
        if all(abs(S[p][q]) <= _NOTHING * math.sqrt(abs(S[p][p] * S[q][q])) for p, q in pairs):
            break
        for p, q in pairs:
            if S[p][q] == 0.0:
                continue
            ratio = (S[q][q] - S[p][p]) / (2 * S[p][q])
            t = math.copysign(1.0, ratio) / (abs(ratio) + math.sqrt(ratio * ratio + 1.0))
            c = 1.0 / math.sqrt(t * t + 1.0)
            s = t * c
            for row in (*S, *V):
                row[p], row[q] = c * row[p] - s * row[q], s * row[p] + c * row[q]
            S[p], S[q] = (
                [c * x - s * y for x, y in zip(S[p], S[q], strict=True)],
                [s * x + c * y for x, y in zip(S[p], S[q], strict=True)],
            )
    return [S[k][k] for k in range(d)], V


def _product(a: _Array, b: _Array) -> Any:
    if not (a.ndim and b.ndim) or a.shape[-1] != b.shape[-2 if b.ndim > 1 else 0]:
        raise ValueError(f"mismatch of the inner dimensions: a product of shapes {a.shape} and {b.shape}")
    if a.ndim <= 2 and b.ndim == 2 and b.flags.c_contiguous:
        return (_loops().vector_times_rows if a.ndim == 1 else _loops().matrices_of_rows)(a, b)
    if a.ndim <= 2 and b.ndim <= 2:
        return _loops()[a.ndim * 2 + b.ndim - 3](a, b)
    left, right = a if a.ndim > 1 else a[None], b if b.ndim > 1 else b[:, None]
    stacks = left.shape[:-2], right.shape[:-2]
    if stacks[0] == stacks[1] or () in stacks:
        both = max(stacks, key=len)
    else:
        both = np.broadcast_shapes(*stacks)
        left, right = (np.broadcast_to(x, (*both, *x.shape[-2:])) for x in (left, right))
    out = _loops().stacks(*(x.reshape(math.prod(x.shape[:-2]), *x.shape[-2:]) for x in (left, right)))
    rows, columns = a.shape[-2:-1], b.shape[-1:] if b.ndim > 1 else ()
    return out.reshape(*both, *rows, *columns)


class _Loops(NamedTuple):
    vectors: Callable[..., Any]
    vector_times: Callable[..., Any]
    times_vector: Callable[..., Any]
    matrices: Callable[..., Any]
    stacks: Callable[..., Any]
    squares: Callable[..., Any]
    vector_times_rows: Callable[..., Any]
    matrices_of_rows: Callable[..., Any]


@cache
def _loops() -> _Loops:
    """The loops, compiled for arrays of any layout; two of them once more for a second factor that lies row by row.

    Along such a row the processor adds several numbers at a time, each of them in the same order as ever.
    """
    from numba import types

    def of(dimensions: int, layout: Literal["A", "C"] = "A") -> Any:
        return types.Array(types.float64, dimensions, layout, readonly=True)

    takes = (1, 1), (1, 2), (2, 1), (2, 2), (3, 3), (2,)
    loops = _vectors, _vector_times, _times_vector, _matrices, _stacks, _squares
    any_layout = (compiled(loop, tuple(map(of, n))) for loop, n in zip(loops, takes, strict=True))
    by_rows = (compiled(loop, (of(n), of(2, "C"))) for loop, n in ((_vector_times_rows, 1), (_matrices_of_rows, 2)))
    return _Loops(*any_layout, *by_rows)


def _vectors(a, b):  # type: ignore
    total = 0.0
    for k in range(a.shape[0]):
        total += a[k] * b[k]
    return total


def _vector_times(a, B):  # type: ignore
    out = np.empty(B.shape[1])
    for j in range(B.shape[1]):
        total = 0.0
        for k in range(B.shape[0]):
            total += a[k] * B[k, j]
        out[j] = total
    return out


def _times_vector(A, b):  # type: ignore
    out = np.empty(A.shape[0])
    for i in range(A.shape[0]):
        total = 0.0
        for k in range(A.shape[1]):
            total += A[i, k] * b[k]
        out[i] = total
    return out


def _matrices(A, B):  # type: ignore
    out = np.empty((A.shape[0], B.shape[1]))
    for i in range(A.shape[0]):
        for j in range(B.shape[1]):
            total = 0.0
            for k in range(A.shape[1]):
                total += A[i, k] * B[k, j]
            out[i, j] = total
    return out


def _stacks(A, B):  # type: ignore
    """Products of as many matrices, or of one with each of many."""
    one, other = A.shape[0], B.shape[0]
    out = np.empty((other if one == 1 else one, A.shape[1], B.shape[2]))
    for s in range(out.shape[0]):
        p, q = s if one > 1 else 0, s if other > 1 else 0
        for i in range(A.shape[1]):
            for j in range(B.shape[2]):
                total = 0.0
                for k in range(A.shape[2]):
                    total += A[p, i, k] * B[q, k, j]
                out[s, i, j] = total
    return out


def _squares(V):  # type: ignore
    out = np.empty(V.shape[0])
    for i in range(V.shape[0]):
        total = 0.0
        for k in range(V.shape[1]):
            total += V[i, k] * V[i, k]
        out[i] = total
    return out


def _vector_times_rows(a, B):  # type: ignore
    out = np.zeros(B.shape[1])
    for k in range(B.shape[0]):
        for j in range(B.shape[1]):
            out[j] += a[k] * B[k, j]
    return out


def _matrices_of_rows(A, B):  # type: ignore
    out = np.zeros((A.shape[0], B.shape[1]))
    for i in range(A.shape[0]):
        for k in range(B.shape[0]):
            for j in range(B.shape[1]):
                out[i, j] += A[i, k] * B[k, j]
    return out
