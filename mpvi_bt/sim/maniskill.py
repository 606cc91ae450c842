"""`MpviHouse-v1`: the tasks as a ManiSkill environment, in the same house with the same robot as the core's.

Our builder makes house, things and robot in ManiSkill's scene, in the same order and with the same physics as in the
core's, and ManiSkill is told of them afterwards.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any

import gymnasium
import numpy as np
import sapien
import torch
from mani_skill.agents.base_agent import BaseAgent
from mani_skill.envs.sapien_env import BaseEnv
from mani_skill.sensors.camera import CameraConfig
from mani_skill.utils.registration import register_env
from mani_skill.utils.structs.types import SimConfig

from mpvi_bt.errors import UnknownName, UserError
from mpvi_bt.goals.evaluate import GoalReport, Snapshot, judge, snapshot
from mpvi_bt.goals.predicates import truth_in
from mpvi_bt.robot import kinematics as kin
from mpvi_bt.robot.solids import Array
from mpvi_bt.sim import maniskill_fetch
from mpvi_bt.sim.catalogue import load_catalogue
from mpvi_bt.sim.house import House, load_house
from mpvi_bt.sim.maniskill_agent import R1
from mpvi_bt.sim.maniskill_scene import SHADERS, adopt, register_shaders, simulation
from mpvi_bt.sim.maniskill_world import ManiSkillWorld
from mpvi_bt.sim.robot import SimRobot
from mpvi_bt.sim.sampling import Start
from mpvi_bt.sim.shaders import add_lights, renderer, use_light_shaders
from mpvi_bt.sim.views import overview
from mpvi_bt.sim.world import World
from mpvi_bt.suite.instances import begin, come_to_rest, expanded_problem
from mpvi_bt.suite.splits import Split
from mpvi_bt.suite.tasks import Task, load_task

_STATE_MODES = ("state", "state_dict")
_BLIND_MODES = (*_STATE_MODES, "none")
_VIEW_RAD = 0.6


@cache
def _start(task: str, instance: int, split: Split) -> Start:
    """Where an instance begins, as the core has it."""
    known = load_task(task)
    house = load_house(known.house)
    problem = expanded_problem(known, house)
    return begin(known, house, load_catalogue(), problem, instance, split, render=False)[1]


@register_env("MpviHouse-v1")
class MpviHouseEnv(BaseEnv):  # type: ignore[misc]  # mani_skill is untyped
    """A task in the house.

    Observations: of the agent, joints and commands; "extra", `base_pose` x, y [m], yaw [rad] and `gripper_width` left,
    right [m] (the fetch has the right one), in state modes also `objects`, pose x, y, z [m], quaternion wxyz of each
    movable thing, and `openings`, 0 closed to 1 open, of each door and drawer. In visual modes the pictures of the
    robot's cameras: of the r1 "head", "left", "right", of the fetch "fetch_head", "fetch_hand".

    What `evaluate` tells: `success`, `q` as at the end of an episode of `mpvi run`, and `predicates`, each literal of
    the goal. Rewards: "q_increment" (also by the names "dense" and "normalized_dense"), what q has gained in the step,
    which sums up to q; "sparse", 1 at success.

    Attributes:
        task: What is done.
        world: The world of this episode, which trees can drive.
        start: Where things and robot began, before they came to rest.
        instance: Which start of the task it is.
    """

    SUPPORTED_ROBOTS = ("r1", "fetch")
    SUPPORTED_REWARD_MODES = ("q_increment", "normalized_dense", "dense", "sparse", "none")

    agent: BaseAgent
    world: ManiSkillWorld
    start: Start
    instance: int
    _render_device: sapien.Device | None

    def __init__(
        self,
        *args: Any,
        task: str = "picking_up_trash",
        instance: int | None = None,
        split: Split = "public",
        assisted: bool = False,
        robot_uids: str = "r1",
        num_envs: int = 1,
        obs_mode: str | None = None,
        render_mode: str | None = None,
        render_backend: str | None = None,
        sim_backend: str = "auto",
        reconfiguration_freq: int | None = None,
        **kwargs: Any,
    ) -> None:
        """Make the environment and reset it.

        Args:
            *args, num_envs, obs_mode, render_mode, sim_backend, **kwargs: As of any environment of ManiSkill.
            task: Name of a task, or the file of one.
            instance: Which of the task's starts; None: the episode's seed draws one.
            split: Of which instances.
            assisted: Whether a closing hand fixes what it pinches to itself.
            robot_uids: "r1", or "fetch": ManiSkill's own, with its controllers and cameras.
            render_backend: As of ManiSkill; None: none where nothing draws, else the GPU or, without one, the CPU.
            reconfiguration_freq: As of ManiSkill; None: each reset builds the scene anew, so that it is the same bit by
                bit whatever came before. (0 only puts things back: faster, and what physics has cached stays.)

        Raises:
            UserError: There is no such task or robot, or this cannot be simulated here.
        """
        if robot_uids not in self.SUPPORTED_ROBOTS:
            raise UnknownName("robot", str(robot_uids), self.SUPPORTED_ROBOTS)
        if num_envs != 1 or sim_backend not in ("auto", "cpu", "physx_cpu"):
            raise UserError(_no_gpu(num_envs, sim_backend))
        self.task: Task = load_task(task)
        self._task_name = task
        self._fixed_instance, self._split = instance, split
        self._assisted = assisted
        self._house: House = load_house(self.task.house)
        self._problem = expanded_problem(self.task, self._house)
        if render_backend is None:
            blind = (obs_mode or _BLIND_MODES[0]) in _BLIND_MODES and render_mode is None
            render_backend = "none" if blind else _drawing()
        super().__init__(
            *args,
            num_envs=1,
            obs_mode=obs_mode,
            render_mode=render_mode,
            robot_uids=robot_uids,
            render_backend=render_backend,
            sim_backend="physx_cpu",
            reconfiguration_freq=1 if reconfiguration_freq is None else reconfiguration_freq,
            **kwargs,
        )

    # --- the scene

    @property
    def _default_sim_config(self) -> SimConfig:
        return simulation()

    def _setup_scene(self) -> None:
        if self._render_device is not None and self._render_device.is_cpu():
            # A process can draw on one device only: the one that the core's scenes are drawn on.
            self._render_device = self.backend.render_device = renderer().device
        super()._setup_scene()

    def _load_agent(self, options: Mapping[str, Any], *args: Any, **kwargs: Any) -> None:
        """Build everything: in the core's order, the house before the robot."""
        self._choose(options)
        visible = self.scene.can_render()
        if visible:
            use_light_shaders()
        fetch = self._fetch if self.robot_uids == maniskill_fetch.NAME else None
        self.world = ManiSkillWorld(
            self.scene.sub_scenes[0], self.step, self._house, self.start, visible, self._assisted, fetch
        )
        self._unmoved = self.world.save()
        self._fresh = True
        if fetch is not None:
            maniskill_fetch.let_roll(map(self.world.thing, self.world.things))
        else:
            self.agent = R1(self.scene, self._control_freq, self._control_mode, robots=[self.world.robot])

    def _fetch(self, base_pose: Array) -> SimRobot:
        robot = maniskill_fetch.put(self.scene, self._control_freq, self._control_mode, base_pose)
        self.agent = robot.agent
        return robot

    def _load_scene(self, options: Mapping[str, Any]) -> None:
        self._views = {name: adopt(self.scene, [self.world.thing(name)]) for name in self.world.things}

    def _load_lighting(self, options: Mapping[str, Any]) -> None:
        for scene in self.scene.sub_scenes:
            add_lights(scene)

    def _setup_sensors(self, options: Mapping[str, Any]) -> None:
        use_light_shaders()  # ManiSkill sets the formats of pictures only for shaders of its own
        super()._setup_sensors(options)

    @property
    def _default_human_render_camera_configs(self) -> CameraConfig:
        register_shaders()
        T = overview(self._house, fov_rad=_VIEW_RAD)
        T[:3, :3] = T[:3, :3] @ kin.LINK_TO_OPTICAL.T
        pose = sapien.Pose(T)
        return CameraConfig("render_camera", pose, 960, 540, fov=_VIEW_RAD, near=0.05, far=60.0, shader_pack=SHADERS)

    def _clear(self) -> None:
        self.__dict__.pop("world", None)
        self._views = {}
        super()._clear()

    # --- an episode

    def reset(
        self, seed: int | list[int] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode.

        Args:
            seed: As of ManiSkill.
            options: As of ManiSkill; "instance" is the start that is meant, whatever the environment was made for.

        Raises:
            UserError: The task has no such instance.
        """
        gymnasium.Env.reset(self, seed=int(np.ravel(seed)[0]) if seed is not None else None)
        return super().reset(seed, options)

    def _choose(self, options: Mapping[str, Any]) -> None:
        """Settle which instance this episode is."""
        instance = options.get("instance", self._fixed_instance)
        if instance is None:
            instance = self._episode_rng.randint(self.task.instances)
        self.instance = int(instance)
        self.task.check_instance(self.instance)
        self.start = _start(self._task_name, self.instance, self._split)

    def _initialize_episode(self, env_idx: torch.Tensor, options: Mapping[str, Any]) -> None:
        if not self._fresh:
            self._choose(options)
            self._put_back()
        self._fresh = False
        come_to_rest(self.world, self.start)
        self._truth = truth_in(self.world, self.start.scene_names)
        self._judged: tuple[Snapshot, GoalReport] | None = None
        self._before = snapshot(self._problem, self._truth)
        self._rewarded = 0.0

    def _put_back(self) -> None:
        """Have everything stand as if the scene had just been built."""
        state = {**self._unmoved, "things": dict(self._unmoved["things"]), "robot": dict(self._unmoved["robot"])}
        for name, placement in self.start.objects.items():
            pose = sapien.Pose(placement.T_world)
            state["things"][name] = {**state["things"][name], "pose": [*pose.p.tolist(), *pose.q.tolist()]}
        state["robot"]["q"] = self.world.robot.standing_at(self.start.base_pose, state["robot"]["q"])
        self.world.restore(state)

    def _after_simulation_step(self) -> None:
        if self.world.bumps is not None:
            self.world.bumps.update()

    def _after_control_step(self) -> None:
        self.world.stepped()

    # --- what is told

    def evaluate(self) -> dict[str, Any]:
        """How the goal stands: `success` (1,) bool, `q` (1,), and `predicates`, each literal's text to (1,) bool."""
        now = snapshot(self._problem, self._truth)
        if self._judged is None or self._judged[0] != now:
            self._judged = (now, judge(self._problem, self._before, now))
        report = self._judged[1]
        return {
            "success": torch.tensor([report.satisfied]),
            "q": torch.tensor([report.q], dtype=torch.float32),
            "predicates": {str(literal): torch.tensor([holds]) for literal, holds in now.items()},
        }

    def get_reward(self, obs: Any, action: torch.Tensor, info: dict[str, Any]) -> torch.Tensor:
        """(1,) the reward of the step that was just made."""
        if self._reward_mode in ("q_increment", "dense", "normalized_dense"):
            q = float(info["q"][0])
            gained, self._rewarded = q - self._rewarded, q
            return torch.tensor([gained], dtype=torch.float32)
        return super().get_reward(obs, action, info)

    def _get_obs_extra(self, info: dict[str, Any]) -> dict[str, Any]:
        felt = self.world.robot.proprioception()
        extra: dict[str, Any] = {
            "base_pose": _row(felt.base_pose),
            "gripper_width": _row([felt.gripper_width[side] for side in felt.sides]),
        }
        if self.obs_mode_struct.state or self._obs_mode in _STATE_MODES:
            poses = {name: self.world.thing(name).entity.pose for name in self.world.objects}
            openings = {name: self.world.joint_fractions(name) for name in self.world.things}
            extra["objects"] = {name: _row([*pose.p, *pose.q]) for name, pose in poses.items()}
            extra["openings"] = {name: _row(fractions) for name, fractions in openings.items() if len(fractions)}
        return extra

    def _get_obs_sensor_data(self, apply_texture_transforms: bool = True) -> Any:
        self.world.show_switches()
        return super()._get_obs_sensor_data(apply_texture_transforms)

    # --- its state

    def get_state_dict(self) -> dict[str, Any]:
        """Poses and speeds of all that can move; the commands of the robot, and which switches are on."""
        state: dict[str, Any] = super().get_state_dict()
        state["switches"] = _row([float(on) for on in self.world.switched.values()])
        return state

    def set_state_dict(self, state: dict[str, Any], env_idx: torch.Tensor | None = None) -> None:
        """Bring everything to a state of `get_state_dict`, as ManiSkill has it: contacts are found anew."""
        super().set_state_dict(state, env_idx)
        if "controller" in state:
            self.agent.set_controller_state(_rows(state["controller"]))
        if "switches" in state:
            on = np.ravel(state["switches"])
            for name, value in zip(self.world.switched, on, strict=True):
                self.world.turn(name, bool(value > 0.5))
        self.world.robot.forget()


def begin_in_maniskill(
    task: str, instance: int, split: Split = "public", *, render: bool = True, assisted: bool = False
) -> tuple[World, Start]:
    """An instance of a task in an environment of its own, which its world steps; as of `suite.instances.begin`."""
    env = MpviHouseEnv(
        task=task,
        instance=instance,
        split=split,
        assisted=assisted,
        obs_mode="none",
        reward_mode="none",
        render_backend=_drawing() if render else "none",
    )
    return env.world, env.start


def _drawing() -> str:
    """What draws where something does."""
    return "gpu" if torch.cuda.is_available() else "cpu"


def _rows(state: Any) -> Any:
    """A state of one environment with its row again, which ManiSkill's files of demonstrations leave out."""
    if isinstance(state, dict):
        return {key: _rows(value) for key, value in state.items()}
    return state[None] if state.ndim == 1 else state


def _row(values: Any) -> torch.Tensor:
    """(1, n) float32."""
    return torch.tensor(np.asarray(values, np.float32))[None]


def _no_gpu(num_envs: int, sim_backend: str) -> str:
    """Why that many environments cannot be simulated in one process here."""
    asked = f"num_envs={num_envs}, sim_backend={sim_backend!r}"
    if not torch.cuda.is_available():
        return f"{asked}: physics on the GPU needs CUDA, and there is none here; use one environment a process."
    return f"{asked}: this environment is simulated on the CPU only; use one environment a process."
