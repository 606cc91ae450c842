"""The catalogue: entries for the things of houses and tasks."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from mpvi_bt.executive.plan.knowledge import normalize
from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import FileProblems, Problem, UnknownName, UserError, with_article
from mpvi_bt.ground.marked_yaml import Location, Record, SourceMarks, Synset, load_marked, validate_data
from mpvi_bt.house.goals.vocabulary import abilities, behavior, unknown_synset
from mpvi_bt.house.states.cutting import Cuttable
from mpvi_bt.house.states.heat import Source
from mpvi_bt.house.states.mounts import Fitting
from mpvi_bt.house.states.recipes import Recipe
from mpvi_bt.house.states.sprayer import Sprayer
from mpvi_bt.house.states.temperature import Thermal
from mpvi_bt.house.things.description import Description
from mpvi_bt.house.things.families import FAMILIES, describe, parameters

FOLDER = "tasks/catalogues"


class EntryFile(Record):
    """One kind of thing, as it stands in the file.

    Attributes:
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
        heat: What heat does to it; None: its temperature is not followed.
        source: What it warms or cools things with, such as a fridge; None: nothing.
        washes: Kinds of marks that it takes off what is in it as it begins to run, each with the solvents of which one
            is needed; None: it is no washer.
        cut: What cutting makes of it, as names of entries; None: it cannot be cut.
        cooks_to: What grains of it become in a hot vessel; None: nothing.
        removes: Likewise, of what it takes off what comes into the box about it, such as a brush.
        sprays: What it sprays while it is on; None: nothing.
        mounts: Places by which it is mounted on others, or they on it.
        bakes: What it becomes in an oven with all on it that belongs there; None: nothing.
    """

    synset: Synset
    family: str
    shape: dict[str, Any]
    phrases: tuple[str, ...] = ()
    mass_kg: Annotated[float, Field(gt=0, le=200)] | None = None
    friction: Annotated[float, Field(ge=0, le=3)] = 0.5
    rolling_damping: Annotated[float, Field(ge=0, le=10)] = 0.5
    abilities: tuple[str, ...] = ()
    at_back: bool = False
    heat: Thermal | None = None
    source: Source | None = None
    washes: dict[Synset, tuple[Synset, ...]] | None = None
    cut: Cuttable | None = None
    cooks_to: str | None = None
    removes: dict[Synset, tuple[Synset, ...]] | None = None
    sprays: Sprayer | None = None
    mounts: tuple[Fitting, ...] = ()
    bakes: Recipe | None = None


class CatalogueFile(Record):
    """The file: entries by name."""

    entries: dict[str, EntryFile]


class CatalogueEntry(EntryFile):
    """One kind of thing.

    Attributes:
        name: Unique in the catalogue, such as "can_of_soda".
    """

    name: str

    @cached_property
    def description(self) -> Description:
        """What it is made of."""
        return describe(self.family, self.shape)

    @property
    def cut_into(self) -> list[tuple[str, int]]:
        """Names of the entries that one cut makes of it, and how many of each."""
        cut = self.cut or Cuttable()
        return [(name, number) for name, number in ((cut.half, 2), (cut.diced, cut.dice)) if name is not None]

    @property
    def cooked_into(self) -> list[tuple[str, int]]:
        """Likewise, what heat makes of it."""
        baked = None if self.bakes is None else self.bakes.into
        return [(name, 1) for name in (self.cooks_to, baked) if name is not None]

    def reshaped(self, changes: Mapping[str, Any]) -> CatalogueEntry:
        """The same kind of thing with other dimensions or colors."""
        return self.changed(shape={**self.shape, **changes}) if changes else self

    def changed(self, **fields: Any) -> CatalogueEntry:
        """The same with other fields."""
        return CatalogueEntry(**{**self.model_dump(), **fields})


class Catalogue:
    """Entries by name, and by synset."""

    def __init__(self, entries: Mapping[str, CatalogueEntry]) -> None:
        self.entries = dict(entries)

    def __iter__(self) -> Iterator[CatalogueEntry]:
        return iter(self.entries.values())

    def __getitem__(self, name: str) -> CatalogueEntry:
        """The entry of that name.

        Raises:
            UnknownName: There is none.
        """
        if name not in self.entries:
            raise UnknownName("catalogue entry", name, self.entries)
        return self.entries[name]


def load_catalogue(path: str | Path | None = None) -> Catalogue:
    """The catalogue of a file; by default of all files in `tasks/catalogues/` of every root.

    Of entries of one name that of the first file counts, in the order of search.

    Raises:
        UserError: There is no such file.
        FileProblems: Everything that is wrong with it, or with the first file that is wrong.
    """
    if path is not None:
        return check_catalogue(*load_marked(path))
    return _merged(tuple((file, file.stat().st_mtime_ns) for file in paths.files(FOLDER)))


@lru_cache(maxsize=2)
def _merged(files: tuple[tuple[Path, int], ...]) -> Catalogue:
    """The catalogue of files as they were last changed: a suite loads many tasks, each of which asks for it."""
    entries: dict[str, CatalogueEntry] = {}
    for file, _ in reversed(files):
        entries |= load_catalogue(file).entries
    return Catalogue(entries)


def check_catalogue(data: Any, marks: SourceMarks) -> Catalogue:
    """As `load_catalogue`, of data that is already loaded."""
    try:
        file = validate_data(data, marks, CatalogueFile)
    except FileProblems as found:
        raise FileProblems([_said_where(problem, data, marks) for problem in found.problems]) from None
    problems: list[Problem] = []
    entries: dict[str, CatalogueEntry] = {}
    for name, given in file.entries.items():
        place: Location = ("entries", name)
        for i, ability in enumerate(given.abilities):
            if ability not in abilities():
                problems.append(marks.unknown((*place, "abilities", i), "ability", ability, abilities()))
        if given.family not in FAMILIES:
            problems.append(marks.unknown((*place, "family"), "family", given.family, FAMILIES))
            continue
        shape = _placed(given.shape, marks)
        problems += shape_problems(marks, (*place, "shape"), given.family, shape)
        words = re.sub(r"[_\W]+", " ", given.synset.rsplit(".", 2)[0])
        phrases = dict.fromkeys(normalize(p) for p in (*given.phrases, words, name))
        entry = CatalogueEntry(name=name, **{**dict(given), "phrases": tuple(phrases), "shape": shape})
        entries[name] = entry
        if not problems:
            problems += _tool_problems(entry, place, marks)
        if entry.source is not None and not problems:
            problems += _source_problems(entry, entry.source, place, marks)
    if problems:
        raise FileProblems(problems)
    return Catalogue(entries)


def _said_where(problem: Problem, data: Any, marks: SourceMarks) -> Problem:
    """The problem of a misplaced shape parameter, with its right place."""
    if problem.code != "unknown-key" or problem.pointer.count("/") != 3:
        return problem
    _, _, name, key = problem.pointer.split("/")
    given = data["entries"].get(name, {}).get("family")
    whose = [family for family in FAMILIES if key in parameters(family).model_fields]
    if given in whose:
        return replace(problem, message=f"{key!r} belongs under `shape:`, with the other parameters of {given!r}")
    if whose:
        several = ", ".join(whose[:5]) + (", ..." if len(whose) > 5 else "")
        about = f"no parameter of {given!r}" if given in FAMILIES else "no key of an entry"
        return replace(problem, message=f"{key!r} is {about}; under `shape:` these families take it: {several}")
    return problem


def _tool_problems(entry: CatalogueEntry, place: Location, marks: SourceMarks) -> Iterator[Problem]:
    """Problems of tools: a sprayer without a switch, a mount that faces along its own up axis."""
    for i, mount in enumerate(entry.mounts):
        if mount.facing.strip("-") == mount.up.strip("-"):
            message = f"it cannot face along {mount.facing} and have {mount.up} up"
            yield marks.problem((*place, "mounts", i), "impossible-mount", message)
    if entry.sprays is not None and not any(body.switches for body in entry.description.bodies):
        yield marks.problem((*place, "sprays"), "impossible-sprayer", "it sprays while it is on, and has no switch")


def _source_problems(entry: CatalogueEntry, source: Source, place: Location, marks: SourceMarks) -> Iterator[Problem]:
    """Parts required by a source that its thing lacks."""
    bodies = entry.description.bodies
    wanted = {
        "switched": (source.switched, any(body.switches for body in bodies), "a switch"),
        "shut": (source.shut, any(body.joint is not None for body in bodies), "a door"),
        "placing": (source.placing == "inside", any(body.volumes for body in bodies), "room inside"),
    }
    for field, (asked, there, what) in wanted.items():
        if asked and not there:
            named: Location = (*place, "source", field)
            at = named if named in marks.keys else (*place, "source")
            yield marks.problem(at, "impossible-source", f"{entry.family!r} has not {what} that its source asks for")


def _placed(shape: Mapping[str, Any], marks: SourceMarks) -> dict[str, Any]:
    """The parameters, a file among them by its place, not by where it is from the catalogue's own file."""
    file = shape.get("file")
    return {**shape, "file": str(Path(marks.file).parent / file)} if isinstance(file, str) else dict(shape)


