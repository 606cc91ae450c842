"""The r1 as a ManiSkill agent: its cameras, and controllers that send the same drives the same commands as the core's.

Actions, commands and joints are batches, a row an environment; only a hand's closed-form inverse is worked out row by
row, on the CPU.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import sapien
import torch
from gymnasium import spaces
from mani_skill.agents.base_agent import BaseAgent
from mani_skill.agents.controllers.base_controller import BaseController, ControllerConfig
from mani_skill.agents.registration import register_agent
from mani_skill.envs.scene import ManiSkillScene
from mani_skill.sensors.camera import CameraConfig
from scipy.spatial.transform import Rotation

from mpvi_bt.ground.errors import BackendError
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.limits import extremes
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, SIDES, Side
from mpvi_bt.hands.robots import r1
from mpvi_bt.house.maniskill.drive_tensors import DrivenR1, Drives
from mpvi_bt.house.maniskill.scene_views import SHADERS, adopt_articulation, register_shaders
from mpvi_bt.house.sim.sim_robot import load_robot

# Our choice: what a delta of 1 is. Joints: what they do in a step at the speed that motions are planned with.
_TORSO_STEP = r1.TORSO_SPEED / CONTROL_HZ
_ARM_STEP = r1.ARM_SPEED / CONTROL_HZ
_LAYOUT = r1.R1.layout
_BASE = [i for i in _LAYOUT.base if i is not None]
_STEP = np.zeros(_LAYOUT.size)
_STEP[_LAYOUT.torso] = _TORSO_STEP
for _part in _LAYOUT.arm.values():
    _STEP[_part] = _ARM_STEP
_AHEAD = 5.0  # steps that targets may be ahead of joints: what is in the way would else have them run on
_HAND_STEP_M, _HAND_STEP_RAD = 0.5 / CONTROL_HZ, 1.5 / CONTROL_HZ


@dataclass
class R1ControllerConfig(ControllerConfig):  # type: ignore[misc]  # mani_skill is untyped
    """A controller of all joints.

    Attributes:
        drives: What commands go to.
        controller_cls: What carries it out.
    """

    drives: Drives
    controller_cls: type[BaseController] = BaseController


class PositionController(BaseController):  # type: ignore[misc]
    """Actions of 23 numbers in the order and units of the r1's layout: what `Robot.act` takes."""

    config: R1ControllerConfig
    sets_target_qpos = True
    sets_target_qvel = True
    lowest, highest = extremes(r1.R1)

    def set_drive_property(self) -> None:
        """Nothing: drives have their gains from the start."""

    def set_action(self, action: torch.Tensor) -> None:
        """Send the drives what the actions (n, size) ask for."""
        asked = self._preprocess_action(action).double()
        if not torch.isfinite(asked).all():
            raise BackendError(f"an action that is not finite was given: {asked.tolist()}")
        drives = self.config.drives
        command = self.command(drives, asked.clip(_like(asked, self.lowest), _like(asked, self.highest)))
        drives.command[:] = command.clip(*(_like(asked, limit) for limit in extremes(r1.R1)))
        drives.send()

    def command(self, drives: Drives, action: torch.Tensor) -> torch.Tensor:
        """(n, A) the robots' commands for an action (n, size) of this controller.

        Who drives a robot as a `Robot` has told it already, with all digits: then that stands, not what is left of it
        in ManiSkill's float32.
        """
        told = (drives.command.float() == action.float()).all(dim=1, keepdim=True)
        return torch.where(told, drives.command, action)

    def get_state(self) -> dict[str, torch.Tensor]:
        """The commands (n, A), and the velocities (n, 3) that the bases were told to have."""
        drives = self.config.drives
        return {"command": drives.command.float(), "base_velocity": drives.base_velocity.float()}

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Have the drives go on from a state: of all robots, or of those that ManiSkill resets."""
        rows = self.scene._reset_mask.nonzero().flatten()
        self.config.drives.restore(rows, *(torch.as_tensor(state[key]) for key in ("command", "base_velocity")))

    def _initialize_action_space(self) -> None:
        low, high = np.float32(self.lowest), np.float32(self.highest)
        self.single_action_space = spaces.Box(low, high, dtype=np.float32)


class DeltaController(PositionController):
    """Actions of 23 numbers, -1 to 1: shares of the base's top speeds, steps of the targets of torso and arms, grippers
    from -1 closed to 1 open.

    Steps are from the last target, as drives are told its speed too: from where the joints are they would run away.
    """

    lowest, highest = -np.ones(_LAYOUT.size), np.ones(_LAYOUT.size)

    def command(self, drives: Drives, action: torch.Tensor) -> torch.Tensor:
        """(n, A) the robots' commands."""
        command = ahead(drives.command, drives.felt(), action)
        command[:, _BASE] = action[:, _BASE] * _like(action, r1.BASE_SPEED)
        grippers = list(_LAYOUT.gripper.values())
        command[:, grippers] = action[:, grippers]
        return command


