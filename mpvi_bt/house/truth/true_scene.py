"""The scene as the simulator knows it: what the privileged expert works with."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.executive.plan.knowledge import KnowledgeBase
from mpvi_bt.finding.scene.mount_pose import Mount
from mpvi_bt.finding.shapes.moving_parts import Bar, Door
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array, Solid
from mpvi_bt.ground.robot.collision import Surroundings, carries
from mpvi_bt.ground.robot.protocol import CameraImage, Proprioception, Side
from mpvi_bt.house.states.world_state import WorldState


@dataclass(frozen=True)
class Spots:
    """How free places on a face are searched.

    Our choice: finer than a hand is wide.
    """

    room_m: float = 2.5  # distance around the spot in which solids are looked for [m]
    grid_m: float = 0.05  # distance from one place to the next [m]
    wall_m: float = 0.01  # a solid that rises this much through a face is a wall of its own [m]
    square_rad: float = 0.05  # a face that is turned by more has a grid turned with it [rad]


_SPOT = Spots()


class Truth(WorldState, Protocol):
    """Simulator truth; `Scene` says what its answers mean."""

    def knowledge(self) -> KnowledgeBase:
        """Present places of all things; held and stored ones are marked."""
        ...

    def pose(self, name: str) -> Array:
        """T_world_thing (4, 4)."""
        ...

    def handles(self, name: str) -> Sequence[Bar]:
        """Bars to take hold of, in the world."""
        ...

    def doors(self, name: str) -> Sequence[Door]:
        """Its parts that open."""
        ...

    def switches(self, name: str) -> Sequence[Array]:
        """T_world_switch (4, 4) of each switch."""
        ...

    def mounts(self, name: str) -> Sequence[Mount]:
        """Its mounts, in the world."""
        ...

    def holding(self, side: Side) -> str | None:
        """The movable thing that the fingers of one hand hold between them."""
        ...

    def between(self) -> str | None:
        """The movable thing that both hands hold between them, pressed from its sides."""
        ...

    def within(self, name: str) -> Sequence[str]:
        """The movable things that lie in a thing's container volumes."""
        ...

    def obstacles(self, xy: Array, radius_m: float, without: Collection[str] = ()) -> list[Solid]:
        """Solids in the world of everything but the robot that come within `radius_m` of a place on the floor (2,)."""
        ...


class TrueScene:
    """The `Scene` of a simulator."""

    needs_looks = False
    pose_error_m = 0.0

    def __init__(self, truth: Truth) -> None:
        """Answer from `truth`."""
        self.truth = truth
        self.knowledge, self.pose = truth.knowledge, truth.pose
        self.solids, self.volumes = truth.solids, truth.volumes
        self.body = truth.solids
        self.handles, self.doors, self.switches = truth.handles, truth.doors, truth.switches
        self.mounts = truth.mounts
        self.holding, self.between, self.within = truth.holding, truth.between, truth.within

    def see(self, images: Mapping[str, CameraImage], felt: Proprioception) -> None:
        """Nothing is learned by looking."""

    def covered(self, places: Array, radius_m: float) -> NDArray[np.bool_]:
        """As `Scene` says: nothing looks like the floor."""
        return np.zeros(len(places), bool)

    def others(self, name: str) -> Sequence[str]:
        """As `Scene` says: everything is known by name."""
        return ()

    def trusting(self, remembering: bool = False) -> AbstractContextManager[None]:
        """As `Scene` says: nothing is hidden."""
        return nullcontext()

    def laden(self, name: str) -> bool:
        """As `Scene` says."""
        return bool(self.within(name))

    def is_on(self, name: str) -> bool:
        """As `Scene` says."""
        return self.truth.toggled_on(name)

    def obstacles(
        self, xy: Array, radius_m: float, without: Collection[str] = (), beside: str | None = None
    ) -> Surroundings:
        """As `Scene` says."""
        left_out = without if beside is None else {*without, beside}
        return Surroundings(self.truth.obstacles(xy, radius_m, left_out))

    def spots(self, surface: str, radius_m: float, height_m: float, near: Array) -> list[Array]:
        """As `Scene` says, on a grid of 5 cm about the middle of each face."""
        own = self.truth.solids(surface)
        faces = [s for s in own if s.kind != "sphere" and (s.aabb()[1] - s.aabb()[0])[:2].min() > 2 * radius_m]
        held = {n for side in ("left", "right") if (n := self.truth.holding(side)) is not None}
        carried = {m for n in held for m in (n, *self.truth.within(n))}
        others = self.truth.obstacles(near, _SPOT.room_m, without={surface, *carried})
        spots: list[Array] = []
        for face in faces:
            top = face.aabb()[1, 2]
            level = top + _SPOT.wall_m  # what rises through it is a wall of its own: a round one is nearer to its box
            walls = [f for f in own if f is not face and f.aabb()[0, 2] < level < f.aabb()[1, 2]]
            around = Surroundings(walls)
            above = [s.aabb() for s in (*others, *(f for f in own if f is not face and f not in walls))]
            blocking = [b for b in above if b[1, 2] > top + 0.005 and b[0, 2] < top + height_m]
            grid = _grid(face, radius_m)
            gaps = np.minimum.reduce([np.full(len(grid), 9.0), *(_aside(b, grid) for b in blocking)])
            if walls:
                gaps = np.minimum(gaps, around.distance(np.column_stack([grid, np.full(len(grid), level)])))
            free = np.column_stack([grid, np.full(len(grid), top)])[gaps > radius_m]
            spots += [spot for spot in free if carries(face, spot, radius_m)]
        return sorted(spots, key=lambda s: float(norm(s[:2] - near)))


def _grid(face: Solid, radius_m: float) -> Array:
    """Places (n, 2) about the middle of a face that a disc on it may be about; those of a turned box turn with it."""
    low, high = face.aabb()[:, :2]
    up = int(np.abs(face.T[2, :3]).argmax())
    a, b = (k for k in range(3) if k != up)
    yaw = float(np.arctan2(face.T[1, a], face.T[0, a]))
    if face.kind != "box" or abs((yaw + np.pi / 4) % (np.pi / 2) - np.pi / 4) < _SPOT.square_rad:
        return np.stack(np.meshgrid(*_lines(low, high, radius_m), indexing="ij"), -1).reshape(-1, 2)
    half = face.half_m[[a, b]]
    own = np.stack(np.meshgrid(*_lines(-half, half, radius_m), indexing="ij"), -1).reshape(-1, 2)
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    return np.asarray((low + high) / 2 + matmul(own, turn.T))


def _lines(low: Array, high: Array, radius_m: float) -> list[Array]:
    """Of each axis the coordinates (n,) of grid lines in a range (2,), as far from its one end as from the other."""
    lines = []
    for start, end in zip(low + radius_m, high - radius_m, strict=True):
        n = int((end - start + 1e-9) / _SPOT.grid_m)
        lines.append((start + end) / 2 + _SPOT.grid_m * (np.arange(n + 1) - n / 2))
    return lines


def _aside(box: Array, at: Array) -> Array:
    """(n,) distances [m], seen from above, of places (n, 2) to an axis-aligned box (2, 3)."""
    return np.asarray(norm(np.maximum(np.maximum(box[0, :2] - at, at - box[1, :2]), 0), axis=1))
