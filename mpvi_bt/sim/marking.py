"""Marks on the things of a world, such as dust: where they sit, who sees them, and the washers that take them."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

import numpy as np
import sapien

from mpvi_bt.goals.predicates import OPEN_FRACTION, inside
from mpvi_bt.goals.world_state import WorldState
from mpvi_bt.robot import kinematics as kin
from mpvi_bt.robot.linear_algebra import matmul, norm
from mpvi_bt.robot.solids import Array, Solid
from mpvi_bt.rules.marks import Marks, covered
from mpvi_bt.rules.washer import begins, washed
from mpvi_bt.sim.builder import show
from mpvi_bt.things.description import Color, Part

_COUNT = 24  # Our choice: marks of one kind on one thing, many enough to be seen from each side
_RADIUS_M = 0.006
_COLORS: Mapping[str, Color] = {
    "dust": (0.62, 0.6, 0.56),
    "dirt": (0.36, 0.24, 0.13),
    "mud": (0.25, 0.17, 0.1),
    "debris": (0.3, 0.3, 0.32),
}
_OTHER: Color = (0.45, 0.52, 0.3)

Solvents = Mapping[str, Collection[str]]  # of each kind that is taken those of which one is needed; empty: none is


class Marking:
    """What sits on the things of a world."""

    def __init__(self, washers: Mapping[str, Solvents]) -> None:
        """Everything is clean. `washers` take those kinds of marks off what is in them as they begin to run."""
        self._washers = dict(washers)
        self._ran = dict.fromkeys(washers, False)
        self._marks: dict[str, Marks] = {}
        self._dots: dict[tuple[str, str], sapien.Entity] = {}

    def put(self, name: str, kind: str, solids: Sequence[Solid], T_world_thing: Array) -> Array:
        """Spread marks of a kind over a thing; the same at each call.

        Returns:
            (n, 3) where they sit, in the thing's frame [m].
        """
        rng = np.random.default_rng(zlib.crc32(f"{name} {kind}".encode()))
        areas = np.array([float(np.prod(np.sort(s.half_m)[1:])) for s in solids])
        chosen = rng.choice(len(solids), _COUNT, p=areas / areas.sum())
        frame = kin.inverse(T_world_thing)
        points = np.stack([_on_surface(solids[k].moved(frame), rng) for k in chosen])
        self._marks[name] = self._marks.get(name, Marks()).with_kind(kind, points)
        return points

    def covered(self, name: str, kind: str) -> bool:
        """Whether there is a mark of a kind on a thing."""
        return covered(self._marks.get(name, Marks()), kind)

    def step(self, state: WorldState) -> None:
        """One control step later: a washer that begins to run takes what it takes off all that is in it."""
        if not self._marks:
            return
        for washer, solvents in self._washers.items():
            on = state.toggled_on(washer)
            closed = all(fraction <= OPEN_FRACTION for fraction in state.joint_fractions(washer))
            if begins(self._ran[washer], on=on, closed=closed):
                for name, marks in self._marks.items():
                    if inside(state, name, washer):
                        self._marks[name] = washed(marks, solvents)
            self._ran[washer] = on and closed

    def draw(self, scene: sapien.Scene, name: str, kind: str) -> sapien.Entity:
        """Make what cameras see of the marks of a kind on a thing."""
        color = _COLORS.get(kind.partition(".")[0], _OTHER)
        dots = [
            Part(Solid("sphere", np.full(3, _RADIUS_M), kin.transform(np.eye(3), point)), color, collides=False)
            for point in self._marks[name].points[kind]
        ]
        entity = sapien.Entity()
        entity.name = f"{name}.marks"
        show(entity, dots)
        scene.add_entity(entity)
        self._dots[name, kind] = entity
        return entity

    def show(self, pose: Callable[[str], Array]) -> None:
        """Bring what cameras see to where things are; below the floor where the marks are gone."""
        for (name, kind), entity in self._dots.items():
            T = pose(name).copy()
            if not self.covered(name, kind):
                T[2, 3] = -9.0
            entity.set_pose(sapien.Pose(T))

    def save(self) -> dict[str, Any]:
        """As JSON values; empty where nothing was marked."""
        return {
            name: {kind: points.tolist() for kind, points in marks.points.items()}
            for name, marks in self._marks.items()
        }

    def restore(self, saved: Mapping[str, Mapping[str, Any]]) -> None:
        """Bring every mark to where it was; what is marked now and not among them becomes clean."""
        self._marks = {
            name: Marks({kind: np.array(p, float).reshape(-1, 3) for kind, p in saved.get(name, {}).items()})
            for name in dict.fromkeys((*saved, *self._marks))
        }


def _on_surface(solid: Solid, rng: np.random.Generator) -> Array:
    """(3,) a random point on a box, a cylinder or a sphere."""
    if solid.kind == "sphere":
        way = rng.normal(size=3)
        p = solid.half_m * way / norm(way)
    else:
        p = rng.uniform(-1, 1, 3)
        if solid.kind == "cylinder":
            angle = rng.uniform(0, 2 * np.pi)
            p[:2] = np.cos(angle), np.sin(angle)
        else:
            axis = int(rng.choice(3, p=_faces(solid.half_m)))
            p[axis] = np.sign(p[axis]) or 1.0
        p = p * solid.half_m
    return np.asarray(matmul(solid.T[:3, :3], p) + solid.T[:3, 3])


def _faces(half_m: Array) -> Array:
    """(3,) share of a box's surface that faces along each axis."""
    areas = np.prod(half_m) / half_m
    return np.asarray(areas / areas.sum())
