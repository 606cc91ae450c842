"""Colors and sizes of the fixtures of one generated house, drawn within their families; what people match is alike."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

# All our choice, about the shapes of the catalogue.
_WOODS = ("#80512c", "#a97845", "#d9b98c", "#6f4526", "#c28e55", "#f2efe8")
_FRONTS = ("#7f9a86", "#8aa0b4", "#e6e0d2", "#b9856a", "#5f7480", "#d8d3c8")
_TOPS = ("#d7cfc0", "#4f5358", "#c9b48f", "#e9e7e2")
_SPLASHES = ("#a9c3b4", "#c7d3dc", "#ddcdb6", "#b7b2c6")
_FABRICS = ("#2f6f7e", "#b8863b", "#7b5e7b", "#5d7350", "#8c4a3f", "#4a5c7d")
_RUGS = (
    ("#c9674b", "#f0dfc2"),
    ("#55748a", "#e6ddc8"),
    ("#7a8f5a", "#e8dcc0"),
    ("#7d6bb0", "#f1ebf5"),
    ("#b58a6a", "#f3ead9"),
)
_PICTURES = ("#e29b4a", "#7fa7c4", "#4f9aa3", "#c86f6f", "#d8a24a", "#6f8f5f")
_CARS = ("#2c5fa8", "#8c2f2a", "#3f5d46", "#b9bcc0", "#c98b2b")
_FLOORS: Mapping[str, tuple[str, ...]] = {
    "wood": ("#c08e5c", "#b98d5e", "#a9764a", "#d3ae7d", "#b5845a"),
    "tiles": ("#9fb0ab", "#9fb0b8", "#7fb0b5", "#b9b3a6"),
    "concrete": ("#8a8d90", "#979389"),
    "stone": ("#c7bda8", "#bdb7aa"),
}
_FLOOR_OF = {"kitchen": "tiles", "bathroom": "tiles", "utility_room": "tiles", "garage": "concrete", "garden": "stone"}
_WALLS = ("#f6ecd4", "#dfe7dc", "#f5ecdc", "#e9e2ee", "#e4eef2", "#fbe7b8", "#e3dcea", "#d8eef0", "#f3e3da")
_HEDGES = ("#4f7a3f", "#5d8046")
_OUTSIDES = ("#efe6d6", "#e4dccb", "#d9e0e2", "#e8d3c4")
# Depth, width and height [m] of what is not as large everywhere.
_SIZES: Mapping[str, tuple[tuple[float, float], tuple[float, float], tuple[float, float]]] = {
    "breakfast_table": ((0.66, 0.74), (0.85, 1.0), (0.72, 0.76)),
    "table": ((0.5, 0.58), (1.0, 1.2), (0.7, 0.74)),
    "coffee_table": ((0.55, 0.65), (0.95, 1.2), (0.4, 0.44)),
    "nightstand": ((0.38, 0.42), (0.42, 0.5), (0.48, 0.54)),
    "desk": ((0.58, 0.65), (1.2, 1.45), (0.72, 0.76)),
    "sofa": ((0.86, 0.94), (1.9, 2.2), (0.78, 0.84)),
    "bookcase": ((0.3, 0.34), (0.8, 0.95), (1.6, 1.85)),
    "shelf": ((0.29, 0.32), (0.75, 0.85), (1.2, 1.4)),
    "chest_of_drawers": ((0.45, 0.48), (0.8, 0.95), (0.78, 0.84)),
    "hallstand": ((0.38, 0.42), (0.9, 1.1), (1.7, 1.8)),
    "houseplant": ((0.4, 0.45), (0.4, 0.45), (0.9, 1.2)),
    "floor_lamp": ((0.34, 0.38), (0.34, 0.38), (1.5, 1.7)),
    "picture": ((0.04, 0.04), (0.6, 1.0), (0.45, 0.65)),
}


class Tints:
    """Colors and sizes of one house, drawn once or for each thing.

    Args:
        rng: Source of the draw.
    """

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self.wood, self.second_wood = self._two(_WOODS)
        self.front, self.top, self.splash = self.one(_FRONTS), self.one(_TOPS), self.one(_SPLASHES)
        self.fabric, self.second_fabric = self._two(_FABRICS)
        self.outside = self.one(_OUTSIDES)
        self._wood_floor = self.one(_FLOORS["wood"])

    def one(self, colors: tuple[str, ...]) -> str:
        """One of some colors."""
        return colors[int(self._rng.integers(len(colors)))]

    def room(self, name: str) -> tuple[str, str]:
        """Colors of a room's floor and walls."""
        kind = _FLOOR_OF.get(name, "wood")
        floor = self._wood_floor if kind == "wood" else self.one(_FLOORS[kind])
        return floor, self.one(_HEDGES if name == "garden" else _WALLS)

    def size(self, entry: str) -> list[float]:
        """Depth, width and height [m] of a thing."""
        return [round(float(self._rng.uniform(low, high)), 2) for low, high in _SIZES[entry]]

    def shape(self, entry: str, **fixed: Any) -> dict[str, Any]:
        """Size and colors of a thing, but for what is `fixed`."""
        drawn: dict[str, Any] = {"size_m": self.size(entry)} if entry in _SIZES else {}
        match entry:
            case "sofa":
                drawn |= {"color": self.fabric, "cushion_color": lighter(self.fabric)}
            case "breakfast_table" | "table" | "coffee_table" | "nightstand" | "chest_of_drawers" | "hallstand":
                drawn["color"] = self.wood
            case "desk" | "shelf":
                drawn["color"] = self.second_wood
            case "bookcase":
                drawn |= {"color": self.wood, "back_color": lighter(self.wood)}
            case "chair":
                drawn |= {"color": lighter(self.second_wood), "leg_color": self.second_wood}
            case "bed":
                drawn |= {"color": self.wood, "blanket_color": self.one(_FABRICS)}
            case "rug":
                color, border = _RUGS[int(self._rng.integers(len(_RUGS)))]
                drawn |= {"color": color, "border_color": border}
            case "picture":
                drawn["color"] = self.one(_PICTURES)
            case "car":
                drawn["color"] = self.one(_CARS)
            case "base_cabinet" | "wall_cabinet":
                drawn["door_color"] = self.front
            case "counter":
                drawn |= {"color": self.front, "top_color": self.top, "splash_color": self.splash}
            case "countertop":
                drawn |= {"color": self.top, "splash_color": self.splash}
            case "kitchen_sink":
                drawn |= {"color": self.front, "top_color": self.top}
        return drawn | fixed

    def _two(self, colors: tuple[str, ...]) -> tuple[str, str]:
        first, second = self._rng.choice(len(colors), 2, replace=False)
        return colors[int(first)], colors[int(second)]


def lighter(color: str) -> str:
    """A color halfway to white, by a third."""
    parts = (int(color[i : i + 2], 16) for i in (1, 3, 5))
    return "#" + "".join(f"{round(part + (255 - part) / 3):02x}" for part in parts)
