"""How hard the robot bumps into the house: a measurement for benchmarks and tests, nothing that the robot feels."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping

import numpy as np
import sapien

from mpvi_bt.ground.geometry.linear_algebra import norm


class Bumps:
    """The largest force [N] between robot and each thing, over all physics steps since it was made.

    Contacts of what it grips and of the floor under its wheels are none: only `things` are looked at.

    Attributes:
        forces: By name of the thing; what was never touched is not in it.
        seconds: Wall time that measuring took.
    """

    def __init__(
        self,
        scene: sapien.Scene,
        robot: Iterable[sapien.Entity],
        things: Mapping[str, Iterable[sapien.Entity]],
        step_s: float,
    ) -> None:
        self._scene, self._step_s = scene, step_s
        self._robot = {entity.per_scene_id for entity in robot}
        self._things = {entity.per_scene_id: name for name, entities in things.items() for entity in entities}
        self.forces: dict[str, float] = {}
        self.seconds = 0.0

    @property
    def worst(self) -> float:
        """The largest of all [N]; 0 where nothing was touched."""
        return max(self.forces.values(), default=0.0)

    def update(self) -> None:
        """Take in the contacts of the last physics step."""
        began = time.perf_counter()
        now: dict[str, float] = {}
        for contact in self._scene.get_contacts():
            first, second = (body.entity.per_scene_id for body in contact.bodies)
            ids = (first, second) if first in self._robot else (second, first)
            if ids[0] in self._robot and (name := self._things.get(ids[1])) is not None:
                impulse = np.sum([p.impulse for p in contact.points], axis=0) if contact.points else np.zeros(3)
                now[name] = now.get(name, 0.0) + float(norm(impulse)) / self._step_s
        for name, force in now.items():
            if force > 0.0:
                self.forces[name] = max(force, self.forces.get(name, 0.0))
        self.seconds += time.perf_counter() - began
