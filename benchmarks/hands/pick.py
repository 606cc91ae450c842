"""Scenes of picking up: floor to 1.6 m, in clutter, under a board, against a wall, inside fridge and cabinet."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from benchmarks.hands.rooms import facing, placed, room, things
from benchmarks.hands.trial import Scene, Shapes, Trial
from mpvi_bt.robot.protocol import SIDES
from mpvi_bt.robot.solids import Array
from mpvi_bt.sim.catalogue import Entry
from mpvi_bt.sim.world import World

LIFTED_M = 0.05


def lifted(name: str, rest_m: float) -> Callable[[World], str]:
    """Whether a thing whose underside lay at a height [m] is in hand and off everything else.

    Codes: not_held (no hand has both fingers on it), not_lifted (its lowest point has risen less than 5 cm), touching
    (it rests on or is wedged against something that is not the robot).
    """

    def done(world: World) -> str:
        if not any(name in world.pinched(side) for side in SIDES):
            return "not_held"
        if lowest(world, name) < rest_m + LIFTED_M:
            return "not_lifted"
        if any(world.touching(name, other) for other in world.things if other != name):
            return "touching"
        return ""

    return done


def lowest(world: World, name: str) -> float:
    """Height of a thing's lowest point [m]."""
    return float(min(solid.aabb()[0, 2] for solid in world.solids(name)))


def one_hand(shapes: Shapes) -> list[Entry]:
    """The things of a set of shapes that one hand can pick up."""
    return [entry for entry in things(shapes) if "fillable" not in entry.abilities]


def draw_thing(rng: np.random.Generator, shapes: Shapes) -> Entry:
    """One of them."""
    entries = one_hand(shapes)
    return entries[rng.integers(len(entries))]


def floor(rng: np.random.Generator, shapes: Shapes) -> Trial:
    """One thing on the free floor."""
    entry = draw_thing(rng, shapes)
    at = rng.uniform(-0.5, 0.5, 2)
    return _trial(entry, at, 0.0, rng, {})


def _trial(
    entry: Entry, at: Array, z: float, rng: np.random.Generator, fixtures: dict[str, dict[str, object]]
) -> Trial:
    objects = {"target": placed(entry, *at, z, rng.uniform(-np.pi, np.pi))}
    prompt = f"pick up the {entry.phrases[0]}"
    return Trial(room(fixtures), objects, facing(at, rng), prompt, lifted("target", z))


SKILLS: dict[str, dict[str, Scene]] = {"pick": {"floor": floor}}
