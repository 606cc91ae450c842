"""How hard the robot, and what it carries, runs into things."""

from __future__ import annotations

import numpy as np

from mpvi_bt.robot.solids import Array
from mpvi_bt.sim.world import World


class Bumps:
    """Records the forces between the robot with its load and everything else, at every step of physics.

    The floor does not count, nor what the hands hold. Manipulation touches things on purpose: watch drives only.

    Attributes:
        worst_n: The largest force [N] that each thing has met since the last `forget`, by name: the sum over all of the
            thing's contacts with the robot, or with its load, in one step of physics.
    """

    def __init__(self, world: World) -> None:
        """Begin to watch `world`; it has one watcher at a time."""
        self._world = world
        self._held: tuple[int, set[str]] = (-1, set())
        self.worst_n: dict[str, float] = {}
        world.after_physics = self._look

    @property
    def peak_n(self) -> float:
        """The largest of all forces [N]."""
        return max(self.worst_n.values(), default=0.0)

    def forget(self) -> None:
        """Begin anew."""
        self.worst_n = {}

    def _look(self) -> None:
        if self._held[0] != self._world.steps:
            self._held = (self._world.steps, {e.name for e in self._world.knowledge() if e.held})
        ours = {"robot"} | self._held[1]
        sums: dict[str, Array] = {}
        for first, second, force in self._world.contacts():
            if (first in ours) == (second in ours):
                continue
            name = second if first in ours else first
            if not name.startswith("floor_"):
                sums[name] = sums.get(name, np.zeros(3)) + (force if first in ours else -force)
        for name, force in sums.items():
            self.worst_n[name] = max(self.worst_n.get(name, 0.0), float(np.linalg.norm(force)))
