"""A house of ProcTHOR as the text of a house's file, and all that is other than in the original."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from mpvi_bt.ground.errors import UserError
from mpvi_bt.house.generated.house_text import house_text
from mpvi_bt.house.generated.placement import GAP_M, Furnishing, RoomFloor, WallOpening
from mpvi_bt.house.generated.plane import SIDES, Rect, Side, WallFrame, shared_edge
from mpvi_bt.house.generated.tints import Tints
from mpvi_bt.house.generated.walkable import out_of_reach
from mpvi_bt.house.imported.fixture_types import PICTURE, WINDOW, FixtureType, fixture_type, is_picture, type_of
from mpvi_bt.house.imported.floor_rectangles import floor_rectangles
from mpvi_bt.house.imported.imported_openings import Hole, Openings, rounded
from mpvi_bt.house.imported.procthor_file import FileOpening, FileThing, ProcthorHouse, has_lines, read_procthor
from mpvi_bt.house.things.catalogue import Catalogue, load_catalogue

SMALLEST_M = 1.0  # side of a room; a house's file has no smaller ones
AT_WALL_M = 0.35  # what stands so near to the wall behind it stands against it: their sizes are others
MOVED_M = 0.8  # a thing that has no room where it was is put up to so far away
TURNED_DEG = 5.0  # what is turned by less to stand along a wall is not told
_STEP_M = 0.1
_WAY_M = 1.2  # of a wide opening, this much stays free of furniture: a robot's way, and room to pass by
_SILL_M = 0.8  # pictures hang above this
_LOWEST_WINDOW_M = 0.3  # our choice: no window is lower
_IN_WALL_M = 0.1  # an opening so near to a wall's surface is in that wall
_CEILING_M = 2.1  # what hangs ends below the walls' upper edge
_HUMP = re.compile(r"(?<=[a-z])(?=[A-Z])")


class ImportedHouse:
    """A house of ProcTHOR, rebuilt from our fixtures.

    Args:
        house: The original.
        source: What it is called in messages and in the file's first line.

    Raises:
        UserError: It has walls at odd angles, a room that is too small, or a room without a door.
    """

    def __init__(self, house: ProcthorHouse, source: str) -> None:
        self._house, self._source = house, source
        self.said: list[str] = []
        self._parts: dict[str, Rect] = {}
        self._room_of: dict[str, str] = {}  # id of the original
        self._base: dict[str, str] = {}  # its name without a number
        self._cut_rooms()
        self._openings = Openings(self._parts, self._room_of)
        self._make_openings()
        self._catalogue: Catalogue = load_catalogue()
        self._count: Counter[str] = Counter()
        self._left: Counter[str] = Counter()
        self._no_room: list[str] = []
        self._moved: list[float] = []
        self._turned = 0
        self._floors = {name: self._floor(name) for name in self._parts}
        self._furnish()

    def text(self) -> str:
        """The file's text."""
        about = f"From {self._source}, a house of ProcTHOR: x runs east, y north, meters."
        tints = _RoomTints(np.random.default_rng(0), self._base)
        pieces: Mapping[str, list[Furnishing]] = {name: floor.pieces for name, floor in self._floors.items()}
        return house_text(about, self._parts, self._openings.doors, pieces, tints)

    def _cut_rooms(self) -> None:
        for room in self._house.rooms:
            base = _HUMP.sub("_", room.room_type).lower()
            if not re.fullmatch(r"[a-z][a-z0-9_]{0,40}", base):
                raise UserError(
                    f"{self._source}: room {room.id!r} has the type {room.room_type[:40]!r}, which is no name"
                )
            try:
                corners = rounded([(corner.x, corner.z) for corner in room.floor_polygon])
                rects, lost_m2 = floor_rectangles(corners, SMALLEST_M)
            except ValueError as error:
                raise UserError(f"{self._source}: room {room.id!r} cannot be rebuilt: {error}") from None
            if not rects:
                raise UserError(f"{self._source}: room {room.id!r} is nowhere {SMALLEST_M:g} m wide")
            if lost_m2 > 0.01:
                self.said.append(f"{lost_m2:.1f} m2 of {base} are narrower than {SMALLEST_M:g} m, and left out")
            names = []
            for rect in rects:
                taken = sum(name == base for name in self._base.values())
                names.append(base if not taken else f"{base}_{taken + 1}")
                self._parts[names[-1]], self._room_of[names[-1]], self._base[names[-1]] = rect, room.id, base
            if len(names) > 1:
                self.said.append(f"{room.id} is no rectangle: it is {', '.join(names)}, open to one another")

    def _make_openings(self) -> None:
        known = set(self._room_of.values())
        openings = self._openings
        openings.join_parts()
        for a in self._house.walls:
            others = (b for b in self._house.walls if b.empty and b.room_id != a.room_id and b.room_id in known)
            if a.empty and a.room_id in known:
                first, last = ((corner.x, corner.z) for corner in a.polygon[:2])
                for other in dict.fromkeys(b.room_id for b in others):
                    if a.room_id < other:
                        openings.add_open_wall(Hole((a.room_id, other), (first, last)))
        outside = 0
        for door in self._house.doors:
            ends = self._house.span(door)
            if door.room0 == door.room1 or not {door.room0, door.room1} <= known:
                outside += 1
            elif ends is None:
                self.said.append(f"{door.id} is in a wall that is not in the file, and is left out")
            else:
                openings.add_door(Hole((door.room0, door.room1), ends), f"{door.room0} and {door.room1}")
        if outside:
            self.said.append(f"{outside} door{'s' * (outside > 1)} to the outside: a wall here")
        self.said += openings.said
        if lost := openings.cut_off():
            raise UserError(f"{self._source}: no way leads to {', '.join(lost)}")

    def _floor(self, name: str) -> RoomFloor:
        rect = self._parts[name]
        openings = []
        for door in self._openings.doors:
            if name in door.between:
                other = door.between[door.between[0] == name]
                edge = shared_edge(rect, self._parts[other])
                assert edge is not None  # a doorway is in a wall of both
                along = door.at[0] - rect[0] if edge[0] in ("south", "north") else door.at[1] - rect[1]
                openings.append(WallOpening(edge[0], along, min(door.width_m, _WAY_M)))
        return RoomFloor(name, rect, openings, [], self._catalogue, np.random.default_rng(0))

    def _furnish(self) -> None:
        for thing in self._house.objects:
            self._left.update(type_of(small.id) for small in _all(thing.children))  # what stands on something
        types = {room.id: room.room_type for room in self._house.rooms}
        last_pictures = sorted(self._house.objects, key=lambda thing: is_picture(type_of(thing.id)))
        for thing in last_pictures:
            kind = type_of(thing.id)
            part = self._part_at(thing.position.x, thing.position.z)
            found = fixture_type(kind, types[self._room_of[part]] if part else "")
            if part is not None and is_picture(kind):
                self._hang_picture(self._floors[part], thing)
            elif part is None or found is None:
                self._left[kind] += 1
            elif not self._stand(self._floors[part], found, thing):
                self._no_room.append(f"{kind} in the {part}")
        for window in self._house.windows:
            self._put_window(window)
        for floor in self._floors.values():
            if not _passable(floor, []):
                self.said.append(f"too narrow for a robot to get from doorway to doorway: {floor.name}")
        blocking = [piece for floor in self._floors.values() for piece in _clear_ways(floor)]
        if blocking:
            self.said.append(f"left out, so that a robot gets through the room: {', '.join(blocking)}")
        self._tell()

    def _part_at(self, x: float, y: float) -> str | None:
        inside = (n for n, (x0, y0, x1, y1) in self._parts.items() if x0 <= x <= x1 and y0 <= y <= y1)
        return next(inside, None)

    def _put(self, floor: RoomFloor, piece: Furnishing) -> bool:
        """Put a thing up under a name of its own, if it has room."""
        if not floor.fits([piece]):
            return False
        base = self._catalogue[piece.entry].synset.split(".")[0]
        self._count[base] += 1
        floor.add([replace(piece, name=f"{base}_{self._count[base]}")])
        return True

    def _stand(self, floor: RoomFloor, kind: FixtureType, thing: FileThing) -> bool:
        """Put a thing up as near to its place as it has room; False: it has none."""
        side = _side(thing.rotation.y)
        frame = floor.frame(side)
        depth = floor.size(kind.entry, kind.shape)[0]
        u, middle = _along(frame, thing.position.x, thing.position.z)
        v = middle - depth / 2
        v = GAP_M if v < AT_WALL_M else v
        steps = np.arange(-MOVED_M, MOVED_M + _STEP_M / 2, _STEP_M)
        tries = sorted(((du, dv) for du in steps for dv in steps), key=lambda d: (round(np.hypot(*d), 6), d))
        for du, dv in tries:
            if v + dv < GAP_M - 1e-9 or np.hypot(du, dv) > MOVED_M + 1e-9:
                continue
            piece = floor.piece(
                "", kind.entry, frame, u + float(du), v + float(dv), front_m=kind.front_m, shape=kind.shape
            )
            if self._put(floor, piece):
                self._moved.append(float(np.hypot(du, dv)))
                self._turned += abs((thing.rotation.y + 45) % 90 - 45) > TURNED_DEG
                return True
        return False

    def _hang_picture(self, floor: RoomFloor, thing: FileThing) -> None:
        frame, height = floor.frame(_side(thing.rotation.y)), floor.size(PICTURE)[2]
        z_m = round(min(max(thing.position.y - height / 2, _SILL_M), _CEILING_M - height), 2)
        u, _ = _along(frame, thing.position.x, thing.position.z)
        if not self._put(floor, floor.piece("", PICTURE, frame, u, z_m=z_m)):
            self._no_room.append(f"{PICTURE} in the {floor.name}")

    def _put_window(self, window: FileOpening) -> None:
        ends = self._house.span(window)
        low, high = sorted(hole.y for hole in window.hole_polygon)
        top = min(high, _CEILING_M)
        low = min(low, top - _LOWEST_WINDOW_M)
        rooms = [floor for name, floor in self._floors.items() if self._room_of[name] == window.room0]
        for frame, floor in ((floor.frame(side), floor) for floor in rooms for side in SIDES):
            if ends is None:
                break
            (ua, va), (ub, vb) = (_along(frame, *end) for end in ends)
            if max(abs(va), abs(vb)) > _IN_WALL_M or min(ua, ub) < 0 or max(ua, ub) > frame.length_m:
                continue
            size = [0.06, round(abs(ub - ua), 2), round(top - low, 2)]
            shape = {"size_m": size, "panes": 2 if size[1] > 1 else 1}
            if self._put(floor, floor.piece("", WINDOW, frame, (ua + ub) / 2, z_m=round(low, 2), shape=shape)):
                return
        self._no_room.append(WINDOW)

    def _tell(self) -> None:
        put = sum(len(floor.pieces) for floor in self._floors.values())
        far = [moved for moved in self._moved if moved > 0.05]
        self.said.append(
            f"{put} fixtures, with the sizes of our catalogue, since the file has none"
            + (f"; {len(far)} moved by up to {100 * max(far):.0f} cm, to have room" if far else "")
            + (f"; {self._turned} turned to the nearest right angle" if self._turned else "")
        )
        if self._no_room:
            self.said.append(f"no room for: {_counted(Counter(self._no_room))}")
        if self._left:
            self.said.append(f"left out, since they are no fixtures here: {_counted(self._left)}")
        stand = {piece.name for floor in self._floors.values() for piece in floor.pieces if piece.z_m == 0}
        missed = [
            f"{found} in the {name}"
            for name, floor in self._floors.items()
            for found in out_of_reach(floor)
            if found in stand
        ]
        if missed:
            self.said.append(f"a robot does not get to: {', '.join(missed)}")


