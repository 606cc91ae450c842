"""Marks: dust, dirt, mud or a spray that sits on things, at points of each.

Source: OmniGibson, object_states/covered.py and particle_modifier.py.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.rays import crosses
from mpvi_bt.ground.geometry.solids import Array, Solid
from mpvi_bt.house.states.in_world import ThingLike
from mpvi_bt.house.states.world_state import WorldState

_COUNT = 24  # Our choice: marks of one kind on one thing, many enough to be seen from each side
_UP = np.array([0.0, 0.0, 1.0])
_STEEPEST = 0.5  # Our choice: marks lie on what faces up by that sine or more; OmniGibson refuses what looks down
_DRAWS = 40  # of a place for each mark


@dataclass(frozen=True, eq=False)
class Marks:
    """What sits on a thing.

    Attributes:
        points: (n, 3) places of the marks in the thing's frame [m], by kind, such as "dust.n.01".
    """

    points: Mapping[str, Array] = field(default_factory=dict)

    def count(self, kind: str) -> int:
        """How many marks of a kind there are."""
        return len(self.points.get(kind, ()))

    def with_kind(self, kind: str, points: Array) -> Marks:
        """The same with other points (n, 3) of one kind."""
        return Marks({**self.points, kind: points})


def covered(marks: Marks, kind: str, grains: int = 0) -> bool:
    """Whether at least one mark of a kind is on a thing, or one of so many grains of it touches the thing."""
    return marks.count(kind) > 0 or grains > 0


class Change(Protocol):
    """What makes or takes marks: sprayers, washers, removers."""

    def step(self, state: WorldState, marks: dict[str, Marks]) -> None:
        """One control step later. `marks` are those of each thing that has, or had, any; they are changed in place."""
        ...

    def save(self) -> dict[str, Any]:
        """What it has to remember, as JSON values."""
        ...

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Go on from the saved state. Nothing has happened yet to things missing in it."""
        ...


class Marking:
    """What sits on the things of a world.

    Attributes:
        marks: Those of each thing that has, or had, any.
    """

    def __init__(self, things: Mapping[str, ThingLike], changes: Sequence[Change]) -> None:
        """Everything is clean.

        Args:
            things: All that there are, by name.
            changes: What makes or takes marks, in the order in which it does.
        """
        self._things, self._changes = things, changes
        self.marks: dict[str, Marks] = {}

    def put(self, name: str, kind: str, solids: Sequence[Solid]) -> Array:
        """Spread marks of a kind over the upper sides of `solids` of a thing, in the world; the same at each call.

        Returns:
            (n, 3) where they sit, in the thing's frame [m].
        """
        rng = np.random.default_rng(zlib.crc32(f"{name} {kind}".encode()))
        areas = np.array([float(np.prod(np.sort(s.half_m)[1:])) for s in solids])
        frame = kin.inverse(self._things[name].T_world_body())
        there = [_settled(solids, areas / areas.sum(), rng) for _ in range(_COUNT)]
        points = matmul(np.stack(there), frame[:3, :3].T) + frame[:3, 3]
        self.marks[name] = self.marks.get(name, Marks()).with_kind(kind, points)
        return points

    def covered(self, name: str, kind: str) -> bool:
        """Whether there is a mark of a kind on a thing."""
        return covered(self.marks.get(name, Marks()), kind)

    def marked(self, name: str) -> bool:
        """Whether there are marks of any kind on a thing."""
        return any(len(points) for points in self.marks.get(name, Marks()).points.values())

    def step(self, state: WorldState) -> None:
        """One control step later: running sprayers add marks, and removers and washers take marks away."""
        for change in self._changes:
            change.step(state, self.marks)

    def save(self) -> dict[str, Any]:
        """As JSON values; empty where nothing was marked and nothing sprays."""
        told = {"on": {n: {kind: points.tolist() for kind, points in m.points.items()} for n, m in self.marks.items()}}
        for change in reversed(self._changes):
            told |= change.save()
        return {key: value for key, value in told.items() if value}

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Restore every saved mark. Things marked now but not in `saved` become clean."""
        marks = saved.get("on", {})
        self.marks = {
            name: Marks({kind: np.array(p, float).reshape(-1, 3) for kind, p in marks.get(name, {}).items()})
            for name in dict.fromkeys((*marks, *self.marks))
        }
        for change in self._changes:
            change.restore(saved)


def _settled(solids: Sequence[Solid], shares: Array, rng: np.random.Generator) -> Array:
    """(3,) a random point for a mark that falls from above: on an upper side, with no other solid above."""
    for _ in range(_DRAWS):
        k = int(rng.choice(len(solids), p=shares))
        point, normal = _on_surface(solids[k], rng)
        others = [solid for i, solid in enumerate(solids) if i != k]
        if normal[2] > _STEEPEST and not crosses(others, point, _UP, 1.0):
            break
    return point


def _on_surface(solid: Solid, rng: np.random.Generator) -> tuple[Array, Array]:
    """(3,) a random point on a box, a cylinder or a sphere, and (3,) the way out there."""
    if solid.kind == "sphere":
        out = rng.normal(size=3)
        out = out / norm(out)
        p = solid.half_m * out
    else:
        p, out = rng.uniform(-1, 1, 3), np.zeros(3)
        axis = int(rng.choice(3, p=_faces(solid.half_m)))
        if solid.kind == "cylinder":
            angle = rng.uniform(0, 2 * np.pi)
            ring = np.array([np.cos(angle), np.sin(angle)])
            p[:2] = ring if axis < 2 else ring * np.sqrt(rng.uniform())
            out[:2] = ring if axis < 2 else 0.0
        if solid.kind == "box" or axis == 2:
            p[axis] = out[axis] = 1.0 if p[axis] >= 0 else -1.0
        p = p * solid.half_m
    R = solid.T[:3, :3]
    return np.asarray(matmul(R, p) + solid.T[:3, 3]), np.asarray(matmul(R, out))


def _faces(half_m: Array) -> Array:
    """(3,) share of a box's surface that faces along each axis."""
    areas = np.prod(half_m) / half_m
    return np.asarray(areas / areas.sum())
