"""What is looked for, where it is and where the robot begins: drawn from a seed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mpvi_bt.executive.plan.knowledge import Entry as Known
from mpvi_bt.finding.navigation.goals import HandoffDistances, object_goals
from mpvi_bt.finding.navigation.traversability import floor_obstacles, traversability
from mpvi_bt.finding.scene.occupancy_map import OccupancyMap
from mpvi_bt.ground.geometry.solids import Array, pose
from mpvi_bt.house.layout.house import House
from mpvi_bt.house.sim.world import Placement
from mpvi_bt.house.things.catalogue import Catalogue, CatalogueEntry

# What is looked for and lies about: named here, so that a catalogue that grows draws no other scenes.
KINDS = (
    "board_game", "book", "bottle", "bottle_of_olive_oil", "bowl", "box", "box_of_oatmeal", "can_of_soda", "candle",
    "carton_of_milk", "coffee_cup", "hammer", "mixing_bowl", "plate", "radio_receiver", "tennis_ball", "toy_box",
    "trash_can", "wicker_basket",
)  # fmt: skip
FOOTPRINT_M = 0.33  # of a robot with its arms tucked
_ROBOT_M = 0.45  # free floor around the robot at the start
_GRASP_M = 0.25  # free floor around a thing that lies on it
_EDGE_M = 0.12  # from the middle of a thing to the edge of what it stands on
_NEAR_M = 0.75  # what lies on furniture is so near to floor that the robot may stand on
_TOPS_M = (0.3, 1.2)  # furniture on which things stand: its height
_HEADROOM_M = 0.2  # free over a thing that stands on furniture
_DRAWS = 500


@dataclass(frozen=True, eq=False)
class Scene:
    """One search.

    Attributes:
        target: What is looked for: the name of the thing in the world.
        objects: All movable things, the target among them.
        base_pose: (3,) where the robot begins.
        room: The room that the target is in.
        hidden: Whether furniture hides it from every doorway of its room.
        on: "floor" or the fixture that it stands on.
    """

    target: str
    objects: dict[str, Placement]
    base_pose: Array
    room: str
    hidden: bool
    on: str


def draw(seed: int, house: House, catalogue: Catalogue, grid: OccupancyMap, others: int = 6) -> Scene:
    """The search of a seed: in another room than the robot's; every third target is hidden behind furniture.

    Args:
        seed: Of everything.
        house, catalogue, grid: Where, what the `KINDS` are, and the house's map.
        others: How many other things lie about, of other kinds than the target.
    """
    rng = np.random.default_rng([5, seed])
    places = _Places(house, grid)
    kinds = [KINDS[i] for i in rng.permutation(len(KINDS))]
    rooms = [room.name for room in house.rooms.values() if not room.outdoors]
    hidden = seed % 3 == 0
    for _ in range(_DRAWS):
        start_room, target_room = (rooms[i] for i in rng.choice(len(rooms), 2, replace=False))
        entry = catalogue[kinds[0]]
        found = places.hidden(target_room, rng) if hidden else places.open(target_room, entry, rng)
        start = places.robot(start_room, rng)
        if found is None or start is None:
            continue
        on, spot = found
        objects = {"target": Placement(entry, pose(spot, float(rng.uniform(-np.pi, np.pi))))}
        for k, kind in enumerate(kinds[1 : 1 + others]):
            place = places.open(rooms[rng.integers(len(rooms))], catalogue[kind], rng)
            if place is not None and np.linalg.norm(place[1][:2] - start[:2]) > 0.8:
                objects[f"other_{k}"] = Placement(catalogue[kind], pose(place[1], float(rng.uniform(-np.pi, np.pi))))
        if not places.can_be_stood_before(objects, target_room, start):
            continue
        return Scene("target", objects, start, target_room, hidden, on)
    raise AssertionError(f"no scene of seed {seed} in {_DRAWS} draws")


def _known(name: str, thing: Placement, room: str) -> Known:
    """A thing as a knowledge base has it; its box holds it however it is turned."""
    low, high = thing.entry.description.extent()
    half = np.append(np.full(2, float(np.hypot(*(high - low)[:2])) / 2), 0.0)
    bottom = thing.T_world[:3, 3]
    return Known(name, (), "object", bottom - half, bottom + half + [0.0, 0.0, float(high[2] - low[2])], room)


class _Places:
    """Where things can lie and a robot can stand."""

    def __init__(self, house: House, grid: OccupancyMap) -> None:
        self._house, self._map = house, grid
        self._clearance = ndimage.distance_transform_edt(~grid.occupied) * grid.resolution_m
        passable, _ = ndimage.label(self._clearance > 0.36)
        self._reachable = passable == np.bincount(passable[passable > 0]).argmax()
        self._to_reachable = ndimage.distance_transform_edt(~self._reachable) * grid.resolution_m
        self._taken: list[Array] = []
        self._boxes = [solid.aabb() for fixture in house.fixtures.values() for solid in fixture.solids()]

    def robot(self, room: str, rng: np.random.Generator) -> Array | None:
        """(3,) a free pose in a room."""
        cells = self._cells(room, self._reachable & (self._clearance > _ROBOT_M))
        if not len(cells):
            return None
        return np.array([*self._map.center(*cells[rng.integers(len(cells))]), rng.uniform(-np.pi, np.pi)])

    def can_be_stood_before(self, objects: Mapping[str, Placement], room: str, start: Array) -> bool:
        """Whether a robot gets from its start, past all that lies about, to where it could work on the target."""
        known = {name: _known(name, thing, room) for name, thing in objects.items()}
        grid = traversability(self._map, FOOTPRINT_M, floor_obstacles(known.values())).escaping(start[:2])
        goals = object_goals(known["target"], start[:2], grid, HandoffDistances())
        return any(np.isfinite(goal.score) for goal in goals)

    def open(self, room: str, entry: CatalogueEntry, rng: np.random.Generator) -> tuple[str, Array] | None:
        """On the floor or on furniture of a room, wherever it is."""
        low, high = entry.description.extent()
        tops = self._tops(room) if np.ptp([low, high], axis=0)[:2].max() < 0.35 else []
        if tops and rng.random() < 0.7:
            name, lowest, highest = tops[rng.integers(len(tops))]
            for _ in range(50):
                xy = rng.uniform(lowest[:2] + _EDGE_M, highest[:2] - _EDGE_M)
                spot = np.array([*xy, highest[2] + 0.002])
                near = self._to_reachable[self._map.cell(xy)] < _NEAR_M
                if near and self._free(xy) and not self._covered(spot):
                    return name, spot
        return self._on_floor(self._cells(room, self._floor()), rng)

    def hidden(self, room: str, rng: np.random.Generator) -> tuple[str, Array] | None:
        """On the floor, where furniture hides it from every doorway of the room."""
        doorways = [np.asarray(d.at, float) for d in self._house.doorways if room in d.rooms]
        cells = self._cells(room, self._floor())
        for cell in cells[rng.permutation(len(cells))][:200]:
            xy = self._map.center(*cell)
            if not any(self._sees(door, xy) for door in doorways):
                return self._on_floor(cell[None], rng)
        return None

    def _floor(self) -> Array:
        near: Array = (self._clearance > _GRASP_M) & (self._to_reachable < 0.5)
        return near

    def _on_floor(self, cells: NDArray[np.int64], rng: np.random.Generator) -> tuple[str, Array] | None:
        for cell in cells[rng.permutation(len(cells))][:50]:
            xy = self._map.center(*cell)
            if self._free(xy) and all(np.linalg.norm(xy - np.asarray(d.at)) > 0.9 for d in self._house.doorways):
                self._taken.append(xy)
                return "floor", np.array([*xy, 0.002])
        return None

    def _free(self, xy: Array) -> bool:
        return all(float(np.linalg.norm(xy - other)) > 0.6 for other in self._taken)

    def _covered(self, spot: Array) -> bool:
        """Whether something is right over a place (3,), as the worktop over a cabinet is."""
        lowest, highest = spot + [-_EDGE_M, -_EDGE_M, 0.0], spot + [_EDGE_M, _EDGE_M, _HEADROOM_M]
        return any(bool(((box[0] < highest) & (box[1] > lowest)).all()) for box in self._boxes)

    def _cells(self, room: str, mask: Array) -> NDArray[np.int64]:
        return np.argwhere((self._map.rooms == self._map.room_names.index(room)) & mask)

    def _sees(self, start: Array, end: Array) -> bool:
        """Whether the floor between two places (2,) is free but for the doorway itself."""
        n = int(np.linalg.norm(end - start) / self._map.resolution_m * 2) + 2
        points = [start + t * (end - start) for t in np.linspace(0, 1, n)]
        return not any(self._map.occupied[self._map.cell(p)] for p in points if np.linalg.norm(p - start) > 0.2)

    def _tops(self, room: str) -> list[tuple[str, Array, Array]]:
        """Name and lowest and highest corner of the highest broad face of each fixture of a height to reach."""
        tops = []
        for fixture in self._house.fixtures.values():
            if fixture.room != room:
                continue
            boxes = [solid.aabb() for solid in fixture.solids() if solid.kind == "box"]
            faces = [box for box in boxes if (np.ptp(box, axis=0)[:2] > 0.35).all()]
            if faces and _TOPS_M[0] < (top := max(faces, key=lambda box: float(box[1, 2])))[1, 2] < _TOPS_M[1]:
                tops.append((fixture.name, top[0], top[1]))
        return tops
