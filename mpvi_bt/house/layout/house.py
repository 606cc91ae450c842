"""A house: rooms, doorways and fixtures, read from YAML; what is wrong with it, all at once."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import FileProblems, Problem, UnknownName
from mpvi_bt.ground.geometry.solids import Array, Solid, pose
from mpvi_bt.ground.marked_yaml import (
    Coordinate,
    Location,
    Record,
    SourceMarks,
    load_marked,
    parse_marked,
    validate_data,
)
from mpvi_bt.house.generated.generator import generated_house
from mpvi_bt.house.generated.seeded_name import SeededName, seeded
from mpvi_bt.house.layout.overlap import penetration
from mpvi_bt.house.layout.rooms import PANEL_M, Doorway, Rect, Room, Wall, shared_wall, walls
from mpvi_bt.house.things.catalogue import Catalogue, CatalogueEntry, load_catalogue, shape_problems
from mpvi_bt.house.things.dimensions import Length, Rgb

MIN_DOORWAY_M = 0.9


class FixtureFile(Record):
    """A fixture as it stands in the file."""

    entry: str
    at: tuple[Coordinate, Coordinate]
    z_m: Annotated[float, Field(ge=0, le=3)] = 0.0
    yaw_deg: Annotated[float, Field(ge=-360, le=360)] = 0.0
    shape: dict[str, Any] = {}


class RoomFile(Record):
    """A room as it stands in the file."""

    rect: tuple[Coordinate, Coordinate, Coordinate, Coordinate]
    floor: Rgb
    walls: Rgb
    phrases: tuple[str, ...] = ()
    outdoors: bool = False
    fixtures: dict[str, FixtureFile] = {}


class DoorwayFile(Record):
    """A doorway as it stands in the file."""

    between: tuple[str, str]
    at: tuple[Coordinate, Coordinate]
    width_m: Annotated[float, Field(ge=MIN_DOORWAY_M, le=6)] = 1.0


class HouseFile(Record):
    """The file."""

    wall_height_m: Length = 2.2
    hedge_height_m: Length = 0.9
    outside: Rgb
    rooms: Annotated[dict[str, RoomFile], Field(min_length=1)]
    doorways: tuple[DoorwayFile, ...] = ()


@dataclass(frozen=True, eq=False)
class Fixture:
    """Something that stands in a room and stays there.

    Attributes:
        name: Unique in the house, such as "countertop_1".
        entry: What it is.
        room: Where it is.
        T_world_fixture: (4, 4) its body frame to the world.
    """

    name: str
    entry: CatalogueEntry
    room: str
    T_world_fixture: Array

    def solids(self) -> Iterator[Solid]:
        """What collides, closed, in the world."""
        return self.entry.description.solids(self.T_world_fixture)

    def extent(self) -> Array:
        """(2, 3) lowest and highest corner in the world [m]."""
        return self.entry.description.extent(self.T_world_fixture)


@dataclass(frozen=True, eq=False)
class House:
    """Rooms, doorways and fixtures by name, and the walls that follow from them."""

    name: str
    rooms: Mapping[str, Room]
    doorways: tuple[Doorway, ...]
    fixtures: Mapping[str, Fixture]
    walls: tuple[Wall, ...]

    def room(self, name: str) -> Room:
        """The room of that name.

        Raises:
            UnknownName: There is none.
        """
        if name not in self.rooms:
            raise UnknownName("room", name, self.rooms)
        return self.rooms[name]

    def fixtures_of(self, synset: str, room: str | None = None) -> list[Fixture]:
        """Fixtures of a synset, in the order of the file."""
        return [f for f in self.fixtures.values() if f.entry.synset == synset and room in (None, f.room)]

    def bounds(self) -> Rect:
        """x0, y0, x1, y1 [m] around all rooms."""
        rects = np.array([room.rect for room in self.rooms.values()])
        return (*rects[:, :2].min(0).tolist(), *rects[:, 2:].max(0).tolist())


def load_house(house: str | Path = "family_house", catalogue: Catalogue | None = None) -> House:
    """A house by name or path, or by its seed, such as "generated:7" or "generated:flat:7".

    Raises:
        UserError: There is no such house, or no such kind.
        FileProblems: Everything that is wrong with the file.
    """
    if (drawn := seeded(str(house))) is not None:
        return _drawn(str(house), drawn, catalogue or load_catalogue())
    return check_house(*load_marked(paths.find_or_file("tasks/houses", str(house), "house")), catalogue)


@lru_cache(maxsize=4)
def _drawn(name: str, drawn: SeededName, catalogue: Catalogue) -> House:
    return check_house(*parse_marked(generated_house(drawn.seed, kind=drawn.kind), name), catalogue)


def check_house(data: Any, marks: SourceMarks, catalogue: Catalogue | None = None) -> House:
    """As `load_house`, of data that is already loaded."""
    catalogue = catalogue or load_catalogue()
    file = validate_data(data, marks, HouseFile)
    problems: list[Problem] = []
    rooms = {
        name: Room(name, given.rect, _phrases(name, given), given.floor, given.walls, given.outdoors)
        for name, given in file.rooms.items()
    }
    problems += _room_problems(rooms, marks)
    doorways, doorway_problems = _doorways(file, rooms, marks)
    fixtures, fixture_problems = _fixtures(file, rooms, catalogue, marks)
    problems += doorway_problems or _cut_off(rooms, doorways, marks)
    problems += fixture_problems
    if problems:
        raise FileProblems(problems)
    panels = walls(rooms.values(), doorways, file.outside, file.wall_height_m, file.hedge_height_m)
    return House(Path(marks.file).stem, rooms, tuple(doorways), fixtures, tuple(panels))


def _phrases(name: str, given: RoomFile) -> tuple[str, ...]:
    return tuple(dict.fromkeys((name.replace("_", " "), *given.phrases)))


def _room_problems(rooms: Mapping[str, Room], marks: SourceMarks) -> list[Problem]:
    problems = []
    for name, room in rooms.items():
        place: Location = ("rooms", name, "rect")
        x0, y0, x1, y1 = room.rect
        if x1 - x0 < 1 or y1 - y0 < 1:
            message = f"room {name!r} is smaller than 1 m; a rectangle is written [x0, y0, x1, y1], x0 < x1 and y0 < y1"
            problems.append(marks.problem(place, "room-size", message))
            continue
        for other in rooms.values():
            if other.name == name:
                break
            u0, v0, u1, v1 = other.rect
            if min(x1, u1) - max(x0, u0) > 1e-6 and min(y1, v1) - max(y0, v0) > 1e-6:
                message = f"room {name!r} overlaps {other.name!r}, which is {list(other.rect)}"
                problems.append(marks.problem(place, "room-overlap", message))
    return problems


def _doorways(file: HouseFile, rooms: Mapping[str, Room], marks: SourceMarks) -> tuple[list[Doorway], list[Problem]]:
    doorways: list[Doorway] = []
    problems: list[Problem] = []
    for k, given in enumerate(file.doorways):
        place: Location = ("doorways", k)
        strange = [(j, name) for j, name in enumerate(given.between) if name not in rooms]
        if strange:
            problems += [marks.unknown((*place, "between", j), "room", name, rooms) for j, name in strange]
            continue
        a, b = (rooms[name] for name in given.between)
        shared = shared_wall(a, b)
        if shared is None:
            message = f"no wall between {a.name!r} and {b.name!r}: they have no edge in common"
            problems.append(marks.problem((*place, "between"), "doorway-in-no-wall", message))
            continue
        wall, level, low, high = shared
        along, across = (given.at[0], given.at[1]) if wall == "x" else (given.at[1], given.at[0])
        half = given.width_m / 2 + PANEL_M
        if abs(across - level) > 1e-6 or along - half < low - 1e-6 or along + half > high + 1e-6:
            edge = f"y = {level:g}, x from" if wall == "x" else f"x = {level:g}, y from"
            message = (
                f"a doorway {given.width_m:g} m wide at {list(given.at)} is not in the wall between {a.name!r} and "
                f"{b.name!r}, which is {edge} {low:g} to {high:g}"
            )
            problems.append(marks.problem((*place, "at"), "doorway-in-no-wall", message))
            continue
        doorway = Doorway(given.between, given.at, given.width_m, wall)
        if (twice := next((other for other in doorways if _same_hole(doorway, other)), None)) is not None:
            message = f"a doorway is there already, {twice.width_m:g} m wide at {list(twice.at)}; they overlap"
            problems.append(marks.problem((*place, "at"), "doorway-overlap", message))
            continue
        doorways.append(doorway)
    return doorways, problems


def _same_hole(a: Doorway, b: Doorway) -> bool:
    """Whether two doorways of a house share a part of a wall."""
    along, across = (0, 1) if a.wall == "x" else (1, 0)
    apart = abs(a.at[along] - b.at[along]) - (a.width_m + b.width_m) / 2
    return a.wall == b.wall and abs(a.at[across] - b.at[across]) < 1e-6 and apart < -1e-6


def _cut_off(rooms: Mapping[str, Room], doorways: Iterable[Doorway], marks: SourceMarks) -> list[Problem]:
    """Rooms that no way leads to from the first one."""
    doors = [set(doorway.rooms) for doorway in doorways]
    first = next(iter(rooms))
    reached = {first}
    while new := [door for door in doors if door & reached and door - reached]:
        reached = reached.union(*new)
    return [
        marks.problem(("rooms", name), "cut-off", f"no doorways lead from {first!r} to {name!r}", key=True)
        for name in rooms
        if name not in reached
    ]


def _fixtures(
    file: HouseFile, rooms: Mapping[str, Room], catalogue: Catalogue, marks: SourceMarks
) -> tuple[dict[str, Fixture], list[Problem]]:
    fixtures: dict[str, Fixture] = {}
    places: dict[str, Location] = {}
    problems: list[Problem] = []
    for room in rooms.values():
        for name, given in file.rooms[room.name].fixtures.items():
            place: Location = ("rooms", room.name, "fixtures", name)
            if name in fixtures:
                message = f"there is a fixture {name!r} in {fixtures[name].room!r} already"
                problems.append(marks.problem(place, "duplicate-fixture", message, key=True))
                continue
            if given.entry not in catalogue.entries:
                problems.append(marks.unknown((*place, "entry"), "catalogue entry", given.entry, catalogue.entries))
                continue
            entry = catalogue[given.entry].reshaped(given.shape)
            if given.shape and (wrong := shape_problems(marks, (*place, "shape"), entry.family, entry.shape)):
                problems += wrong
                continue
            T = pose((*given.at, given.z_m), float(np.deg2rad(given.yaw_deg)))
            fixture = Fixture(name, entry, room.name, T)
            fixtures[name], places[name] = fixture, place
            problems += _outside(fixture, room, (*place, "at"), marks)
    for a, b, depth in _overlaps(fixtures.values()):
        message = f"fixture {b.name!r} overlaps {a.name!r} by {depth * 100:.0f} cm"
        problems.append(marks.problem((*places[b.name], "at"), "fixture-overlap", message))
    return fixtures, problems


def _outside(fixture: Fixture, room: Room, place: Location, marks: SourceMarks) -> list[Problem]:
    """The problem, if any, that a fixture sticks out of its room's walls."""
    x0, y0, x1, y1 = room.rect
    margin = PANEL_M - 1e-4
    (lx, ly, _), (hx, hy, _) = fixture.extent()
    out = max(x0 + margin - lx, y0 + margin - ly, hx - x1 + margin, hy - y1 + margin)
    if out <= 1e-6:
        return []
    message = (
        f"fixture {fixture.name!r} reaches {out * 100:.0f} cm out of {room.name!r}: it covers x {lx:.2f} to {hx:.2f}, "
        f"y {ly:.2f} to {hy:.2f}; between the walls there is x {x0 + PANEL_M:g} to {x1 - PANEL_M:g}, "
        f"y {y0 + PANEL_M:g} to {y1 - PANEL_M:g}"
    )
    return [marks.problem(place, "fixture-outside-room", message)]


def _overlaps(fixtures: Iterable[Fixture]) -> Iterator[tuple[Fixture, Fixture, float]]:
    """Pairs of fixtures whose solids lie more than 2 mm deep in each other."""
    done: list[tuple[Fixture, Array, list[Solid]]] = []
    for fixture in fixtures:
        solids = list(fixture.solids())
        if not solids:
            continue
        extent = fixture.extent()
        for other, around, others in done:
            if np.all(extent[0] < around[1]) and np.all(around[0] < extent[1]):
                depth = max(penetration(a, b) for a in solids for b in others)
                if depth > 0.002:
                    yield other, fixture, depth
        done.append((fixture, extent, solids))
