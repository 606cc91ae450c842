"""Marks on the things of a world, such as dust: where they sit, who sees them, what makes them and takes them."""

from __future__ import annotations

import math
import zlib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
import sapien

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.rays import crosses, interval
from mpvi_bt.ground.geometry.solids import Array, Solid
from mpvi_bt.house.goals.predicates import OPEN_FRACTION, inside
from mpvi_bt.house.goals.world_state import WorldState
from mpvi_bt.house.rules.marks import Marks, Remover, covered, wiped
from mpvi_bt.house.rules.sprayer import EVERY_STEPS, Sprayer, sprayed
from mpvi_bt.house.rules.washer import begins, washed
from mpvi_bt.house.sim.builder import Thing, show
from mpvi_bt.house.things.description import Color, Part

_COUNT = 24  # Our choice: marks of one kind on one thing, many enough to be seen from each side
_RADIUS_M = 0.006
_LUMP_M = (0.03, 0.03, 0.004)  # half sizes of one on a floor
_COLORS: Mapping[str, Color] = {
    "dust": (0.62, 0.6, 0.56),
    "dirt": (0.36, 0.24, 0.13),
    "mud": (0.25, 0.17, 0.1),
    "debris": (0.3, 0.3, 0.32),
}
_OTHER: Color = (0.45, 0.52, 0.3)

Solvents = Mapping[str, Collection[str]]  # of each kind that is taken those of which one is needed; empty: none is
_UP = np.array([0.0, 0.0, 1.0])
_STEEPEST = 0.5  # Our choice: marks lie on what faces up by that sine or more; OmniGibson refuses what looks down
_DRAWS = 40  # of a place for each mark


@dataclass(frozen=True)
class MarkTools:
    """What changes marks, by the names of things.

    Attributes:
        washers: They take those kinds off what is in them as they begin to run.
        removers: They take those kinds off what comes into the box about them.
        sprays: While they are on they make marks.
    """

    washers: Mapping[str, Solvents] = field(default_factory=dict)
    removers: Mapping[str, Solvents] = field(default_factory=dict)
    sprays: Mapping[str, Sprayer] = field(default_factory=dict)


