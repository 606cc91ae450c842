"""The r1 as a ManiSkill agent: its cameras, and controllers that send the same drives the same commands as the core's.

Of ManiSkill's physics only the one on the CPU is driven: commands go to each robot's drives one by one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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

from mpvi_bt.robot import kinematics as kin
from mpvi_bt.robot import r1
from mpvi_bt.robot.limits import extremes
from mpvi_bt.robot.protocol import CONTROL_HZ, SIDES, ActionLayout
from mpvi_bt.robot.solids import Array
from mpvi_bt.sim.cameras import Cameras
from mpvi_bt.sim.maniskill_scene import SHADERS, adopt_articulation, register_shaders
from mpvi_bt.sim.robot import SimRobot

# Our choice: what a delta of 1 is. Joints: what they do in a step at the speed that motions are planned with.
_TORSO_STEP = r1.TORSO_SPEED / CONTROL_HZ
_ARM_STEP = r1.ARM_SPEED / CONTROL_HZ
_AHEAD = 5.0  # steps that targets may be ahead of joints: what is in the way would else have them run on
_HAND_STEP_M, _HAND_STEP_RAD = 0.5 / CONTROL_HZ, 1.5 / CONTROL_HZ


@dataclass
class R1ControllerConfig(ControllerConfig):  # type: ignore[misc]  # mani_skill is untyped
    """A controller of all joints.

    Attributes:
        robots: The robot of each sub scene.
        controller_cls: What carries it out.
    """

    robots: Sequence[SimRobot]
    controller_cls: type[BaseController] = BaseController


class PositionController(BaseController):  # type: ignore[misc]
    """Actions of 23 numbers in the order and units of `ActionLayout`: what `Robot.act` takes."""

    config: R1ControllerConfig
    sets_target_qpos = True
    sets_target_qvel = True
    lowest, highest = extremes(r1.R1)

    def set_drive_property(self) -> None:
        """Nothing: the robots have set their drives."""

    def set_action(self, action: torch.Tensor) -> None:
        """Send the drives what the actions (n, size) ask for."""
        rows = np.asarray(self._preprocess_action(action).cpu(), float)
        for robot, row in zip(self.config.robots, rows, strict=True):
            robot.act(self.command(robot, np.clip(row, self.lowest, self.highest)))
            robot.apply()

    def command(self, robot: SimRobot, action: Array) -> Array:
        """(23,) the robot's command for one action of this controller.

        Who drives the robot as a `Robot` has told it already, with all digits: then that stands, not what is left of it
        in ManiSkill's float32.
        """
        told = robot.action
        return told if np.array_equal(np.float32(told), np.float32(action)) else action

    def get_state(self) -> dict[str, torch.Tensor]:
        """The commands (n, 23), and the velocities (n, 3) that the bases were told to have."""
        saved = [robot.save() for robot in self.config.robots]
        return {
            "command": torch.tensor([s["action"] for s in saved], dtype=torch.float32, device=self.device),
            "base_velocity": torch.tensor([s["base"] for s in saved], dtype=torch.float32, device=self.device),
        }

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Have the drives go on from a state."""
        commands, velocities = (np.asarray(state[key], float) for key in ("command", "base_velocity"))
        for robot, action, base in zip(self.config.robots, commands, velocities, strict=True):
            robot.restore(robot.save() | {"action": action.tolist(), "base": base.tolist()})

    def _initialize_action_space(self) -> None:
        low, high = np.float32(self.lowest), np.float32(self.highest)
        self.single_action_space = spaces.Box(low, high, dtype=np.float32)


class DeltaController(PositionController):
    """Actions of 23 numbers, -1 to 1: shares of the base's top speeds, steps of the targets of torso and arms, grippers
    from -1 closed to 1 open.

    Steps are from the last target, as drives are told its speed too: from where the joints are they would run away.
    """

    lowest, highest = -np.ones(23), np.ones(23)

    def command(self, robot: SimRobot, action: Array) -> Array:
        """(23,) the robot's command."""
        felt, last, command = robot.proprioception(), robot.action, action.copy()
        command[ActionLayout.BASE] *= r1.BASE_SPEED
        command[ActionLayout.TORSO] = _ahead(last, felt.torso, ActionLayout.TORSO, action[ActionLayout.TORSO])
        for side in SIDES:
            part = ActionLayout.ARM[side]
            command[part] = _ahead(last, felt.arm[side], part, action[part])
        return command


