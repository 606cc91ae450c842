"""The rooms of a generated office: to work in alone and together, and to meet in."""

from __future__ import annotations

from mpvi_bt.house.generated.placement import HINGE_M, RoomFloor
from mpvi_bt.house.generated.seats import around_table, desk
from mpvi_bt.house.generated.tints import Tints

_DESKS = 4  # of a shared office
_SEATS = 3  # at each long side of the table of a room to meet in


def shared_office(room: RoomFloor, tints: Tints) -> None:
    """Furnish an office of four people: desks along its walls, bookcases, a plant. Raises NoRoom."""
    for number in range(1, _DESKS + 1):
        desk(room, f"desk_{number}", tints, f"office_chair_{number}")
    bookcase = tints.shape("bookcase")
    for number in (1, 2):
        room.along_wall(f"bookcase_{number}", "bookcase", front_m=1.0, shape=bookcase)
    room.along_wall("office_plant", "houseplant", front_m=0.5, shape=tints.shape("houseplant"), corner=True, gap_m=0.06)


def private_office(room: RoomFloor, tints: Tints) -> None:
    """Furnish an office of one person: a desk, a table, a bookcase, a chest of drawers, a lamp. Raises NoRoom."""
    desk(room, f"desk_{_DESKS + 1}", tints, f"office_chair_{_DESKS + 1}")
    room.along_wall("bookcase_3", "bookcase", front_m=1.0, shape=tints.shape("bookcase"))
    drawers = tints.shape("chest_of_drawers")
    room.along_wall("chest_of_drawers_1", "chest_of_drawers", front_m=1.1, shape=drawers)
    room.along_wall("table_1", "table", front_m=1.0, shape=tints.shape("table"))
    room.along_wall("office_lamp", "floor_lamp", front_m=0.6, shape=tints.shape("floor_lamp"), corner=True, gap_m=0.08)


def meeting_room(room: RoomFloor, tints: Tints) -> None:
    """Furnish a room to meet in: a long table with its chairs, a cabinet, a plant. Raises NoRoom."""
    around_table(room, "meeting_table_1", "meeting_chair", tints, seats=_SEATS)
    color = {"color": tints.wood, "door_color": tints.second_wood}
    cabinet = {"size_m": [0.47, 0.64, 0.85], "shelves_z_m": [0.46], **color}
    room.along_wall("meeting_cabinet", "base_cabinet", front_m=1.2, shape=cabinet, beside_m=HINGE_M)
    plant = tints.shape("houseplant")
    room.along_wall("meeting_plant", "houseplant", front_m=0.5, shape=plant, corner=True, gap_m=0.06)
