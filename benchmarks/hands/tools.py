"""Scenes of working with what a hand holds: pouring, wiping, spraying."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.hands.rooms import called, facing, placed, things
from benchmarks.hands.trial import Scene, Shapes, Trial
from mpvi_bt.ground.robot.protocol import SIDES, Side
from mpvi_bt.house.sim.world import SimWorld
from mpvi_bt.house.things.catalogue import CatalogueEntry, load_catalogue
from mpvi_bt.testing.scene_builder import one_room

_CONTENTS_M = 0.03  # what is poured is no wider than this
_SMALL_TOPS = ("nightstand", "chest_of_drawers")
_WIPED_M = 0.02  # a tool cleans so far past its outline, as BEHAVIOR's does
_SPRAYED_M = 0.12
_WIPING_S, _SPRAYING_S = 120.0, 90.0  # as plans allow for it
_LEFT = 0.05  # share of a top that may be left out
_TABLES = ("table", "breakfast_table", "coffee_table", "desk")


def vessels(shapes: Shapes) -> list[CatalogueEntry]:
    """What one hand can hold and something can be in."""
    return [entry for entry in things(shapes) if entry.family in ("cup", "bowl") and entry.shape["height_m"] > 0.05]


def contents(shapes: Shapes) -> list[CatalogueEntry]:
    """Small things that roll or slide out of a vessel."""
    return [e for e in things(shapes) if np.ptp(np.array(e.description.extent()), axis=0).max() < _CONTENTS_M]


def receivers(shapes: Shapes) -> list[CatalogueEntry]:
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
        house = one_room(fixtures)
        height, at = 0.0, rng.uniform(-0.3, 0.3, 2)
        if table:
            boxes = np.stack([s.aabb() for s in house.fixtures["table_1"].solids()])
            height, depth = float(boxes[:, 1, 2].max()), receiver.shape["size_m"][0]
            at = np.array([boxes[:, 0, 0].min() + depth / 2 + rng.uniform(0.02, 0.06), rng.uniform(-0.2, 0.2)])
        objects = {
            "vessel": placed(vessel, 2.0, 1.0, 0.0),
            "receiver": placed(receiver, at[0], at[1], height, 0.0 if table else rng.uniform(-np.pi, np.pi)),
            **{name: placed(small, 2.2, 0.3 + 0.1 * k, 0.0) for k, name in enumerate(names)},
        }
        prompt = f"pour the {called(small)} out of the {called(vessel)} into the {called(receiver)}"

        def done(world: SimWorld) -> str:
            """Codes: still_in (the vessel), missed (something lies elsewhere), not_held (the vessel was dropped)."""
            if set(names) & set(world.within("vessel")):
                return "still_in"
            if set(names) - set(world.within("receiver")):
                return "missed"
            return "" if world.holding(side) == "vessel" else "not_held"

        base = facing(at, rng, far_m=(0.9, 1.2), from_rad=(-0.3, 0.3))
        return Trial(house, objects, base, prompt, done, held={side: "vessel"}, filled={"vessel": names})

    return scene


def work_over(sprays: bool) -> Scene:
    """A held tool, and a piece of furniture with a small top to go over."""

    def scene(rng: np.random.Generator, shapes: Shapes) -> Trial:
        tool = _one(list(load_catalogue(Path(__file__).parent / "shapes" / f"tools_{shapes}.yaml")), rng)
        side: Side = SIDES[rng.integers(2)]
        fixture = _SMALL_TOPS[rng.integers(len(_SMALL_TOPS))]
        at = rng.uniform(-0.2, 0.2, 2)
        turn = float(rng.choice([0.0, 90.0, 180.0, 270.0]))
        house = one_room({"top_1": {"entry": fixture, "at": at, "yaw_deg": turn}})
        boxes = np.stack([s.aabb() for s in house.fixtures["top_1"].solids()])
        low, high = boxes[:, 0].min(0), boxes[:, 1].max(0)
        marks = _marks(low, high)
        left = np.ones(len(marks), bool)

        def done(world: SimWorld) -> str:
            """Codes: uncovered (a part of the top was not gone over), not_held (the tool was dropped)."""
            body = np.stack([s.aabb() for s in world.solids("tool")])
            under = np.array([*body[:, 0].min(0)[:2], *body[:, 1].max(0)[:2]])
            reach, gap = (_SPRAYED_M, (0.05, 0.35)) if sprays else (_WIPED_M, (-0.01, 0.02))
            if gap[0] <= float(body[:, 0, 2].min()) - high[2] <= gap[1]:
                inside = (marks > under[:2] - reach).all(1) & (marks < under[2:] + reach).all(1)
                left[inside] = False
            if left.mean() > _LEFT:
                return "uncovered"
            return "" if world.holding(side) == "tool" else "not_held"

        name = house.fixtures["top_1"].entry.phrases[0]
        prompt = f"{'spray' if sprays else 'wipe'} the {name} with the {called(tool)}"
        base = facing((low + high)[:2] / 2, rng, far_m=(0.9, 1.2), from_rad=(-3.1, 3.1))
        objects = {"tool": placed(tool, 2.0, 1.5, 0.0)}
        return Trial(
            house, objects, base, prompt, done, held={side: "tool"}, budget_s=_SPRAYING_S if sprays else _WIPING_S
        )

    return scene


def _marks(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """(n, 2) a grid of 4 cm over a top, a hand's breadth off its edges."""
    x, y = (np.arange(a + 0.05, b - 0.05, 0.04) for a, b in zip(low[:2], high[:2], strict=True))
    return np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)


def _one(entries: list[CatalogueEntry], rng: np.random.Generator) -> CatalogueEntry:
    return entries[rng.integers(len(entries))]


SKILLS: dict[str, dict[str, Scene]] = {
    "pour": {"floor": pour_on(table=False), "table": pour_on(table=True)},
    "wipe": {"top": work_over(sprays=False)},
    "spray": {"top": work_over(sprays=True)},
}
