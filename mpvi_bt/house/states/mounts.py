"""Mounts: a thing that is brought close to a mount of its kind is fixed to it, until something tears it off.

Source: OmniGibson, object_states/attached_to.py.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from mpvi_bt.finding.scene.mount_pose import Mount
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.marked_yaml import Coordinate, Record
from mpvi_bt.house.states.in_world import Springs, ThingLike
from mpvi_bt.house.states.world_state import WorldState

Axis = Literal["x", "-x", "y", "-y", "z", "-z"]
_AXES: Mapping[Axis, Array] = {
    "x": np.array([1.0, 0, 0]), "-x": np.array([-1.0, 0, 0]),
    "y": np.array([0.0, 1, 0]), "-y": np.array([0.0, -1, 0]),
    "z": np.array([0.0, 0, 1]), "-z": np.array([0.0, 0, -1]),
}  # fmt: skip
NEAR_M, NEAR_RAD = 0.05, float(np.deg2rad(15.0))
BREAKS_N, BREAKS_NM = 5e3, 1e4
# Our choice: a joint that tells how hard it is pulled, so it is a spring. 5 kN stretch it by 2.5 cm.
_LINEAR, _ANGULAR = np.array([2e5, 2e2]), np.array([2e4, 2e1])  # stiffness [N/m, N m/rad] and damping


class Fitting(Record):
    """A mount as the catalogue has it.

    Attributes:
        kind: Of the pair, such as "wall_nail".
        male: Whether it is the child's, which comes to hang on or stand on the other.
        at: (3,) in the thing's frame [m].
        facing: The axis of the thing's frame that looks away from what bears it: a child comes from there.
        up: Another one, that is turned alike on both once they are mounted.
    """

    kind: str
    male: bool = False
    at: tuple[Coordinate, Coordinate, Coordinate]
    facing: Axis = "x"
    up: Axis = "z"

    def pose(self, T_world_thing: Array) -> Array:
        """(4, 4) the mount in the world: x as it faces, z up."""
        x, z = _AXES[self.facing], _AXES[self.up]
        T = np.eye(4)
        T[:3, :3] = np.stack([x, np.cross(z, x), z], axis=1)
        T[:3, 3] = self.at
        return matmul(T_world_thing, T)


def fits(child: Mount, parent: Mount, contact: bool) -> bool:
    """Whether a child is fixed to a parent now: they touch, their mounts are a free pair, close and turned alike."""
    if not (contact and child.kind == parent.kind and child.male and not parent.male and child.free and parent.free):
        return False
    off = float(norm(child.pose[:3, 3] - parent.pose[:3, 3]))
    turn = matmul(child.pose[:3, :3].T, parent.pose[:3, :3])
    angle = float(np.arccos(np.clip((np.trace(turn) - 1) / 2, -1.0, 1.0)))
    return off <= NEAR_M and angle <= NEAR_RAD


def breaks(force_n: float, torque_nm: float) -> bool:
    """Whether the joint between two mounts gives way."""
    return force_n > BREAKS_N or torque_nm > BREAKS_NM


@dataclass(eq=False)
class _Joint:
    """What holds a child at a parent: as `between` (4, 4), of the child in the parent's frame."""

    parent: str
    between: Array


class Mounts:
    """Things mounted on other things."""

    def __init__(
        self, springs: Springs, things: Mapping[str, ThingLike], fittings: Mapping[str, tuple[Fitting, ...]]
    ) -> None:
        """Nothing is mounted yet.

        Args:
            springs: What can tie one thing to another.
            things: By name.
            fittings: The mounts of each thing that has any.
        """
        self._springs, self._things, self._fittings = springs, things, dict(fittings)
        self._pairs = [
            (child, parent, mine, theirs)
            for child, own in fittings.items()
            if things[child].movable
            for parent, others in fittings.items()
            if parent != child
            for mine in own
            for theirs in others
            if mine.male and not theirs.male and mine.kind == theirs.kind
        ]
        self._joints: dict[str, _Joint] = {}

    def attached(self, child: str, parent: str) -> bool:
        """Whether a thing is mounted on another one."""
        return child in self._joints and self._joints[child].parent == parent

    def step(self, state: WorldState) -> None:
        """One control step later: overloaded mounts break, and things that have come to a mount are fixed to it."""
        if not self._pairs:
            return
        for child in [name for name, joint in self._joints.items() if self._torn(name, joint)]:
            self._take_off(child)
        for child, parent, mine, theirs in self._pairs:
            apart = math.dist(self._things[child].origin, self._things[parent].origin)
            if child in self._joints or apart > NEAR_M + math.hypot(*mine.at) + math.hypot(*theirs.at):
                continue
            male, female = self._mount(child, mine), self._mount(parent, theirs)
            if norm(male.pose[:3, 3] - female.pose[:3, 3]) <= NEAR_M and fits(
                male, female, state.touching(child, parent)
            ):
                self._fix(child, parent, self._between(child, parent))

    def save(self) -> dict[str, Any]:
        """As JSON values: of each child its parent, and how it is held there; empty where nothing is mounted."""
        return {c: {"parent": j.parent, "between": j.between.ravel().tolist()} for c, j in self._joints.items()}

    def restore(self, saved: Mapping[str, Mapping[str, Any]]) -> None:
        """Mount what was mounted and nothing else; the things themselves stand already as they did."""
        for child in list(self._joints):
            self._take_off(child)
        for child, joint in saved.items():
            self._fix(child, joint["parent"], np.array(joint["between"], float).reshape(4, 4))

    def of(self, name: str) -> list[Mount]:
        """The mounts of a thing, as it stands."""
        return [self._mount(name, fitting) for fitting in self._fittings.get(name, ())]

    def _mount(self, name: str, fitting: Fitting) -> Mount:
        taken = name in self._joints if fitting.male else any(j.parent == name for j in self._joints.values())
        pose = fitting.pose(self._things[name].T_world_body())
        return Mount(fitting.kind, fitting.male, pose, free=not taken)

    def _between(self, child: str, parent: str) -> Array:
        return matmul(kin.inverse(self._things[parent].T_world_body()), self._things[child].T_world_body())

    def _torn(self, child: str, joint: _Joint) -> bool:
        off = matmul(kin.inverse(joint.between), self._between(child, joint.parent))
        turn = float(np.arccos(np.clip((np.trace(off[:3, :3]) - 1) / 2, -1.0, 1.0)))
        return breaks(_LINEAR[0] * float(norm(off[:3, 3])), _ANGULAR[0] * turn)

    def _fix(self, child: str, parent: str, between: Array) -> None:
        self._springs.tie(child, parent, between, _LINEAR, _ANGULAR)
        self._joints[child] = _Joint(parent, between)

    def _take_off(self, child: str) -> None:
        del self._joints[child]
        self._springs.untie(child)
