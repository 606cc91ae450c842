"""Scenes for two hands: lifting what is too wide for one, setting it down, handing over."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np

from benchmarks.hands.pick import draw_thing, lowest
from benchmarks.hands.rooms import called, facing, placed
from benchmarks.hands.trial import Scene, Shapes, Trial
from mpvi_bt.ground.robot.protocol import Side
from mpvi_bt.house.layout.house import House
from mpvi_bt.house.sim.world import SimWorld
from mpvi_bt.house.things.catalogue import Catalogue, CatalogueEntry, load_catalogue
from mpvi_bt.testing.scene_builder import one_room

_LIFTED_M = 0.08
_TABLES = ("table", "breakfast_table", "coffee_table", "desk")


@cache
def large_things(shapes: Shapes) -> Catalogue:
    """What it takes two hands to lift."""
    return load_catalogue(Path(__file__).parent / "shapes" / f"large_{shapes}.yaml")


def draw_large(rng: np.random.Generator, shapes: Shapes) -> CatalogueEntry:
    """One of them."""
    entries = list(large_things(shapes))
    return entries[rng.integers(len(entries))]


def carried(name: str, rest_m: float) -> Callable[[SimWorld], str]:
    """Whether a thing whose underside lay at a height [m] is off everything but the robot.

    Codes: not_lifted (its lowest point has risen less than 8 cm), touching (it rests on something), tilted (by more
    than 25 degrees).
    """

    def done(world: SimWorld) -> str:
        if lowest(world, name) < rest_m + _LIFTED_M:
            return "not_lifted"
        if any(world.touching(name, other) for other in world.things if other != name):
            return "touching"
        if world.pose(name)[2, 2] < np.cos(np.radians(25)):
            return "tilted"
        return ""

    return done


def standing(name: str, rest_m: float, over: tuple[float, float, float, float]) -> Callable[[SimWorld], str]:
    """Whether a thing stands upright at a height [m], its middle over a rectangle (x0, y0, x1, y1), and is let go.

    Codes: not_down, beside, tilted, held.
    """

    def done(world: SimWorld) -> str:
        x, y = world.pose(name)[:2, 3]
        if abs(lowest(world, name) - rest_m) > 0.02:
            return "not_down"
        if not (over[0] < x < over[2] and over[1] < y < over[3]):
            return "beside"
        if world.pose(name)[2, 2] < np.cos(np.radians(8)):
            return "tilted"
        return "held" if world.between() == name else ""

    return done


def lift_from_floor(rng: np.random.Generator, shapes: Shapes) -> Trial:
    """A box on the free floor."""
    entry = draw_large(rng, shapes)
    at = rng.uniform(-0.4, 0.4, 2)
    thing = placed(entry, at[0], at[1], 0.0, rng.uniform(-np.pi, np.pi))
    base = facing(at, rng, far_m=(1.0, 1.3))
    return Trial(
        one_room({}), {"box": thing}, base, f"lift the {entry.phrases[0]} with both hands", carried("box", 0.0)
    )


def lift_from_table(rng: np.random.Generator, shapes: Shapes) -> Trial:
    """A box on a table, one side along its edge."""
    entry = draw_large(rng, shapes)
    table = one_room({"table_1": {"entry": _TABLES[rng.integers(len(_TABLES))], "at": [0.9, 0.0], "yaw_deg": 180}})
    (x0, _), _, top = _top(table)
    length = entry.shape["size_m"][0]
    at = np.array([x0 + length / 2 + rng.uniform(0.01, 0.04), rng.uniform(-0.1, 0.1)])
    thing = placed(entry, at[0], at[1], top, rng.uniform(-0.12, 0.12))
    base = facing(at, rng, far_m=(1.0, 1.3), from_rad=(-0.3, 0.3))
    return Trial(table, {"box": thing}, base, f"lift the {entry.phrases[0]} with both hands", carried("box", top))


def _top(house: House) -> tuple[tuple[float, float], tuple[float, float], float]:
    """x range, y range and height of the table's top."""
    boxes = np.stack([s.aabb() for s in house.fixtures["table_1"].solids()])
    low, high = boxes[:, 0].min(0), boxes[:, 1].max(0)
    return (low[0], high[0]), (low[1], high[1]), float(high[2])


def set_on_table(rng: np.random.Generator, shapes: Shapes) -> Trial:
    """Lift a box and set it down on a table a step aside."""
    entry = draw_large(rng, shapes)
    house = one_room({"table_1": {"entry": _TABLES[rng.integers(len(_TABLES))], "at": [1.6, 0.0], "yaw_deg": 180}})
    (x0, x1), (y0, y1), top = _top(house)
    at = np.array([rng.uniform(-0.6, -0.3), rng.uniform(-0.4, 0.4)])
    name = entry.phrases[0]
    prompt = f"lift the {name} with both hands, then put the {name} on the {house.fixtures['table_1'].entry.phrases[0]}"
    thing = placed(entry, at[0], at[1], 0.0, rng.uniform(-np.pi, np.pi))
    base = facing(at, rng, far_m=(1.0, 1.2))
    return Trial(house, {"box": thing}, base, prompt, standing("box", top, (x0, y0, x1, y1)), budget_s=120.0)


def hand_over(rng: np.random.Generator, shapes: Shapes) -> Trial:
    """A thing in one hand that the other has to take."""
    entry = draw_thing(rng, shapes)
    giver: Side = "left" if rng.random() < 0.5 else "right"
    taker: Side = "right" if giver == "left" else "left"
    thing = placed(entry, 1.5, 0.0, 0.0, rng.uniform(-np.pi, np.pi))
    base = np.array([*rng.uniform(-0.5, 0.5, 2), rng.uniform(-np.pi, np.pi)])
    prompt = f"hand the {called(entry)} over from the {giver} hand to the {taker} hand"

    def done(world: SimWorld) -> str:
        """Codes: not_taken (the other hand has not both fingers on it), not_let_go, touching."""
        if "thing" not in world.pinched(taker):
            return "not_taken"
        if world.holding(giver) is not None or "thing" in world.pinched(giver):
            return "not_let_go"
        return "touching" if any(world.touching("thing", o) for o in world.things if o != "thing") else ""

    return Trial(one_room({}), {"thing": thing}, base, prompt, done, held={giver: "thing"})


SKILLS: dict[str, dict[str, Scene]] = {
    "lift": {"floor": lift_from_floor, "table": lift_from_table, "floor_to_table": set_on_table},
    "hand_over": {"any": hand_over},
}
