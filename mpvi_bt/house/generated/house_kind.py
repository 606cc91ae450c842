"""Kinds of generated houses, from YAML: which rooms there are, in which rows, and how large each is."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

from pydantic import Field

from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import FileProblems, UnknownName, UserError
from mpvi_bt.ground.marked_yaml import Location, Record, SourceMarks, load_marked, validate_data
from mpvi_bt.house.generated.furnished_rooms import FURNISH

FOLDER = "tasks/kinds"
CORRIDOR, GARDEN = "corridor", "garden"
FEWEST = 2
Row = tuple[str, ...]
_Length = Annotated[float, Field(ge=1.5, le=30.0)]
_Area = Annotated[float, Field(ge=4.0, le=100.0)]


class RoomSize(Record):
    """Bounds of one room.

    Attributes:
        area_m2: Between which its area is drawn.
        shorter_m: Its shorter side at the least.
        without: Catalogue entries that rooms of that name have in other kinds, such as an office's bathtub.
    """

    area_m2: tuple[_Area, _Area]
    shorter_m: _Length
    without: list[str] = []


class GardenSize(Record):
    """Between which a garden's depth from the house is drawn, and its length along it."""

    deep_m: tuple[_Length, _Length]
    long_m: tuple[_Length, _Length]


class HouseKind(Record):
    """A kind of house (tasks/kinds/*.yaml): two rows of rooms with a corridor between them.

    Attributes:
        about: For people.
        day: Orders of the rooms in one row; one of them is drawn.
        night: Rooms of the other row, which come in any order.
        rooms: How large they are.
        corridor_m: Between which the corridor's width is drawn.
        garden: How large it is; None: there is none.
    """

    about: str = ""
    day: Annotated[list[Annotated[list[str], Field(min_length=1)]], Field(min_length=1)]
    night: list[str] = []
    rooms: dict[str, RoomSize]
    corridor_m: tuple[_Length, _Length]
    garden: GardenSize | None = None

    @property
    def all_rooms(self) -> Row:
        """Its rooms, in the order in which a house's file has them."""
        day = [room for room in self.rooms if room in self.day[0]]
        return (*day, CORRIDOR, *self.night, *([GARDEN] if self.garden else []))

    def chosen(self, names: Sequence[str]) -> Row:
        """Rooms of a house, in our order; all if none are named.

        Raises:
            UnknownName: This kind has no such room.
            UserError: They are too few, or nothing leads from one to the others.
        """
        for name in names:
            if name not in self.all_rooms:
                raise UnknownName("room", name, self.all_rooms)
        rooms = tuple(name for name in self.all_rooms if name in names) or self.all_rooms
        if len(rooms) < FEWEST:
            raise UserError(f"a generated house has {FEWEST} rooms at least")
        if CORRIDOR not in rooms and any(room in self.night for room in rooms):
            night = ", ".join(room for room in rooms if room in self.night)
            raise UserError(f"a house with {night} needs a corridor")
        if not any(room in self.day[0] for room in rooms):
            raise UserError(f"a generated house needs one of these rooms: {', '.join(self.day[0])}")
        return rooms


def load_kind(name: str) -> HouseKind:
    """The kind of a name, or in a YAML file.

    Raises:
        UnknownName: No kind has that name.
        UserError: There is no such file.
        FileProblems: Everything that is wrong with the file.
    """
    return check_kind(*load_marked(paths.find_or_file(FOLDER, name, "kind of house")))


def check_kind(data: Any, marks: SourceMarks) -> HouseKind:
    """As `load_kind`, of data that is already loaded."""
    kind = validate_data(data, marks, HouseKind)
    placed: list[tuple[Location, str]]
    placed = [(("day", i, j), room) for i, order in enumerate(kind.day) for j, room in enumerate(order)]
    placed += [(("night", i), room) for i, room in enumerate(kind.night)]
    problems = [marks.unknown(at, "room", room, kind.rooms) for at, room in placed if room not in kind.rooms]
    for room in kind.rooms:
        if room not in FURNISH or room in (CORRIDOR, GARDEN):
            problems.append(marks.unknown(("rooms", room), "room", room, FURNISH.keys() - {CORRIDOR, GARDEN}, key=True))
        elif room not in {name for _, name in placed}:
            problems.append(marks.problem(("rooms", room), "misplaced", f"{room} is in no row", key=True))
    for i, order in enumerate(kind.day):
        if sorted(order) != sorted(kind.day[0]) or {*order} & {*kind.night} or len({*order}) < len(order):
            problems.append(marks.problem(("day", i), "misplaced", "an order has each room of its row once"))
    if problems:
        raise FileProblems(problems)
    return kind
