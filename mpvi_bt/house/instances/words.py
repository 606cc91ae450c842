"""The names that problems may use here: BEHAVIOR's, and those of the catalogue and of the houses."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import replace

from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.marked_yaml import load_marked
from mpvi_bt.house.goals.vocabulary import BddlVocabulary, behavior
from mpvi_bt.house.things.catalogue import load_catalogue


def known_words() -> BddlVocabulary:
    """All of them.

    Raises:
        UserError: The `bddl` distribution is not installed.
        FileProblems: Everything that is wrong with the catalogue.
    """
    known, catalogue = behavior(), list(load_catalogue())
    assert known.synsets is not None
    assert known.rooms is not None
    return replace(
        known,
        synsets=known.synsets.union(entry.synset for entry in catalogue),
        fixtures=known.fixtures.union(entry.synset for entry in catalogue if entry.mass_kg is None),
        rooms=known.rooms.union(_rooms()),
    )


def _rooms() -> Iterator[str]:
    """Of every house; what is wrong with their files is said elsewhere."""
    for name in paths.names("tasks/houses"):
        with contextlib.suppress(UserError):
            data = load_marked(paths.find("tasks/houses", name))[0]
            if isinstance(data, dict) and isinstance(rooms := data.get("rooms"), dict):
                yield from map(str, rooms)
