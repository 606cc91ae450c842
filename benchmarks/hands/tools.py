"""Scenes of working with what a hand holds: pouring, wiping, spraying."""

from __future__ import annotations

import numpy as np

from benchmarks.hands.rooms import called, facing, placed, room, things
from benchmarks.hands.trial import Scene, Shapes, Trial
from mpvi_bt.robot.protocol import SIDES, Side
from mpvi_bt.sim.catalogue import Entry
from mpvi_bt.sim.world import World

_CONTENTS_M = 0.03  # what is poured is no wider than this
_TABLES = ("table", "breakfast_table", "coffee_table", "desk")


def vessels(shapes: Shapes) -> list[Entry]:
    """What one hand can hold and something can be in."""
    return [entry for entry in things(shapes) if entry.family in ("cup", "bowl") and entry.shape["height_m"] > 0.05]


def contents(shapes: Shapes) -> list[Entry]:
    """Small things that roll or slide out of a vessel."""
    return [e for e in things(shapes) if np.ptp(np.array(e.description.extent()), axis=0).max() < _CONTENTS_M]


def receivers(shapes: Shapes) -> list[Entry]:
    """What it is poured into."""
    return [entry for entry in things(shapes) if "fillable" in entry.abilities]


def pour_on(table: bool) -> Scene:
    """A held vessel with one to three small things in it, and something to pour them into."""

    def scene(rng: np.random.Generator, shapes: Shapes) -> Trial:
        vessel = _one(vessels(shapes), rng)
        small = _one(contents(shapes), rng)
        receiver = _one(receivers(shapes), rng)
        side: Side = SIDES[rng.integers(2)]
        names = [f"{small.name}_{k + 1}" for k in range(rng.integers(1, 4))]
        fixtures = {"table_1": {"entry": _TABLES[rng.integers(4)], "at": [1.0, 0.0], "yaw_deg": 180}} if table else {}
        house = room(fixtures)
        height, at = 0.0, rng.uniform(-0.3, 0.3, 2)
        if table:
            boxes = np.stack([s.aabb() for s in house.fixtures["table_1"].solids()])
            height, depth = float(boxes[:, 1, 2].max()), receiver.shape["size_m"][0]
            at = np.array([boxes[:, 0, 0].min() + depth / 2 + rng.uniform(0.02, 0.06), rng.uniform(-0.2, 0.2)])
        objects = {
            "vessel": placed(vessel, 2.0, 1.0, 0.0),
            "receiver": placed(receiver, *at, height, 0.0 if table else rng.uniform(-np.pi, np.pi)),
            **{name: placed(small, 2.2, 0.3 + 0.1 * k, 0.0) for k, name in enumerate(names)},
        }
        prompt = f"pour the {called(small)} out of the {called(vessel)} into the {called(receiver)}"

        def done(world: World) -> str:
            """Codes: still_in (the vessel), missed (something lies elsewhere), not_held (the vessel was dropped)."""
            if set(names) & set(world.within("vessel")):
                return "still_in"
            if set(names) - set(world.within("receiver")):
                return "missed"
            return "" if world.holding(side) == "vessel" else "not_held"

        base = facing(at, rng, far_m=(0.9, 1.2), from_rad=(-0.3, 0.3))
        return Trial(house, objects, base, prompt, done, held={side: "vessel"}, filled={"vessel": names})

    return scene


def _one(entries: list[Entry], rng: np.random.Generator) -> Entry:
    return entries[rng.integers(len(entries))]


SKILLS: dict[str, dict[str, Scene]] = {
    "pour": {"floor": pour_on(table=False), "table": pour_on(table=True)},
}
