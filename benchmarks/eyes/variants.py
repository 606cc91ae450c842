"""Sizes and colors that things are drawn with, and those that are held out from training.

Held out are: a fifth of the shapes, those that are drawn out the most in height; and of ten kinds all colors but about
their own.
"""

from __future__ import annotations

import colorsys
from collections.abc import Mapping
from typing import Any, Literal

import numpy as np

from mpvi_bt.ground.errors import UserError
from mpvi_bt.house.things.catalogue import CatalogueEntry

Drawn = Literal["catalogue", "trained", "held_out_shape", "held_out_color"]
# Kinds whose other colors are never trained on.
ONE_COLOR = (
    "can__of__soda.n.01", "bottle.n.01", "bowl.n.01", "plate.n.04", "coffee_cup.n.01", "ashcan.n.01", "book.n.02",
    "gift_box.n.01", "gym_shoe.n.01", "toolbox.n.01",
)  # fmt: skip
# All our choice.
_AS_IT_IS = 0.45  # of the things are as the catalogue has them
_SCALE = (0.87, 1.15)  # of the whole
_STRETCH = (0.75, 1.15)  # of its height in training,
_HELD_OUT_STRETCH = (1.15, 1.25)  # and held out
_HUE, _HELD_OUT_HUE = 0.05, (0.3, 0.7)  # turns
_FULL, _BRIGHT = (0.8, 1.2), (0.82, 1.15)
_ANY_HUE = 0.15  # of the things of all other kinds have any color


def drawn(entry: CatalogueEntry, rng: np.random.Generator, how: Drawn) -> tuple[CatalogueEntry, Drawn]:
    """A thing with another size and color, and how it was drawn: as it is where it cannot be drawn otherwise.

    Args:
        entry: Of the catalogue.
        rng: Source of the draw.
        how: "trained" draws as in training, where about half are as in the catalogue.
    """
    if how == "catalogue" or (how == "trained" and rng.random() < _AS_IT_IS):
        return entry, "catalogue"
    if how == "held_out_color" and entry.synset not in ONE_COLOR:
        how = "trained"
    scale = rng.uniform(*_SCALE)
    stretch = rng.uniform(*(_HELD_OUT_STRETCH if how == "held_out_shape" else _STRETCH))
    hue = rng.uniform(-_HUE, _HUE)
    if how == "held_out_color":
        hue = rng.uniform(*_HELD_OUT_HUE)
    elif entry.synset not in ONE_COLOR and rng.random() < _ANY_HUE:
        hue = rng.random()
    full, bright = rng.uniform(*_FULL), rng.uniform(*_BRIGHT)
    shape = _resized(dict(entry.shape), scale, stretch)
    shape = _recolored(shape, hue, full, bright)
    try:
        other = entry.changed(shape=shape)
        assert other.description.bodies
    except (UserError, ValueError):
        return entry, "catalogue"
    return other, how


def _resized(shape: Mapping[str, Any], scale: float, stretch: float) -> dict[str, Any]:
    """All lengths scaled, and the height stretched where it is a number of its own."""
    out: dict[str, Any] = {}
    for key, value in shape.items():
        if key == "pieces":
            out[key] = [_resized(piece, scale, stretch) for piece in value]
        elif key in ("size_m", "at") and isinstance(value, list | tuple):
            out[key] = [value[0] * scale, value[1] * scale, value[2] * scale * stretch]
        elif key == "height_m":
            out[key] = value * scale * stretch
        elif key.endswith("_m") and isinstance(value, int | float):
            out[key] = value * scale
        else:
            out[key] = value
    return out


def _recolored(value: Any, hue: float, full: float, bright: float) -> Any:
    """All colors of a shape, turned and scaled."""
    if isinstance(value, dict):
        return {key: _recolored(each, hue, full, bright) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_recolored(each, hue, full, bright) for each in value]
    if isinstance(value, str) and value.startswith("#") and len(value) == 7:
        h, s, v = colorsys.rgb_to_hsv(*(int(value[k : k + 2], 16) / 255 for k in (1, 3, 5)))
        r, g, b = colorsys.hsv_to_rgb((h + hue) % 1, min(s * full, 1), min(v * bright, 1))
        return "#" + "".join(f"{round(255 * c):02x}" for c in (r, g, b))
    return value
