"""A house as ProcTHOR writes them, for tests: two rooms, one of them an L, doors, a window and things."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any


def place(x: float, z: float, y: float = 0.0) -> dict[str, float]:
    """A place as the file has it: y is up."""
    return {"x": x, "y": y, "z": z}


def wall(room: str, x0: float, z0: float, x1: float, z1: float, **more: Any) -> dict[str, Any]:
    """A wall of a room."""
    corners = [place(x0, z0), place(x1, z1), place(x0, z0, 2.6), place(x1, z1, 2.6)]
    return {"id": f"wall|{room}|{x0}|{z0}|{x1}|{z1}", "roomId": f"room|{room}", "polygon": corners, **more}


def opening(kind: str, rooms: tuple[str, str], wall_id: str, low: float, high: float, bottom: float = 0.0) -> Any:
    """A door or window, between so many meters along a wall."""
    hole = [place(low, 0.0, bottom), place(high, 0.0, bottom + 1.3)]
    named = [f"room|{room}" for room in rooms]
    return {
        "id": f"{kind}|{rooms[0]}|{rooms[1]}", "room0": named[0], "room1": named[1], "wall0": wall_id,
        "holePolygon": hole,
    }  # fmt: skip


def thing(name: str, x: float, z: float, turn: float, y: float = 0.4, children: tuple[Any, ...] = ()) -> dict[str, Any]:
    """A thing with its middle there."""
    rotation = {"x": 0, "y": turn, "z": 0}
    return {"id": f"{name}|2|0", "position": place(x, z, y), "rotation": rotation, "children": list(children)}


def house() -> dict[str, Any]:
    """A bedroom of 4 x 4 m to the west; to the east a living room, an L around a corner that is nobody's."""
    bedroom = [place(0, 0), place(0, 4), place(4, 4), place(4, 0)]
    living = [place(4, 0), place(4, 6), place(7, 6), place(7, 3), place(10, 3), place(10, 0)]
    between = wall("2", 4, 0, 4, 4)
    return {
        "rooms": [
            {"id": "room|2", "roomType": "Bedroom", "floorPolygon": bedroom},
            {"id": "room|3", "roomType": "LivingRoom", "floorPolygon": living},
        ],
        "walls": [between, wall("3", 4, 0, 4, 6), wall("3", 10, 0, 10, 3), wall("2", 0, 0, 0, 4)],
        "doors": [
            opening("door", ("2", "3"), between["id"], 1.0, 2.0),
            opening("door", ("3", "3"), "wall|3|10|0|10|3", 1.0, 2.0),
        ],
        "windows": [opening("window", ("2", "2"), "wall|2|0|0|0|4", 1.0, 2.2, 0.9)],
        "objects": [
            thing("Bed", 1.0, 3.4, 180, children=(thing("Pillow", 1.0, 3.4, 0, 0.8),)),
            thing("Dresser_12", 0.3, 0.8, 90),
            thing("RoboTHOR_sofa_alrid", 5.5, 5.5, 180),
            thing("Wall_Decor_Painting_3", 2.0, 0.05, 0, 1.5),
            thing("Television", 9.5, 0.5, 0, 0.8),
        ],
        "proceduralParameters": {"lights": []},
    }


def written(folder: Path, told: Any, name: str = "theirs.json") -> Path:
    """A file of it."""
    file = folder / name
    file.write_text(json.dumps(told))
    return file