def lint_catalogue(data: Any, marks: SourceMarks) -> list[Problem]:
    """Warnings for a file without errors: synsets unknown to BEHAVIOR, entries also in another file."""
    known = behavior().synsets or ()
    found = [
        marks.problem(("entries", name, "synset"), severity="warning", **unknown_synset(given["synset"], known))
        for name, given in data["entries"].items()
        if given["synset"] not in known
    ]
    return found + list(_namesakes(data["entries"], marks))


def _namesakes(entries: Iterable[str], marks: SourceMarks) -> Iterator[Problem]:
    """Warnings for entries also in another file of the catalogue; the first file counts."""
    files, own = paths.files(FOLDER), Path(marks.file).resolve()
    at = next((i for i, file in enumerate(files) if file.resolve() == own), None)
    for i, file in enumerate(files if at is not None else ()):
        if i == at:
            continue
        with contextlib.suppress(UserError):  # what is wrong with it is said of it
            theirs = load_marked(file)[1].keys
            for name in entries:
                if (place := ("entries", name)) not in theirs:
                    continue
                where = f"{file}:{theirs[place][0]}"
                if at is not None and i > at:
                    message = f"{name!r} takes the place of that in {where}"
                    yield marks.problem(place, "shadows", message, key=True, severity="note")
                else:
                    together = file.parent.resolve() == own.parent
                    message = f"{name!r} is not used: that in {where} comes first"
                    yield marks.problem(
                        place, "shadowed", message, key=True, severity="warning" if together else "note"
                    )


def shape_problems(marks: SourceMarks, place: Location, family: str, shape: Mapping[str, Any]) -> list[Problem]:
    """Problems of a family's parameters at `place` of a file."""
    try:
        validate_data(dict(shape), marks, parameters(family), place)
    except FileProblems as found:
        fields = [f"/{name}" for name in EntryFile.model_fields]
        return [
            replace(p, message=f"{p.pointer.rsplit('/', 1)[-1]!r} belongs beside `shape:`, not under it")
            if p.code == "unknown-key" and p.pointer.endswith(tuple(fields))
            else p
            for p in found.problems
        ]
    try:
        description = describe(family, shape)
    except UserError as error:  # of a mesh
        return [marks.problem((*place, "file"), "unreadable", str(error))]
    solids = (part.solid for body in description.bodies for part in body.parts)
    if any((solid.half_m <= 0).any() for solid in solids):
        return [
            marks.problem(
                place, "impossible-shape", f"{with_article(family)} of these dimensions would have parts without size"
            )
        ]
    return []
