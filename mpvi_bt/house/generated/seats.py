"""Tables and desks of a generated house, with their chairs."""

from __future__ import annotations

from dataclasses import replace

from mpvi_bt.house.generated.placement import GAP_M, Furnishing, NoRoom, RoomFloor
from mpvi_bt.house.generated.plane import WallFrame, grown, overlap
from mpvi_bt.house.generated.tints import Tints

_UNDER_M = 0.1  # of a chair is under the table
_FREE_M = 0.95  # floor before a table
_AWAY_M = 0.6  # from a desk to a chair that is not at it


def at_table(room: RoomFloor, name: str, entry: str, chairs: str, tints: Tints) -> None:
    """Put up a table along a wall, with a chair at either end. Raises NoRoom."""
    shape = tints.shape(entry)
    depth, width, _ = room.size(entry, shape)
    seat = tints.shape("chair")
    chair = room.size("chair", seat)[0]
    for side in room.sides():
        frame = room.frame(side)
        for u in room.spots(frame, width / 2 + chair, corner=True):
            table = room.piece(name, entry, frame, u, 0.02, front_m=_FREE_M, shape=shape)
            pieces = [table]
            for number, sign in ((1, -1), (2, 1)):
                at = u + sign * (width / 2 + chair / 2 - _UNDER_M)
                pieces.append(_seat(room, f"{chairs}_{number}", frame, (at, 0.02 + depth / 2), sign, seat))
            if room.fits(pieces):
                room.add(pieces)
                return
    raise NoRoom(name)


def around_table(room: RoomFloor, name: str, chairs: str, tints: Tints, seats: int = 2) -> Furnishing:
    """Put up a table in the middle of a room, with so many chairs at each long side. Raises NoRoom."""
    frame = room.frame("south" if room.rng.random() < 0.5 else "west")
    width = round(float(room.rng.uniform(1.5, 1.7)) * seats / 2, 2)
    shape = tints.shape("table", size_m=[0.9, width, round(float(room.rng.uniform(0.73, 0.76)), 2)])
    u = frame.length_m / 2 + float(room.rng.uniform(-0.15, 0.15))
    v = frame.depth_m / 2 + float(room.rng.uniform(-0.15, 0.15))
    table = room.piece(name, "table", frame, u, v - 0.45, shape=shape)
    seat = tints.shape("chair")
    chair = room.size("chair", seat)[0]
    pieces = [table]
    places = ((along, away) for away in (-1, 1) for along in range(seats))
    for number, (along, away) in enumerate(places, 1):
        at = (u + ((along + 0.5) / seats - 0.5) * width, v + away * (0.45 + chair / 2 - _UNDER_M))
        turn = 0.0 if away < 0 else 180.0
        pieces.append(_turned(room, f"{chairs}_{number}", frame, at, turn, seat))
    if not room.fits(pieces):
        raise NoRoom(name)
    room.add(pieces)
    return table


def desk(room: RoomFloor, name: str, tints: Tints, chair: str) -> None:
    """Put up a desk with a chair at one end of its front; before the rest of it the floor is free. Raises NoRoom."""
    shape, seat = tints.shape("desk"), tints.shape("chair")
    depth, width, _ = room.size("desk", shape)
    deep, broad, _ = room.size("chair", seat)
    for side in room.sides():
        frame = room.frame(side)
        for u in room.spots(frame, width / 2 + GAP_M, corner=True):
            sign = 1 if room.rng.random() < 0.5 else -1
            at = (u + sign * (width / 2 - broad / 2 - 0.08), 0.02 + depth + deep / 2 - _UNDER_M)
            sitting = _turned(room, chair, frame, at, 180.0, seat)
            edge = u - sign * width / 2
            beyond = edge + sign * (width - broad - 0.1)
            front = frame.area(edge, beyond, 0.02 + depth, 0.02 + depth + _FREE_M)
            table = replace(room.piece(name, "desk", frame, u, 0.02, shape=shape), front=front)
            if room.fits([table, sitting]):
                room.add([table, sitting])
                return
    raise NoRoom(name)


def desk_without_chair(room: RoomFloor, name: str, tints: Tints, chair: str) -> None:
    """Put up a desk, and a chair on castors at least a step away from it, for a task to bring. Raises NoRoom."""
    table = room.along_wall(name, "desk", front_m=_FREE_M + 0.2, shape=tints.shape("desk"), corner=True, gap_m=0.02)
    away = room.along_wall(chair, "swivel_chair", front_m=0.7, gap_m=0.12, beside_m=0.1)
    if overlap(grown(table.area, _AWAY_M), away.area):
        raise NoRoom(f"{chair} away from {name}")


def _seat(
    room: RoomFloor, name: str, frame: WallFrame, at: tuple[float, float], sign: int, shape: dict[str, object]
) -> Furnishing:
    """A chair at the low (-1) or high (1) end of a table along a wall, facing it."""
    toward_high = frame.side in ("north", "west")  # a thing turned left looks to where u is high
    return _turned(room, name, frame, at, 90.0 if (sign < 0) == toward_high else 270.0, shape)


def _turned(
    room: RoomFloor,
    name: str,
    frame: WallFrame,
    at: tuple[float, float],
    turn_deg: float,
    shape: dict[str, object],
) -> Furnishing:
    """A chair whose middle is at (u, v)."""
    depth, width, _ = room.size("chair", shape)
    across = width if round(turn_deg / 90) % 2 else depth
    return room.piece(name, "chair", frame, at[0], at[1] - across / 2, turn_deg=turn_deg, shape=shape)
