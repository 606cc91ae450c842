"""How deep two solids lie in each other."""

from __future__ import annotations

import numpy as np

from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Solid


def penetration(a: Solid, b: Solid) -> float:
    """Smallest shift [m] that would part two solids, 0 or less if they are apart.

    By the separating axis theorem; cylinders and spheres count as the boxes around them (Our choice: an upper bound is
    enough to keep furniture apart).
    """
    A, B = a.T[:3, :3], b.T[:3, :3]
    apart = b.T[:3, 3] - a.T[:3, 3]
    axes = [*A.T, *B.T]
    if not np.allclose(np.abs(matmul(A.T, B)).max(1), 1):  # not parallel: the edges' cross products count too
        crosses = np.cross(A.T[:, None], B.T[None]).reshape(9, 3)
        lengths = norm(crosses, axis=1)
        axes += [c / n for c, n in zip(crosses, lengths, strict=True) if n > 1e-6]
    N = np.stack(axes)
    reach = matmul(np.abs(matmul(N, A)), a.half_m) + matmul(np.abs(matmul(N, B)), b.half_m)
    return float((reach - np.abs(matmul(N, apart))).min())
