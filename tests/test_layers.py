"""All that is seen of something large, as upright boxes."""

from __future__ import annotations

import numpy as np
import pytest

from mpvi_bt.finding.shapes.layers import layers
from mpvi_bt.ground.geometry.solids import Array, bounds

TRUNK_M, CROWN_M = 0.1, 0.6  # radii
CROWN_Z = 1.6


def tree(lowest: float) -> Array:
    """Points (n, 3) of the side toward -x of a trunk that is seen from a height [m] up, and of the crown on it."""
    around = np.linspace(np.pi / 2, 3 * np.pi / 2, 40)
    shell = np.column_stack([np.cos(around), np.sin(around)])

    def side(radius: float, low: float, high: float) -> Array:
        heights = np.arange(low, high, 0.01)
        ring = np.repeat(radius * shell, len(heights), axis=0)
        return np.column_stack([ring, np.tile(heights, len(shell))])

    spread = np.arange(-CROWN_M, CROWN_M, 0.02)
    below = np.stack(np.meshgrid(spread, spread, [CROWN_Z], indexing="ij"), -1).reshape(-1, 3)
    below = below[np.linalg.norm(below[:, :2], axis=1) < CROWN_M]
    return np.concatenate([side(TRUNK_M, lowest, CROWN_Z), below, side(CROWN_M, CROWN_Z, 2.0)])


@pytest.mark.parametrize(("lowest", "before", "foot"), [
    (0.02, np.inf, 0.0), (0.2, np.inf, 0.0), (0.5, 0.02, 0.0), (0.5, np.inf, 0.5),
])  # fmt: skip
def test_below_a_crown_there_is_but_the_trunk(lowest: float, before: float, foot: float) -> None:
    """It goes down to the floor where it was seen to, now or before; nothing as wide as the crown is below that."""
    parts = [solid.aabb() for solid in layers(tree(lowest), before)]
    under = [box for box in parts if box[1, 2] < CROWN_Z - 0.1 or box[0, 2] < CROWN_Z - 0.2]
    assert min(box[0, 2] for box in parts) == pytest.approx(foot, abs=0.011)
    assert all((np.abs(box[:, :2]) < TRUNK_M + 0.03).all() for box in under)
    whole = bounds(layers(tree(lowest), before))
    assert whole[1, 2] > 1.95
    assert np.ptp(whole[:, 1]) == pytest.approx(2 * CROWN_M, abs=0.05)


def test_of_nothing_there_is_nothing() -> None:
    """No points make no boxes."""
    assert layers(np.empty((0, 3))) == []
