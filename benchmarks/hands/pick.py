"""Scenes of picking up: floor to 1.6 m, in clutter, under a board, against a wall, inside fridge and cabinet."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from benchmarks.hands import surfaces
from benchmarks.hands.rooms import arrival, called, name_in, things
from benchmarks.hands.surfaces import Surface
from benchmarks.hands.trial import Scene, Shapes, Trial
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import SIDES
from mpvi_bt.house.sim.world import Placement, SimWorld
from mpvi_bt.house.things.catalogue import CatalogueEntry
from mpvi_bt.testing.scene_builder import one_room

LIFTED_M = 0.05
_AWAY_M = 0.15
_CLUTTER, _CLUTTER_M, _APART_M = 8, 0.25, 0.02


def lifted(name: str, rest_m: float, at: Array) -> Callable[[SimWorld], str]:
    """Whether a thing that lay at a height [m] and a place (2,) is in hand and off everything else.

    Codes: not_held (no hand has both fingers on it), not_lifted (neither has its lowest point risen by 5 cm nor is it
    15 cm away: a thing from a high board may be carried lower), touching (it rests on or is wedged against something
    that is not the robot).
    """

    def done(world: SimWorld) -> str:
        if not any(name in world.pinched(side) for side in SIDES):
            return "not_held"
        away = float(np.linalg.norm(world.pose(name)[:2, 3] - at))
        if lowest(world, name) < rest_m + LIFTED_M and away < _AWAY_M:
            return "not_lifted"
        if any(world.touching(name, other) for other in world.things if other != name):
            return "touching"
        return ""

    return done


def lowest(world: SimWorld, name: str) -> float:
    """Height of a thing's lowest point [m]."""
    return float(min(solid.aabb()[0, 2] for solid in world.solids(name)))


def one_hand(shapes: Shapes) -> list[CatalogueEntry]:
    """The things of a set of shapes that one hand can pick up."""
    return [entry for entry in things(shapes) if "fillable" not in entry.abilities]


def draw_thing(rng: np.random.Generator, shapes: Shapes) -> CatalogueEntry:
    """One of them."""
    entries = one_hand(shapes)
    return entries[rng.integers(len(entries))]


def radius(entry: CatalogueEntry) -> float:
    """Of the disc that a thing covers [m]."""
    low, high = entry.description.extent()
    return float(np.linalg.norm(np.maximum(np.abs(low), np.abs(high))[:2]))


def crowd(
    objects: dict[str, Placement],
    surface: Surface,
    middle: Array,
    rng: np.random.Generator,
    shapes: Shapes,
    without: CatalogueEntry | None = None,
) -> None:
    """Add up to eight other things within 25 cm of a place (u, v) on a surface, 2 cm and more from everything.

    The one thing that there may be already stands in the middle; there will be no second one of its kind, nor one of
    the kind `without`.
    """
    taken = [(middle, radius(p.entry)) for p in objects.values()]
    kinds = {p.entry.name for p in objects.values()} | ({without.name} if without else set())
    others = [entry for entry in one_hand(shapes) if entry.name not in kinds]
    for k in rng.permutation(len(others))[:_CLUTTER]:
        entry = others[k]
        r = radius(entry)
        for _ in range(60):
            away, toward = _CLUTTER_M * np.sqrt(rng.uniform()), rng.uniform(-np.pi, np.pi)
            spot = middle + away * np.array([np.cos(toward), np.sin(toward)])
            inside = surface.inset_m <= spot[0] - r and spot[0] + r <= surface.inset_m + surface.depth_m
            if not inside or abs(spot[1]) + r > surface.width_m / 2:
                continue
            if all(np.linalg.norm(spot - other) > r + other_r + _APART_M for other, other_r in taken):
                taken.append((spot, r))
                yaw = rng.uniform(-np.pi, np.pi)
                objects[name_in(objects, entry)] = surface.put(entry, spot, yaw)
                break


def pick_from(draw: Callable[[np.random.Generator], Surface], cluttered: bool = False) -> Scene:
    """Scenes of one thing on a surface."""

    def scene(rng: np.random.Generator, shapes: Shapes) -> Trial:
        surface, entry = draw(rng), draw_thing(rng, shapes)
        yaw = rng.uniform(-np.pi, np.pi)
        spot = surface.spot(radius(entry), rng)
        if surface.wall:
            yaw, spot[0] = _touching(surface, entry, rng)
        name = name_in({}, entry)
        objects = {name: surface.put(entry, spot, yaw)}
        if cluttered:
            crowd(objects, surface, spot, rng, shapes)
        house = one_room(surface.fixtures)
        base = arrival(surface.at(*spot), rng, house, objects, surface.opened, level_m=surface.z)
        done = lifted(name, surface.z, surface.at(*spot))
        return Trial(house, objects, base, f"pick up the {called(entry)}", done, opened=surface.opened)

    return scene


def _touching(surface: Surface, entry: CatalogueEntry, rng: np.random.Generator) -> tuple[float, float]:
    """A yaw in the world, and the u at which the thing's back is a millimeter from the wall."""
    yaw = float(rng.integers(4)) * np.pi / 2
    low, high = entry.description.extent()
    c, s = round(np.cos(yaw)), round(np.sin(yaw))
    back = max(c * x - s * y for x in (low[0], high[0]) for y in (low[1], high[1]))
    heading = float(np.arctan2(surface.T[1, 0], surface.T[0, 0]))
    return yaw + heading, surface.inset_m + surface.depth_m - float(back) - 0.001


SKILLS: dict[str, dict[str, Scene]] = {
    "pick": {
        "floor": pick_from(surfaces.floor),
        "table": pick_from(surfaces.table),
        "counter": pick_from(surfaces.counter),
        "high_shelf": pick_from(surfaces.high_shelf),
        "clutter": pick_from(surfaces.one_of(surfaces.floor, surfaces.table, surfaces.counter), cluttered=True),
        "under_board": pick_from(surfaces.board),
        "wall": pick_from(surfaces.one_of(surfaces.floor_wall, surfaces.table_wall)),
        "fridge": pick_from(surfaces.fridge),
        "cabinet": pick_from(surfaces.one_of(surfaces.low_cabinet, surfaces.wall_cabinet)),
    }
}