class _RoomTints(Tints):
    """Colors for each room of the original, so that its rectangles are alike."""

    def __init__(self, rng: np.random.Generator, base: Mapping[str, str]) -> None:
        super().__init__(rng)
        self._base = base
        self._known: dict[str, tuple[str, str]] = {}

    def room(self, name: str) -> tuple[str, str]:
        """As of `Tints`."""
        base = self._base[name]
        if base not in self._known:
            self._known[base] = super().room(base)
        return self._known[base]


def _passable(floor: RoomFloor, pieces: list[Furnishing]) -> bool:
    """Whether a robot would get from doorway to doorway, with that furniture."""
    there, floor.pieces = floor.pieces, pieces
    try:
        return not any(found.startswith("doorway") for found in out_of_reach(floor))
    finally:
        floor.pieces = there


def _clear_ways(floor: RoomFloor) -> list[str]:
    """Take furniture away until a robot gets through: the one piece that is in the way, or else the last; its names."""
    taken: list[str] = []
    if not _passable(floor, []):
        return taken
    while not _passable(floor, floor.pieces):
        standing = [piece for piece in reversed(floor.pieces) if piece.on_floor]
        alone = (one for one in standing if _passable(floor, [piece for piece in floor.pieces if piece is not one]))
        blocking = next(alone, standing[0])
        floor.pieces = [piece for piece in floor.pieces if piece is not blocking]
        taken.append(f"{blocking.name} in the {floor.name}")
    return taken


