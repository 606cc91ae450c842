"""What may come to be of things, by the catalogue."""

from __future__ import annotations

from typing import Any

import pytest

from mpvi_bt.ground.errors import UnknownName, UserError
from mpvi_bt.house.sim.future import future
from mpvi_bt.house.states.cutting import Cuttable
from mpvi_bt.house.things.catalogue import Catalogue, CatalogueEntry

PIECE = {"kind": "box", "at": [0, 0, 0.02], "size_m": [0.04, 0.04, 0.04]}
CUBE: dict[str, Any] = {"color": "#ffffff", "pieces": [PIECE]}
KNIFE = CatalogueEntry(
    name="knife", synset="knife.n.01", family="compound", shape={**CUBE, "pieces": [{**PIECE, "blade": True}]}
)


def entry(name: str, half: str | None = None, diced: str | None = None, cooks_to: str | None = None) -> CatalogueEntry:
    """An entry that becomes others."""
    cut = Cuttable(half=half, diced=diced)
    return CatalogueEntry(name=name, synset=f"{name}.n.01", family="compound", shape=CUBE, cut=cut, cooks_to=cooks_to)


def test_a_whole_may_become_two_halves_and_the_dice_of_each() -> None:
    """Numbered by kind over all things, after those that there are; with what dice become in a hot pan."""
    kinds = [entry("beet", half="half"), entry("half", diced="dice"), entry("dice", cooks_to="fried"), entry("fried")]
    catalogue = Catalogue({kind.name: kind for kind in kinds})
    made = future(catalogue, {"a": catalogue["beet"], "b": catalogue["half"], "k": KNIFE})
    assert sorted(made) == sorted(
        [f"half.n.01_{k}" for k in (2, 3)] + [f"{kind}.n.01_{k}" for kind in ("dice", "fried") for k in range(1, 7)]
    )
    assert made["half.n.01_3"] is catalogue["half"]


def test_without_a_blade_nothing_is_cut() -> None:
    """So a world of vegetables pays for no halves; what cooks does so all the same."""
    kinds = {"beet": entry("beet", half="half"), "corn": entry("corn", cooks_to="popped"), "popped": entry("popped")}
    assert list(future(Catalogue(kinds), {"a": kinds["beet"], "b": kinds["corn"]})) == ["popped.n.01_1"]


def test_what_becomes_of_itself_or_of_nothing_known_is_told() -> None:
    """By the entry's name."""
    with pytest.raises(UserError, match="'a' becomes of itself"):
        future(Catalogue({"a": entry("a", half="a")}), {"x": entry("a", half="a"), "k": KNIFE})
    with pytest.raises(UnknownName, match="unknown catalogue entry 'b'"):
        future(Catalogue({}), {"x": entry("a", half="b"), "k": KNIFE})
