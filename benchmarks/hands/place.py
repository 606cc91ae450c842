"""Scenes of putting down what is in hand: in, on, next to and under things."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

import numpy as np

from benchmarks.hands import surfaces
from benchmarks.hands.pick import crowd, draw_thing, lowest, one_hand, radius
from benchmarks.hands.rooms import arrival, called, name_in, things
from benchmarks.hands.surfaces import Surface
from benchmarks.hands.trial import Scene, Shapes, Trial
from mpvi_bt.ground.geometry.solids import Array, pose
from mpvi_bt.ground.robot.protocol import SIDES
from mpvi_bt.house.sim.world import Placement, SimWorld
from mpvi_bt.house.states.relations import inside, nextto, ontop, under
from mpvi_bt.house.things.catalogue import CatalogueEntry
from mpvi_bt.testing.scene_builder import one_room

_MOVED_M, _UPRIGHT = 0.10, 0.9
_REACH_M = 0.3  # what is held sticks out so far before the body
_PARKED = (0.0, 0.0, -5.0)  # where a thing is said to be that will be in hand

Placed = Callable[[SimWorld], bool]
Draw = Callable[[np.random.Generator], Surface]


def put(name: str, where: Placed, missing: str, others: Mapping[str, Placement]) -> Callable[[SimWorld], str]:
    """Whether a thing has been let go of where it belongs.

    Codes: in_hand (a hand is still about it), `missing` (it is not where it belongs), toppled or moved (another thing
    lies on its side or is more than 10 cm from where it stood).

    Args:
        name: The thing.
        where: Whether it is where it belongs.
        missing: The code if it is not.
        others: What stood in the scene at the start and is to go on standing there.
    """

    def done(world: SimWorld) -> str:
        if any(world.holding(side) == name or name in world.pinched(side) for side in SIDES):
            return "in_hand"
        if not where(world):
            return missing
        for other, start in others.items():
            T = world.pose(other)
            if np.linalg.norm(T[:3, 3] - start.T_world[:3, 3]) > _MOVED_M:
                return "moved"
            if start.entry.family != "ball" and T[2, 2] < _UPRIGHT:
                return "toppled"
        return ""

    return done


def on(name: str, surface: str) -> Placed:
    """Whether a thing rests on one of the faces of another, with or without a board above."""
    return lambda world: world.touching(name, surface) and (ontop(world, name, surface) or inside(world, name, surface))


def fits(entry: CatalogueEntry, container: CatalogueEntry) -> bool:
    """Whether a thing goes upright through a container's opening with a centimeter to spare on each side.

    A bar over the middle halves the opening.
    """
    opening = 2 * container.description.root.volumes[0].half_m[:2]
    for bar in container.description.root.handles:
        across = int(abs(bar.axis[1]) > 0.5)  # the bar runs along y: it halves what is along x
        opening[1 - across] = (opening[1 - across] - bar.thickness_m) / 2
    low, high = entry.description.extent()
    return bool((np.sort((high - low)[:2]) + 0.02 <= np.sort(opening)).all())


def _trial(
    entry: CatalogueEntry, prompt: str, surface: Surface, at: Array, done: Callable[[SimWorld], str],
    objects: Mapping[str, Placement], name: str, rng: np.random.Generator, budget_s: float = 90.0,
) -> Trial:  # fmt: skip
    """A trial with a thing in one hand and the robot before a place (2,)."""
    house = one_room(surface.fixtures)
    base = arrival(at, rng, house, objects, surface.opened, _REACH_M, surface.z)
    held = {SIDES[rng.integers(2)]: name}
    everything = {**objects, name: Placement(entry, pose(_PARKED))}
    return Trial(house, everything, base, prompt, done, budget_s, held, opened=surface.opened)


def put_into(kinds: Iterable[str], draw: Draw) -> Scene:
    """Scenes of putting a thing into a container of certain families that stands on a surface."""

    def scene(rng: np.random.Generator, shapes: Shapes) -> Trial:
        surface = draw(rng)
        containers = [c for c in things(shapes) if "fillable" in c.abilities and c.family in kinds]
        container = containers[rng.integers(len(containers))]
        entries = [entry for entry in one_hand(shapes) if fits(entry, container)]
        entry = entries[rng.integers(len(entries))]
        spot = surface.spot(radius(container), rng)
        at = surface.at(*spot)
        box = name_in({}, container)
        objects = {box: surface.put(container, spot, rng.uniform(-np.pi, np.pi))}
        name = name_in(objects, entry)
        done = put(name, lambda world: inside(world, name, box), "not_inside", objects)
        prompt = f"put the {called(entry)} in the {called(container)}"
        return _trial(entry, prompt, surface, at, done, objects, name, rng)

    return scene


def put_inside(draw: Draw) -> Scene:
    """Scenes of putting a thing into a fixture: onto a board or the floor of it."""

    def scene(rng: np.random.Generator, shapes: Shapes) -> Trial:
        surface, entry = draw(rng), draw_thing(rng, shapes)
        at = surface.at(surface.inset_m + surface.depth_m / 2, 0.0)
        name = name_in({}, entry)
        done = put(name, lambda world: inside(world, name, surface.name), "not_inside", {})
        prompt = f"put the {called(entry)} in the {surface.called}"
        return _trial(entry, prompt, surface, at, done, {}, name, rng)

    return scene


def put_on(draw: Draw, cluttered: bool = False) -> Scene:
    """Scenes of putting a thing on a surface."""

    def scene(rng: np.random.Generator, shapes: Shapes) -> Trial:
        surface, entry = draw(rng), draw_thing(rng, shapes)
        spot = surface.spot(radius(entry) + (0.15 if cluttered else 0.0), rng)
        objects: dict[str, Placement] = {}
        if cluttered:
            crowd(objects, surface, spot, rng, shapes, without=entry)
        name = name_in(objects, entry)
        done = put(name, on(name, surface.name), "not_on_it", dict(objects))
        prompt = f"put the {called(entry)} on the {surface.called}"
        return _trial(entry, prompt, surface, surface.at(*spot), done, objects, name, rng)

    return scene


def put_next_to(draw: Draw) -> Scene:
    """Scenes of putting a thing next to another on the same surface."""

    def scene(rng: np.random.Generator, shapes: Shapes) -> Trial:
        surface, entry = draw(rng), draw_thing(rng, shapes)
        others = [e for e in things(shapes) if e.name != entry.name and e.family != "ball"]
        other = others[rng.integers(len(others))]
        spot = surface.spot(radius(other), rng)
        beside = name_in({}, other)
        objects = {beside: surface.put(other, spot, rng.uniform(-np.pi, np.pi))}
        name = name_in(objects, entry)

        def where(world: SimWorld) -> bool:
            return nextto(world, name, beside) and abs(lowest(world, name) - surface.z) < 0.02

        done = put(name, where, "not_next_to_it", objects)
        prompt = f"put the {called(entry)} next to the {called(other)}"
        return _trial(entry, prompt, surface, surface.at(*spot), done, objects, name, rng)

    return scene


def put_under(draw: Draw) -> Scene:
    """Scenes of putting a thing on the floor under a piece of furniture."""

    def scene(rng: np.random.Generator, shapes: Shapes) -> Trial:
        surface, entry = draw(rng), draw_thing(rng, shapes)
        name = name_in({}, entry)

        def where(world: SimWorld) -> bool:
            return under(world, name, surface.name) and lowest(world, name) < 0.02

        at = surface.at(0.1, 0.0)
        prompt = f"put the {called(entry)} under the {surface.called}"
        done = put(name, where, "not_under_it", {})
        return _trial(entry, prompt, surface, at, done, {}, name, rng)

    return scene


SKILLS: dict[str, dict[str, Scene]] = {
    "place_in": {
        "bin": put_into(["trash_can"], surfaces.floor),
        "basket": put_into(["open_box"], surfaces.floor),
        "basket_on_table": put_into(["open_box"], surfaces.table),
        "sink": put_inside(surfaces.sink),
        "drawer": put_inside(surfaces.drawer),
        "fridge": put_inside(surfaces.fridge),
        "cabinet": put_inside(surfaces.one_of(surfaces.low_cabinet, surfaces.wall_cabinet)),
    },
    "place_on": {
        "table": put_on(surfaces.table),
        "counter": put_on(surfaces.counter),
        "high_shelf": put_on(surfaces.high_shelf),
        "under_board": put_on(surfaces.board),
        "clutter": put_on(surfaces.one_of(surfaces.table, surfaces.counter), cluttered=True),
    },
    "place_next_to": {
        "floor": put_next_to(surfaces.floor),
        "table": put_next_to(surfaces.table),
    },
    "place_under": {
        "table": put_under(surfaces.tall_table),
        "desk": put_under(surfaces.desk),
    },
}
