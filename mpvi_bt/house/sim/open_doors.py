"""The map of a house with the doors of its fixtures as they stand now: a base that ran into one would shut it."""

from __future__ import annotations

from mpvi_bt.finding.scene.occupancy_map import OccupancyMap
from mpvi_bt.house.layout.prior_map import marked
from mpvi_bt.house.sim.world import SimWorld

_STEPS = 20  # of a joint's way; a door that has moved by less stands where it stood
_SHUT = 1  # step up to which the map's closed front stands for a door


class OpenDoors:
    """Called for the map of now, for navigators that know by simulator truth; the same object while no door moves."""

    def __init__(self, grid_map: OccupancyMap, world: SimWorld) -> None:
        """Mark the open doors of `world` in `grid_map`, in which all are closed."""
        self._closed, self._world = grid_map, world
        self._jointed = [e.name for e in world.knowledge() if e.kind == "fixture" and world.joint_fractions(e.name)]
        self._stand: dict[str, tuple[int, ...]] = {}
        self._now = grid_map

    def __call__(self) -> OccupancyMap:
        """The map with the doors as they stand now."""
        stand = {
            name: steps
            for name in self._jointed
            if max(steps := tuple(round(_STEPS * f) for f in self._world.joint_fractions(name))) > _SHUT
        }
        if stand != self._stand:
            self._stand = stand
            solids = [solid for name in stand for door in self._world.doors(name) for solid in door.solids]
            self._now = marked(self._closed, solids) if solids else self._closed
        return self._now