def _all(things: list[FileThing]) -> Iterator[FileThing]:
    """Things, what stands on them, and so on."""
    left = list(reversed(things))
    while left:
        thing = left.pop()
        yield thing
        left += reversed(thing.children)


def _side(rotation_deg: float) -> Side:
    """The wall that a thing has its back to: the nearest to its rotation, which is clockwise from facing north."""
    return ("south", "west", "north", "east")[round(rotation_deg / 90) % 4]


def _along(frame: WallFrame, x: float, y: float) -> tuple[float, float]:
    """u and v of a place, along and away from a wall [m]."""
    x0, y0, x1, y1 = frame.rect
    return {"south": (x - x0, y - y0), "north": (x - x0, y1 - y), "west": (y - y0, x - x0), "east": (y - y0, x1 - x)}[
        frame.side
    ]


def _counted(found: Counter[str]) -> str:
    return ", ".join(f"{n} {name}" if n > 1 else name for name, n in found.most_common())


def imported_house(file: Path, line: int = 1) -> tuple[str, list[str]]:
    """The text of a house's file from one of ProcTHOR's, and what is other than there, a line each.

    Args:
        file, line: As `read_procthor` takes them.

    Raises:
        UserError: As `read_procthor` and `ImportedHouse`.
    """
    source = f"{file.name}, line {line}" if has_lines(file) else file.name
    made = ImportedHouse(read_procthor(file, line), source)
    return made.text(), made.said
