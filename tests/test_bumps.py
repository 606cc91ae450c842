"""What the robot bumps into is measured, and how hard."""

from __future__ import annotations

import numpy as np

from tests.layouts import BASE
from tests.small_house import run, small_world


def test_a_wall_that_is_driven_into() -> None:
    """Nothing in the open; a wall that the base leans on is named, with more than a brush."""
    world = small_world(base=(1.5, 0.0, 0.0))
    world.settle()
    bumps = world.measure_bumps()
    action = world.robot.action.copy()
    run(world, action, 1.0)
    assert bumps.forces == {}
    assert bumps.worst == 0.0
    action[BASE] = 0.5, 0.0, 0.0
    run(world, action, 5.0)
    assert set(bumps.forces) == {"wall_hall"}
    assert 20.0 < bumps.worst < np.inf
