"""What scenes are made of: a room with fixtures, things in it, and where a robot arrives."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path

import numpy as np

from benchmarks.hands.trial import Shapes
from mpvi_bt.ground.errors import BackendError
from mpvi_bt.ground.geometry.solids import Array, Solid, pose
from mpvi_bt.ground.robot.collision import Surroundings
from mpvi_bt.house.layout.house import House
from mpvi_bt.house.sim.world import Placement
from mpvi_bt.house.things.catalogue import Catalogue, CatalogueEntry, load_catalogue
from mpvi_bt.testing.scene_builder import HALF_M

_BODY_M = 0.38  # free around the base's center at every height
_HEIGHTS_M = np.arange(0.05, 1.6, 0.1)
_NEAR_M, _FAR_M, _FACING_RAD = 0.65, 1.15, 0.4  # as navigation hands over
_DRAWS = 2000


@cache
def catalogue() -> Catalogue:
    """The catalogue that comes with mpvi_bt: fixtures, and the usual things."""
    return load_catalogue()


@cache
def things(shapes: Shapes) -> Catalogue:
    """The movable things of one set of shapes. Held-out shapes are for the final table, never for tuning."""
    return load_catalogue(Path(__file__).parent / "shapes" / f"{shapes}.yaml")


def placed(entry: CatalogueEntry, x: float, y: float, z: float, yaw: float = 0.0) -> Placement:
    """A thing, upright, its underside a millimeter above `z` [m]."""
    return Placement(entry, pose((x, y, z + 0.001), yaw))


def called(entry: CatalogueEntry) -> str:
    """What a prompt calls a thing: the words of its name."""
    return entry.name.replace("_", " ")


def name_in(objects: Mapping[str, Placement], entry: CatalogueEntry) -> str:
    """A name for one more thing in a scene, as BDDL would name it: "mug.n.04_1"."""
    return f"{entry.synset}_{sum(placement.entry.synset == entry.synset for placement in objects.values()) + 1}"


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


def arrival(
    target: Array,
    rng: np.random.Generator,
    house: House,
    objects: Mapping[str, Placement],
    opened: Mapping[str, Mapping[str, float]],
    ahead_m: float = 0.0,
    level_m: float = 1.05,
) -> Array:
    """(3,) a base pose as navigation hands over: within the handoff distance of a target, facing it, clear of all else.

    Args:
        target: (2,) x, y [m].
        rng: Source of the draw.
        house: The room.
        objects: What stands in it.
        opened: Its open doors, as in `Trial`.
        ahead_m: How much farther than the body the robot reaches out before it, for what it holds.
        level_m: Height of what the target lies on; a little above it nothing is between the robot and the target.

    Raises:
        BackendError: No such pose was found.
    """
    around = Surroundings([*_fixed(house, opened), *(s for p in objects.values() for s in _solids(p))])
    limit = HALF_M - 0.05 - _BODY_M
    for _ in range(_DRAWS):
        bearing, far = rng.uniform(-np.pi, np.pi), rng.uniform(_NEAR_M, _FAR_M)
        toward = np.array([np.cos(bearing), np.sin(bearing)])
        at = np.asarray(target, float) - far * toward
        yaw = bearing + rng.uniform(-_FACING_RAD, _FACING_RAD)
        ahead = at + ahead_m * np.array([np.cos(yaw), np.sin(yaw)])
        spots = np.array([[*p, z] for p in (at, (at + ahead) / 2, ahead) for z in _HEIGHTS_M])
        if np.abs(at).max() < limit and np.abs(ahead).max() < limit and (around.distance(spots) > _BODY_M).all():
            between = np.array([[*(at + s * toward), level_m + 0.25] for s in np.linspace(0, far - 0.15, 12)])
            if (around.distance(between) > 0.02).all():
                return np.array([*at, yaw])
    raise BackendError(f"no free place for the robot near {np.round(target, 2).tolist()}")


def _fixed(house: House, opened: Mapping[str, Mapping[str, float]]) -> Iterator[Solid]:
    """Walls, and fixtures with their doors as they stand."""
    yield from (wall.solid for wall in house.walls)
    for name, fixture in house.fixtures.items():
        for body in fixture.entry.description.bodies:
            limit = 0.0 if body.joint is None else body.joint.limit
            frame = fixture.T_world_fixture @ body.frame(limit * opened.get(name, {}).get(body.name, 0.0))
            yield from (part.solid.moved(frame) for part in body.parts if part.collides)


def _solids(placement: Placement) -> Iterator[Solid]:
    return placement.entry.description.solids(placement.T_world)
