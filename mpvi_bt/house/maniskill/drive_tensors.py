"""Drive commands of many r1 at once, in torch; each row equals those of one `sim.sim_robot.SimRobot`.

One environment on the CPU is a batch of one, which a `SimWorld`'s robot shares.
"""

from __future__ import annotations

from typing import TypeAlias

import sapien
import torch
from mani_skill.utils.structs import Articulation

from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.limits import BASE_ACCELERATION, travel_action
from mpvi_bt.ground.robot.protocol import CONTROL_HZ
from mpvi_bt.hands.robots.r1 import R1
from mpvi_bt.house.sim.cameras import Cameras
from mpvi_bt.house.sim.sim_robot import CLOSED_M, SimRobot

_PLACES = {name: i for i, name in enumerate(R1.torso_joints, R1.layout.torso.start) if name is not None} | {
    name: R1.layout.arm[side].start + i for side in R1.sides for i, name in enumerate(R1.arm_joints[side])
}  # those with targets of their own, to their places in an action
_FINGERS = {name: R1.layout.gripper[side] for side in R1.sides for name in R1.finger_joints[side]}
Rows: TypeAlias = torch.Tensor | slice  # which of the robots


class Drives:
    """The drives of n robots. Numbers are float64, so that a batch of one goes as the core's robot does, bit by bit.

    Attributes:
        command: (n, A) what each robot was told last, by its layout.
        base_velocity: (n, 3) that its base was told to have, in its frame [m/s, m/s, rad/s].
        robot: The robots, as soon as ManiSkill knows them; until then nothing is sent.
    """

    def __init__(self, n: int, device: torch.device) -> None:
        """`n` robots, commanded to stay in the travel posture."""
        self.command = torch.tensor(travel_action(R1), device=device).repeat(n, 1)
        self.base_velocity = torch.zeros((n, 3), dtype=torch.float64, device=device)
        self.robot: Articulation | None = None
        self._limit = torch.tensor(BASE_ACCELERATION / CONTROL_HZ, device=device)
        self._sent = torch.full_like(self.command, torch.nan)
        self._moving = True

    def take(self, robot: Articulation) -> None:
        """Take the robots as ManiSkill knows them, and send them what they have been told."""
        self.robot, joints = robot, robot.active_joints_map
        order = list(joints)
        self._posed, self._where = [joints[name] for name in _PLACES], [order.index(name) for name in _PLACES]
        self._fingers = [joints[name] for name in _FINGERS]
        self._base, self._yaw = [joints[name] for name in R1.base_joints], order.index(R1.base_joints[2])
        self.send()

    def felt(self) -> torch.Tensor:
        """(n, A) where the joints of torso and arms are [m, rad], in the places of an action; 0 in all others."""
        assert self.robot is not None
        out = torch.zeros_like(self.command)
        out[:, list(_PLACES.values())] = self.robot.get_qpos().double()[:, self._where]
        return out

    def restore(self, rows: Rows, command: torch.Tensor, base_velocity: torch.Tensor) -> None:
        """Have the drives of some robots go on from commands (m, A) and velocities (m, 3), whatever they did before.

        Args:
            rows: Which robots, ascending: those that ManiSkill resets, or all.
            command, base_velocity: As of the attributes.
        """
        self.command[rows] = command.to(self.command)
        self.base_velocity[rows] = base_velocity.to(self.command)
        self.begin_anew(rows)
        self.send(rows)

    def begin_anew(self, rows: Rows) -> None:
        """Take it that nothing has been sent to some robots."""
        self._sent[rows] = torch.nan
        if self.robot is not None:
            still = torch.zeros_like(self.base_velocity[rows])
            self.robot.set_joint_drive_velocity_targets(still.float(), self._base)

    def send(self, rows: Rows = slice(None)) -> None:
        """Send commands to the drives, once a control step: to all robots, or to those that ManiSkill resets."""
        if self.robot is None:
            return
        self._steer(rows)
        command, sent, joints, places = self.command[rows], self._sent[rows], self._posed, list(_PLACES.values())
        if not torch.equal(command[:, 3:], sent[:, 3:]):
            targets, before = command[:, places], torch.where(sent.isnan(), command, sent)[:, places]
            self.robot.set_joint_drive_targets(targets.float(), joints)
            # Without its velocity a PD drive trails a moving target by damping / stiffness = 0.1 s.
            self.robot.set_joint_drive_velocity_targets(((targets - before) * CONTROL_HZ).float(), joints)
            opened = CLOSED_M + (command[:, list(_FINGERS.values())] + 1) / 2 * (R1.hand.travel_m - CLOSED_M)
            self.robot.set_joint_drive_targets(opened.float(), self._fingers)
            self._sent[rows], self._moving = command.clone(), True
        elif self._moving:
            self.robot.set_joint_drive_velocity_targets(torch.zeros_like(command[:, places]).float(), joints)
            self._moving = False

    def _steer(self, rows: Rows) -> None:
        """Bring bases nearer to the velocity that they are told to have, within their limit of acceleration."""
        assert self.robot is not None
        velocity = self.base_velocity[rows]
        change = torch.clamp(self.command[rows, :3] - velocity, -self._limit, self._limit)
        if not change.any() and not velocity.any():
            return
        self.base_velocity[rows] = velocity = velocity + change
        yaw = self.robot.get_qpos()[rows, self._yaw].double()
        yaw = yaw + velocity[:, 2] / CONTROL_HZ / 2  # the heading midway through the step
        (vx, vy, w), c, s = velocity.T, torch.cos(yaw), torch.sin(yaw)
        told = torch.stack([c * vx - s * vy, s * vx + c * vy, w], dim=1)
        self.robot.set_joint_drive_velocity_targets(told.float(), self._base)


class DrivenR1(SimRobot):
    """The r1 of a world in the scene of one environment: what it is told is the only row of a batch."""

    def __init__(self, drives: Drives, scene: sapien.Scene, base_pose: Array, cameras: Cameras | None) -> None:
        """Put it into `scene` at `base_pose` (3,) x, y [m], yaw [rad]; its commands are those of `drives`."""
        self.drives = drives
        super().__init__(scene, base_pose, cameras, R1)

    def apply(self) -> None:
        """Send the command to the drives."""
        self.drives.send()
        self.forget()

    # `SimRobot` keeps these as attributes; in-place changes of what they return are changes of the batch.

    @property
    def _action(self) -> Array:
        row: Array = self.drives.command.numpy()[0]
        return row

    @_action.setter
    def _action(self, action: Array) -> None:
        self._action[:] = action

    @property
    def _velocity(self) -> Array:
        row: Array = self.drives.base_velocity.numpy()[0]
        return row

    @_velocity.setter
    def _velocity(self, velocity: Array) -> None:
        self._velocity[:] = velocity

    @property
    def _sent(self) -> None:
        return None

    @_sent.setter
    def _sent(self, sent: None) -> None:
        self.drives.begin_anew(slice(None))