class HandController(PositionController):
    """Actions of 21 numbers, -1 to 1: base (3) and torso (4) as of `DeltaController`; then of the left and of the right
    hand a step along x, y, z of the base's frame (3), a turn about them (3), and its gripper (1).

    Steps are from where the hand was told to be. A hand that cannot get there stays.
    """

    lowest, highest = -np.ones(21), np.ones(21)

    def command(self, robot: SimRobot, action: Array) -> Array:
        """(23,) the robot's command."""
        felt, last, command = robot.proprioception(), robot.action, robot.action
        command[ActionLayout.BASE] = action[:3] * r1.BASE_SPEED
        torso = np.clip(_ahead(last, felt.torso, ActionLayout.TORSO, action[3:7]), *r1.TORSO_LIMITS.T)
        command[ActionLayout.TORSO] = torso
        for side, asked in zip(SIDES, (action[7:14], action[14:21]), strict=True):
            part = ActionLayout.ARM[side]
            T = r1.R1.tcp(last[ActionLayout.TORSO], last[part], side)
            T[:3, :3] = Rotation.from_rotvec(asked[3:6] * _HAND_STEP_RAD).as_matrix() @ T[:3, :3]
            T[:3, 3] += asked[:3] * _HAND_STEP_M
            posture = r1.R1.nearest_posture(kin.inverse(r1.R1.chest(torso)) @ T, side, last[part])
            if posture is not None and np.abs(posture - felt.arm[side]).max() < _AHEAD * _ARM_STEP.max():
                command[part] = posture
            command[ActionLayout.GRIPPER[side]] = asked[6]
        return command


def _ahead(last: Array, felt: Array, part: slice, action: Array) -> Array:
    """Targets of a part of the joints a step on from the last ones, but not far ahead of where the joints are."""
    step = _TORSO_STEP if part == ActionLayout.TORSO else _ARM_STEP
    return np.clip(last[part] + action * step, felt - _AHEAD * step, felt + _AHEAD * step)


@register_agent()
class R1(BaseAgent):  # type: ignore[misc]
    """The r1. Its joints, gains, cameras and limits are those of `mpvi_bt.robot.r1`."""

    uid = "r1"
    urdf_path = "generated"  # by robot/r1_urdf.py, when it is loaded

    def __init__(
        self,
        scene: ManiSkillScene,
        control_freq: int,
        control_mode: str | None = None,
        agent_idx: str | None = None,
        initial_pose: Any = None,
        build_separate: bool = False,
        robots: Sequence[SimRobot] = (),
    ) -> None:
        """Load it, or take over robots that stand in the sub scenes already.

        Args:
            scene, control_freq, control_mode, agent_idx, initial_pose, build_separate: As of any agent; where it begins
                is the matter of its base's joints.
            robots: One of each sub scene.
        """
        self.robots = list(robots)
        super().__init__(scene, control_freq, control_mode, agent_idx, initial_pose, build_separate)

    def _load_articulation(self, initial_pose: Any = None) -> None:
        visible = self.scene.can_render()
        if not self.robots:
            subs = self.scene.sub_scenes
            self.robots = [SimRobot(sub, np.zeros(3), Cameras(sub) if visible else None) for sub in subs]
        name = self.uid if self._agent_idx is None else f"{self.uid}-agent-{self._agent_idx}"
        articulations = [robot.articulation for robot in self.robots]
        poses = [sapien.Pose()] * len(articulations)
        self.robot = adopt_articulation(self.scene, name, articulations, poses)
        self.robot_link_names = [link.name for link in self.robot.get_links()]

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
        return {mode: R1ControllerConfig(names, self.robots, kind) for mode, kind in kinds.items()}

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
