"""Instances: where the objects and the robot of a task begin, drawn so that what :init says can hold."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from mpvi_bt.errors import BackendError, UserError
from mpvi_bt.goals.problem import AGENT, Problem
from mpvi_bt.perception.map import OccupancyMap
from mpvi_bt.robot.collision import Surroundings, carries
from mpvi_bt.robot.solids import Array, pose
from mpvi_bt.sim.catalogue import Catalogue, Entry
from mpvi_bt.sim.house import House
from mpvi_bt.sim.prior_map import prior_map
from mpvi_bt.sim.world import Placement

ROBOT_CLEARANCE_M = 0.45  # free floor around the robot at the start
OBJECT_CLEARANCE_M = 0.30  # free floor around an object's edge, so that a hand gets at it
APART_M = 0.45  # between two objects' edges
DOORWAY_M = 0.9  # nothing lies this near the middle of a doorway
_DRAWS = 400


@dataclass(frozen=True, eq=False)
class Start:
    """Where an instance begins.

    Attributes:
        objects: Movable things by their BDDL name.
        base_pose: (3,) the robot's x, y [m], yaw [rad].
        scene_names: BDDL name of every fixture and floor to its name in the house.
    """

    objects: Mapping[str, Placement]
    base_pose: Array
    scene_names: Mapping[str, str]


def scene_names(house: House, problem: Problem) -> dict[str, str]:
    """Binds the floors and fixtures of a problem to those of a house, room by room, in order.

    Raises:
        UserError: The house has no such room, or fewer fixtures of a kind than the problem names.
    """
    bound: dict[str, str] = {}
    taken: set[str] = set()
    for name, room in problem.rooms.items():
        house.room(room)  # names the rooms that there are
        synset = problem.objects[name]
        if synset.startswith("floor.n."):
            bound[name] = f"floor_{room}"
            continue
        free = [f.name for f in house.fixtures_of(synset, room) if f.name not in taken]
        if not free:
            raise UserError(f"{house.name}: {problem.name} needs {name} in the {room}, and no {synset} is left there")
        bound[name] = free[0]
        taken.add(free[0])
    return bound


def sample(
    house: House, catalogue: Catalogue, problem: Problem, bindings: Mapping[str, str], rng: np.random.Generator
) -> Start:
    """Draw one start.

    Floors and the upper faces of fixtures can carry things (`ontop`); whether all of :init then holds is for physics to
    say, so a caller settles the world and checks.

    Args:
        house: Where.
        catalogue: What the bindings name.
        problem: Whose :init is to hold.
        bindings: Synset of a movable thing to its catalogue entry.
        rng: Source of the draw.

    Raises:
        UserError: :init asks for a place that cannot be sampled yet.
        BackendError: No room was found for something.
    """
    names = scene_names(house, problem)
    floor = _Floor(house, prior_map(house))
    objects: dict[str, Placement] = {}
    agent_room = problem.agent_room
    for fact in problem.init:
        predicate, args = fact.literal.predicate, fact.literal.args
        if predicate != "ontop" or problem.objects.get(args[0]) == AGENT or not fact.positive:
            if predicate not in ("inroom", "ontop") and fact.positive:
                raise UserError(f"{problem.name}: a start with {fact.literal} cannot be sampled yet; known: ontop")
            continue
        synset = problem.objects[args[0]]
        if synset not in bindings:
            raise UserError(f"{problem.name}: {args[0]} is bound to no catalogue entry; bound: {', '.join(bindings)}")
        entry = catalogue[bindings[synset]]
        support = names.get(args[1])
        if support is None:
            raise UserError(f"{problem.name}: {fact.literal}: only floors and fixtures can carry things yet")
        if support.startswith("floor_"):
            xy = floor.draw(support.removeprefix("floor_"), _radius(entry), OBJECT_CLEARANCE_M, rng)
            T = pose((float(xy[0]), float(xy[1]), 0.001), float(rng.uniform(-np.pi, np.pi)))
        else:
            T = floor.on_top(support, _radius(entry), rng)
        objects[args[0]] = Placement(entry, T)
    if agent_room is None:
        raise UserError(f"{problem.name}: :init does not say where the robot begins")
    xy = floor.draw(agent_room, 0.0, ROBOT_CLEARANCE_M, rng)
    return Start(objects, np.array([*xy, rng.uniform(-np.pi, np.pi)]), names)


def _radius(entry: Entry) -> float:
    low, high = entry.description.extent()
    return float(np.hypot(*(high - low)[:2])) / 2


class _Floor:
    """Free places, fewer with each draw."""

    def __init__(self, house: House, grid: OccupancyMap) -> None:
        self._house, self._map = house, grid
        self._clearance = ndimage.distance_transform_edt(~grid.occupied) * grid.resolution_m
        passable, _ = ndimage.label(self._clearance > 0.36)
        self._reachable = passable == np.bincount(passable[passable > 0]).argmax()  # by a robot from anywhere else
        self._near_reachable = ndimage.distance_transform_edt(~self._reachable) * grid.resolution_m < 0.5
        self._taken: list[tuple[Array, float]] = []

    def draw(self, room: str, radius: float, clearance: float, rng: np.random.Generator) -> Array:
        """(2,) a free place [m] on a room's floor for something of a radius [m]; it is taken from now on."""
        standing = self._reachable if radius == 0.0 else self._near_reachable
        index = self._map.room_names.index(room)
        cells = np.argwhere((self._map.rooms == index) & (self._clearance > radius + clearance) & standing)
        for _ in range(_DRAWS if len(cells) else 0):
            xy = self._map.center(*cells[rng.integers(len(cells))])
            if self._is_free(xy, radius):
                self._taken.append((xy, radius))
                return xy
        raise BackendError(f"no free place of radius {radius:.2f} m on the floor of the {room}")

    def on_top(self, fixture: str, radius: float, rng: np.random.Generator) -> Array:
        """(4, 4) a place on the highest broad face of a fixture, clear of what stands on it."""
        solids = [s for s in self._house.fixtures[fixture].solids() if s.kind != "sphere"]
        broad = [s for s in solids if (np.ptp(s.aabb(), axis=0)[:2] > 2 * radius).all()]
        for face in sorted(broad, key=lambda s: -s.aabb()[1, 2])[:1]:
            low, high = face.aabb()
            others = Surroundings([s for f in self._house.fixtures.values() for s in f.solids() if f.name != fixture])
            for _ in range(_DRAWS):
                spot = np.append(rng.uniform(low[:2] + radius, high[:2] - radius), high[2])
                if (
                    all(np.linalg.norm(spot[:2] - other) > radius + r + 0.05 for other, r in self._taken)
                    and carries(face, spot, radius)
                    and others.distance(spot + [0, 0, 0.05]) > radius
                ):
                    self._taken.append((spot[:2], radius))
                    return pose(spot + [0, 0, 0.001], float(rng.uniform(-np.pi, np.pi)))
        raise BackendError(f"no free place of radius {radius:.2f} m on {fixture}")

    def _is_free(self, xy: Array, radius: float) -> bool:
        doorways = all(np.linalg.norm(xy - np.asarray(d.at)) > DOORWAY_M for d in self._house.doorways)
        return doorways and all(np.linalg.norm(xy - other) > radius + r + APART_M for other, r in self._taken)
