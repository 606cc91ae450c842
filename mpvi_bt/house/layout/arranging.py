"""Furnishes a house with the things of a start, place after place."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.ground.errors import BackendError, UserError, with_article
from mpvi_bt.ground.geometry.solids import Array, Solid, bounds, box, pose
from mpvi_bt.house.layout.boards import DROP_M, Around, Board, MovableForm, Put, balanced, floor_of, heap, put_all
from mpvi_bt.house.layout.ground import OBJECT_CLEARANCE_M, REACH_M, ROBOT_CLEARANCE_M, TWO_HANDS_REACH_M, Ground
from mpvi_bt.house.layout.house import House
from mpvi_bt.house.things.description import Description

HIGHEST_M = 1.75  # that a hand puts things down at, and takes them from
Openings = Mapping[str, Mapping[str, float]]
_SHELF_SHARE = 0.6  # of the room inside a cabinet that a solid takes up to be one of its boards, at the least


class Arrangement:
    """Things and the robot in a house, more with each call.

    Args:
        house: Where.
        names: BDDL name of each fixture and floor to the house's.
        openings: Name in the house of each fixture that is not closed to how far its joints are open, by body.
        rng: Source of the draw.

    Attributes:
        done: What has been placed, by BDDL name.
    """

    def __init__(self, house: House, names: Mapping[str, str], openings: Openings, rng: np.random.Generator) -> None:
        self.done: dict[str, Put] = {}
        self._house, self._names, self._rng = house, names, rng
        there = ((house.fixtures[n], bodies) for n, bodies in openings.items() if n in house.fixtures)
        doors = [s for f, bodies in there for s in f.entry.description.solids(f.T_world_fixture, bodies)]
        self._ground = Ground(house, doors)

    def robot(self, ground: str) -> Array:
        """(3,) a free place for the robot on a floor or lawn: x, y [m], yaw [rad].

        Raises:
            BackendError: There is none.
        """
        xy, _ = self._ground.draw(self._names[ground], 0.0, ROBOT_CLEARANCE_M, self._rng)
        return np.array([*xy, self._rng.uniform(-np.pi, np.pi)])

    def add(self, predicate: str, place: str, shapes: Mapping[str, MovableForm]) -> None:
        """Put things where they belong, such as "ontop" of "desk.n.01_1".

        Raises:
            UserError: There is nothing there to be on, in or under.
            BackendError: There is no room.
        """
        scene = self._names.get(place)
        on_fixture = scene is not None and scene in self._house.fixtures
        if scene is not None and predicate == "ontop" and self._ground.is_ground(scene):
            self._on_ground(scene, shapes)
        elif on_fixture and (boards := self._boards(predicate, str(scene))):
            self._on_fixture(str(scene), shapes, boards, shuffled=predicate == "inside")
        elif scene is None and predicate == "ontop":
            self._on_thing(self.done[place], shapes)
        elif scene is None and predicate == "inside" and self.done[place].shape.entry.description.root.volumes:
            self._in_thing(self.done[place], shapes)
        else:
            raise UserError(f"nothing can be {predicate} {with_article(place.split('.')[0])} yet")

    def _on_ground(self, ground: str, shapes: Mapping[str, MovableForm]) -> None:
        for name, shape in shapes.items():
            xy, z = self._ground.draw(ground, shape.radius, OBJECT_CLEARANCE_M, self._rng)
            spot = (float(xy[0]), float(xy[1]), z + DROP_M - float(shape.extent[0, 2]))
            self.done[name] = Put(shape, pose(spot, float(self._rng.uniform(-np.pi, np.pi))))

    def _on_fixture(
        self, fixture: str, shapes: Mapping[str, MovableForm], boards: Sequence[Board], shuffled: bool
    ) -> None:
        put = put_all(shapes, boards, self._around(fixture), self._rng, shuffled=shuffled)
        self.done.update(put)
        for thing in put.values():
            self._ground.keep_way_to(thing.T[:2, 3])

    def _on_thing(self, carrier: Put, shapes: Mapping[str, MovableForm]) -> None:
        """On a face of it that they lie on with all of them; else, such as a keyboard on a notebook, on its middle."""
        root = carrier.shape.entry.description.root
        faces = [part.solid.moved(carrier.T) for part in root.parts if part.collides]
        boards = [
            Board(face, carrier.solids, "any", False, self._ground.ahead, _anywhere) for face in faces if _level(face)
        ]
        around = self._around(None, without=carrier)
        try:
            self.done.update(put_all(shapes, sorted(boards, key=lambda board: board.rank), around, self._rng))
        except BackendError:
            for name, shape in shapes.items():
                put = balanced(shape, carrier, around, self._rng)
                if put is None:
                    raise
                self.done[name] = put
                around = [*around, put.around]

    def _in_thing(self, container: Put, shapes: Mapping[str, MovableForm]) -> None:
        """Side by side on the bottom, with room for a hand if there is; else one on the other."""
        volumes = [v.moved(container.T) for v in container.shape.entry.description.root.volumes]
        boards = [Board(floor_of(v), container.solids, "any", False, self._ground.ahead, _anywhere) for v in volumes]
        try:
            put = put_all(shapes, boards, [], self._rng)
        except BackendError:
            put = heap(shapes, volumes[0], container.solids, self._rng)
        self.done.update(put)

    def _boards(self, predicate: str, fixture: str) -> list[Board]:
        """Where on, in or under a fixture things can be, the best first."""
        it = self._house.fixtures[fixture]
        owner = list(it.solids())
        if predicate == "ontop":
            faces = [face for face in owner if _level(face) and face.aabb()[1, 2] <= HIGHEST_M]
            boards = [Board(face, owner, "free", False, self._ground.ahead, self._within_reach) for face in faces]
            return sorted(boards, key=lambda board: board.rank)
        ahead = float(np.arctan2(-it.T_world_fixture[1, 0], -it.T_world_fixture[0, 0]))
        if predicate == "inside":
            faces = [face.moved(it.T_world_fixture) for face in _inner_faces(it.entry.description)]
            return [
                Board(face, owner, "any", True, lambda spots: np.full(len(spots), ahead), self._within_reach)
                for face in faces
                if face.aabb()[1, 2] <= HIGHEST_M
            ]
        low, high = bounds(owner)
        if low[2] > DROP_M:
            return []  # it hangs on a wall
        floor = box((*(low + high)[:2] / 2, 0.0), (*(high - low)[:2], 0.0))
        return [Board(floor, owner, "covered", False, self._ground.ahead, self._within_reach)]

    def _within_reach(self, spots: Array, two_hands: bool) -> NDArray[np.bool_]:
        return self._ground.away_m(spots) < (TWO_HANDS_REACH_M if two_hands else REACH_M)

    def _around(self, fixture: str | None, without: Put | None = None) -> list[Around]:
        """All that stands in the house, without one fixture, or one thing."""
        fixed = [around for name, around in _standing(self._house).items() if name != fixture]
        return fixed + [put.around for put in self.done.values() if put is not without]


@lru_cache(maxsize=2)
def _standing(house: House) -> dict[str, Around]:
    """Walls, and each fixture by its name."""
    fixtures = {name: Around(list(fixture.solids())) for name, fixture in house.fixtures.items()}
    return {"": Around([wall.solid for wall in house.walls]), **fixtures}


def _anywhere(spots: Array, two_hands: bool) -> NDArray[np.bool_]:
    """Accept all places: things in or on another thing are as near as that thing."""
    return np.ones(len(spots), bool)


def _level(face: Solid) -> bool:
    return face.kind != "sphere" and bool(face.T[2, 2] > 1 - 1e-6)


def _inner_faces(description: Description) -> list[Solid]:
    """The bottoms of what can hold things, and the boards in between, in the frame of the fixture."""
    faces = []
    for volume in description.root.volumes:
        low, high = volume.aabb()
        faces.append(floor_of(volume))
        for part in description.root.parts:
            a, b = part.solid.aabb()
            overlap = np.prod(np.minimum(high, b)[:2] - np.maximum(low, a)[:2]) / np.prod((high - low)[:2])
            shelf = _level(part.solid) and low[2] < a[2] and b[2] < high[2] and overlap > _SHELF_SHARE
            if part.collides and shelf:
                faces.append(part.solid)
    return faces
