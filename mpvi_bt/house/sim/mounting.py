"""What is mounted on what in a world: what comes to a mount of its kind is held there by a joint that breaks."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import sapien

from mpvi_bt.finding.scene.mount_pose import Mount
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.house.goals.world_state import WorldState
from mpvi_bt.house.rules.mounts import NEAR_M, Fitting, breaks, fits
from mpvi_bt.house.sim.builder import Thing

# Our choice: a joint that tells how hard it is pulled, so it is a spring. 5 kN stretch it by 2.5 cm.
_STIFFNESS_N_M, _STIFFNESS_NM_RAD = 2e5, 2e4
_DAMPING_N_S_M, _DAMPING_NM_S_RAD = 2e2, 2e1


@dataclass(eq=False)
class _Joint:
    """What holds a child at a parent: as `between` (4, 4), of the child in the parent's frame."""

    parent: str
    between: Array
    drive: sapien.physx.PhysxDriveComponent


class Mounts:
    """What is mounted on what."""

    def __init__(
        self, scene: sapien.Scene, things: Mapping[str, Thing], fittings: Mapping[str, tuple[Fitting, ...]]
    ) -> None:
        """Nothing is mounted yet.

        Args:
            scene: Where the things are.
            things: By name.
            fittings: The mounts of each thing that has any.
        """
        self._scene, self._things, self._fittings = scene, things, dict(fittings)
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
        """One control step later: what gives way is torn off, what has come to a mount is fixed to it."""
        if not self._pairs:
            return
        for child in [name for name, joint in self._joints.items() if self._torn(name, joint)]:
            self._take_off(child)
        for child, parent, mine, theirs in self._pairs:
            apart = math.dist(self._things[child].entity.pose.p, self._things[parent].entity.pose.p)
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
        return breaks(_STIFFNESS_N_M * float(norm(off[:3, 3])), _STIFFNESS_NM_RAD * turn)

    def _fix(self, child: str, parent: str, between: Array) -> None:
        below, thing = self._things[parent], self._things[child]
        T = between if below.moves else matmul(below.T_world_body(), between)
        drive = self._scene.create_drive(
            below.root_body if below.moves else None, sapien.Pose(T), thing.root_body, sapien.Pose()
        )
        for linear in (drive.set_drive_property_x, drive.set_drive_property_y, drive.set_drive_property_z):
            linear(_STIFFNESS_N_M, _DAMPING_N_S_M)
        drive.set_drive_property_slerp(_STIFFNESS_NM_RAD, _DAMPING_NM_S_RAD)
        self._joints[child] = _Joint(parent, between, drive)

    def _take_off(self, child: str) -> None:
        self._things[child].entity.remove_component(self._joints.pop(child).drive)
