"""ManiSkill's own Fetch in our house: its description, meshes, controllers and cameras, felt as our robots are."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import sapien
from mani_skill.agents.base_agent import BaseAgent
from mani_skill.agents.robots.fetch.fetch import FETCH_BASE_COLLISION_BIT, FETCH_WHEELS_COLLISION_BIT, Fetch
from mani_skill.sensors.camera import CameraConfig

from mpvi_bt.ground.errors import BackendError
from mpvi_bt.ground.geometry.solids import Array, bounds
from mpvi_bt.ground.robot.protocol import Side
from mpvi_bt.hands.robots.fetch import FETCH
from mpvi_bt.house.maniskill.scene_views import SHADERS, register_shaders
from mpvi_bt.house.sim.body import SimBody
from mpvi_bt.house.sim.builder import Thing
from mpvi_bt.house.sim.sim_robot import CLOSED_M, SimRobot
from mpvi_bt.house.sim.world import GROUND_M

NAME = "fetch"


class _Agent(Fetch):  # type: ignore[misc]  # mani_skill is untyped
    """The agent, its cameras with our light shaders: the pictures are the same, and the first comes much sooner."""

    @property
    def _sensor_configs(self) -> list[CameraConfig]:
        register_shaders()
        configs: list[CameraConfig] = super()._sensor_configs
        for config in configs:
            config.shader_pack = SHADERS
        return configs


class ShippedFetch(SimRobot):
    """Our world's view of an agent driven by ManiSkill's controllers.

    It stands where our robots begin, the arm folded as our own Fetch has it.
    """

    def __init__(self, agent: BaseAgent, base_pose: Array) -> None:
        """Put the agent's robot at `base_pose` (3,) x, y [m], yaw [rad]."""
        SimBody.__init__(self, agent.robot._objs[0], FETCH, None, prefix=f"scene-0-{NAME}_")
        self.agent = agent
        q = np.zeros(len(self._joints))
        q[self._base] = base_pose
        for i, at in self._torso:
            q[at] = FETCH.travel_torso[i]
        q[self._arm["right"]], q[self._fingers["right"]] = FETCH.travel_arm["right"], FETCH.hand.travel_m
        self.restore({"q": q.tolist(), "v": np.zeros_like(q).tolist()})

    @property
    def action(self) -> Array:
        """Raises BackendError."""
        raise _not_ours()

    def act(self, action: Array) -> None:
        """Raises BackendError."""
        raise _not_ours()

    def apply(self) -> None:
        """Nothing: the agent's controllers have sent their commands."""

    @property
    def gripper_command(self) -> Mapping[Side, float]:
        """What the gripper's drives were told last, -1 closed ... 1 open."""
        told = float(self._joints[FETCH.finger_joints["right"][0]].drive_target[0])
        return {"right": float(np.clip(2 * (told - CLOSED_M) / (FETCH.hand.travel_m - CLOSED_M) - 1, -1.0, 1.0))}

    @property
    def arm_command(self) -> Mapping[Side, Array]:
        """(7,) what the arm's drives were told last."""
        return {"right": np.array([self._joints[name].drive_target[0] for name in FETCH.arm_joints["right"]], float)}

    def save(self) -> dict[str, list[float]]:
        """How it stands and moves."""
        return {"q": self.articulation.get_qpos().tolist(), "v": self.articulation.get_qvel().tolist()}

    def restore(self, saved: Mapping[str, list[float]]) -> None:
        """Have it stand and move so, and its drives keep it there."""
        q = np.array(saved["q"], np.float32)
        self.articulation.set_qpos(q)
        self.articulation.set_qvel(np.array(saved["v"], np.float32))
        for joint, target in zip(self._joints.values(), q.tolist(), strict=True):
            joint.set_drive_target(target)
            joint.set_drive_velocity_target(0.0)
        self.agent.controller.reset()
        self.forget()


def load(scene: Any, control_freq: int, control_mode: str | None) -> BaseAgent:
    """ManiSkill's Fetch, one in each sub scene."""
    return _Agent(scene, control_freq, control_mode)


def let_roll(things: Iterable[Thing]) -> None:
    """Let base and wheels, which reach slightly into the ground, pass through things as low as a lawn."""
    for thing in things:
        solids = thing.solids()
        if thing.movable or not solids or bounds(solids)[1, 2] > GROUND_M:
            continue
        for entity in thing.entities.values():
            body = entity.find_component_by_type(sapien.physx.PhysxRigidBaseComponent)
            for shape in body.collision_shapes:
                words = list(shape.get_collision_groups())
                words[2] |= 1 << FETCH_WHEELS_COLLISION_BIT | 1 << FETCH_BASE_COLLISION_BIT
                shape.set_collision_groups(words)


def _not_ours() -> BackendError:
    return BackendError("ManiSkill's Fetch takes the actions of its own controllers, by the environment's step")
