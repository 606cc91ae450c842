"""What scenes are made of: a room with fixtures, and places on and in them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.hands.trial import Shapes
from mpvi_bt.marked_yaml import parse_marked
from mpvi_bt.robot.solids import Array, pose
from mpvi_bt.sim.catalogue import Catalogue, Entry, load_catalogue
from mpvi_bt.sim.house import House, check_house
from mpvi_bt.sim.world import Placement

ROOM_M = 3.0  # half the room's width


@cache
def catalogue() -> Catalogue:
    """The catalogue that comes with mpvi_bt: fixtures, and the usual things."""
    return load_catalogue()


@cache
def things(shapes: Shapes) -> Catalogue:
    """The movable things of one set of shapes. Held-out shapes are for the final table, never for tuning."""
    return load_catalogue(Path(__file__).parent / "shapes" / f"{shapes}.yaml")


def room(fixtures: Mapping[str, Mapping[str, Any]]) -> House:
    """A house of one room, 6 x 6 m around the origin.

    Args:
        fixtures: By name, as in a house file: {"table_1": {"entry": "table", "at": [1.0, 0.0], "yaw_deg": 180}}.

    Raises:
        FileProblems: A fixture is unknown, sticks out of the room or overlaps another.
    """
    hall = {"rect": [-ROOM_M, -ROOM_M, ROOM_M, ROOM_M], "floor": "#9fb0ab", "walls": "#f6ecd4", "fixtures": fixtures}
    text = json.dumps({"outside": "#efe6d6", "rooms": {"hall": hall}}, default=_plain)
    return check_house(*parse_marked(text, "trial.yaml"), catalogue())


def placed(entry: Entry, x: float, y: float, z: float, yaw: float = 0.0) -> Placement:
    """A thing, upright, its underside a millimeter above `z` [m]."""
    return Placement(entry, pose((x, y, z + 0.001), yaw))


def facing(target: Array | tuple[float, float], rng: np.random.Generator, far_m: tuple[float, float] = (0.8, 1.2),
           from_rad: tuple[float, float] = (-0.5, 0.5), askew_rad: float = 0.5) -> Array:  # fmt: skip
    """(3,) a base pose at the end of a drive: some way before a target, roughly turned to it.

    Args:
        target: (2,) x, y [m].
        rng: Source of the draw.
        far_m: Range of the distance.
        from_rad: Range of the bearing from the robot to the target; 0 is along x.
        askew_rad: How far the robot may look past the target.
    """
    bearing = rng.uniform(*from_rad)
    at = np.asarray(target, float) - rng.uniform(*far_m) * np.array([np.cos(bearing), np.sin(bearing)])
    return np.array([*at, bearing + rng.uniform(-askew_rad, askew_rad)])


def _plain(value: Any) -> Any:
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else str(value)