class HandController(PositionController):
    """Actions of 21 numbers, -1 to 1: base (3) and torso (4) as of `DeltaController`; then of the left and of the right
    hand a step along x, y, z of the base's frame (3), a turn about them (3), and its gripper (1).

    Steps are from where the hand was told to be. A hand that cannot get there stays.
    """

    lowest, highest = -np.ones(21), np.ones(21)

    def command(self, drives: Drives, action: torch.Tensor) -> torch.Tensor:
        """(n, A) the robots' commands."""
        felt, command = drives.felt(), drives.command.clone()
        command[:, _BASE] = action[:, _BASE] * _like(action, r1.BASE_SPEED)
        whole = torch.zeros_like(command)
        whole[:, _LAYOUT.torso] = action[:, _LAYOUT.torso]
        lowest, highest = (_like(action, limit) for limit in r1.TORSO_LIMITS.T)
        command[:, _LAYOUT.torso] = ahead(command, felt, whole)[:, _LAYOUT.torso].clip(lowest, highest)
        for side, part in zip(SIDES, (slice(7, 14), slice(14, 21)), strict=True):
            asked, arm = action[:, part], _LAYOUT.arm[side]
            rows = (t.cpu().numpy() for t in (drives.command, command[:, _LAYOUT.torso], asked, felt[:, arm]))
            arms = np.stack([_arm(side, *row) for row in zip(*rows, strict=True)])
            command[:, arm] = _like(action, arms)
            command[:, _LAYOUT.gripper[side]] = asked[:, 6]
        return command


def ahead(last: torch.Tensor, felt: torch.Tensor, action: torch.Tensor) -> torch.Tensor:
    """Targets of torso and arms a step on from the last ones, but not far ahead of where the joints are.

    Args:
        last: (n, A) the last commands.
        felt: (n, A) where the joints are, in the places of an action.
        action: (n, A) steps, -1 to 1; those of base and grippers, which have none, count for nothing.
    """
    step = _like(last, _STEP)
    return torch.clamp(last + action * step, felt - _AHEAD * step, felt + _AHEAD * step)


def _arm(side: Side, last: Array, torso: Array, asked: Array, felt: Array) -> Array:
    """(7,) targets of one arm that bring its hand a step on, with the torso at its new targets; else the last ones."""
    told: Array = last[_LAYOUT.arm[side]]
    T = r1.R1.tcp(last[_LAYOUT.torso], told, side)
    T[:3, :3] = matmul(Rotation.from_rotvec(asked[3:6] * _HAND_STEP_RAD).as_matrix(), T[:3, :3])
    T[:3, 3] += asked[:3] * _HAND_STEP_M
    posture = r1.R1.nearest_posture(matmul(kin.inverse(r1.R1.chest(torso)), T), side, told)
    near = posture is not None and np.abs(posture - felt).max() < _AHEAD * _ARM_STEP.max()
    return posture if posture is not None and near else told


def _like(tensor: torch.Tensor, values: Array) -> torch.Tensor:
    """Values as a tensor of the same kind, in the same place."""
    return torch.as_tensor(values, dtype=tensor.dtype, device=tensor.device)


@register_agent()
class R1(BaseAgent):  # type: ignore[misc]
    """The r1. Its joints, gains, cameras and limits are those of `mpvi_bt.hands.robots.r1`."""

    uid = "r1"
    urdf_path = "generated"  # by hands/robots/r1_urdf.py, when it is loaded

    def __init__(
        self,
        scene: ManiSkillScene,
        control_freq: int,
        control_mode: str | None = None,
        agent_idx: str | None = None,
        initial_pose: Any = None,
        build_separate: bool = False,
        robot: DrivenR1 | None = None,
    ) -> None:
        """Load it into each sub scene, or take over one that stands in the only one already.

        Args:
            scene, control_freq, control_mode, agent_idx, initial_pose, build_separate: As of any agent; where it begins
                is the matter of its base's joints.
            robot: The one to take over.
        """
        self._stands = robot
        self.drives = Drives(scene.num_envs, scene.device) if robot is None else robot.drives
        super().__init__(scene, control_freq, control_mode, agent_idx, initial_pose, build_separate)

    def _load_articulation(self, initial_pose: Any = None) -> None:
        if self._stands is None:
            visible = self.scene.can_render()
            articulations = [load_robot(sub, r1.R1, visible) for sub in self.scene.sub_scenes]
        else:
            articulations = [self._stands.articulation]
        name = self.uid if self._agent_idx is None else f"{self.uid}-agent-{self._agent_idx}"
        poses = [sapien.Pose()] * len(articulations)
        self.robot = adopt_articulation(self.scene, name, articulations, poses)
        self.robot_link_names = [link.name for link in self.robot.get_links()]
        self.drives.take(self.robot)

    def set_action(self, action: torch.Tensor) -> None:
        """Send the drives what the actions (n, size) ask for. Raises BackendError if they are not finite."""
        self.controller.set_action(action)

    @property
    def _controller_configs(self) -> dict[str, R1ControllerConfig]:
        kinds = {
            "pd_joint_pos": PositionController,
            "pd_joint_target_delta_pos": DeltaController,
            "pd_ee_target_delta_pose": HandController,
        }
        names = [joint.name for joint in self.robot.active_joints]
        return {mode: R1ControllerConfig(names, self.drives, kind) for mode, kind in kinds.items()}

    @property
    def _sensor_configs(self) -> list[CameraConfig]:
        register_shaders()
        return [
            CameraConfig(
                uid=name,
                pose=sapien.Pose(),
                width=camera.width,
                height=camera.height,
                fov=camera.fov_rad,
                near=camera.near_m,
                far=camera.far_m,
                entity_uid=camera.link,
                shader_pack=SHADERS,
            )
            for name, camera in r1.CAMERAS.items()
        ]
