"""scipy's rotations of matrices. scipy's own way from a matrix takes an SVD, by BLAS: see `linear_algebra`."""

from __future__ import annotations

from scipy.spatial.transform import Rotation

from mpvi_bt.robot.solids import Array


def rotation(R: Array) -> Rotation:
    """Of rotation matrices (3, 3) or (n, 3, 3) that are orthogonal but for rounding."""
    if R.ndim == 2:
        return Rotation.from_quat(_quaternion(R))
    return Rotation.from_quat([_quaternion(one) for one in R])


def _quaternion(R: Array) -> list[float]:
    """x, y, z, w, not normalized (Shepperd, "Quaternion from rotation matrix", 1978): from the largest of the four."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = R.tolist()
    trace = xx + yy + zz
    largest = max(xx, yy, zz, trace)
    if largest == trace:
        return [zy - yz, xz - zx, yx - xy, 1.0 + trace]
    if largest == xx:
        return [1.0 + xx - yy - zz, xy + yx, xz + zx, zy - yz]
    if largest == yy:
        return [xy + yx, 1.0 + yy - xx - zz, yz + zy, xz - zx]
    return [xz + zx, yz + zy, 1.0 + zz - xx - yy, yx - xy]
