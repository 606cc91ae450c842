"""Future things made from the things of a start: halves, dice, cooked grains and baked things."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping

from mpvi_bt.ground.errors import UserError
from mpvi_bt.house.things.catalogue import Catalogue, CatalogueEntry

_DEEPEST = 5  # steps from a thing to what becomes of it; more is a circle, such as a half that is cut into wholes


def future(catalogue: Catalogue, entries: Mapping[str, CatalogueEntry]) -> dict[str, CatalogueEntry]:
    """All future things made from present things, by their future names: a synset and a number each.

    Args:
        catalogue: What entries name.
        entries: Of the things that there are, by name.

    Raises:
        UnknownName: An entry is to become what the catalogue does not have.
        UserError: What becomes of an entry becomes that entry.
    """
    sharp = any(body.blades for entry in entries.values() for body in entry.description.bodies)
    made = [into for entry in entries.values() for into in _becomes(catalogue, entry, sharp)]
    count: Counter[str] = Counter(entry.synset for entry in entries.values())
    out = {}
    for entry in made:
        count[entry.synset] += 1
        out[f"{entry.synset}_{count[entry.synset]}"] = entry
    return out


def _becomes(catalogue: Catalogue, entry: CatalogueEntry, sharp: bool, depth: int = 0) -> Iterator[CatalogueEntry]:
    """All things made from one thing, step by step and with their numbers; without cuts if nothing is `sharp`."""
    if depth > _DEEPEST:
        raise UserError(f"{entry.name!r} becomes of itself: cutting and cooking lead nowhere")
    for name, number in [*(entry.cut_into if sharp else ()), *entry.cooked_into]:
        into = catalogue[name]
        for _ in range(number):
            yield into
            yield from _becomes(catalogue, into, sharp, depth + 1)
