"""Recipes: what an oven makes of a thing with all that belongs on it, such as a pizza of dough.

Source: OmniGibson, transition_rules.py; the recipes themselves are of the catalogue, after those of BEHAVIOR's tasks.
"""

from __future__ import annotations

from collections.abc import Mapping, Set
from typing import Annotated

from pydantic import Field

from mpvi_bt.ground.marked_yaml import Record, Synset


class Recipe(Record):
    """What a thing becomes in an oven that is on, whatever its temperature.

    Attributes:
        into: Name of the catalogue's entry that it becomes.
        covered_by: Synsets of the grains that have to cover it.
        topped_with: How many of each synset have to lie on it.
        on: Synset of what it has to lie on; None: anything.
    """

    into: str
    covered_by: tuple[Synset, ...] = ()
    topped_with: dict[Synset, Annotated[int, Field(ge=1, le=12)]] = {}
    on: Synset | None = None


def baked(recipe: Recipe, covered_by: Set[str], topped_with: Mapping[str, int], on: Set[str]) -> bool:
    """Whether a thing in an oven that is on becomes what its recipe says, by the synsets of what is about it."""
    topped = all(topped_with.get(kind, 0) >= number for kind, number in recipe.topped_with.items())
    return set(recipe.covered_by) <= covered_by and topped and (recipe.on is None or recipe.on in on)
