"""What people call kinds of things, and how large these are, for networks that see kinds and no names."""

from __future__ import annotations

from collections.abc import Iterable

from mpvi_bt.finding.perception.segments import FLOOR, FURNITURE, kind_of
from mpvi_bt.ground.geometry.linear_algebra import norm
from mpvi_bt.ground.geometry.solids import bounds
from mpvi_bt.ground.words.spoken import spoken
from mpvi_bt.house.things.catalogue import CatalogueEntry


def kind_words(entries: Iterable[CatalogueEntry]) -> dict[str, tuple[str, ...]]:
    """Each kind that `kind_of` names, with the phrases of all catalogue entries of it.

    What can be carried is of the kind of its synset. Furniture is of the kind that its name ends in, or that its synset
    is of: "base_cabinet" is a cabinet, and "extractor_hood", a range hood, is a hood.
    """
    words: dict[str, dict[str, None]] = {FLOOR: {FLOOR: None}, **{kind: {spoken(kind): None} for kind in FURNITURE}}
    for entry in entries:
        for kind in _kinds(entry):
            words.setdefault(kind, {}).update(dict.fromkeys(entry.phrases))
    return {kind: tuple(called) for kind, called in words.items()}


def kind_sizes(entries: Iterable[CatalogueEntry]) -> dict[str, float]:
    """How long things are that can be carried, by kind: the largest diagonal of the boxes about them [m]."""
    sizes: dict[str, float] = {}
    for entry in entries:
        if entry.mass_kg is not None:
            kind, box = kind_of(f"{entry.synset}_1"), bounds(entry.description.solids())
            sizes[kind] = max(sizes.get(kind, 0.0), float(norm(box[1] - box[0])))
    return sizes


def _kinds(entry: CatalogueEntry) -> set[str]:
    """Of what is carried as a thing and stands in houses as furniture, such as a swivel chair, there are two."""
    furniture = {kind for name in (entry.synset.partition(".")[0], entry.name) if (kind := kind_of(name)) in FURNITURE}
    if entry.mass_kg is not None:
        return {kind_of(f"{entry.synset}_1"), *furniture.intersection([entry.name])}
    return {kind_of(entry.name)} & furniture or furniture
