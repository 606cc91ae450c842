"""Simulator truth with errors of position: what the expert would work with if something saw for it.

It shows how far the skills depend on seeing well, apart from how well anything sees.
"""

from __future__ import annotations

import zlib
from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from mpvi_bt.executive.plan.knowledge import KnowledgeBase
from mpvi_bt.finding.shapes.moving_parts import Door
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array, Solid
from mpvi_bt.ground.robot.protocol import SIDES
from mpvi_bt.house.sim.noise import StandingError
from mpvi_bt.house.sim.world import SimWorld
from mpvi_bt.house.things.description import Handle


class MistakenTruth:
    """`mpvi_bt.house.truth.true_scene.Truth` of a world, everything a little aside.

    Each thing is off by a vector of its own, drawn anew wherever the base comes to stand; what is in hand is felt, and
    is where it is.
    """

    def __init__(self, world: SimWorld, deviation_m: float, seed: int) -> None:
        """Shift things by errors of a standard deviation along x and along y [m]; heights are true."""
        self._world = world
        self._errors = {
            name: StandingError(deviation_m, np.random.default_rng([seed, zlib.crc32(name.encode())]))
            for name in (*world.objects, *world.house.fixtures)
        }
        self._held: tuple[int, set[str]] | None = None
        self.exists, self.touching = world.exists, world.touching
        self.joint_fractions, self.toggled_on, self.heat = world.joint_fractions, world.toggled_on, world.heat
        self.covered, self.grains = world.covered, world.grains
        self.holding, self.between, self.within = world.holding, world.between, world.within

    def pose(self, name: str) -> Array:
        """T_world_thing (4, 4), off."""
        return matmul(self._off(name), self._world.pose(name))

    def solids(self, name: str) -> list[Solid]:
        """Its solids, off."""
        return [solid.moved(self._off(name)) for solid in self._world.solids(name)]

    def volumes(self, name: str) -> list[Solid]:
        """Its container volumes, off."""
        return [solid.moved(self._off(name)) for solid in self._world.volumes(name)]

    def handles(self, name: str) -> Sequence[Handle]:
        """Its handles, off."""
        return [_moved(handle, self._off(name)) for handle in self._world.handles(name)]

    def doors(self, name: str) -> Sequence[Door]:
        """Its doors, off."""
        T = self._off(name)
        return [
            replace(
                door,
                origin=door.origin + T[:3, 3],
                bar=_moved(door.bar, T) if isinstance(door.bar, Handle) else door.bar,
                solids=[solid.moved(T) for solid in door.solids],
            )
            for door in self._world.doors(name)
        ]

    def switches(self, name: str) -> Sequence[Array]:
        """Its switches, off."""
        return [matmul(self._off(name), T) for T in self._world.switches(name)]

    def obstacles(self, xy: Array, radius_m: float, without: Collection[str] = ()) -> list[Solid]:
        """Solids around a place, each thing's off like the thing; walls are where they are."""
        walls = self._world.obstacles(xy, radius_m, without=self._errors)
        solids = [s for name in self._errors if name not in without for s in self.solids(name)]
        place = np.asarray(xy, float)[:2]
        return walls + [s for s in solids if _near(s, place, radius_m)]

    def knowledge(self) -> KnowledgeBase:
        """Where everything is, off."""
        shift = {name: self._off(name)[:3, 3] for name in self._errors}
        known = self._world.knowledge()
        return KnowledgeBase(
            {
                e.name: replace(e, lowest=e.lowest + shift[e.name], highest=e.highest + shift[e.name])
                if e.name in shift
                else e
                for e in known
            }
        )

    def _off(self, name: str) -> Array:
        T = np.eye(4)
        if name in self._errors and name not in self._in_hand():
            T[:2, 3] = self._errors[name].offset(self._world.robot.proprioception())
        return T

    def _in_hand(self) -> set[str]:
        if self._held is None or self._held[0] != self._world.steps:
            held = {name for name in (*map(self._world.holding, SIDES), self._world.between()) if name is not None}
            self._held = (self._world.steps, held | {inner for name in held for inner in self._world.within(name)})
        return self._held[1]


def _moved(handle: Handle, T: Array) -> Handle:
    return replace(handle, center=handle.center + T[:3, 3])


def _near(solid: Solid, place: Array, radius_m: float) -> bool:
    low, high = solid.aabb()
    aside = norm(np.maximum(np.maximum(low[:2] - place, place - high[:2]), 0))
    return bool(aside < radius_m and high[2] > 0.005)
