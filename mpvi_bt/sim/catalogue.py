"""The catalogue: what the things are that houses are furnished with and tasks are about."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, StringConstraints

from mpvi_bt import paths
from mpvi_bt.errors import FileProblems, Problem, UnknownName
from mpvi_bt.marked_yaml import Location, Marks, Record, load_marked, validate_data
from mpvi_bt.perception.knowledge import normalize
from mpvi_bt.sim.description import Description
from mpvi_bt.sim.families import FAMILIES, describe, parameters

Synset = Annotated[str, StringConstraints(pattern=r"^\S+\.[nvasr]\.\d\d$")]


class EntryFile(Record):
    """An entry as it stands in the file."""

    synset: Synset
    family: str
    shape: dict[str, Any]
    phrases: tuple[str, ...] = ()
    mass_kg: Annotated[float, Field(gt=0, le=200)] | None = None
    friction: Annotated[float, Field(ge=0, le=3)] = 0.5
    rolling_damping: Annotated[float, Field(ge=0, le=10)] = 0.5
    abilities: tuple[str, ...] = ()
    at_back: bool = False


class CatalogueFile(Record):
    """The file: entries by name."""

    entries: dict[str, EntryFile]


@dataclass(frozen=True)
class Entry:
    """One kind of thing.

    Attributes:
        name: Unique in the catalogue, such as "can_of_soda".
        synset: WordNet synset as BDDL writes it.
        phrases: What people call it, lower case, the synset's own words among them.
        family: What makes its shape.
        shape: The family's parameters.
        mass_kg: None for fixtures, which stand where they are.
        friction: Of its surface, static and dynamic.
        rolling_damping: Angular damping [1/s]: stands for rolling resistance, which the physics engine lacks. Slender
            round things need 3: their rim gains energy as it rolls on a box.
        abilities: BEHAVIOR's, such as "fillable" or "openable".
        at_back: Whether it is set up at the back of what it stands on, such as a monitor, and nobody carries it.
    """

    name: str
    synset: str
    phrases: tuple[str, ...]
    family: str
    shape: Mapping[str, Any]
    mass_kg: float | None = None
    friction: float = 0.5
    rolling_damping: float = 0.5
    abilities: tuple[str, ...] = ()
    at_back: bool = False

    @cached_property
    def description(self) -> Description:
        """What it is made of."""
        return describe(self.family, self.shape)

    def reshaped(self, changes: Mapping[str, Any]) -> Entry:
        """The same kind of thing with other dimensions or colors."""
        return replace(self, shape={**self.shape, **changes}) if changes else self


class Catalogue:
    """Entries by name, and by synset."""

    def __init__(self, entries: Mapping[str, Entry]) -> None:
        self.entries = dict(entries)

    def __iter__(self) -> Iterator[Entry]:
        return iter(self.entries.values())

    def __getitem__(self, name: str) -> Entry:
        """The entry of that name.

        Raises:
            UnknownName: There is none.
        """
        if name not in self.entries:
            raise UnknownName("catalogue entry", name, self.entries)
        return self.entries[name]


def load_catalogue(path: str | Path | None = None) -> Catalogue:
    """The catalogue of a file; by default the one that comes with mpvi_bt.

    Raises:
        UserError: There is no such file.
        FileProblems: Everything that is wrong with it.
    """
    return check_catalogue(*load_marked(path or paths.find("tasks/catalogues", "objects", "catalogue")))


def check_catalogue(data: Any, marks: Marks) -> Catalogue:
    """As `load_catalogue`, of data that is already loaded."""
    file = validate_data(data, marks, CatalogueFile)
    problems: list[Problem] = []
    entries: dict[str, Entry] = {}
    for name, given in file.entries.items():
        place: Location = ("entries", name)
        if given.family not in FAMILIES:
            problems.append(marks.unknown((*place, "family"), "family", given.family, FAMILIES))
            continue
        problems += shape_problems(marks, (*place, "shape"), given.family, given.shape)
        words = re.sub(r"[_\W]+", " ", given.synset.rsplit(".", 2)[0])
        phrases = dict.fromkeys(normalize(p) for p in (*given.phrases, words, name))
        fields = given.model_dump(exclude={"phrases"})
        entries[name] = Entry(name=name, phrases=tuple(phrases), **fields)
    if problems:
        raise FileProblems(problems)
    return Catalogue(entries)


def shape_problems(marks: Marks, place: Location, family: str, shape: Mapping[str, Any]) -> list[Problem]:
    """What is wrong with the parameters of a family that stand at `place` of a file."""
    try:
        validate_data(dict(shape), marks, parameters(family), place)
    except FileProblems as found:
        return list(found.problems)
    solids = (part.solid for body in describe(family, shape).bodies for part in body.parts)
    if any((solid.half_m <= 0).any() for solid in solids):
        return [
            marks.problem(place, "impossible-shape", f"a {family} of these dimensions would have parts without size")
        ]
    return []
