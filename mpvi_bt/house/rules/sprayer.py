"""Sprayers: while one is on, rays leave the tip of its cone; what each meets first gets a mark there.

Source: OmniGibson, object_states/particle_modifier.py (ParticleApplier).
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.marked_yaml import Coordinate, Record, Synset
from mpvi_bt.house.rules.marks import Marks

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