class Marking:
    """What sits on the things of a world."""

    def __init__(self, things: Mapping[str, Thing], tools: MarkTools) -> None:
        """Everything is clean. `things` are all that there are, by name."""
        self._things, self._tools = things, tools
        self._ran = dict.fromkeys(tools.washers, False)
        self._marks: dict[str, Marks] = {}
        self._removers: dict[str, Remover] = {}
        self._boxes: dict[str, Array] = {}
        for name, solvents in tools.removers.items():
            low, high = things[name].description.extent(visible=True)
            self._removers[name] = Remover(solvents, tuple(((high - low) / 2).tolist()))
            self._boxes[name] = kin.transform(np.eye(3), (low + high) / 2)
        self._steps = 0
        self._reaches_m: dict[str, float] = {}
        self._dots: dict[tuple[str, str], tuple[sapien.Entity, Array]] = {}

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
        self._marks[name] = self._marks.get(name, Marks()).with_kind(kind, points)
        return points

    def covered(self, name: str, kind: str) -> bool:
        """Whether there is a mark of a kind on a thing."""
        return covered(self._marks.get(name, Marks()), kind)

    def marked(self, name: str) -> bool:
        """Whether there are marks of any kind on a thing."""
        return any(len(points) for points in self._marks.get(name, Marks()).points.values())

    def step(self, state: WorldState) -> None:
        """One control step later: sprayers that are on have sprayed, removers and washers have taken what they take."""
        if self._tools.sprays:
            self._spray(state)
        if not self._marks:
            return
        self._wash(state)
        for name, remover in self._removers.items():
            self._removers[name] = self._wipe(name, remover)

    def _wash(self, state: WorldState) -> None:
        for washer, solvents in self._tools.washers.items():
            on = state.toggled_on(washer)
            closed = all(fraction <= OPEN_FRACTION for fraction in state.joint_fractions(washer))
            if begins(self._ran[washer], on=on, closed=closed):
                for name, marks in self._marks.items():
                    if inside(state, name, washer):
                        self._marks[name] = washed(marks, solvents)
            self._ran[washer] = on and closed

    def _wipe(self, name: str, remover: Remover) -> Remover:
        frame = kin.inverse(matmul(self._things[name].T_world_body(), self._boxes[name]))
        wet = [kind for kind, points in self._marks.get(name, Marks()).points.items() if len(points)]
        for marked, marks in self._marks.items():
            if marked != name and any(remover.takes(kind, wet) for kind, points in marks.points.items() if len(points)):
                T = matmul(frame, self._things[marked].T_world_body())
                self._marks[marked], remover = wiped(marks, remover, T, wet)
        return remover

    def _spray(self, state: WorldState) -> None:
        self._steps += 1
        for name, sprayer in self._tools.sprays.items():
            if self._steps % EVERY_STEPS or not state.toggled_on(name):
                continue
            seed = np.random.default_rng((zlib.crc32(name.encode()), self._steps))
            ends = sprayer.rays(True, self._steps, seed)
            T = matmul(self._things[name].T_world_body(), kin.transform(np.eye(3), np.array(sprayer.at)))
            for end in matmul(ends, T[:3, :3].T):
                met = self._met(name, T[:3, 3], end)
                if met is not None:
                    thing, at = met
                    frame = kin.inverse(self._things[thing].T_world_body())
                    point = matmul(frame[:3, :3], at) + frame[:3, 3]
                    self._marks[thing] = sprayed(self._marks.get(thing, Marks()), sprayer.kind, point[None])

    def _met(self, sprayer: str, tip: Array, ray: Array) -> tuple[str, Array] | None:
        """What a ray (3,) from a tip meets first, and where."""
        length = float(norm(ray))
        first: tuple[float, str] | None = None
        for name, thing in self._things.items():
            if name == sprayer or math.dist(thing.entity.pose.p, tip) > length + self._reach_m(name):
                continue
            for solid in thing.solids():
                if math.dist(solid.T[:3, 3], tip) > length + math.hypot(*solid.half_m):
                    continue
                span = interval(solid, tip, ray / length)
                if span is not None and span[1] >= 0.0 and span[0] <= length and (first is None or span[0] < first[0]):
                    first = (max(span[0], 0.0), name)
        return None if first is None else (first[1], tip + ray / length * first[0])

    def _reach_m(self, name: str) -> float:
        """How far any part of a thing can be from its origin."""
        if name not in self._reaches_m:
            description = self._things[name].description
            swings = 2.0 if description.jointed else 1.0
            self._reaches_m[name] = swings * float(norm(np.abs(description.extent()).max(0)))
        return self._reaches_m[name]

    def show(self, scene: sapien.Scene) -> dict[int, str]:
        """Bring what cameras see to where things are, as many dots as there are marks.

        Returns:
            Scene ids of dots that are new, to the names of what they are on.
        """
        new = {}
        for name, marks in self._marks.items():
            for kind, points in marks.points.items():
                entity, drawn = self._dots.get((name, kind), (None, np.zeros((0, 3))))
                if points is not drawn:
                    if entity is not None:
                        scene.remove_entity(entity)
                        del self._dots[name, kind]
                    if len(points):
                        self._dots[name, kind] = (self._drawn(scene, name, kind, points), points)
                        new[self._dots[name, kind][0].per_scene_id] = name
        for name, kind in [key for key in self._dots if not self.covered(*key)]:
            scene.remove_entity(self._dots.pop((name, kind))[0])
        for (name, _), (entity, _) in self._dots.items():
            entity.set_pose(sapien.Pose(self._things[name].T_world_body()))
        return new

    def _drawn(self, scene: sapien.Scene, name: str, kind: str, points: Array) -> sapien.Entity:
        color = _COLORS.get(kind.partition(".")[0], _OTHER)
        flat = np.array(_LUMP_M) if name.startswith("floor_") else np.full(3, _RADIUS_M)
        form: Literal["cylinder", "sphere"] = "cylinder" if name.startswith("floor_") else "sphere"
        dots = [Part(Solid(form, flat, kin.transform(np.eye(3), point)), color, collides=False) for point in points]
        entity = sapien.Entity()
        entity.name = f"{name}.marks"
        show(entity, dots)
        scene.add_entity(entity)
        return entity

    def save(self) -> dict[str, Any]:
        """As JSON values; empty where nothing was marked and nothing sprays."""
        marks = {n: {kind: points.tolist() for kind, points in m.points.items()} for n, m in self._marks.items()}
        taken = {name: dict(remover.taken) for name, remover in self._removers.items() if remover.taken}
        told = {"on": marks, "taken": taken, "steps": self._steps}
        return {key: value for key, value in told.items() if value}

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Bring every mark to where it was; what is marked now and not among them becomes clean."""
        marks, taken = saved.get("on", {}), saved.get("taken", {})
        self._marks = {
            name: Marks({kind: np.array(p, float).reshape(-1, 3) for kind, p in marks.get(name, {}).items()})
            for name in dict.fromkeys((*marks, *self._marks))
        }
        self._removers = {n: replace(remover, taken=dict(taken.get(n, {}))) for n, remover in self._removers.items()}
        self._steps = int(saved.get("steps", 0))


def _settled(solids: Sequence[Solid], shares: Array, rng: np.random.Generator) -> Array:
    """(3,) a random point where what falls from above comes to lie: on an upper side, with no other solid above."""
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
