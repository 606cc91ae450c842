"""The rooms that a generated house may have, and what furnishes each."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from mpvi_bt.house.generated.day_furniture import dining_room, living_room
from mpvi_bt.house.generated.garden_furniture import garden
from mpvi_bt.house.generated.kitchen_furniture import kitchen
from mpvi_bt.house.generated.night_furniture import bedroom, childs_room
from mpvi_bt.house.generated.office_furniture import meeting_room, private_office, shared_office
from mpvi_bt.house.generated.placement import RoomFloor
from mpvi_bt.house.generated.service_furniture import bathroom, corridor, garage, utility_room
from mpvi_bt.house.generated.tints import Tints

FURNISH: Mapping[str, Callable[[RoomFloor, Tints], None]] = {  # the rooms that are hardest to furnish come first
    "kitchen": kitchen,
    "garage": garage,
    "utility_room": utility_room,
    "shared_office": shared_office,
    "meeting_room": meeting_room,
    "private_office": private_office,
    "dining_room": dining_room,
    "living_room": living_room,
    "corridor": corridor,
    "bathroom": bathroom,
    "bedroom": bedroom,
    "childs_room": childs_room,
    "garden": garden,
}
