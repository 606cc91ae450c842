"""A generated house as the text of its file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import yaml

from mpvi_bt.house.generated.doorways import DrawnDoor
from mpvi_bt.house.generated.placement import Furnishing
from mpvi_bt.house.generated.plane import Rect
from mpvi_bt.house.generated.tints import Tints

PHRASES = {
    "living_room": ["lounge"],
    "corridor": ["hall", "hallway"],
    "utility_room": ["laundry room"],
    "bathroom": ["bath"],
    "childs_room": ["child's room", "children's room", "childs room", "nursery"],
    "garden": ["yard", "patio"],
    "meeting_room": ["conference room"],
    "private_office": ["study"],
    "shared_office": ["open-plan office"],
}


def house_text(
    about: str,
    floor: Mapping[str, Rect],
    doors: Sequence[DrawnDoor],
    pieces: Mapping[str, Sequence[Furnishing]],
    tints: Tints,
) -> str:
    """The file's text.

    Args:
        about: The comment that it begins with.
        floor: Rooms and their rectangles.
        doors: Between them.
        pieces: What is in each room.
        tints: Colors of floors and walls.
    """
    lines = [f"# {about}", f"outside: {_flow(tints.outside)}", "doorways:"]
    for door in doors:
        lines.append(f"  - {_flow({'between': list(door.between), 'at': _rounded(door.at), 'width_m': door.width_m})}")
    if not doors:
        lines[-1] = "doorways: []"
    lines.append("rooms:")
    for name, rect in floor.items():
        ground, walls = tints.room(name)
        lines += [f"  {name}:", f"    rect: {_flow(_rounded(rect))}", f"    floor: {_flow(ground)}"]
        lines.append(f"    walls: {_flow(walls)}")
        if name == "garden":
            lines.append("    outdoors: true")
        if name in PHRASES:
            lines.append(f"    phrases: {_flow(PHRASES[name])}")
        lines.append("    fixtures:" if pieces[name] else "    fixtures: {}")
        lines += [f"      {piece.name}: {_flow(_fixture(piece))}" for piece in pieces[name]]
    return "\n".join(lines) + "\n"


def _fixture(piece: Furnishing) -> dict[str, Any]:
    written: dict[str, Any] = {"entry": piece.entry, "at": _rounded(piece.at)}
    if piece.z_m:
        written["z_m"] = round(piece.z_m, 3)
    if piece.yaw_deg:
        written["yaw_deg"] = round(piece.yaw_deg)
    if piece.shape:
        written["shape"] = dict(piece.shape)
    return written


def _rounded(values: Sequence[float]) -> list[float]:
    return [round(float(value), 3) for value in values]


def _flow(value: Any) -> str:
    text: str = yaml.safe_dump(value, default_flow_style=True, sort_keys=False, width=10_000, allow_unicode=True)
    return text.removesuffix("...\n").strip()
