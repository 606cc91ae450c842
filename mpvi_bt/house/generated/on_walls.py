"""Windows in outer walls and pictures on inner ones, where no furniture hides them."""

from __future__ import annotations

from mpvi_bt.house.generated.placement import RoomFloor
from mpvi_bt.house.generated.tints import Tints

_SILL_M = 0.95
_NO_WINDOWS = ("garage", "garden", "corridor")
_MOST_WINDOWS = {"living_room": 3, "kitchen": 2, "dining_room": 2, "shared_office": 3, "meeting_room": 2}
_WITH_PICTURE = {"dining_room": "dining_picture", "living_room": "living_picture", "corridor": "corridor_picture",
                 "bedroom": "bedroom_picture", "meeting_room": "meeting_picture",
                 "private_office": "office_picture"}  # fmt: skip
_NAMES = {"living_room": "living", "dining_room": "dining", "childs_room": "childs", "utility_room": "utility"}


def hang_on_walls(room: RoomFloor, tints: Tints) -> None:
    """Put windows and pictures up, as many as have room."""
    if room.name not in _NO_WINDOWS:
        _windows(room)
    if (name := _WITH_PICTURE.get(room.name)) is not None:
        for side in room.sides():
            frame = room.frame(side)
            shape = tints.shape("picture")
            middle_first = sorted(room.spots(frame, 0.55), key=lambda u: abs(u - frame.length_m / 2))
            for u in middle_first:
                piece = room.piece(name, "picture", frame, u, z_m=1.25, shape=shape)
                if room.fits([piece]):
                    room.add([piece])
                    return


def _windows(room: RoomFloor) -> None:
    number = 0
    for side, low, high in room.outer:
        frame = room.frame(side)
        for width in (2.2, 1.6, 1.0, 0.7):
            high_up = room.name in ("bathroom", "kitchen", "utility_room")
            size = [0.06, width, 0.7 if high_up else 1.0]
            shape = {"size_m": size, "panes": max(1, round(width / 0.8))}
            sill = 1.2 if high_up else _SILL_M
            spots = sorted(room.spots(frame, width / 2 + 0.1), key=lambda u: abs(u - (low + high) / 2))
            for u in spots:
                name = f"{_NAMES.get(room.name, room.name)}_window_{number + 1}"
                piece = room.piece(name, "window", frame, u, z_m=sill, shape=shape)
                if low + 0.15 < u - width / 2 and u + width / 2 < high - 0.15 and room.fits([piece]):
                    room.add([piece])
                    number += 1
                    break
            else:
                continue
            break
        if number == _MOST_WINDOWS.get(room.name, 1):
            return
