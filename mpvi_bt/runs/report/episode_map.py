"""An episode from above, as SVG: house, the base's path, old and new places of moved things."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from html import escape

from mpvi_bt.executive.drawing.cells import one_line
from mpvi_bt.ground.words.spoken import spoken, spoken_each
from mpvi_bt.house.layout.house import House
from mpvi_bt.house.layout.prior_map import BAND_M
from mpvi_bt.runs.episode.way import Way

WIDTH, TALLEST = 340.0, 420.0  # pixels; a telephone is as wide
_MARGIN_M, _LEAST_M, _MOVED_M = 0.8, 3.0, 0.1
_PALE = 6  # tints of rooms
_CORNERS = 200  # of a way, at most: pages hold hundreds

Box = tuple[float, float, float, float]


def house_symbol(house: House) -> str:
    """A house as an SVG symbol in meters, y up, which every map of it uses: it is in a page once."""
    parts = []
    for i, room in enumerate(house.rooms.values()):
        look = "outdoors" if room.outdoors else f"r{i % _PALE}"
        parts.append(f'<path class="room {look}" d="{_rectangle(*room.rect)}"/>')
    for fixture in house.fixtures.values():
        boxes = [solid.aabb().tolist() for solid in fixture.solids()]
        tall = [(a, b) for a, b in boxes if a[2] < BAND_M[1] and b[2] > BAND_M[0]]  # a lawn is driven over
        path = "".join(_rectangle(*a[:2], *b[:2]) for a, b in tall)
        name = escape(one_line(spoken(fixture.name)))
        parts += [f'<path class="fixture" d="{path}"><title>{name}</title></path>'] if path else []
    for wall in house.walls:
        (x0, y0, _), (x1, y1, _) = wall.solid.aabb().tolist()
        parts.append(f'<path class="wall" d="{_rectangle(x0, y0, x1, y1)}"/>')
    return f'<symbol id="house-{escape(house.name)}" overflow="visible">{"".join(parts)}</symbol>'


def way_map(way: Way, house: House | None) -> str:
    """The map of an episode.

    Args:
        way: Where everything went.
        house: Whose symbol is in the page; None: none is drawn.
    """
    moved = {name: ends for name, ends in way.things.items() if math.dist(*ends) > _MOVED_M}
    places = [*way.base, *(place for ends in (moved or way.things).values() for place in ends)]
    if not places:
        return ""
    x0, y0, x1, y1 = _window(places)
    scale = min(WIDTH / (x1 - x0), TALLEST / (y1 - y0))
    width, height = (x1 - x0) * scale, (y1 - y0) * scale

    def px(place: Sequence[float]) -> tuple[float, float]:
        return (place[0] - x0) * scale, (y1 - place[1]) * scale

    parts = []
    if house is not None:
        turn = f"translate({-x0 * scale:.1f} {y1 * scale:.1f}) scale({scale:.2f} {-scale:.2f})"
        parts.append(f'<use href="#house-{escape(house.name)}" transform="{turn}"/>')
        parts += _room_names(house, (x0, y0, x1, y1), scale)
    if way.base:
        corners = way.base[:: math.ceil(len(way.base) / _CORNERS)]
        points = " ".join(f"{x:.0f},{y:.0f}" for x, y in map(px, [*corners, way.base[-1]]))
        parts.append(f'<polyline class="way" points="{points}"/>')
    for name, (before, after) in way.things.items():
        (a, b), (c, d) = px(before), px(after)
        if name in moved:
            parts.append(f'<circle class="was" cx="{a:.0f}" cy="{b:.0f}" r="4"/>')
            parts.append(f'<path class="move" d="M{a:.0f} {b:.0f}L{c:.0f} {d:.0f}"/>')
        parts.append(_disc("moved" if name in moved else "still", c, d, 4, name))
    for look, place in zip(("start", "end"), way.base[:1] + way.base[-1:], strict=False):
        parts.append(_disc(look, *px(place), 6, f"{look} of the way"))
    parts += _names({name: px(ends[1]) for name, ends in moved.items()}, width, height)
    size = f'width="{width:.0f}" height="{height:.0f}" viewBox="0 0 {width:.0f} {height:.0f}"'
    return f'<svg class="map" role="img" {size}><title>The way, from above</title>{"".join(parts)}</svg>'


def _disc(look: str, x: float, y: float, radius: int, title: str) -> str:
    return (
        f'<circle class="{look}" cx="{x:.0f}" cy="{y:.0f}" r="{radius}">'
        f"<title>{escape(one_line(title))}</title></circle>"
    )


def _window(places: Sequence[Sequence[float]]) -> Box:
    """What is shown [m]: all places with a margin, at least 3 m either way."""
    xs, ys = [place[0] for place in places], [place[1] for place in places]
    spare_x = max(_MARGIN_M, (_LEAST_M - max(xs) + min(xs)) / 2)
    spare_y = max(_MARGIN_M, (_LEAST_M - max(ys) + min(ys)) / 2)
    return min(xs) - spare_x, min(ys) - spare_y, max(xs) + spare_x, max(ys) + spare_y


def _room_names(house: House, window: Box, scale: float) -> list[str]:
    """Each room's name, in a corner of its visible part if there is space."""
    x0, y0, x1, y1 = window
    parts = []
    for room in house.rooms.values():
        left, right = max(room.rect[0], x0), min(room.rect[2], x1)
        low, high = max(room.rect[1], y0), min(room.rect[3], y1)
        name = one_line(room.name.replace("_", " "))
        if (right - left) * scale > 6 * len(name) and (high - low) * scale > 16:
            x, y = (left - x0) * scale + 5, (y1 - high) * scale + 14
            parts.append(f'<text class="name" x="{x:.0f}" y="{y:.0f}">{escape(name)}</text>')
    return parts


def _names(places: Mapping[str, tuple[float, float]], width: float, height: float) -> list[str]:
    """Names of moved things at their new places; a name that would cover another is left to the tooltip."""
    taken: list[Box] = []
    parts = []
    words = spoken_each(places)
    for name, (x, y) in places.items():
        text = one_line(words[name])
        wide = 6.3 * len(text)
        left = min(x + 7, width - wide - 2)
        box = (left, y - 9, left + wide, y + 3)
        if left < 0 or any(box[0] < b[2] and b[0] < box[2] and box[1] < b[3] and b[1] < box[3] for b in taken):
            continue
        taken.append(box)
        parts.append(f'<text x="{left:.0f}" y="{min(y, height - 4):.0f}">{escape(text)}</text>')
    return parts


def _rectangle(x0: float, y0: float, x1: float, y1: float) -> str:
    return f"M{x0:.2f} {y0:.2f}H{x1:.2f}V{y1:.2f}H{x0:.2f}z"
