"""A house: rooms, doorways and fixtures, read from YAML; its walls follow from them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from mpvi_bt import paths
from mpvi_bt.errors import FileProblems, Problem, UnknownName
from mpvi_bt.marked_yaml import Location, Marks, Record, load_marked, validate_data
from mpvi_bt.robot.solids import Array, Solid, box, pose
from mpvi_bt.sim.catalogue import Catalogue, Entry, load_catalogue, shape_problems, unknown
from mpvi_bt.sim.description import Color
from mpvi_bt.sim.dimensions import Length, Rgb
from mpvi_bt.sim.overlap import penetration

PANEL_M = 0.05  # half a wall: every room has its own panels, inside its rectangle
HEDGE_M = 0.3
MIN_DOORWAY_M = 0.9

Rect = tuple[float, float, float, float]
Edge = Literal["x", "y"]


class FixtureFile(Record):
    """A fixture as it stands in the file."""

    entry: str
    at: tuple[float, float]
    z_m: Annotated[float, Field(ge=0, le=3)] = 0.0
    yaw_deg: Annotated[float, Field(ge=-360, le=360)] = 0.0
    shape: dict[str, Any] = {}


class RoomFile(Record):
    """A room as it stands in the file."""

    rect: Rect
    floor: Rgb
    walls: Rgb
    phrases: tuple[str, ...] = ()
    outdoors: bool = False
    fixtures: dict[str, FixtureFile] = {}


class DoorwayFile(Record):
    """A doorway as it stands in the file."""

    between: tuple[str, str]
    at: tuple[float, float]
    width_m: Annotated[float, Field(ge=MIN_DOORWAY_M, le=6)] = 1.0


class HouseFile(Record):
    """The file."""

    wall_height_m: Length = 2.2
    hedge_height_m: Length = 0.9
    outside: Rgb
    rooms: dict[str, RoomFile]
    doorways: tuple[DoorwayFile, ...] = ()


@dataclass(frozen=True)
class Room:
    """A rectangle of floor.

    Attributes:
        name: Such as "living_room".
        rect: x0, y0, x1, y1 [m].
        phrases: What people call it.
        floor_color, wall_color: sRGB.
        outdoors: Open to the sky, with a hedge around it instead of walls.
    """

    name: str
    rect: Rect
    phrases: tuple[str, ...]
    floor_color: Color
    wall_color: Color
    outdoors: bool

    @property
    def floor(self) -> Solid:
        """Its floor: 10 cm thick, the top at z = 0."""
        x0, y0, x1, y1 = self.rect
        return box(((x0 + x1) / 2, (y0 + y1) / 2, -0.05), (x1 - x0, y1 - y0, 0.1))


@dataclass(frozen=True)
class Doorway:
    """An opening in the wall between two rooms.

    Attributes:
        rooms: The two.
        at: x, y of its middle [m].
        width_m: Clear width.
        wall: "x" if the wall runs along x, else "y".
    """

    rooms: tuple[str, str]
    at: tuple[float, float]
    width_m: float
    wall: Edge


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
    entry: Entry
    room: str
    T_world_fixture: Array

    def solids(self) -> Iterator[Solid]:
        """What collides, closed, in the world."""
        return self.entry.description.solids(self.T_world_fixture)

    def extent(self) -> Array:
        """(2, 3) lowest and highest corner in the world [m]."""
        return self.entry.description.extent(self.T_world_fixture)


@dataclass(frozen=True, eq=False)
class Wall:
    """A panel of a wall or hedge, seen from one room ("outside" for the house's shell)."""

    room: str
    solid: Solid
    color: Color


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
    """A house by name or path.

    Raises:
        UserError: There is no such house.
        FileProblems: Everything that is wrong with the file.
    """
    path = paths.find_or_file("tasks/houses", str(house), "house")
    catalogue = catalogue or load_catalogue()
    data, marks = load_marked(path)
    file = validate_data(data, marks, HouseFile)
    problems: list[Problem] = []
    rooms = {
        name: Room(name, given.rect, _phrases(name, given), given.floor, given.walls, given.outdoors)
        for name, given in file.rooms.items()
    }
    problems += _room_problems(rooms, marks)
    doorways, doorway_problems = _doorways(file, rooms, marks)
    fixtures, fixture_problems = _fixtures(file, rooms, catalogue, marks)
    problems += doorway_problems + fixture_problems
    if problems:
        raise FileProblems(problems)
    return House(path.stem, rooms, tuple(doorways), fixtures, tuple(_walls(file, rooms, doorways)))


def _phrases(name: str, given: RoomFile) -> tuple[str, ...]:
    return tuple(dict.fromkeys((name.replace("_", " "), *given.phrases)))


def _room_problems(rooms: Mapping[str, Room], marks: Marks) -> list[Problem]:
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


def _doorways(file: HouseFile, rooms: Mapping[str, Room], marks: Marks) -> tuple[list[Doorway], list[Problem]]:
    doorways, problems = [], []
    for k, given in enumerate(file.doorways):
        place: Location = ("doorways", k)
        strange = [(j, name) for j, name in enumerate(given.between) if name not in rooms]
        if strange:
            problems += [unknown(marks, (*place, "between", j), "room", name, rooms) for j, name in strange]
            continue
        a, b = (rooms[name] for name in given.between)
        shared = _shared_wall(a, b)
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
        doorways.append(Doorway(given.between, given.at, given.width_m, wall))
    return doorways, problems


def _fixtures(
    file: HouseFile, rooms: Mapping[str, Room], catalogue: Catalogue, marks: Marks
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
                problems.append(unknown(marks, (*place, "entry"), "catalogue entry", given.entry, catalogue.entries))
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


def _outside(fixture: Fixture, room: Room, place: Location, marks: Marks) -> list[Problem]:
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


def _shared_wall(a: Room, b: Room) -> tuple[Edge, float, float, float] | None:
    """Direction, level and interval of the edge that two rooms have in common."""
    ax0, ay0, ax1, ay1 = a.rect
    bx0, by0, bx1, by1 = b.rect
    for one, two in ((ax1, bx0), (ax0, bx1)):
        low, high = max(ay0, by0), min(ay1, by1)
        if abs(one - two) < 1e-6 and high - low > 1e-6:
            return "y", one, low, high
    for one, two in ((ay1, by0), (ay0, by1)):
        low, high = max(ax0, bx0), min(ax1, bx1)
        if abs(one - two) < 1e-6 and high - low > 1e-6:
            return "x", one, low, high
    return None


def _walls(file: HouseFile, rooms: Mapping[str, Room], doorways: Iterable[Doorway]) -> Iterator[Wall]:
    """Every room's panels, the shell around the house, and the hedge around what is outdoors."""
    openings = [(d.wall, d.at[1] if d.wall == "x" else d.at[0], *_span(d)) for d in doorways]
    indoors = [room for room in rooms.values() if not room.outdoors]
    for room in rooms.values():
        x0, y0, x1, y1 = room.rect
        for wall, level, inward, low, high in (
            ("x", y0, 1, x0, x1), ("x", y1, -1, x0, x1), ("y", x0, 1, y0, y1), ("y", x1, -1, y0, y1),
        ):  # fmt: skip
            holes = [(a, b) for direction, at, a, b in openings if direction == wall and abs(at - level) < 1e-6]
            neighbors = [
                (other, span)
                for other in rooms.values()
                if other is not room and (span := _touching(room, other, wall, level)) is not None
            ]
            trim = PANEL_M if wall == "y" else 0.0
            if room.outdoors:
                free = _without([(low, high)], [*holes, *(span for _, span in neighbors)])
                color = file.rooms[room.name].walls
                for a, b in free:
                    yield Wall(room.name, _panel(wall, level, inward, HEDGE_M, a, b, file.hedge_height_m), color)
                continue
            for a, b in _without([(low + trim, high - trim)], holes):
                yield Wall(room.name, _panel(wall, level, inward, PANEL_M, a, b, file.wall_height_m), room.wall_color)
            inside = [span for other, span in neighbors if other in indoors]
            for a, b in _without([(low, high)], [*holes, *inside]):
                yield Wall("outside", _panel(wall, level, -inward, PANEL_M, a, b, file.wall_height_m), file.outside)


def _span(doorway: Doorway) -> tuple[float, float]:
    middle = doorway.at[0] if doorway.wall == "x" else doorway.at[1]
    return middle - doorway.width_m / 2, middle + doorway.width_m / 2


def _touching(room: Room, other: Room, wall: str, level: float) -> tuple[float, float] | None:
    """Interval of `room`'s edge at `level` that is `other`'s edge too."""
    shared = _shared_wall(room, other)
    if shared is None or shared[0] != wall or abs(shared[1] - level) > 1e-6:
        return None
    return shared[2], shared[3]


def _without(spans: list[tuple[float, float]], holes: Iterable[tuple[float, float]]) -> list[tuple[float, float]]:
    """The spans less the holes; slivers under 1 cm are dropped."""
    for a, b in holes:
        spans = [part for low, high in spans for part in ((low, min(high, a)), (max(low, b), high)) if part[1] > part[0]]
    return [(low, high) for low, high in spans if high - low > 0.01]


def _panel(wall: str, level: float, side: int, thick: float, low: float, high: float, height: float) -> Solid:
    """A panel on one side of an edge."""
    across, middle, length = level + side * thick / 2, (low + high) / 2, high - low
    if wall == "x":
        return box((middle, across, height / 2), (length, thick, height))
    return box((across, middle, height / 2), (thick, length, height))
