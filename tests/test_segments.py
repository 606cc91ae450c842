"""Kinds of labels."""

from __future__ import annotations

import pytest

from mpvi_bt.finding.perception.segments import FURNITURE, kind_of
from mpvi_bt.house.layout.house import load_house

_BACKGROUND = ("window", "picture", "rug", "mirror", "lawn", "driveway")


@pytest.mark.parametrize(
    ("label", "kind"),
    [
        ("can__of__soda.n.01_1", "can__of__soda.n.01"),
        ("half__onion.n.01", "half__onion.n.01"),
        ("robot", "robot"),
        ("radio_receiver.n.01_1.switch", "switch"),
        ("oven_1.switch", "switch"),
        ("floor_kitchen", "floor"),
        ("floor_lamp_1", "lamp"),
        ("wall_kitchen", ""),
        ("wall_nail_1", "wall_nail"),
        ("dining_chair_2", "chair"),
        ("swivel_chair_1", "swivel_chair"),
        ("coffee_table_1", "coffee_table"),
        ("living_window_3", ""),
    ],
)
def test_a_label_has_a_kind(label: str, kind: str) -> None:
    """A label's kind is its synset, its kind of furniture, or background."""
    assert kind_of(label) == kind


@pytest.mark.parametrize("house", ["family_house", "generated:3", "generated:flat:3", "generated:office:3"])
def test_all_furniture_has_a_kind(house: str) -> None:
    """Of a house's fixtures only what no skill asks for is background."""
    for name in load_house(house).fixtures:
        assert kind_of(name) in FURNITURE or any(word in name for word in _BACKGROUND), name
