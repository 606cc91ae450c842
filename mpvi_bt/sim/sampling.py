"""Instances: where the objects and the robot of a task begin, drawn so that what :init says can hold."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mpvi_bt.errors import BackendError, UserError
from mpvi_bt.goals.formula import Literal
from mpvi_bt.goals.problem import AGENT, Problem
from mpvi_bt.perception.map import OccupancyMap
from mpvi_bt.robot.collision import Surroundings, carries
from mpvi_bt.robot.solids import Array, Solid, pose
from mpvi_bt.sim.catalogue import Catalogue, Entry
from mpvi_bt.sim.house import House
from mpvi_bt.sim.prior_map import BAND_M, prior_map
from mpvi_bt.sim.world import Placement

ROBOT_CLEARANCE_M = 0.45  # free floor around the robot at the start
OBJECT_CLEARANCE_M = 0.30  # free floor around an object's edge, so that a hand gets at it
APART_M = 0.45  # between two objects' edges
DOORWAY_M = 0.9  # nothing lies this near the middle of a doorway
PASSAGE_M = 0.36  # half the width of the ways that things on the floor leave free
INSIDE_CLEARANCE_M = 0.03  # between things in a container
HAND_M = 0.08  # from the middle of what is in a container to its walls, so that a hand gets around it
REACH_M = 0.85  # from where a robot can stand to a thing on a fixture,
TWO_HANDS_REACH_M = 0.58  # and to one that takes two hands
ONE_HAND_M = 0.085
ASKEW_RAD = 0.25  # how far such a thing is turned from square, at the most
KNOWN = ("ontop", "inside")
_DROP_M = 0.001  # things are let go of so far above what carries them
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

    Things lie on floors, on flat ground such as a lawn, on the upper faces of fixtures, or inside other movable things;
    whether all of :init then holds is for physics to say, so a caller settles the world and checks.

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
    contents: dict[str, list[tuple[Array, float]]] = {}
    for literal in _containers_first(problem):
        name, place = literal.args
        entry = _bound(problem, catalogue, bindings, name)
        radius = _radius(entry)
        if literal.predicate == "inside" and place in objects:
            T = _within(objects[place], entry, contents.setdefault(place, []), rng)
        elif literal.predicate == "inside":
            raise UserError(f"{problem.name}: {literal}: only movable things can have others inside yet")
        elif place not in names:
            raise UserError(f"{problem.name}: {literal}: only floors and fixtures can carry things yet")
        elif floor.is_ground(names[place]):
            xy, z = floor.draw(names[place], radius, OBJECT_CLEARANCE_M, rng)
            T = pose((float(xy[0]), float(xy[1]), z + _DROP_M), float(rng.uniform(-np.pi, np.pi)))
        else:
            T = floor.on_top(names[place], entry, rng)
        objects[name] = Placement(entry, T)
    ground = problem.agent_support
    if ground is None:
        raise UserError(f"{problem.name}: :init does not say where the robot begins")
    xy, _ = floor.draw(names[ground], 0.0, ROBOT_CLEARANCE_M, rng)
    return Start(objects, np.array([*xy, rng.uniform(-np.pi, np.pi)]), names)


def _containers_first(problem: Problem) -> list[Literal]:
    """What :init says of where movable things are: of a container before what is in it, else in the order of the file.

    Raises:
        UserError: It says something of them that cannot be sampled.
    """
    facts: list[Literal] = []
    for fact in problem.init:
        literal = fact.literal
        if literal.predicate == "inroom" or not fact.positive or problem.objects.get(literal.args[0]) == AGENT:
            continue
        if literal.predicate not in KNOWN:
            raise UserError(f"{problem.name}: a start with {literal} cannot be sampled yet; known: {', '.join(KNOWN)}")
        facts.append(literal)
    return sorted(facts, key=lambda literal: literal.predicate == "inside")


def _bound(problem: Problem, catalogue: Catalogue, bindings: Mapping[str, str], name: str) -> Entry:
    synset = problem.objects[name]
    if synset not in bindings:
        raise UserError(f"{problem.name}: {name} is bound to no catalogue entry; bound: {', '.join(bindings)}")
    return catalogue[bindings[synset]]


def _within(container: Placement, entry: Entry, taken: list[tuple[Array, float]], rng: np.random.Generator) -> Array:
    """(4, 4) a place for a thing on the bottom of a container, with room for a hand and clear of what is there."""
    radius, height = _radius(entry), float(np.ptp(entry.description.extent()[:, 2]))
    for volume in container.entry.description.root.volumes:
        low, high = volume.aabb()
        reach = (high - low)[:2] / 2 - max(radius + INSIDE_CLEARANCE_M, HAND_M)
        if (reach <= 0).any() or height / 2 > high[2] - low[2]:
            continue
        middle = (low + high)[:2] / 2
        for _ in range(_DRAWS):
            xy = middle + rng.uniform(-reach, reach)
            if all(np.linalg.norm(xy - other) > radius + r + INSIDE_CLEARANCE_M for other, r in taken):
                taken.append((xy, radius))
                spot = pose((float(xy[0]), float(xy[1]), float(low[2]) + _DROP_M), float(rng.uniform(-np.pi, np.pi)))
                return np.asarray(container.T_world @ spot)
    raise BackendError(f"no free place of radius {radius:.2f} m inside {container.entry.name}")


def _for_two_hands(entry: Entry) -> bool:
    """Whether a thing is too broad for one hand and has no rim or bar to take it by."""
    size = np.ptp(entry.description.extent(), axis=0)
    root = entry.description.root
    return bool(size[:2].min() > ONE_HAND_M and not root.volumes and not root.handles)


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
        away, self._standing = ndimage.distance_transform_edt(~self._reachable, return_indices=True)
        self._from_reachable_m = away * grid.resolution_m
        self._taken: list[tuple[Array, float]] = []
        self._occupied = grid.occupied.copy()  # with what was drawn

    def is_ground(self, support: str) -> bool:
        """Whether a support is a floor, or so flat that a robot drives over it, such as a lawn."""
        return support.startswith("floor_") or self._house.fixtures[support].extent()[1, 2] < BAND_M[0]

    def draw(self, ground: str, radius: float, clearance: float, rng: np.random.Generator) -> tuple[Array, float]:
        """(2,) a free place [m] on some ground for something of a radius [m], and its height [m]; taken from now on."""
        standing = self._reachable if radius == 0.0 else self._from_reachable_m < 0.5
        free = (self._clearance > radius + clearance) & standing
        height = 0.0
        if ground.startswith("floor_"):
            free = free & (self._map.rooms == self._map.room_names.index(ground.removeprefix("floor_")))
        cells = np.argwhere(free)
        if not ground.startswith("floor_"):
            low, high = self._house.fixtures[ground].extent()
            at = np.array([self._map.center(*cell) for cell in cells]).reshape(-1, 2)
            cells = cells[((at > low[:2] + radius) & (at < high[:2] - radius)).all(1)]
            height = float(high[2])
        for _ in range(_DRAWS if len(cells) else 0):
            xy = self._map.center(*cells[rng.integers(len(cells))])
            if self._is_free(xy, radius) and (radius == 0.0 or self._leaves_a_way(xy, radius)):
                self._taken.append((xy, radius))
                return xy, height
        raise BackendError(f"no free place of radius {radius:.2f} m on {ground}")

    def on_top(self, fixture: str, entry: Entry, rng: np.random.Generator) -> Array:
        """(4, 4) a place for a thing on the broadest upper face of a fixture that has one free within reach.

        What takes two hands lies near an edge, about square to whoever stands before it.
        """
        radius, two_hands = _radius(entry), _for_two_hands(entry)
        solids = list(self._house.fixtures[fixture].solids())
        broad = [s for s in solids if s.kind != "sphere" and (np.ptp(s.aabb(), axis=0)[:2] > 2 * radius).all()]
        for face in sorted(broad, key=_breadth):
            low, high = face.aabb()
            others = Surroundings(
                [
                    s
                    for f in self._house.fixtures.values()
                    for s in f.solids()
                    if f.name != fixture or (s is not face and s.aabb()[1, 2] > high[2] + 0.005)
                ]
            )
            for _ in range(_DRAWS):
                spot = np.append(rng.uniform(low[:2] + radius, high[:2] - radius), high[2])
                if (
                    all(np.linalg.norm(spot[:2] - other) > radius + r + 0.05 for other, r in self._taken)
                    and self._from_reachable_m[self._map.cell(spot)] < (TWO_HANDS_REACH_M if two_hands else REACH_M)
                    and carries(face, spot, radius)
                    and others.distance(spot + [0, 0, 0.05]) > radius
                ):
                    self._taken.append((spot[:2], radius))
                    yaw = float(rng.uniform(-np.pi, np.pi))
                    if two_hands:
                        ahead = spot[:2] - self._map.center(*self._standing[:, *self._map.cell(spot)])
                        yaw = float(np.arctan2(ahead[1], ahead[0])) + yaw * ASKEW_RAD / np.pi
                    return pose(spot + [0, 0, _DROP_M], yaw)
        raise BackendError(f"no free place of radius {radius:.2f} m on {fixture}")

    def _leaves_a_way(self, xy: Array, radius: float) -> bool:
        """Whether a robot still gets from each doorway of the room, and each thing in it, to all others, within it.

        If so, a thing stands there from now on.
        """
        cell = np.array(self._map.cell(xy))
        index = self._map.rooms[tuple(cell)]
        room = self._map.rooms == index
        (window,) = ndimage.find_objects(room.astype(np.int32))
        low = np.array([part.start for part in window])
        name = self._map.room_names[index]
        ends = [xy, *(np.asarray(d.at) for d in self._house.doorways if name in d.rooms)]
        ends += [at for at, _ in self._taken if self._map.rooms[self._map.cell(at)] == index]
        cells = [np.array(self._map.cell(end)) - low for end in ends]
        before = self._occupied[window]
        away = np.linalg.norm(np.moveaxis(np.indices(before.shape), 0, -1) - (cell - low), axis=-1)
        after = before | (away * self._map.resolution_m < radius)
        if len(self._parts(after, room[window], cells)) > len(self._parts(before, room[window], cells)):
            return False
        self._occupied[window] = after
        return True

    def _parts(self, occupied: NDArray[np.bool_], room: NDArray[np.bool_], ends: list[Array]) -> set[int]:
        """The connected parts of a room that a robot can pass through and that are nearest to some cells."""
        wide = ndimage.distance_transform_edt(~occupied) * self._map.resolution_m > PASSAGE_M
        parts, count = ndimage.label(wide & room)
        if not count:
            return set()
        nearest = ndimage.distance_transform_edt(parts == 0, return_distances=False, return_indices=True)
        cells = np.clip(ends, 0, np.array(parts.shape) - 1)
        return {int(parts[tuple(nearest[:, row, column])]) for row, column in cells}

    def _is_free(self, xy: Array, radius: float) -> bool:
        doorways = all(np.linalg.norm(xy - np.asarray(d.at)) > DOORWAY_M for d in self._house.doorways)
        return doorways and all(np.linalg.norm(xy - other) > radius + r + APART_M for other, r in self._taken)


def _breadth(face: Solid) -> tuple[float, float]:
    """What faces are ranked by: the broadest first, of those as broad the highest."""
    low, high = face.aabb()
    return -round(float(np.prod((high - low)[:2])), 2), -float(high[2])
