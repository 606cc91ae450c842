"""What there is to say of a house: rooms, doorways and fixtures, as data and as text with a plan."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from typing import Any

from mpvi_bt.executive.drawing.cells import WIDTH
from mpvi_bt.house.layout.house import House

_TALL = 2  # a character is so many times as high as it is wide
_TIED = "\u00a0"  # a space at which no line ends
_WIDEST = 4.0  # columns of a meter at the most: a small house is no whole page


def house_sheet(house: House) -> dict[str, Any]:
    """The sheet, ready for JSON; lengths are in meters."""
    x0, y0, x1, y1 = house.bounds()
    rooms: dict[str, Any] = {}
    for name, room in house.rooms.items():
        own = (fixture for fixture in house.fixtures.values() if fixture.room == name)
        rooms[name] = {
            "rect_m": list(room.rect),
            "outdoors": room.outdoors,
            "phrases": list(room.phrases),
            "fixtures": {
                fixture.name: {
                    "entry": fixture.entry.name,
                    "synset": fixture.entry.synset,
                    "at_m": [round(float(x), 3) for x in fixture.T_world_fixture[:3, 3]],
                }
                for fixture in own
            },
        }
    doorways = [{"between": list(d.rooms), "at_m": list(d.at), "width_m": d.width_m} for d in house.doorways]
    return {"house": house.name, "size_m": [x1 - x0, y1 - y0], "rooms": rooms, "doorways": doorways}


def house_text(sheet: dict[str, Any]) -> str:
    """The sheet in lines of at most 80 columns: a plan with north up, then each room with its fixtures."""
    wide, deep = sheet["size_m"]
    rooms = sheet["rooms"]
    count = sum(len(room["fixtures"]) for room in rooms.values())
    lines = [f"{sheet['house']}: {wide:.1f} m by {deep:.1f} m; rooms: {len(rooms)}, fixtures: {count}", ""]
    lines += [*floor_plan(sheet), ""]
    for name, room in rooms.items():
        lines += [*_room(name, sheet["doorways"], **room), ""]
    return "\n".join(lines[:-1])


def floor_plan(sheet: dict[str, Any], width: int = WIDTH) -> list[str]:
    """Rooms from above in characters: walls with their doorways, hedges as dots, north up."""
    rects = {name: room["rect_m"] for name, room in sheet["rooms"].items()}
    west, north = min(r[0] for r in rects.values()), max(r[3] for r in rects.values())
    scale = min((width - 1) / sheet["size_m"][0], _WIDEST)
    cells = [[" "] * (width + 1) for _ in range(round(sheet["size_m"][1] * scale / _TALL) + 1)]

    def column(x: float) -> int:
        return round((x - west) * scale)

    def line(y: float) -> int:
        return round((north - y) * scale / _TALL)

    for name, (x0, y0, x1, y1) in sorted(rects.items(), key=lambda item: not sheet["rooms"][item[0]]["outdoors"]):
        across, up, corner = "..." if sheet["rooms"][name]["outdoors"] else "-|+"
        left, right, top, bottom = column(x0), column(x1), line(y1), line(y0)
        for x in range(left, right + 1):
            cells[top][x] = cells[bottom][x] = across
        for y in range(top, bottom + 1):
            cells[y][left] = cells[y][right] = up if top < y < bottom else corner
        room = right - left - 1
        texts = [*textwrap.wrap(name.replace("_", " "), max(room, 1)), f"{(x1 - x0) * (y1 - y0):.0f} m2"]
        first = (top + bottom + 1 - len(texts)) // 2
        for row, text in enumerate(texts, first):
            if top < row < bottom:
                start = left + 1 + (room - len(text)) // 2
                cells[row][start : start + len(text)] = text[:room]
    for doorway in sheet["doorways"]:
        (x, y), half = doorway["at_m"], doorway["width_m"] / 2
        a = rects[doorway["between"][0]]
        if min(abs(y - a[1]), abs(y - a[3])) < 1e-6:
            for k in range(column(x - half) + 1, column(x + half)):
                cells[line(y)][k] = " "
        else:
            for k in range(line(y + half), max(line(y - half), line(y + half) + 1)):
                cells[k][column(x)] = " " if cells[k][column(x)] == "|" else cells[k][column(x)]
    return ["".join(row).rstrip() for row in cells]


def _room(
    name: str,
    doorways: list[dict[str, Any]],
    rect_m: list[float],
    outdoors: bool,
    phrases: list[str],
    fixtures: dict[str, Any],
) -> Iterator[str]:
    x0, y0, x1, y1 = rect_m
    leads = [(other, d["width_m"]) for d in doorways if name in d["between"] for other in d["between"] if other != name]
    doors = f"; doors to {', '.join(f'{other} ({width:g}{_TIED}m)' for other, width in leads)}" if leads else ""
    head = f"{name}: {x1 - x0:.1f} m by {y1 - y0:.1f} m{', outdoors' if outdoors else ''}{doors}"
    for line in textwrap.wrap(head, WIDTH, subsequent_indent="  ", break_long_words=False):
        yield line.replace(_TIED, " ")
    told = ", ".join(fixtures) or "no fixtures"
    yield from textwrap.wrap(told, WIDTH, initial_indent="  ", subsequent_indent="  ", break_long_words=False)
