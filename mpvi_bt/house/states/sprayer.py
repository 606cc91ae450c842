"""Sprayers: while one is on, rays leave the tip of its cone; what each meets first gets a mark there.

Source: OmniGibson, object_states/particle_modifier.py (ParticleApplier).
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Mapping
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.rays import interval
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.marked_yaml import Coordinate, Record, Synset
from mpvi_bt.house.states.in_world import ThingLike
from mpvi_bt.house.states.marks import Marks
from mpvi_bt.house.states.world_state import WorldState

EVERY_STEPS = 5
MARKS_AT_ONCE = 2


class Sprayer(Record):
    """What sprays along its x axis.

    Attributes:
        kind: Of the marks that it makes, such as "pesticide.n.01".
        at: (3,) of the tip of its cone in the thing's frame [m].
        length_m, radius_m: Of the cone, from the tip along x to the middle of the base, and of the base.
    """

    kind: Synset
    at: tuple[Coordinate, Coordinate, Coordinate]
    length_m: Annotated[float, Field(gt=0, le=5)] = 0.6
    radius_m: Annotated[float, Field(gt=0, le=2)] = 0.15

    def rays(self, on: bool, step: int, rng: np.random.Generator) -> Array:
        """(n, 3) where rays from the tip end on the base in this step, in the cone's frame [m]; n may be 0."""
        if not on or step % EVERY_STEPS:
            return np.zeros((0, 3))
        angle = rng.uniform(0, 2 * np.pi, MARKS_AT_ONCE)
        r = self.radius_m * np.sqrt(rng.uniform(0, 1, MARKS_AT_ONCE))  # evenly over the disc
        return np.stack([np.full(MARKS_AT_ONCE, self.length_m), r * np.cos(angle), r * np.sin(angle)], -1)


def sprayed(marks: Marks, kind: str, points: Array) -> Marks:
    """What is on a thing once rays met it at points (n, 3) in its frame."""
    if not len(points):
        return marks
    return marks.with_kind(kind, np.concatenate([marks.points.get(kind, np.zeros((0, 3))), points]))


class Spraying:
    """What the sprayers of a world do."""

    def __init__(self, things: Mapping[str, ThingLike], sprayers: Mapping[str, Sprayer]) -> None:
        """Nothing is sprayed yet. `things` has all things by name, `sprayers` the spraying ones."""
        self._things, self._sprayers = things, sprayers
        self._steps = 0
        self._reaches_m: dict[str, float] = {}

    def step(self, state: WorldState, marks: dict[str, Marks]) -> None:
        """One control step later."""
        if not self._sprayers:
            return
        self._steps += 1
        for name, sprayer in self._sprayers.items():
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
                    marks[thing] = sprayed(marks.get(thing, Marks()), sprayer.kind, point[None])

    def save(self) -> dict[str, Any]:
        """The steps so far, as JSON values."""
        return {"steps": self._steps}

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Go on at the step that was saved."""
        self._steps = int(saved.get("steps", 0))

    def _met(self, sprayer: str, tip: Array, ray: Array) -> tuple[str, Array] | None:
        """The first thing hit by a ray (3,) from a tip, and the point of the hit."""
        length = float(norm(ray))
        first: tuple[float, str] | None = None
        for name, thing in self._things.items():
            if name == sprayer or math.dist(thing.origin, tip) > length + self._reach_m(name):
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
