"""The corridor, bathroom, utility room and garage of a generated house."""

from __future__ import annotations

from mpvi_bt.house.generated.placement import HINGE_M, Furnishing, NoRoom, RoomFloor, hinge_toward
from mpvi_bt.house.generated.tints import Tints

_RUNNER_M = 4.5  # length of a corridor's rug, at the most


def corridor(room: RoomFloor, tints: Tints) -> None:
    """Furnish a corridor: a hallstand, the door to the street, a long rug. Raises NoRoom."""
    room.along_wall("hallstand_1", "hallstand", front_m=0.9, shape=tints.shape("hallstand"))
    _front_door(room)
    x0, y0, x1, y1 = room.inside
    length = round(min(max(x1 - x0, y1 - y0) - 1.2, _RUNNER_M), 2)
    size = [length, 0.9] if x1 - x0 > y1 - y0 else [0.9, length]
    at = ((x0 + x1) / 2, (y0 + y1) / 2)
    area = (at[0] - size[0] / 2, at[1] - size[1] / 2, at[0] + size[0] / 2, at[1] + size[1] / 2)
    shape = tints.shape("rug", size_m=[*size, 0.006])
    room.add([Furnishing("corridor_rug", "rug", at, 0.0, area, (0.0, 0.01), 0.0, shape)])


def _front_door(room: RoomFloor) -> None:
    """Hang the door to the street in an outer wall, the longest stretches last: it is seen only."""
    for side, low, high in sorted(room.outer, key=lambda stretch: stretch[2] - stretch[1]):
        frame = room.frame(side)
        for u in room.spots(frame, 0.55):
            if low < u - 0.55 and u + 0.55 < high:
                door = room.piece("front_door", "front_door", frame, u, front_m=0.8)
                if room.fits([door]):
                    room.add([door])
                    return


def bathroom(room: RoomFloor, tints: Tints) -> None:
    """Furnish a bathroom. Raises NoRoom."""
    room.along_wall("bathtub_1", "bathtub", front_m=0.8, corner=True)
    sink = room.along_wall("sink_2", "bathroom_sink", front_m=1.1)
    frame, u = room.behind(sink)
    room.add([room.piece("bathroom_mirror", "mirror", frame, u, z_m=1.15)])
    white = {"door_color": "#f3f3ef"}
    cabinet = {"size_m": [0.34, 0.6, 1.5], "shelves_z_m": [0.45, 0.83], **white}
    room.along_wall("bathroom_cabinet", "tall_cabinet", front_m=1.1, shape=cabinet, beside_m=HINGE_M)
    room.along_wall("toilet_1", "toilet", front_m=0.8)
    shelf = tints.shape("shelf", color="#f3f3ef", back_color="#c5dcdf")
    room.along_wall("bathroom_shelf", "shelf", front_m=0.95, shape=shelf)


def utility_room(room: RoomFloor, tints: Tints) -> None:
    """Furnish a utility room: a counter with the washer beside it, a workbench, a cabinet. Raises NoRoom."""
    _laundry(room)
    room.along_wall("tabletop_1", "workbench", front_m=1.0, corner=True)
    room.along_wall("utility_cabinet", "tall_cabinet", front_m=1.1, corner=True, beside_m=HINGE_M)


def _laundry(room: RoomFloor) -> None:
    size = [0.62, round(float(room.rng.uniform(1.1, 1.4)), 2), 0.9]
    shape = {"size_m": size, "units": 2, "color": "#c3ced3", "top_color": "#8d9ba3"}
    for side in room.sides():
        frame = room.frame(side)
        for u in room.spots(frame, size[1] / 2 + 0.3 + HINGE_M, corner=True):
            for sign in (1, -1):  # the washer's door opens to the counter's side
                hinge = hinge_toward(frame, high=sign < 0)
                washer = room.piece(
                    "washer_1", "washer", frame, u + sign * size[1] / 2, front_m=1.2, shape={"hinge": hinge}
                )
                counter = room.piece("utility_counter", "counter", frame, u - sign * 0.31, front_m=1.2, shape=shape)
                if room.fits([washer, counter]):
                    room.add([washer, counter])
                    return
    raise NoRoom("a washer")


def garage(room: RoomFloor, tints: Tints) -> None:
    """Furnish a garage: a car whose boot looks into free floor, and a shelf. Raises NoRoom."""
    room.along_wall("car_1", "car", front_m=1.4, shape=tints.shape("car"), gap_m=0.2, corner=True)
    shelf = {"size_m": [0.32, 1.6, 1.7], "color": "#5d6670", "back_color": "#79848f"}
    room.along_wall("garage_shelf", "shelf", front_m=0.85, shape=shelf)
