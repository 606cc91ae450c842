"""Recipes: things that become another under conditions, such as popcorn in a hot bag, or a pizza in an oven.

Source: OmniGibson, transition_rules.py and the recipes of BEHAVIOR's tasks.
"""

from __future__ import annotations

from dataclasses import dataclass


def popped(raw: int, bag_heated: bool) -> tuple[int, int]:
    """Grains of raw and of cooked popcorn in a bag a step later: what is in a hot bag is cooked.

    A kernel itself would have to come to 93 degrees, which a microwave never does.
    """
    return (0, raw) if bag_heated else (raw, 0)


@dataclass(frozen=True)
class Pizza:
    """What lies on a piece of dough.

    Attributes:
        covered_by: Kinds that cover it.
        pepperoni, half_mushrooms: How many lie on it.
        on_sheet: Whether it is on a cookie sheet.
        oven_on: Whether an oven that is on acts on it.
    """

    covered_by: frozenset[str]
    pepperoni: int
    half_mushrooms: int
    on_sheet: bool
    oven_on: bool


GRATED_CHEESE, DICED_ONION = "grated_cheese.n.01", "diced__vidalia_onion.n.01"


def baked(pizza: Pizza) -> bool:
    """Whether it becomes a pizza in this step; no temperature is asked for."""
    toppings = {GRATED_CHEESE, DICED_ONION} <= pizza.covered_by and pizza.pepperoni >= 1 and pizza.half_mushrooms >= 1
    return toppings and pizza.on_sheet and pizza.oven_on
