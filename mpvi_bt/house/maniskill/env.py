"""`MpviHouse-v1`: the tasks as a ManiSkill environment, in the same house with the same robot as the core's.

Our builder makes house, things and robot in ManiSkill's scenes, in the same order and with the same physics as in the
core's, and ManiSkill is told of them afterwards. Whatever is observed, commanded and told has a row an environment; one
environment on the CPU is a batch of one, whose world is the core's own, in ManiSkill's scene. Many are on a GPU; each
has a `Twin` on the CPU that goals are judged by.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from typing import Any

import gymnasium
import numpy as np
import sapien
import torch
from gymnasium.envs.registration import EnvSpec
from mani_skill.agents.base_agent import BaseAgent
from mani_skill.envs.sapien_env import BaseEnv
from mani_skill.sensors.camera import CameraConfig
from mani_skill.utils.registration import register_env
from mani_skill.utils.structs.types import SimConfig

from mpvi_bt.executive.ticking.goal_report import GoalReport
from mpvi_bt.ground.errors import UnknownName, UserError
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.house.goals.evaluate import Snapshot, judge, snapshot
from mpvi_bt.house.goals.formula import Truth
from mpvi_bt.house.goals.predicates import truth_in
from mpvi_bt.house.instances.instances import come_to_rest, expanded_problem
from mpvi_bt.house.instances.sampling import Start
from mpvi_bt.house.instances.splits import Split
from mpvi_bt.house.instances.tasks import Task, in_house, load_task
from mpvi_bt.house.layout.house import House, load_house
from mpvi_bt.house.maniskill import fetch_agent
from mpvi_bt.house.maniskill.agent import R1
from mpvi_bt.house.maniskill.batch import Batch, BatchState, Begun, StateLayout, Twin, begun, furnish, twin
from mpvi_bt.house.maniskill.drive_tensors import DrivenR1, Drives
from mpvi_bt.house.maniskill.env_world import ManiSkillWorld
from mpvi_bt.house.maniskill.scene_views import SHADERS, adopt, register_shaders, simulation
from mpvi_bt.house.sim.builder import Thing
from mpvi_bt.house.sim.cameras import Cameras
from mpvi_bt.house.sim.shaders import add_lights, renderer, use_light_shaders
from mpvi_bt.house.sim.sim_robot import SimRobot
from mpvi_bt.house.sim.views import overview
from mpvi_bt.house.sim.world import SimWorld

_STATE_MODES = ("state", "state_dict")
_BLIND_MODES = (*_STATE_MODES, "none")
_RESET_OPTIONS = ("instance", "env_idx", "reconfigure", "reset_to_env_states")  # ours, and those of ManiSkill
_VIEW_RAD = 0.6


ID = f"{__package__}:MpviHouse-v1"  # for gymnasium.make, with nothing imported


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
        instances: Which start of the task each environment is in.
        worlds: The world of each environment, which goals are judged by.
    """

    SUPPORTED_ROBOTS = ("r1", "fetch")
    SUPPORTED_REWARD_MODES = ("q_increment", "normalized_dense", "dense", "sparse", "none")

    agent: BaseAgent
    instances: list[int]
    worlds: list[SimWorld]
    _render_device: sapien.Device | None
    _spec: EnvSpec | None = None
    _twinned = False  # whether the worlds follow what is simulated elsewhere: always so on a GPU

    def __init__(
        self,
        *args: Any,
        task: str = "picking_up_trash",
        instance: int | Sequence[int] | None = None,
        split: Split = "public",
        house: str | None = None,
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
            instance: Which of the task's starts; several go to the environments in turn; None: the episode's seed draws
                one for each.
            split: Of which instances.
            house: Name or file of a house, or "generated:7", which a seed draws; None: the task's own.
            assisted: Whether a closing hand fixes what it pinches to itself.
            robot_uids: "r1", or "fetch": ManiSkill's own, with its controllers and cameras.
            render_backend: As of ManiSkill; None: none where nothing draws, else the GPU or, without one, the CPU.
            reconfiguration_freq: As of ManiSkill; None: on the CPU each reset builds the scene anew, so that it is the
                same bit by bit whatever came before. (0, as on a GPU, only puts things back where the core's have come
                to rest: faster, and what physics has cached stays.)

        Raises:
            UserError: There is no such task, house or robot, the house lacks what the task needs, or this cannot be
                simulated here.
        """
        if robot_uids not in self.SUPPORTED_ROBOTS:
            raise UnknownName("robot", str(robot_uids), self.SUPPORTED_ROBOTS)
        on_gpu = num_envs > 1 if sim_backend == "auto" else sim_backend not in ("cpu", "physx_cpu")
        if on_gpu or num_envs != 1:
            _check_gpu(num_envs, sim_backend, assisted)
        self._twinned = on_gpu or self._twinned
        self.task: Task = in_house(load_task(task), house)
        self._task_name, self._house_name = task, house
        self._fixed_instance, self._split = instance, split
        self._assisted = assisted
        self._house: House = load_house(self.task.house)
        self._problem = expanded_problem(self.task, self._house)
        if render_backend is None:
            blind = (obs_mode or _BLIND_MODES[0]) in _BLIND_MODES and render_mode is None
            render_backend = "none" if blind else _drawing()
        super().__init__(
            *args,
            num_envs=num_envs,
            obs_mode=obs_mode,
            render_mode=render_mode,
            robot_uids=robot_uids,
            render_backend=render_backend,
            sim_backend=sim_backend,
            reconfiguration_freq=(0 if on_gpu else 1) if reconfiguration_freq is None else reconfiguration_freq,
            **kwargs,
        )

    @property
    def spec(self) -> EnvSpec | None:
        """The environment's spec; its id names this module, so nobody has to import it first.

        ManiSkill's replay tool makes the one whose id a recording has. (Since 1.0 Gymnasium loads no entry points.)
        """
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        self._spec = copy(spec)
        if self._spec is not None:
            self._spec.id = ID

    # --- the scene

    @property
    def world(self) -> ManiSkillWorld:
        """The world of the only environment, which trees can drive. Raises UserError for environments on a GPU."""
        world = self.worlds[0]
        if not isinstance(world, ManiSkillWorld):
            raise UserError("trees drive one environment on the CPU; these are simulated on a GPU")
        return world

    @property
    def start(self) -> Start:
        """Where things and robot of the first environment began, before they came to rest."""
        return self._start(0)

    @property
    def instance(self) -> int:
        """Which start of the task the first environment is in."""
        return self.instances[0]

    @property
    def _is_fetch(self) -> bool:
        return str(self.robot_uids) == fetch_agent.NAME

    def _start(self, k: int) -> Start:
        """Where an environment's episode begins, whatever its robot."""
        return begun(self._task_name, self.instances[k], self._split, named=self._house_name).start

    def _settled(self, k: int) -> Begun:
        """How an environment's episode begins once things have come to rest about its robot."""
        return begun(self._task_name, self.instances[k], self._split, str(self.robot_uids), self._house_name)

    @property
    def _default_sim_config(self) -> SimConfig:
        return simulation(self.num_envs)

    def _setup_scene(self) -> None:
        if self._render_device is not None and self._render_device.is_cpu():
            # A process can draw on one device only: the one that the core's scenes are drawn on.
            self._render_device = self.backend.render_device = renderer().device
        super()._setup_scene()

    def _load_agent(self, options: Mapping[str, Any], *args: Any, **kwargs: Any) -> None:
        """Build everything: in the core's order, the house before the robot."""
        self._fresh, self.instances = True, [0] * self.num_envs
        self._choose(range(self.num_envs), options)
        visible = self.scene.can_render()
        if visible:
            use_light_shaders()
        self._houses = self._built_apart(visible) if self._twinned else self._built_as_world(visible)
        if self._is_fetch:
            for things in self._houses:
                fetch_agent.let_roll(things.values())

    def _built_as_world(self, visible: bool) -> list[dict[str, Thing]]:
        """The only house, a world in the only scene."""
        scene, put = self.scene.sub_scenes[0], self._put_fetch if self._is_fetch else self._put_r1
        world = ManiSkillWorld(scene, self.step, self._house, self.start, visible, put, self._assisted)
        self.worlds = [world]
        if isinstance(world.robot, DrivenR1):
            self.agent = R1(self.scene, self._control_freq, self._control_mode, robot=world.robot)
        return [{name: world.thing(name) for name in world.things}]

    def _built_apart(self, visible: bool) -> list[dict[str, Thing]]:
        """A house in each sub scene, and worlds of the core that follow them."""
        starts = [self._start(k) for k in range(self.num_envs)]
        scenes = self.scene.sub_scenes
        houses = [furnish(sub, self._house, start, visible) for sub, start in zip(scenes, starts, strict=True)]
        load: Callable[..., BaseAgent] = fetch_agent.load if self._is_fetch else R1
        self.agent = load(self.scene, self._control_freq, self._control_mode)
        self.worlds = [twin(self._house, self._settled(k), str(self.robot_uids)) for k in range(self.num_envs)]
        return houses

    def _put_r1(self, base_pose: Array, cameras: Cameras | None) -> SimRobot:
        return DrivenR1(Drives(1, self.device), self.scene.sub_scenes[0], base_pose, cameras)

    def _put_fetch(self, base_pose: Array, cameras: Cameras | None) -> SimRobot:
        self.agent = fetch_agent.load(self.scene, self._control_freq, self._control_mode)
        return fetch_agent.ShippedFetch(self.agent, base_pose)

    def _load_scene(self, options: Mapping[str, Any]) -> None:
        first = self._houses[0]
        self._views = {name: adopt(self.scene, [things[name] for things in self._houses]) for name in first}
        order = [joint.name for joint in self.agent.robot.active_joints]
        self._batch = Batch(self.scene, StateLayout(first, order), self._views, self.agent.robot)
        robot = self.worlds[0].robot
        model = robot.model
        self._base = [order.index(name) for name in robot.physics.base_joints]
        self._hands = [[order.index(name) for name in pair] for pair in model.finger_joints.values()]
        jointed = {name: list(zip(*thing.openings, strict=True)) for name, thing in first.items() if thing.openings}
        self._openings = {
            n: (list(at), torch.tensor(limits, device=self.device)) for n, (at, limits) in jointed.items()
        }
        self._behind = False  # whether the worlds have yet to follow the last step
        self._followed: BatchState | None = None

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
        T[:3, :3] = matmul(T[:3, :3], kin.LINK_TO_OPTICAL.T)
        pose = sapien.Pose(T)
        return CameraConfig("render_camera", pose, 960, 540, fov=_VIEW_RAD, near=0.05, far=60.0, shader_pack=SHADERS)

    def _clear(self) -> None:
        self.worlds, self._houses, self._views = [], [], {}
        self.__dict__.pop("_batch", None)
        super()._clear()

    # --- an episode

    def reset(
        self, seed: int | list[int] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode.

        Args:
            seed: As of ManiSkill.
            options: As of ManiSkill; "instance" is the start that is meant, or are those of the environments that are
                reset, whatever they were made for.

        Raises:
            UserError: The task has no such instance.
            UnknownName: There is no such option.
        """
        for name in options or ():
            if name not in _RESET_OPTIONS:
                raise UnknownName("option of reset", str(name), _RESET_OPTIONS)
        gymnasium.Env.reset(self, seed=int(np.ravel(seed)[0]) if seed is not None else None)
        if options is not None and "env_idx" in options:  # ManiSkill's masks take rows in this order
            options = {**options, "env_idx": torch.sort(torch.as_tensor(options["env_idx"], device=self.device)).values}
        return super().reset(seed, options)

    def _choose(self, rows: Sequence[int], options: Mapping[str, Any]) -> None:
        """Settle which instances the episodes of some environments are."""
        given = options.get("instance", self._fixed_instance)
        for i, k in enumerate(rows):
            if given is None:
                instance = self._batched_episode_rng[k].randint(self.task.instances)
            else:
                instance = np.ravel(given)[(i if "instance" in options else k) % np.size(given)]
            self.task.check_instance(int(instance))
            self.instances[k] = int(instance)

    def _initialize_episode(self, env_idx: torch.Tensor, options: Mapping[str, Any]) -> None:
        rows = env_idx.tolist()
        if self._fresh and not self._twinned:
            come_to_rest(self.world, self.start)
        else:
            if not self._fresh:
                self._choose(rows, options)
                self._fresh = False
            self._put_back(env_idx)
        if len(rows) == self.num_envs:
            self._truths: list[Truth] = [lambda literal: False] * self.num_envs
            self._before: list[Snapshot] = [{}] * self.num_envs
            self._judged: list[tuple[Snapshot, GoalReport] | None] = [None] * self.num_envs
            self._rewarded = torch.zeros(self.num_envs, device=self.device)
        for k in rows:
            self._truths[k] = truth_in(self.worlds[k], self._start(k).scene_names)
            self._before[k] = snapshot(self._problem, self._truths[k])
            self._judged[k] = None
        self._rewarded[env_idx] = 0.0
        self._fresh = False

    def _put_back(self, env_idx: torch.Tensor) -> None:
        """Have everything in some environments stand as the core's things do when they have come to rest."""
        episodes = [self._settled(k) for k in env_idx.tolist()]
        standing = self._batch.layout.standing([episode.saved for episode in episodes])
        self._batch.put(standing)
        if self._followed is not None:
            self._followed = self._followed.replaced(env_idx, standing)
        if isinstance(self.agent, R1):
            commands, speeds = ([e.saved["robot"][key] for e in episodes] for key in ("action", "base"))
            self.agent.drives.restore(env_idx, torch.tensor(commands), torch.tensor(speeds))
        for k, episode in zip(env_idx.tolist(), episodes, strict=True):
            world = self.worlds[k]
            robot = world.robot.save() if isinstance(world, ManiSkillWorld) else episode.saved["robot"]
            world.restore({**episode.saved, "robot": robot})
            world.refresh()

    def _after_simulation_step(self) -> None:
        if not self._twinned and self.world.bumps is not None:
            self.world.bumps.update()

    def _after_control_step(self) -> None:
        if self._twinned:
            self._behind = True  # what there is to follow has yet to be fetched
        else:
            self.world.stepped()

    def _follow(self) -> None:
        """Update the worlds of environments with motion that goals or switches depend on."""
        now = self._batch.read()
        pressed = any(literal.predicate == "toggled_on" for literal in self._before[0])  # by a robot, if nothing moves
        moved = (now.moved_since(self._followed) | pressed).nonzero().flatten()
        for k, row in zip(moved.tolist(), now.only(moved).rows(), strict=True):
            world = self.worlds[k]
            assert isinstance(world, Twin)
            world.follow(self._batch.layout, *row)
        self._followed = now if self._followed is None else self._followed.replaced(moved, now.only(moved))

    # --- what is told

    def evaluate(self) -> dict[str, Any]:
        """How goals stand: `success` (n,) bool, `q` (n,), and `predicates`, each literal's text to (n,) bool."""
        if self._behind:
            self._behind = False
            self._follow()
            for world in self.worlds:
                world.stepped()
        snapshots = [snapshot(self._problem, truth) for truth in self._truths]
        for k, now in enumerate(snapshots):
            judged = self._judged[k]
            if judged is None or judged[0] != now:
                self._judged[k] = (now, judge(self._problem, self._before[k], now))
        reports = [judged[1] for judged in self._judged if judged is not None]
        return {
            "success": torch.tensor([report.satisfied for report in reports], device=self.device),
            "q": torch.tensor([report.q for report in reports], dtype=torch.float32, device=self.device),
            "predicates": {
                str(literal): torch.tensor([now[literal] for now in snapshots], device=self.device)
                for literal in snapshots[0]
            },
        }

    def get_reward(self, obs: Any, action: torch.Tensor, info: dict[str, Any]) -> torch.Tensor:
        """(n,) the rewards of the step that was just made."""
        if self._reward_mode in ("q_increment", "dense", "normalized_dense"):
            gained, self._rewarded = info["q"] - self._rewarded, info["q"]
            return gained
        return super().get_reward(obs, action, info)

    def _get_obs_extra(self, info: dict[str, Any]) -> dict[str, Any]:
        q = self.agent.robot.get_qpos()
        x, y, yaw = q[:, self._base].T
        extra: dict[str, Any] = {
            "base_pose": torch.stack([x, y, torch.atan2(torch.sin(yaw), torch.cos(yaw))], dim=1),
            "gripper_width": torch.stack([q[:, pair].sum(dim=1) for pair in self._hands], dim=1),
        }
        if self.obs_mode_struct.state or self._obs_mode in _STATE_MODES:
            extra["objects"] = {name: self._views[name].pose.raw_pose for name in self.worlds[0].objects}
            extra["openings"] = {
                name: self._views[name].get_qpos()[:, at] / limits for name, (at, limits) in self._openings.items()
            }
        return extra

    def _get_obs_sensor_data(self, apply_texture_transforms: bool = True) -> Any:
        if not self._twinned:
            self.world.show_states()
        return super()._get_obs_sensor_data(apply_texture_transforms)

    # --- its state

    def get_state_dict(self) -> dict[str, Any]:
        """Poses and speeds of all movable things, robot commands and switch states."""
        state: dict[str, Any] = super().get_state_dict()
        on = [list(world.switched.values()) for world in self.worlds]
        state["switches"] = torch.tensor(on, dtype=torch.float32, device=self.device)
        return state

    def set_state_dict(self, state: dict[str, Any], env_idx: torch.Tensor | None = None) -> None:
        """Bring everything to a state of `get_state_dict`, as ManiSkill has it: contacts are found anew."""
        super().set_state_dict(state, env_idx)
        rows = range(self.num_envs) if env_idx is None else env_idx.tolist()
        if "controller" in state:
            mask = self.scene._reset_mask
            self.scene._reset_mask = torch.zeros_like(mask)
            self.scene._reset_mask[list(rows)] = True
            self.agent.set_controller_state(_rows(state["controller"]))
            self.scene._reset_mask = mask
            if self.gpu_sim_enabled:
                self.scene.px.gpu_apply_articulation_target_position()
                self.scene.px.gpu_apply_articulation_target_velocity()
        if "switches" in state:
            for k, on in zip(rows, torch.as_tensor(state["switches"]).reshape(len(rows), -1).tolist(), strict=True):
                for name, value in zip(self.worlds[k].switched, on, strict=True):
                    self.worlds[k].turn(name, value > 0.5)
        if self._twinned:
            self._follow()
        else:
            self.world.robot.forget()


def begin_in_maniskill(
    task: str,
    instance: int,
    split: Split = "public",
    *,
    render: bool = True,
    assisted: bool = False,
    house: str | None = None,
) -> tuple[SimWorld, Start]:
    """An instance of a task in an environment of its own, which its world steps; as of `instances.instances.begin`."""
    env = MpviHouseEnv(
        task=task,
        instance=instance,
        split=split,
        house=house,
        assisted=assisted,
        obs_mode="none",
        reward_mode="none",
        render_backend=_drawing() if render else "none",
    )
    return env.world, env.start


def _drawing() -> str:
    """The rendering device."""
    return "gpu" if torch.cuda.is_available() else "cpu"


def _rows(state: Any) -> Any:
    """A state of one environment with its row again, which ManiSkill's files of demonstrations leave out."""
    if isinstance(state, dict):
        return {key: _rows(value) for key, value in state.items()}
    return state[None] if state.ndim == 1 else state


def _check_gpu(num_envs: int, sim_backend: str, assisted: bool) -> None:
    """Have physics on a GPU be possible in this process; raise UserError if so many environments cannot be had."""
    asked = f"num_envs={num_envs}, sim_backend={sim_backend!r}"
    if sim_backend in ("cpu", "physx_cpu"):
        raise UserError(f"{asked}: the CPU simulates one environment a process.")
    if not torch.cuda.is_available():
        raise UserError(
            f"{asked}: physics on the GPU needs CUDA, and there is none here; use one environment a process."
        )
    if assisted:
        raise UserError(
            f"{asked}: assisted=True fixes things to hands as it goes, which physics on a GPU has no way to."
        )
    try:
        if not sapien.physx.is_gpu_enabled():
            sapien.physx.enable_gpu()
    except (RuntimeError, OSError) as error:  # SAPIEN fetches its library for it when it is first used
        reason = str(error).strip().splitlines()[0] if str(error).strip() else "no reason given"
        raise UserError(
            f"{asked}: physics on the GPU cannot be had ({reason}); it has to be the first physics of a process."
        ) from None
