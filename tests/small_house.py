"""A house of one room for tests, and worlds in it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import yaml

from mpvi_bt.ground.geometry.solids import Array, pose
from mpvi_bt.ground.robot.model import RobotModel
from mpvi_bt.hands.robots.r1 import R1
from mpvi_bt.house.layout.house import House
from mpvi_bt.house.sim.world import Placement, SimWorld
from mpvi_bt.house.things.catalogue import load_catalogue
from mpvi_bt.testing.scene_builder import one_room

CATALOGUE = load_catalogue()
_SHAPES = Path(__file__).parents[1] / "benchmarks" / "hands" / "shapes"
ODD = load_catalogue(_SHAPES / "tuning.yaml")  # things of other shapes and sizes than the usual ones
LARGE = load_catalogue(_SHAPES / "large_tuning.yaml")  # what it takes two hands to lift


def small_house(**fixtures: str) -> House:
    """One room of 6 x 6 m around the origin; fixtures by name, as flow YAML such as "{entry: table, at: [1, 0]}"."""
    return one_room({name: yaml.safe_load(given) for name, given in fixtures.items()})


def placed(entry: str, x: float, y: float, z: float = 0.001, yaw: float = 0.0) -> Placement:
    """A thing of the catalogue, upright."""
    return Placement(CATALOGUE[entry], pose((x, y, z), yaw))


def small_world(
    objects: Mapping[str, Placement] | None = None,
    base: tuple[float, float, float] = (0.0, 0.0, 0.0),
    render: bool = False,
    robot: RobotModel = R1,
    **fixtures: str,
) -> SimWorld:
    """A world in a small house, nothing settled yet."""
    return SimWorld(small_house(**fixtures), objects or {}, np.array(base), render=render, robot=robot)


def run(world: SimWorld, action: Array, seconds: float) -> None:
    """Step a world with one action."""
    for _ in range(round(seconds * 30)):
        world.robot.act(action)
        world.step()
