"""What is burning, cooked or frozen looks so."""

from __future__ import annotations

import numpy as np
import pytest

from mpvi_bt.ground.geometry.solids import pose
from mpvi_bt.house.sim.world import SimWorld
from tests.small_house import placed, small_world


def seen(world: SimWorld) -> np.ndarray:
    """A picture of what lies at x = 1 m, from above."""
    above = pose((1.0, 0.0, 0.9))
    above[:3, :3] = [[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]
    picture = world.look_from(above).rgb
    assert picture is not None
    return picture.astype(int)


@pytest.mark.render
def test_what_burns_has_flames_and_what_is_cooked_is_browner() -> None:
    """Each look is another picture, the same again once it is over; flames are bright, what is cooked is darker."""
    for entry, warmth, brighter in (("firewood", [1000.0, 1000.0, True], True), ("bacon", [80.0, 80.0, False], False)):
        world = small_world({"it": placed(entry, 1.0, 0.0)}, render=True)
        raw, saved = seen(world), world.save()
        world.restore({**saved, "heat": {"it": warmth}})
        hot = seen(world)
        changed = (raw != hot).any(-1)
        assert changed.any()
        assert bool(hot[changed].sum() > raw[changed].sum()) is brighter
        world.restore(saved)
        np.testing.assert_array_equal(seen(world), raw)
