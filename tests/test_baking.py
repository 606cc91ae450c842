"""A pizza in the world: dough with all its toppings becomes one in an oven that is on."""

from __future__ import annotations

import numpy as np
import pytest

from mpvi_bt.ground.geometry.solids import pose
from mpvi_bt.house.sim.future import future
from mpvi_bt.house.sim.world import Placement, SimWorld
from tests.layouts import ACTION_SIZE
from tests.small_house import CATALOGUE, run, small_house

OVEN = "{entry: oven, at: [1.5, 0.0], yaw_deg: 180}"
TOPPINGS = {
    "grated_cheese.n.01_1": ("grated_cheese", -0.045, -0.045),
    "diced__vidalia_onion.n.01_1": ("diced_onion", -0.045, 0.045),
    "pepperoni.n.01_1": ("pepperoni", 0.045, -0.045),
    "half__mushroom.n.01_1": ("half_mushroom", 0.045, 0.045),
}


def an_oven_with(*without: str) -> SimWorld:
    """A world with a sheet, dough and toppings on the shelf of an oven, but for some of them."""
    shelf_m = float(CATALOGUE["oven"].shape["shelves_z_m"][0]) + 0.012
    things = {
        "cookie_sheet.n.01_1": ("cookie_sheet", 0.0, 0.0, 0.0),
        "pizza_dough.n.01_1": ("pizza_dough", 0.0, 0.0, 0.01),
    }
    things |= {name: (entry, x, y, 0.036) for name, (entry, x, y) in TOPPINGS.items()}
    objects = {
        name: Placement(CATALOGUE[entry], pose((1.5 + x, y, shelf_m + z)))
        for name, (entry, x, y, z) in things.items()
        if name not in without
    }
    later = future(CATALOGUE, {name: placement.entry for name, placement in objects.items()})
    return SimWorld(small_house(oven_1=OVEN), objects, np.array([-1.5, 0.0, 0.0]), render=False, future=later)


@pytest.mark.parametrize("without", [None, *TOPPINGS])
def test_dough_with_all_its_toppings_becomes_a_pizza(without: str | None) -> None:
    """In an oven that is on, not before; each topping that is missing prevents it. The toppings are used up."""
    world = an_oven_with(*filter(None, [without]))
    run(world, np.zeros(ACTION_SIZE), 1.0)
    assert world.exists("pizza_dough.n.01_1")
    world.turn("oven_1", True)
    run(world, np.zeros(ACTION_SIZE), 2.0)
    if without is not None:
        assert world.exists("pizza_dough.n.01_1")
    else:
        assert world.objects == ["cookie_sheet.n.01_1", "pizza.n.01_1"]
