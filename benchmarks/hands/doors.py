"""Scenes of opening and closing what has doors, drawers or a lid, of pressing switches, and of pushing things."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from benchmarks.hands.rooms import arrival, called, catalogue, placed, things
from benchmarks.hands.trial import Scene, Shapes, Trial
from mpvi_bt.ground.robot.collision import Surroundings
from mpvi_bt.house.sim.world import Placement, SimWorld
from mpvi_bt.house.things.catalogue import CatalogueEntry
from mpvi_bt.testing.scene_builder import HALF_M, one_room

# What counts as clearly open [rad or m]: an upright door, a flap, a drawer. What counts as closed [of the limit].
_UPRIGHT_RAD, _FLAP_RAD, _SLIDE_M = 1.2, 0.9, 0.2
_CLOSED = 0.05
_MOVED_M = 0.05
_WALL_GAP_M = 0.06
_BEFORE_M = 0.1  # the robot has been brought to a place so far before the front


@dataclass(frozen=True)
class Furniture:
    """A kind of fixture with doors, and how it may vary.

    Attributes:
        entry: In the catalogue.
        called: What a prompt calls it.
        size_m: Ranges of depth, width and height.
        shape: Ranges of other lengths, and choices of other parameters.
        z_m: Range of the height that it hangs or stands at.
        on_counter: Whether a counter is under it.
    """

    entry: str
    called: str
    size_m: tuple[tuple[float, float], tuple[float, float], tuple[float, float]]
    shape: Mapping[str, Any]
    z_m: tuple[float, float] = (0.0, 0.0)
    on_counter: bool = False


_SIDES = ["left", "right"]
FURNITURE: Mapping[str, Furniture] = {
    "refrigerator": Furniture(
        "refrigerator", "fridge", ((0.58, 0.7), (0.58, 0.76), (1.5, 1.9)), {"handle_m": (0.26, 0.4), "hinge": _SIDES}
    ),
    "base_cabinet": Furniture(
        "base_cabinet", "cabinet", ((0.5, 0.62), (0.4, 0.62), (0.74, 0.92)), {"handle_m": (0.13, 0.2), "hinge": _SIDES}
    ),
    "wall_cabinet": Furniture(
        "wall_cabinet", "wall cabinet", ((0.3, 0.38), (0.4, 0.6), (0.6, 0.75)),
        {"handle_m": (0.12, 0.18), "hinge": _SIDES}, z_m=(1.3, 1.4),
    ),
    "tall_cabinet": Furniture(
        "tall_cabinet", "cabinet", ((0.36, 0.5), (0.45, 0.66), (1.4, 1.9)), {"handle_m": (0.15, 0.3), "hinge": _SIDES}
    ),
    "two_doors": Furniture(
        "base_cabinet", "cabinet", ((0.45, 0.6), (0.8, 1.0), (0.74, 0.92)), {"handle_m": (0.13, 0.2), "doors": [2]}
    ),
    "microwave": Furniture(
        "microwave", "microwave", ((0.34, 0.42), (0.48, 0.58), (0.28, 0.36)), {"handle_m": (0.13, 0.18)},
        on_counter=True,
    ),
    "oven": Furniture("oven", "oven", ((0.55, 0.62), (0.54, 0.62), (0.8, 0.9)), {"handle_m": (0.26, 0.4)}),
    "washer": Furniture("washer", "washing machine", ((0.55, 0.65), (0.55, 0.65), (0.8, 0.9)), {}),
    "drawers": Furniture(
        "chest_of_drawers", "chest of drawers", ((0.42, 0.55), (0.6, 1.0), (0.65, 0.95)),
        {"handle_m": (0.11, 0.18), "count": [3]},
    ),
    "boot": Furniture("car", "car", ((3.2, 3.4), (1.5, 1.7), (1.35, 1.5)), {}),
}  # fmt: skip
_PARTS: Mapping[str, Mapping[str, str]] = {
    "two_doors": {"left door of the cabinet": "left_door", "right door of the cabinet": "right_door"},
    "drawers": {
        "top drawer of the chest of drawers": "drawer_3",
        "middle drawer of the chest of drawers": "drawer_2",
        "bottom drawer of the chest of drawers": "drawer_1",
    },
}


def within(rng: np.random.Generator, shapes: Shapes, span: tuple[float, float]) -> float:
    """A length from a range: tuning shapes are of its middle half, held-out ones of the rest."""
    low, high = span
    u = rng.uniform(0.25, 0.75) if shapes == "tuning" else rng.choice([rng.uniform(0, 0.25), rng.uniform(0.75, 1)])
    return float(round(low + (high - low) * u, 3))


def against_wall(kind: str, rng: np.random.Generator, shapes: Shapes) -> tuple[dict[str, dict[str, Any]], np.ndarray]:
    """Fixtures of a scene, by name, and the place (2,) before the front of the one called "thing_1"."""
    what = FURNITURE[kind]
    size = [within(rng, shapes, span) for span in what.size_m]
    shape: dict[str, Any] = {"size_m": size}
    for key, given in what.shape.items():
        shape[key] = within(rng, shapes, given) if isinstance(given, tuple) else given[rng.integers(len(given))]
    height = shape["size_m"][2]
    if "shelves_z_m" in catalogue()[what.entry].shape and height < 1.4:
        shape["shelves_z_m"] = [round(height * 0.55, 2)]
    fixtures: dict[str, dict[str, Any]] = {}
    x, y = HALF_M - _WALL_GAP_M - size[0] / 2, float(round(rng.uniform(-0.8, 0.8), 3))
    z = within(rng, shapes, what.z_m)
    if what.on_counter:
        depth, _, top = catalogue()["counter"].shape["size_m"]
        fixtures["counter_1"] = {"entry": "counter", "at": [HALF_M - _WALL_GAP_M - depth / 2, y], "yaw_deg": 180}
        x, z = HALF_M - _WALL_GAP_M - depth + size[0] / 2 + 0.04, top + 0.001
    fixtures["thing_1"] = {"entry": what.entry, "at": [round(x, 3), y], "yaw_deg": 180, "z_m": z, "shape": shape}
    return fixtures, np.array([x - size[0] / 2 - _BEFORE_M, y])


def positions(world: SimWorld, name: str) -> dict[str, tuple[float, bool, bool]]:
    """Of each door: how far it is open [of the limit], whether clearly open, whether closed."""
    out = {}
    for door in world.doors(name):
        upright = abs(door.axis[2]) > 0.7
        least = _SLIDE_M if door.kind == "slide" else _UPRIGHT_RAD if upright else _FLAP_RAD
        out[door.name] = (door.position, door.position >= least, door.position < _CLOSED * door.limit)
    return out


def opening(kind: str) -> Scene:
    """Scenes of opening a closed fixture, or one of its doors.

    Codes: closed (nothing has moved), ajar (not far enough), wrong_part (another one is open).
    """

    def scene(rng: np.random.Generator, shapes: Shapes) -> Trial:
        fixtures, before = against_wall(kind, rng, shapes)
        house = one_room(fixtures)
        parts = _PARTS.get(kind, {})
        said = FURNITURE[kind].called
        part: str | None = None
        if parts:
            said = list(parts)[rng.integers(len(parts))]
            part = parts[said]

        def done(world: SimWorld) -> str:
            doors = positions(world, "thing_1")
            mine = doors if part is None else {part: doors[part]}
            if any(opened for _, opened, _ in mine.values()):
                return "" if all(shut for name, (_, _, shut) in doors.items() if name not in mine) else "wrong_part"
            return "closed" if all(shut for _, _, shut in mine.values()) else "ajar"

        return Trial(house, {}, arrival(before, rng, house, {}, {}), f"open the {said}", done)

    return scene


def closing(kind: str) -> Scene:
    """Scenes of closing a fixture, one of whose doors stands open. Codes: open, ajar."""

    def scene(rng: np.random.Generator, shapes: Shapes) -> Trial:
        fixtures, before = against_wall(kind, rng, shapes)
        house = one_room(fixtures)
        bodies = [b.name for b in house.fixtures["thing_1"].entry.description.bodies if b.joint is not None]
        body = bodies[rng.integers(len(bodies))]
        opened = {"thing_1": {body: float(rng.uniform(0.5, 0.8))}}
        said = next((s for s, b in _PARTS.get(kind, {}).items() if b == body), FURNITURE[kind].called)
        away = before - [0.35, 0.0]  # whoever opened it stands off

        def done(world: SimWorld) -> str:
            doors = positions(world, "thing_1").values()
            if all(shut for _, _, shut in doors):
                return ""
            return "open" if any(clearly for _, clearly, _ in doors) else "ajar"

        return Trial(house, {}, arrival(away, rng, house, {}, opened), f"close the {said}", done, opened=opened)

    return scene


def pressing(entry: str, phrase: str, kind: str | None = None) -> Scene:
    """Scenes of turning a thing on or off. Codes: not_on, not_off, shoved (it has moved by more than 5 cm)."""

    def scene(rng: np.random.Generator, shapes: Shapes) -> Trial:
        fixtures: dict[str, dict[str, Any]] = {}
        objects: dict[str, Placement] = {}
        if kind is not None:
            fixtures, before = against_wall(kind, rng, shapes)
        else:
            fixtures, objects, before = _stood(entry, rng, shapes)
        house = one_room(fixtures)
        name = "thing_1"
        on = bool(rng.integers(2))
        start: dict[SimWorld, np.ndarray] = {}

        def done(world: SimWorld) -> str:
            if world not in start:
                start[world] = world.pose(name)[:3, 3]
                world.turn(name, not on)
            if world.toggled_on(name) is not on:
                return "not_on" if on else "not_off"
            return "shoved" if np.linalg.norm(world.pose(name)[:3, 3] - start[world]) > _MOVED_M else ""

        prompt = f"turn {'on' if on else 'off'} the {phrase}"
        return Trial(house, objects, arrival(before, rng, house, objects, {}), prompt, done, 60.0)

    return scene


def _stood(
    entry_name: str, rng: np.random.Generator, shapes: Shapes
) -> tuple[dict[str, dict[str, Any]], dict[str, Any], Any]:
    """A toggleable thing where such a thing is: on a table, in a counter, on the floor."""
    entry = catalogue()[entry_name]
    y = float(round(rng.uniform(-0.8, 0.8), 3))
    far = HALF_M - _WALL_GAP_M
    if entry.mass_kg is not None:
        low, high = (0.85, 1.15) if shapes == "tuning" else (0.75, 0.85)
        size = [round(s * float(rng.uniform(low, high)), 3) for s in entry.shape["size_m"]]
        thing: CatalogueEntry = entry.reshaped({"size_m": size})
        table = {"entry": "table", "at": [far - 0.28, y], "yaw_deg": 180}
        at = (far - 0.28 + rng.uniform(-0.12, 0.12), y + rng.uniform(-0.3, 0.3))
        objects = {"thing_1": placed(thing, at[0], at[1], 0.72, rng.uniform(-np.pi, np.pi))}
        return {"table_1": table}, objects, np.array([far - 0.55, at[1]])
    size = [round(s * (within(rng, shapes, (0.9, 1.1)) if i else 1.0), 3) for i, s in enumerate(entry.shape["size_m"])]
    fixture = {"entry": entry_name, "yaw_deg": 180}
    if entry.family in ("stove", "television"):
        base = "counter" if entry.family == "stove" else "table"
        depth, _, top = catalogue()[base].shape["size_m"]
        x = far - depth / 2
        size = entry.shape["size_m"] if entry.family == "stove" else size
        under = {"entry": base, "at": [x, y], "yaw_deg": 180}
        thing_1 = {**fixture, "at": [x, y], "z_m": top + 0.001, "shape": {"size_m": size}}
        return {"under_1": under, "thing_1": thing_1}, {}, np.array([far - depth - _BEFORE_M, y])
    x = far - size[0] / 2
    return {"thing_1": {**fixture, "at": [x, y], "shape": {"size_m": size}}}, {}, np.array([far - size[0] - 0.1, y])


def pushing(kind: Literal["box", "chair", "table"], toward: bool = False) -> Scene:
    """Scenes of pushing a thing to a side, away, or up to a table.

    Codes: not_moved (by less than 15 cm where it was to go, or it is farther than 8 cm from what it was to go to),
    astray (by more than 15 cm elsewhere), toppled, fallen.
    """

    def scene(rng: np.random.Generator, shapes: Shapes) -> Trial:
        x, y = rng.uniform(-0.3, 0.3, 2)
        fixtures: dict[str, dict[str, Any]] = {}
        z, yaw = 0.0, float(rng.uniform(-np.pi, np.pi))
        if kind == "table":
            fixtures["table_1"] = {
                "entry": "desk",
                "at": [0.0, 0.0],
                "yaw_deg": 90,
                "shape": {"size_m": [0.8, 1.4, 0.74]},
            }
            z, entry = 0.74, draw_standing(rng, shapes)
            x, y = x * 0.3, y * 0.3
        elif kind == "chair":
            size = [within(rng, shapes, span) for span in ((0.38, 0.46), (0.38, 0.46), (0.8, 0.96))]
            entry = catalogue()["chair"].reshaped({"size_m": size}).changed(mass_kg=4.0, friction=0.3)
        else:
            size = [within(rng, shapes, span) for span in ((0.24, 0.4), (0.24, 0.4), (0.2, 0.4))]
            entry = catalogue()["box"].reshaped({"size_m": size}).changed(mass_kg=2.0, friction=0.4)
        if toward:
            fixtures["table_1"] = {"entry": "table", "at": [2.4, round(y, 2)], "yaw_deg": 180}
            x = 2.4 - 0.275 - rng.uniform(0.55, 0.75)
        objects = {"thing_1": placed(entry, x, y, z, yaw)}
        house = one_room(fixtures)
        base = arrival(np.array([x, y]), rng, house, objects, {})
        bearing = float(np.arctan2(y - base[1], x - base[0]))
        direction, turn = [("away", 0.0), ("to the left", np.pi / 2), ("to the right", -np.pi / 2)][rng.integers(3)]
        if kind == "table":
            direction, turn = [("to the left", np.pi / 2), ("to the right", -np.pi / 2)][rng.integers(2)]
        way = np.array([np.cos(bearing + turn), np.sin(bearing + turn)])

        def done(world: SimWorld) -> str:
            T = world.pose("thing_1")
            if T[2, 2] < 0.9:
                return "toppled"
            if T[2, 3] < z - 0.05:
                return "fallen"
            moved = T[:2, 3] - [x, y]
            if toward:
                gap = min(float(Surroundings([s]).distance(_corners(world)).min()) for s in world.solids("table_1"))
                return "" if gap < 0.08 else "not_moved"
            if moved @ way < 0.15:
                return "not_moved"
            return "astray" if abs(moved @ [-way[1], way[0]]) > 0.15 else ""

        prompt = f"push the {called(entry)} {'to the table' if toward else direction}"
        return Trial(house, objects, base, prompt, done)

    return scene


def _corners(world: SimWorld) -> np.ndarray:
    """(n, 3) places all over a thing that is pushed."""
    boxes = [s.aabb() for s in world.solids("thing_1")]
    grids = [np.stack(np.meshgrid(*np.linspace(low, high, 5).T, indexing="ij"), -1) for low, high in boxes]
    return np.concatenate([grid.reshape(-1, 3) for grid in grids])


def draw_standing(rng: np.random.Generator, shapes: Shapes) -> CatalogueEntry:
    """A movable thing that does not roll."""
    able = [e for e in things(shapes) if e.family in ("block", "can", "cup", "bowl", "bottle")]
    return able[rng.integers(len(able))]


def _each(make: Callable[[str], Scene]) -> dict[str, Scene]:
    return {kind: make(kind) for kind in FURNITURE}


SKILLS: dict[str, dict[str, Scene]] = {
    "open": _each(opening),
    "close": _each(closing),
    "push": {
        "box": pushing("box"),
        "chair": pushing("chair"),
        "chair_to_table": pushing("chair", toward=True),
        "on_table": pushing("table"),
    },
    "press": {
        "radio": pressing("radio_receiver", "radio"),
        "lamp": pressing("floor_lamp", "floor lamp"),
        "television": pressing("television", "television"),
        "stove": pressing("stove", "stove"),
        "sink": pressing("kitchen_sink", "kitchen sink"),
        "washbasin": pressing("bathroom_sink", "washbasin"),
        "microwave": pressing("microwave", "microwave", kind="microwave"),
        "oven": pressing("oven", "oven", kind="oven"),
        "washer": pressing("washer", "washing machine", kind="washer"),
    },
}
