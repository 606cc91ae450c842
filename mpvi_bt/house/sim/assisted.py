"""Assisted grasping, a setting: what both fingers of a closing hand touch is fixed to the hand until it opens.

As in BEHAVIOR, where it is the usual setting. It is off unless asked for, and results name it: a grasp that would slip
does not.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import sapien

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.ground.robot.protocol import Side
from mpvi_bt.house.sim.builder import Thing
from mpvi_bt.house.sim.sim_robot import SimRobot


class Attachments:
    """Things fixed to the hands."""

    def __init__(self, scene: sapien.Scene, robot: SimRobot, objects: Mapping[str, Thing]) -> None:
        """Nothing is fixed yet.

        Args:
            scene: Where both are.
            robot: Whose hands these are.
            objects: What can be fixed to them, by name.
        """
        self._scene, self._robot, self._objects = scene, robot, objects
        self._fixed: dict[Side, tuple[Thing, sapien.physx.PhysxDriveComponent]] = {}

    def step(self, pinched: Callable[[Side], Sequence[str]]) -> None:
        """Fix what a closing hand pinches to the hand; let go of it when the hand is told to open."""
        for side in self._robot.model.sides:
            if self._robot.gripper_command[side] >= 0:
                self._let_go(side)
            elif side not in self._fixed and (names := pinched(side)):
                self._attach(side, self._objects[names[0]])

    def lose(self, name: str) -> None:
        """Let go of a thing that is no more: it was cut up."""
        for side in self._robot.model.sides:
            if side in self._fixed and self._fixed[side][0].name == name:
                self._let_go(side)

    def release(self) -> None:
        """Let go of everything."""
        for side in self._robot.model.sides:
            self._let_go(side)

    def _attach(self, side: Side, thing: Thing) -> None:
        """Fix a thing to a hand as they stand."""
        hand = self._robot.links[self._robot.physics.hand_links[side]]
        T_world_hand = hand.entity.pose.to_transformation_matrix().astype(float)
        T_hand_thing = matmul(kin.inverse(T_world_hand), thing.T_world_body())
        drive = self._scene.create_drive(hand, sapien.Pose(T_hand_thing), thing.root_body, sapien.Pose())
        for limit in (drive.set_limit_x, drive.set_limit_y, drive.set_limit_z, drive.set_limit_twist):
            limit(0.0, 0.0)
        drive.set_limit_cone(0.0, 0.0)
        self._fixed[side] = (thing, drive)

    def _let_go(self, side: Side) -> None:
        if side in self._fixed:
            thing, drive = self._fixed.pop(side)
            thing.entity.remove_component(drive)
