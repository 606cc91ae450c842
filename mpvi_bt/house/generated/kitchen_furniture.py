"""A kitchen: fridge, sink, stove and cabinets in blocks along walls, a counter, and a table to eat at.

Before each block the floor is free so far that a robot turns there: the circle of 1.525 m in which a wheelchair turns
(ADA Standards 2010, 304.3), as between the counters of a kitchen (804.2).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from mpvi_bt.house.generated.placement import GAP_M, HINGE_M, Furnishing, NoRoom, RoomFloor, hinge_toward
from mpvi_bt.house.generated.plane import WallFrame
from mpvi_bt.house.generated.seats import at_table
from mpvi_bt.house.generated.tints import Tints

TURN_M = 1.53
_JOINT_M = 0.01  # between two units
_FRIDGE_FREE_M = 0.12  # beside a fridge, on the side where its door is hinged, for the door
_UPPER_M = 1.41  # height of wall cabinets
_HOOD_M = 1.5
_COUNTER_M = 0.9


@dataclass(frozen=True)
class _Unit:
    """A part of a block: its width [m], and the entries that stand one above the other there."""

    name: str
    width_m: float


_SINK = (_Unit("cabinet", 0.6), _Unit("dishwasher", 0.6), _Unit("sink", 0.74))
_STOVE = (_Unit("cabinet", 0.6), _Unit("stove", 0.58), _Unit("cabinet", 0.58))
_WHOLE = (*_SINK, *_STOVE)


def kitchen(room: RoomFloor, tints: Tints) -> None:
    """Furnish a kitchen. Raises NoRoom."""
    numbers = _Numbers()
    blocks: list[tuple[_Unit, ...]] = [_WHOLE] if room.rng.random() < 0.5 else [_SINK, _STOVE]
    fridge = int(room.rng.integers(len(blocks)))
    for k, units in enumerate(blocks):
        if room.rng.random() < 0.5:
            units = units[::-1]
        numbers = _block(room, tints, units, numbers, fridge=k == fridge)
    _counter(room, tints, numbers)
    room.along_wall("shelf_1", "shelf", front_m=1.0, shape=tints.shape("shelf"))
    _nail(room)
    at_table(room, "breakfast_table_1", "breakfast_table", "kitchen_chair", tints)
    _hang(room, tints, numbers)


@dataclass
class _Numbers:
    """Names in the order of the family house: cabinets on the floor come before those on the wall.

    The widest countertop, which has room for all that a task prepares, is the first, which is bound before others.
    """

    cabinets: int = 0
    countertops: int = 1
    upper: tuple[tuple[WallFrame, float], ...] = ()  # where a wall cabinet may hang

    def copy(self) -> _Numbers:
        return replace(self)

    def cabinet(self) -> str:
        self.cabinets += 1
        return f"cabinet_{self.cabinets}"

    def countertop(self) -> str:
        self.countertops += 1
        return f"countertop_{self.countertops}"


def _hang(room: RoomFloor, tints: Tints, numbers: _Numbers) -> None:
    """Hang cabinets over the units where nothing hangs yet."""
    for frame, u in numbers.upper:
        name = f"cabinet_{numbers.cabinets + 1}"
        piece = room.piece(name, "wall_cabinet", frame, u, z_m=_UPPER_M, shape=tints.shape("wall_cabinet"))
        if room.fits([piece]):
            room.add([piece])
            numbers.cabinets += 1


def _block(room: RoomFloor, tints: Tints, units: Sequence[_Unit], numbers: _Numbers, *, fridge: bool) -> _Numbers:
    """Put up a row of units along one wall, the fridge at an end that has none of them beyond it."""
    width = sum(unit.width_m + _JOINT_M for unit in units)
    beside = room.size("refrigerator")[1] + _FRIDGE_FREE_M + 2 * _JOINT_M if fridge else 0.0
    for side in room.sides():
        frame = room.frame(side)
        for middle in room.spots(frame, (width + beside) / 2 + HINGE_M, corner=True):
            fridge_first = bool(room.rng.random() < 0.5)
            low = middle - (width + beside) / 2
            drawn = numbers.copy()
            pieces = list(_units(room, tints, units, drawn, frame, low + (beside if fridge_first else 0.0)))
            if fridge:
                at = low + _FRIDGE_FREE_M if fridge_first else low + width + _JOINT_M
                pieces.append(_fridge(room, frame, at, fridge_first))
            if room.fits(pieces):
                room.add(pieces)
                return drawn
    raise NoRoom("a block of the kitchen")


def _units(
    room: RoomFloor, tints: Tints, units: Sequence[_Unit], numbers: _Numbers, frame: WallFrame, low: float
) -> Iterator[Furnishing]:
    for k, unit in enumerate(units):
        u = low + unit.width_m / 2
        size = [0.62, unit.width_m, _COUNTER_M]
        match unit.name:
            case "sink":
                yield room.piece("sink_1", "kitchen_sink", frame, u, front_m=TURN_M, shape=tints.shape("kitchen_sink"))
            case "stove":
                yield room.piece("oven_1", "oven", frame, u, front_m=TURN_M)
                yield room.piece("stove_1", "stove", frame, u, z_m=0.86)
                yield room.piece("hood_1", "extractor_hood", frame, u, z_m=_HOOD_M)
            case "dishwasher":
                yield room.piece("dishwasher_1", "dishwasher", frame, u, front_m=TURN_M)
            case _:
                shape = tints.shape("base_cabinet", size_m=[0.6, unit.width_m, 0.86])
                yield room.piece(numbers.cabinet(), "base_cabinet", frame, u, front_m=TURN_M, shape=shape)
        neighbors = {units[k + step].name for step in (-1, 1) if 0 <= k + step < len(units)}
        if unit.name == "dishwasher":
            way = 1 if units[(k + 1) % len(units)].name == "cabinet" and k + 1 < len(units) else -1
            wide = tints.shape("countertop", size_m=[0.62, 2 * unit.width_m + _JOINT_M, _COUNTER_M])
            yield room.piece("countertop_1", "countertop", frame, u + way * (unit.width_m + _JOINT_M) / 2, shape=wide)
        elif unit.name == "cabinet" and "dishwasher" not in neighbors:
            yield room.piece(numbers.countertop(), "countertop", frame, u, shape=tints.shape("countertop", size_m=size))
        if unit.name in ("dishwasher", "cabinet"):
            numbers.upper += ((frame, u),)
        low += unit.width_m + _JOINT_M


def _fridge(room: RoomFloor, frame: WallFrame, low: float, first: bool) -> Furnishing:
    """Hinged on the side away from the other units, so that its open door is not between them and it."""
    depth, width, _ = room.size("refrigerator")
    shape = {"hinge": hinge_toward(frame, high=not first)}
    piece = room.piece("electric_refrigerator_1", "refrigerator", frame, low + width / 2, shape=shape)
    beside = (_FRIDGE_FREE_M, 0.0) if first else (0.0, _FRIDGE_FREE_M)  # where the open door is
    front = frame.area(low - beside[0], low + width + beside[1], GAP_M + depth, GAP_M + depth + TURN_M)
    return replace(piece, front=front)


def _counter(room: RoomFloor, tints: Tints, numbers: _Numbers) -> None:
    """Put up a counter with a microwave at one end."""
    width = round(float(room.rng.uniform(1.4, 1.8)), 2)
    shape = tints.shape("counter", size_m=[0.62, width, _COUNTER_M])
    counter = room.along_wall(numbers.countertop(), "counter", front_m=TURN_M - 0.2, shape=shape, corner=True)
    frame, u = room.behind(counter)
    high = bool(room.rng.random() < 0.5)
    at, hinge = u + (width / 2 - 0.3) * (1 if high else -1), hinge_toward(frame, high=high)
    room.add([room.piece("microwave_1", "microwave", frame, at, 0.03, z_m=_COUNTER_M, shape={"hinge": hinge})])


def _nail(room: RoomFloor) -> None:
    """Put a nail in a wall with nothing else on it, for a picture."""
    for side in room.sides():
        frame = room.frame(side)
        for u in room.spots(frame, 0.45):
            area, front = (frame.area(u - 0.4, u + 0.4, *v) for v in ((0.0, 0.25), (0.25, 1.0)))
            at = frame.point(u, 0.001)
            nail = Furnishing("wall_nail_1", "wall_nail", at, frame.yaw_deg, area, (0.3, 1.9), 1.45, {}, front)
            if room.fits([nail]):
                room.add([nail])
                return
    raise NoRoom("a nail")
