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
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

_Array = NDArray[np.float64]

_SWEEPS = 30  # of Jacobi's method, at the most: a matrix of a few rows takes about five
_NOTHING = 1e-15  # of two eigenvalues: what is left between them is rounding
_DEPENDS = 1e-12  # of its length: as little of a column is left by rounding where others make it up


def matmul(first: ArrayLike, second: ArrayLike, *more: ArrayLike) -> _Array:
    """The product of matrices, from left to right; stacks of them broadcast, and vectors are taken as by `@`.

    Two vectors give a number.

    Raises:
        ValueError: Shapes that do not go together.
    """
    a, b = np.asarray(first), np.asarray(second)
    out: _Array = _products()[a.ndim > 1, b.ndim > 1](a, b)
    for factor in more:
        b = np.asarray(factor)
        out = _products()[out.ndim > 1, b.ndim > 1](out, b)
    return out


def norm(vectors: ArrayLike, axis: int = -1) -> Any:
    """Euclidean lengths of vectors (..., n), n along `axis`; a number for a single vector."""
    v = np.asarray(vectors)
    return np.sqrt(_products()[False, False](v, v, axis=axis))


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


@cache
def _products() -> dict[tuple[bool, bool], Callable[..., Any]]:
    """The loop for whether the first and the second factor have rows and columns."""
    return {
        (True, True): _ufunc(_matrices, "(n,k),(k,m)->(n,m)", 2, 2, 2),
        (True, False): _ufunc(_times_vector, "(n,k),(k)->(n)", 2, 1, 1),
        (False, True): _ufunc(_vector_times, "(k),(k,m)->(m)", 1, 2, 1),
        (False, False): _ufunc(_vectors, "(k),(k)->()", 1, 1, 1),
    }


def _ufunc(loop: Callable[..., None], layout: str, *dimensions: int) -> Callable[..., Any]:
    """A ufunc of a loop over arrays of so many dimensions, kept where numba keeps what it compiled."""
    import numba

    types = ["void({})".format(", ".join(f"f8[{','.join(':' * n)}]" for n in dimensions))]
    compiled: Any = numba.guvectorize
    try:
        made = compiled(types, layout, cache=True)(loop)
    except RuntimeError:  # no folder that can be written: compile anew in each process
        made = compiled(types, layout)(loop)
    return getattr(made, "ufunc", made)  # numpy's own, without numba's wrapper, which takes longer than the loop


def _matrices(A, B, out):  # type: ignore
    for i in range(A.shape[0]):
        for j in range(B.shape[1]):
            total = 0.0
            for k in range(A.shape[1]):
                total += A[i, k] * B[k, j]
            out[i, j] = total


def _times_vector(A, b, out):  # type: ignore
    for i in range(A.shape[0]):
        total = 0.0
        for k in range(A.shape[1]):
            total += A[i, k] * b[k]
        out[i] = total


def _vector_times(a, B, out):  # type: ignore
    for j in range(B.shape[1]):
        total = 0.0
        for k in range(B.shape[0]):
            total += a[k] * B[k, j]
        out[j] = total


def _vectors(a, b, out):  # type: ignore
    total = 0.0
    for k in range(a.shape[0]):
        total += a[k] * b[k]
    out[0] = total
