"""Predicates in physics: what has come to rest in real things is where a person would say it is."""

from __future__ import annotations

import numpy as np
import pytest

from mpvi_bt.ground.geometry.solids import pose
from mpvi_bt.house.goals.formula import Literal
from mpvi_bt.house.goals.predicates import truth_in
from mpvi_bt.house.sim.world import Placement, SimWorld
from tests.small_house import CATALOGUE, placed, small_world

BOARD_M = 0.503  # height of the bookcase's second board
FLAT = np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1.0]])  # what stood lies on its side


@pytest.fixture(scope="module")
def world() -> SimWorld:
    """Things put a little over where they are to lie, and left to themselves."""
    house = {
        "on_board": placed("can_of_soda", 2.7, -1.3, BOARD_M + 0.07),
        "on_bookcase": placed("can_of_soda", 2.7, -1.5, 1.87),
        "bin": placed("trash_can", 1.0, 1.5),
        "in_bin": placed("can_of_soda", 1.0, 1.5, 0.09),
        "lying_in_bin": Placement(CATALOGUE["can_of_soda"], pose((1.06, 1.5, 0.22)) @ FLAT),
        "lower_book": placed("book", 0.0, -2.5, 0.74),
        "upper_book": placed("book", 0.0, -2.5, 0.78),
        "plate": placed("dinner_plate", 0.35, -2.5, 0.73),
        "mug": placed("coffee_cup", 0.35, -2.5, 0.77),
        "wreath": placed("wreath", -0.35, -2.5, 0.74),
        "bottle": placed("bottle_of_detergent", 2.6, 0.42, 0.01),
        "other_bottle": placed("bottle_of_detergent", 2.6, 0.5, 0.01),
        "far_bottle": placed("bottle_of_detergent", 2.2, 0.5, 0.01),
        "ball": placed("tennis_ball", 0.0, 2.4, 0.04),
        "in_fridge": placed("carton_of_milk", -2.5, 2.0, 0.11),
        "basket": placed("basket", -1.0, 0.0, 0.01),
        "soap": placed("soap_dispenser", -1.0, 0.1, 0.05),
    }
    world = small_world(
        house,
        bookcase="{entry: bookcase, at: [2.7, -1.5], yaw_deg: 180}",
        sink="{entry: bathroom_sink, at: [2.7, 0.5], yaw_deg: 180}",
        desk="{entry: table, at: [0, -2.5], yaw_deg: 90}",
        chest="{entry: chest_of_drawers, at: [-2.6, 0]}",
        fridge="{entry: refrigerator, at: [-2.5, 2]}",
        arbor="{entry: breakfast_table, at: [0, 2.4]}",
    )
    world.settle(2.0)
    return world


FACTS = {
    "on a board, under the next: in the bookcase, not on it": (
        ["inside(on_board, bookcase)", "touching(on_board, bookcase)"],
        ["ontop(on_board, bookcase)", "under(on_board, bookcase)"],
    ),
    "on the uppermost board: on the bookcase, not in it": (
        ["ontop(on_bookcase, bookcase)", "touching(bookcase, on_bookcase)"],
        ["inside(on_bookcase, bookcase)", "under(on_bookcase, bookcase)"],
    ),
    "on the bottom of a bin, in it; on it only where no bail is above, and not on what the bin stands on": (
        ["inside(in_bin, bin)", "inside(lying_in_bin, bin)", "ontop(lying_in_bin, bin)", "ontop(bin, floor_hall)"],
        ["ontop(in_bin, bin)", "touching(in_bin, floor_hall)", "ontop(in_bin, floor_hall)", "inside(bin, in_bin)"],
    ),
    "in a pile each is on the next, and the lowest on the table": (
        ["ontop(lower_book, desk)", "ontop(upper_book, lower_book)", "touching(lower_book, upper_book)"],
        ["ontop(upper_book, desk)", "touching(upper_book, desk)", "ontop(lower_book, upper_book)"],
    ),
    "what lies below a pile is under what lies on it": (["under(lower_book, upper_book)"], ["under(lower_book, desk)"]),
    "a cup stands on a plate, not in it; its rim is higher than the cup's foot, and so next to it": (
        ["ontop(mug, plate)", "ontop(plate, desk)", "nextto(mug, plate)"],
        ["inside(mug, plate)", "ontop(mug, desk)", "nextto(mug, desk)"],
    ),
    "a ring lies on what is below its hole": (["ontop(wreath, desk)"], ["under(wreath, desk)"]),
    "on the floor beneath a sink: under it; side by side: next to each other": (
        [
            "under(bottle, sink)",
            "under(other_bottle, sink)",
            "nextto(bottle, other_bottle)",
            "ontop(bottle, floor_hall)",
        ],
        ["touching(bottle, sink)", "inside(bottle, sink)", "under(far_bottle, sink)", "nextto(bottle, far_bottle)"],
    ),
    "a ball beneath a table": (["under(ball, arbor)", "ontop(ball, floor_hall)"], ["touching(ball, arbor)"]),
    "in a refrigerator and in a basket": (
        ["inside(in_fridge, fridge)", "inside(soap, basket)", "ontop(soap, basket)"],
        ["ontop(in_fridge, fridge)", "inside(soap, fridge)", "nextto(soap, in_fridge)"],
    ),
    "closed is not open": ([], ["open(fridge)", "open(chest)"]),
}


@pytest.mark.parametrize("said", FACTS)
def test_what_rests_is_where_it_is_seen_to_be(world: SimWorld, said: str) -> None:
    """The first facts hold, the others do not."""
    truth = truth_in(world)
    told = {fact: truth(literal(fact)) for facts in FACTS[said] for fact in facts}
    assert told == dict.fromkeys(FACTS[said][0], True) | dict.fromkeys(FACTS[said][1], False)


def literal(text: str) -> Literal:
    """A literal as it prints itself."""
    predicate, _, rest = text.partition("(")
    return Literal(predicate, tuple(rest.removesuffix(")").split(", ")))


@pytest.mark.parametrize(("opened", "expected"), [(0.0, False), (0.045, False), (0.055, True), (1.0, True)])
@pytest.mark.parametrize(("name", "body"), [("fridge", "door"), ("chest", "drawer_2")])
def test_a_door_or_drawer_past_a_twentieth_opens_a_thing(
    world: SimWorld, name: str, body: str, opened: float, expected: bool
) -> None:
    """One of three drawers is enough."""
    world.set_opening(name, body, opened)
    assert truth_in(world)(Literal("open", (name,))) is expected
    world.set_opening(name, body, 0.0)


@pytest.mark.parametrize(("gap", "expected"), [(0.0, True), (0.0015, True), (0.0025, False), (0.02, False)])
def test_what_stands_up_to_two_millimeters_apart_touches(gap: float, expected: bool) -> None:
    """Physics leaves things in contact a little apart; the same in both directions."""
    world = small_world({"a": placed("box_of_oatmeal", 1.0, 0.0), "b": placed("box_of_oatmeal", 1.07 + gap, 0.0)})
    world.settle(0.3)
    truth = truth_in(world)
    assert truth(literal("touching(a, b)")) is expected
    assert truth(literal("touching(b, a)")) is expected
    assert truth(literal("nextto(a, b)"))
