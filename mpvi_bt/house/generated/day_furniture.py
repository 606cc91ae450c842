"""The dining room and the living room of a generated house."""

from __future__ import annotations

from mpvi_bt.house.generated.placement import GAP_M, HINGE_M, Furnishing, NoRoom, RoomFloor
from mpvi_bt.house.generated.plane import WallFrame
from mpvi_bt.house.generated.seats import around_table
from mpvi_bt.house.generated.tints import Tints

_TO_COFFEE_TABLE_M = 0.95  # from a seat: a robot passes
_BOOKCASES = 4  # which books are packed from


def dining_room(room: RoomFloor, tints: Tints) -> None:
    """Furnish a dining room. Raises NoRoom."""
    table = around_table(room, "dining_table_1", "dining_chair", tints)
    rug(room, "dining_rug", table, 0.55, tints)
    room.along_wall("dining_plant", "houseplant", front_m=0.5, shape=tints.shape("houseplant"), corner=True, gap_m=0.06)


def living_room(room: RoomFloor, tints: Tints) -> None:
    """Furnish a living room. Raises NoRoom."""
    _sitting(room, tints)
    shape = {"hearth_z_m": 0.4}
    room.along_wall("wood_fireplace_1", "fireplace", front_m=1.1, shape=shape)
    bookcase = tints.shape("bookcase")
    pairs = ((1, 2), (3, 4)) if room.rng.random() < 0.5 else ((1, 2), (3,), (4,))
    for numbers in pairs:
        _bookcases(room, numbers, bookcase)
    color = {"color": tints.wood, "door_color": tints.second_wood}
    cabinet = {"size_m": [0.47, 0.64, 0.85], "shelves_z_m": [0.46], **color}
    room.hinge_free(room.along_wall("living_cabinet", "base_cabinet", front_m=1.2, shape=cabinet, beside_m=HINGE_M))
    room.along_wall("table_1", "table", front_m=1.0, shape=tints.shape("table"))
    room.along_wall("living_lamp", "floor_lamp", front_m=0.6, shape=tints.shape("floor_lamp"), corner=True, gap_m=0.08)
    room.along_wall("living_plant", "houseplant", front_m=0.5, shape=tints.shape("houseplant"), corner=True, gap_m=0.06)


def _sitting(room: RoomFloor, tints: Tints) -> None:
    """Put up a sofa with a coffee table before it, and a smaller seat at each end of the table, if it fits."""
    sofa, table = tints.shape("sofa"), tints.shape("coffee_table")
    depth, width, _ = room.size("sofa", sofa)
    for side in room.sides():
        frame = room.frame(side)
        for u in room.spots(frame, width / 2 + GAP_M):
            v = 0.02 + depth + _TO_COFFEE_TABLE_M
            seat = room.piece("sofa_1", "sofa", frame, u, 0.02, front_m=_TO_COFFEE_TABLE_M - 0.05, shape=sofa)
            low = room.piece("coffee_table_1", "coffee_table", frame, u, v, front_m=0.9, shape=table)
            if room.fits([seat, low]):
                room.add([seat, low])
                rug(room, "living_rug", low, 0.7, tints)
                _armchairs(room, frame, u, v + low_depth(room, table) / 2, room.size("coffee_table", table)[1], tints)
                return
    raise NoRoom("a sofa with its table")


def low_depth(room: RoomFloor, shape: dict[str, object]) -> float:
    """Depth [m] of a coffee table."""
    return room.size("coffee_table", shape)[0]


def _armchairs(room: RoomFloor, frame: WallFrame, u: float, v: float, length: float, tints: Tints) -> None:
    """Put up a seat beyond either end of the coffee table, facing it, where there is room; at least one of them."""
    wide = round(float(room.rng.uniform(1.4, 1.6)), 2)
    kinds = [
        {"size_m": [0.88, wide, 0.82], "seats": 2},
        {"size_m": [0.85, 0.92, 0.82], "seats": 1, "color": tints.second_fabric, "cushion_color": tints.fabric},
    ]
    number = 2
    for sign, kind in zip((1, -1) if room.rng.random() < 0.5 else (-1, 1), kinds, strict=True):
        shape = tints.shape("sofa") | kind
        deep, broad, _ = room.size("sofa", shape)
        toward_high = frame.side in ("north", "west")
        turn = 90.0 if (sign < 0) == toward_high else 270.0
        far = u + sign * (length / 2 + _TO_COFFEE_TABLE_M + deep / 2)
        piece = room.piece(f"sofa_{number}", "sofa", frame, far, v - broad / 2, turn_deg=turn, shape=shape)
        if room.fits([piece]):
            room.add([piece])
            number += 1


def _bookcases(room: RoomFloor, numbers: tuple[int, ...], shape: dict[str, object]) -> None:
    """Put up bookcases side by side."""
    width = room.size("bookcase", shape)[1] + GAP_M
    for side in room.sides():
        frame = room.frame(side)
        for u in room.spots(frame, width * len(numbers) / 2, corner=True):
            first = u - width * (len(numbers) - 1) / 2
            pieces = [
                room.piece(f"bookcase_{number}", "bookcase", frame, first + k * width, front_m=1.0, shape=shape)
                for k, number in enumerate(numbers)
            ]
            if room.fits(pieces):
                room.add(pieces)
                return
    raise NoRoom("bookcases")


def rug(room: RoomFloor, name: str, under: Furnishing, beyond_m: float, tints: Tints) -> None:
    """Lay a rug under a thing, so far beyond it as the room lets."""
    x0, y0, x1, y1 = under.area
    a0, b0, a1, b1 = room.inside
    x, y = (x0 + x1) / 2, (y0 + y1) / 2
    half_x = min((x1 - x0) / 2 + beyond_m, x - a0 - 0.05, a1 - x - 0.05)
    half_y = min((y1 - y0) / 2 + beyond_m, y - b0 - 0.05, b1 - y - 0.05)
    shape = tints.shape("rug", size_m=[round(2 * half_x, 2), round(2 * half_y, 2), 0.006])
    area = (x - half_x, y - half_y, x + half_x, y + half_y)
    room.add([Furnishing(name, "rug", (x, y), 0.0, area, (0.0, 0.01), 0.0, shape)])
