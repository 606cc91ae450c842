"""Where marks on a floor, such as mud on a patio, are put."""

from __future__ import annotations

import numpy as np
import pytest

from mpvi_bt.ground.errors import BackendError
from mpvi_bt.ground.geometry.solids import Array, Solid, box
from mpvi_bt.house.sim.patches import patch_of

FLOOR = box((5.0, 5.0, -0.05), (10.0, 10.0, 0.1))
NEAR = np.array([2.0, 2.0])


def middle(taken_to_m: float) -> Array:
    """Where a patch comes to be on a floor that is taken up to a distance from its corner."""

    def obstacles(xy: Array, radius_m: float) -> list[Solid]:
        return [FLOOR] if np.hypot(*xy) - radius_m < taken_to_m else []

    return np.asarray(patch_of("floor", "mud.n.03", [FLOOR], NEAR, obstacles).entities["body"].pose.p[:2])


def test_a_patch_is_near_and_farther_only_where_there_is_no_room() -> None:
    """Within 3.5 m while there is room so near; on a floor that is full there is none at all."""
    assert np.hypot(*(middle(0.0) - NEAR)) < 3.5
    assert np.hypot(*(middle(8.0) - NEAR)) > 3.5
    with pytest.raises(BackendError, match="no room for a patch"):
        middle(100.0)
