"""The bedroom and the child's room of a generated house."""

from __future__ import annotations

from mpvi_bt.house.generated.day_furniture import rug
from mpvi_bt.house.generated.placement import GAP_M, NoRoom, RoomFloor
from mpvi_bt.house.generated.seats import desk, desk_without_chair
from mpvi_bt.house.generated.tints import Tints

_BESIDE_BED_M = 0.9


def bedroom(room: RoomFloor, tints: Tints) -> None:
    """Furnish a bedroom. Raises NoRoom."""
    _double_bed(room, tints)
    desk_without_chair(room, "desk_2", tints, "swivel_chair_1")
    drawers = tints.shape("chest_of_drawers")
    room.along_wall("chest_of_drawers_1", "chest_of_drawers", front_m=1.1, shape=drawers)


def _double_bed(room: RoomFloor, tints: Tints) -> None:
    """Put up a bed with its head to a wall, and a nightstand on either side."""
    wide = round(float(room.rng.uniform(1.4, 1.6)), 2)
    bed = tints.shape("bed", size_m=[2.0, wide, round(float(room.rng.uniform(0.5, 0.54)), 2)], pillows=2)
    stand = tints.shape("nightstand")
    broad = room.size("nightstand", stand)[1]
    for side in room.sides():
        frame = room.frame(side)
        for u in room.spots(frame, wide / 2 + broad + 0.12):
            pieces = [room.piece("bed_2", "bed", frame, u, 0.01, front_m=0.8, shape=bed)]
            for number, sign in ((1, -1), (2, 1)):
                at = u + sign * (wide / 2 + broad / 2 + 0.08)
                name = f"nightstand_{number}"
                pieces.append(room.piece(name, "nightstand", frame, at, 0.02, front_m=_BESIDE_BED_M, shape=stand))
            if room.fits(pieces):
                room.add(pieces)
                rug(room, "bedroom_rug", pieces[0], 0.4, tints)
                return
    raise NoRoom("a bed")


def childs_room(room: RoomFloor, tints: Tints) -> None:
    """Furnish a child's room. Raises NoRoom."""
    bed = tints.shape("bed")
    broad = room.size("bed", bed)[1]
    for side in room.sides():
        frame = room.frame(side)
        for u in room.spots(frame, broad / 2 + GAP_M, corner=True):
            piece = room.piece("bed_1", "bed", frame, u, 0.01, front_m=0.8, shape=bed)
            if room.fits([piece]):
                room.add([piece])
                break
        else:
            continue
        break
    else:
        raise NoRoom("a bed")
    desk(room, "desk_1", tints, "chair_1")
    low = {"size_m": [0.32, 0.9, 1.5], "shelves": 4}
    for number in (1, 2):
        back = {"back_color": tints.one(("#8cc0d6", "#e8b2c0", "#b9d6a0", "#f0d79a"))}
        room.along_wall(f"childs_bookcase_{number}", "bookcase", front_m=1.0, shape=low | back, corner=True)
    table = {"size_m": [0.6, 1.0, 0.52], "color": tints.one(("#6fb3c9", "#e2b35f", "#94bd86")), "leg_color": "#f2efe8"}
    room.along_wall("table_2", "table", front_m=0.9, shape=table)
