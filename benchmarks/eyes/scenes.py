"""Scenes that pictures are taken of: a house, things in it as tasks begin or anywhere, and a robot."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, TypeVar

import numpy as np

from benchmarks.eyes.variants import Drawn, drawn
from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import BackendError, UserError
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.robots import model_named
from mpvi_bt.house.instances.instances import expanded_problem
from mpvi_bt.house.instances.sampling import Start, sample
from mpvi_bt.house.instances.tasks import load_task
from mpvi_bt.house.layout.arranging import Arrangement
from mpvi_bt.house.layout.boards import MovableForm, Put
from mpvi_bt.house.layout.house import House, load_house
from mpvi_bt.house.sim.world import Placement, SimWorld
from mpvi_bt.house.things.catalogue import Catalogue, CatalogueEntry, load_catalogue

Split = Literal["train", "held_out"]
NameT = TypeVar("NameT", bound=str)

# All our choice.
FAMILY_HOUSE = 0.25  # of the training pictures are of the house that ships
TASKS = 0.45  # of the scenes are starts of tasks; in the others things stand anywhere
_KINDS = {"family": 0.5, "flat": 0.25, "office": 0.25}
_TRAINING_SEEDS = 150  # of generated houses of each kind
HELD_OUT = tuple(
    [f"generated:{seed}" for seed in range(9001, 9006)]
    + [f"generated:flat:{seed}" for seed in range(9001, 9004)]
    + [f"generated:office:{seed}" for seed in (9001, 9002)]
)
_ROBOTS = {"r1": 0.76, "r1pro": 0.12, "fetch": 0.12}
_ATTEMPTS, _ATTEMPTS_BESIDES = 50, 25  # at putting a few things somewhere, without and with those of a task
_MOST_AT_ONCE = 4
_OPEN, _ON = 0.25, 0.4  # of the furniture and things that can be
_HELD_OUT_DRAWN: Mapping[Drawn, float] = {
    "catalogue": 0.3,
    "trained": 0.2,
    "held_out_shape": 0.2,
    "held_out_color": 0.3,
}


@dataclass(frozen=True, eq=False)
class PictureScene:
    """A world to take pictures of.

    Attributes:
        world: With the robot somewhere.
        house: Whose rooms it has.
        drawn: How each movable thing was drawn, by name.
    """

    world: SimWorld
    house: House
    drawn: Mapping[str, Drawn]


def draw_scene(seed: int, split: Split) -> PictureScene:
    """The scene of a seed."""
    rng = np.random.default_rng([seed, split == "held_out"])
    catalogue = load_catalogue()
    house = load_house(_house(seed, split, rng))
    start: Start | None = None
    if rng.random() < TASKS:
        start = _task_start(house, catalogue, rng)
    opened, on = dict(start.openings if start else {}), set(start.on if start else ())
    for name, fixture in house.fixtures.items():
        moving = [body.name for body in fixture.entry.description.bodies if body.joint is not None]
        if moving and name not in opened and rng.random() < _OPEN:
            opened[name] = {moving[int(rng.integers(len(moving)))]: float(rng.uniform(0.3, 1.0))}
    put = _anywhere(house, catalogue, opened, start, rng)
    objects, how = {}, {}
    for name, placement in put.items():
        wanted = "trained" if split == "train" else _one_of(_HELD_OUT_DRAWN, rng)
        entry, how[name] = drawn(placement.entry, rng, wanted)
        objects[name] = Placement(entry, _on_its_foot(placement, entry))
    robot = _one_of(_ROBOTS, rng)
    world = SimWorld(house, objects, np.zeros(3), robot=model_named(robot))
    for name, bodies in opened.items():
        for body, fraction in bodies.items():
            world.set_opening(name, body, fraction)
    for name in world.switched:
        world.turn(name, name in on or bool(rng.random() < _ON))
    for name, kind in start.marks if start else ():
        world.mark(name, kind)
    world.scene.set_ambient_light((np.array([0.52, 0.52, 0.54]) * rng.uniform(0.75, 1.2)).tolist())
    return PictureScene(world, house, how)


def _house(seed: int, split: Split, rng: np.random.Generator) -> str:
    if split == "held_out":
        return HELD_OUT[seed % len(HELD_OUT)]
    if rng.random() < FAMILY_HOUSE:
        return "family_house"
    return f"generated:{_one_of(_KINDS, rng)}:{rng.integers(_TRAINING_SEEDS)}"


def _one_of(chances: Mapping[NameT, float], rng: np.random.Generator) -> NameT:
    names = list(chances)
    return names[int(rng.choice(len(names), p=list(chances.values())))]


def _task_start(house: House, catalogue: Catalogue, rng: np.random.Generator) -> Start | None:
    """The start of a task that the house has room for; None if none of a few does."""
    names = sorted(file.stem for file in paths.files("tasks"))
    for _ in range(6):
        task = load_task(names[int(rng.integers(len(names)))])
        try:
            return sample(house, catalogue, expanded_problem(task, house), task.bindings, rng)
        except (BackendError, UserError):
            continue
    return None


def _anywhere(
    house: House,
    catalogue: Catalogue,
    opened: Mapping[str, Mapping[str, float]],
    start: Start | None,
    rng: np.random.Generator,
) -> dict[str, Placement]:
    """Things of a task, if any, and of all kinds on furniture, in what is open, on the floor, on and in each other."""
    movable = [entry for entry in catalogue if entry.mass_kg is not None]
    names = {name: name for name in house.fixtures} | {f"floor_{room}": f"floor_{room}" for room in house.rooms}
    arrangement = Arrangement(house, names, opened, rng)
    fixed = {} if start is None else dict(start.objects)
    arrangement.done.update({name: Put(MovableForm(placed.entry), placed.T_world) for name, placed in fixed.items()})
    counts: dict[str, int] = {entry.synset: 100 for entry in movable}  # numbers that no task has
    for _ in range(_ATTEMPTS if start is None else _ATTEMPTS_BESIDES):
        entries = [movable[int(k)] for k in rng.integers(len(movable), size=rng.integers(1, _MOST_AT_ONCE + 1))]
        if rng.random() < 0.2:  # some alike, side by side
            entries = [entries[0]] * len(entries)
        shapes = {}
        for entry in entries:
            counts[entry.synset] += 1
            shapes[f"{entry.synset}_{counts[entry.synset]}"] = MovableForm(entry)
        inside, carriers = [*opened], [*arrangement.done]
        where, predicate = str(rng.choice(list(names))), "ontop"
        if (chance := rng.random()) < 0.15 and inside:
            where, predicate = inside[int(rng.integers(len(inside)))], "inside"
        elif chance < 0.35 and carriers:
            where = carriers[int(rng.integers(len(carriers)))]
            predicate = "inside" if arrangement.done[where].shape.entry.description.root.volumes else "ontop"
        try:
            arrangement.add(predicate, where, shapes)
        except (BackendError, UserError):
            continue
    more = {name: put for name, put in arrangement.done.items() if name not in fixed}
    return fixed | {name: Placement(put.shape.entry, _toppled(put, rng)) for name, put in more.items()}


def _toppled(put: Put, rng: np.random.Generator) -> Array:
    """Its pose; a few lie on their side."""
    if rng.random() > 0.12 or put.shape.radius > 0.15:
        return put.T
    T, (s, c) = put.T.copy(), ((1.0, 0.0) if rng.random() < 0.5 else (-1.0, 0.0))
    turn = np.array([[1, 0, 0], [0, c, -s], [0, s, c]]) if rng.random() < 0.5 else np.array(
        [[c, 0, s], [0, 1, 0], [-s, 0, c]]
    )  # fmt: skip
    T[:3, :3] = T[:3, :3] @ turn
    entry: CatalogueEntry = put.shape.entry
    T[2, 3] += put.box[0, 2] - entry.description.extent(T)[0, 2]
    return T


def _on_its_foot(placement: Placement, entry: CatalogueEntry) -> Array:
    """The pose with what is another size now standing as high as before."""
    T = placement.T_world.copy()
    T[2, 3] += placement.entry.description.extent(T)[0, 2] - entry.description.extent(T)[0, 2]
    return T
