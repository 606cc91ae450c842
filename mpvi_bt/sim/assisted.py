"""Assisted grasping, a setting: what both fingers of a closing hand touch is fixed to the hand until it opens.

As in BEHAVIOR, where it is the usual setting. It is off unless asked for, and results name it: a grasp that would slip
does not.
"""

from __future__ import annotations

import sapien

from mpvi_bt.robot import kinematics as kin
from mpvi_bt.robot.protocol import Side
from mpvi_bt.sim.builder import Thing


class Attachments:
    """What is fixed to which hand."""

    def __init__(self, scene: sapien.Scene) -> None:
        self._scene = scene
        self._fixed: dict[Side, tuple[Thing, sapien.physx.PhysxDriveComponent]] = {}

    def of(self, side: Side) -> str | None:
        """The thing that is fixed to a hand."""
        return self._fixed[side][0].name if side in self._fixed else None

    def attach(self, side: Side, hand: sapien.physx.PhysxArticulationLinkComponent, thing: Thing) -> None:
        """Fix a movable thing to a hand as they stand."""
        T_world_hand = hand.entity.pose.to_transformation_matrix().astype(float)
        T_hand_thing = kin.inverse(T_world_hand) @ thing.T_world_body()
        drive = self._scene.create_drive(hand, sapien.Pose(T_hand_thing), thing.root_body, sapien.Pose())
        for limit in (drive.set_limit_x, drive.set_limit_y, drive.set_limit_z, drive.set_limit_twist):
            limit(0.0, 0.0)
        drive.set_limit_cone(0.0, 0.0)
        self._fixed[side] = (thing, drive)

    def release(self, side: Side) -> None:
        """Let go of what is fixed to a hand; nothing if nothing is."""
        if side in self._fixed:
            thing, drive = self._fixed.pop(side)
            thing.entity.remove_component(drive)
