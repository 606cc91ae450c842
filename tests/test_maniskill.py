"""`MpviHouse-v1`: the core's worlds in ManiSkill's form."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("mani_skill")

import gymnasium
import torch
from mani_skill.utils import common
from mani_skill.utils.wrappers.flatten import FlattenRGBDObservationWrapper
from mani_skill.utils.wrappers.gymnasium import CPUGymWrapper
from mani_skill.utils.wrappers.record import RecordEpisode

from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import BackendError, UnknownName, UserError
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.robot.model import SIGN
from mpvi_bt.hands.robots import r1
from mpvi_bt.hands.robots.fetch import FETCH
from mpvi_bt.hands.robots.r1 import R1
from mpvi_bt.house.instances.instances import begin, expanded_problem
from mpvi_bt.house.instances.tasks import load_task
from mpvi_bt.house.layout.house import load_house
from mpvi_bt.house.maniskill import MpviHouseEnv
from mpvi_bt.house.sim.world import SimWorld
from mpvi_bt.house.things.catalogue import load_catalogue
from tests.layouts import ACTION_SIZE, BASE, LAYOUT

TASK = "picking_up_trash"


def make(**kwargs: Any) -> gymnasium.Env[Any, Any]:
    """The environment, small and blind unless asked otherwise."""
    return gymnasium.make("MpviHouse-v1", **{"task": TASK, "instance": 0, **kwargs})


def inner(env: gymnasium.Env[Any, Any]) -> MpviHouseEnv:
    """The environment under its wrappers."""
    unwrapped = env.unwrapped
    assert isinstance(unwrapped, MpviHouseEnv)
    return unwrapped


@pytest.fixture(scope="module")
def env() -> Iterator[gymnasium.Env[Any, Any]]:
    """One environment for all tests that reset it anyway."""
    made = make(obs_mode="state_dict")
    yield made
    made.close()


def test_it_says_where_it_is_made(env: gymnasium.Env[Any, Any]) -> None:
    """The id in its spec, which recordings keep, names the module: what imports nothing of ours makes it by that."""
    assert env.spec is not None
    assert env.spec.id == "mpvi_bt.house.maniskill:MpviHouse-v1"


@pytest.mark.render
def test_pictures_of_one_size_can_be_stacked() -> None:
    """ManiSkill's flattening wrapper takes the environment with one size for all cameras, as the page says."""
    env = make(obs_mode="rgbd", sensor_configs={"width": 32, "height": 24})
    flat, _ = FlattenRGBDObservationWrapper(env).reset(seed=0)
    assert {key: tuple(value.shape) for key, value in flat.items()} == {
        "state": (1, 81), "rgb": (1, 24, 32, 9), "depth": (1, 24, 32, 3),
    }  # fmt: skip
    env.close()


def core(instance: int = 0, render: bool = False) -> SimWorld:
    """The same start in the core."""
    task = load_task(TASK)
    house = load_house(task.house)
    problem = expanded_problem(task, house)
    return begin(task, house, load_catalogue(), problem, instance, render=render)[0]


def wanders(steps: int, seed: int = 0) -> np.ndarray:
    """(steps, 23) float32 commands that drive about smoothly and swing the arms."""
    rng = np.random.default_rng(seed)
    at = np.arange(steps)[:, None] / 30
    waves = np.sin(at * rng.uniform(0.5, 2.0, ACTION_SIZE) + rng.uniform(0, 6, ACTION_SIZE))
    actions = np.zeros((steps, ACTION_SIZE))
    actions[:, BASE] = waves[:, :3] * [0.4, 0.2, 0.8]
    actions[:, LAYOUT.torso] = r1.TRAVEL_TORSO + waves[:, 3:7] * [0.05, 0.2, 0.1, 0.2]
    for side, part in LAYOUT.arm.items():
        actions[:, part] = r1.TRAVEL_ARM[side] + 0.15 * waves[:, part]
    return actions.astype(np.float32)


@pytest.mark.parametrize("instance", [0, 3])
def test_things_begin_where_the_core_has_them(env: gymnasium.Env[Any, Any], instance: int) -> None:
    """After a reset every movable thing and the robot stand where they do in the core, to a thousandth of 1 mm."""
    env.reset(options={"instance": instance})
    here, there = inner(env).world, core(instance)
    for name in there.objects:
        assert np.abs(here.pose(name) - there.pose(name)).max() < 1e-6, name
    assert np.abs(here.robot.proprioception().base_pose - there.robot.proprioception().base_pose).max() < 1e-6


def test_another_house_is_built(tmp_path: Path) -> None:
    """A copy of the task's own, without its pictures: things begin as there; a house that is not there is refused."""
    lines = paths.find("tasks/houses", "family_house").read_text("utf-8").splitlines()
    (tmp_path / "bare.yaml").write_text("\n".join(line for line in lines if "entry: picture" not in line))
    made = make(house=str(tmp_path / "bare.yaml"))
    pictures = [name for name in inner(made).world.house.fixtures if name.endswith("_picture")]
    assert pictures == []
    made.close()
    with pytest.raises(UnknownName, match="family_house"):
        make(house="famly_house")


def test_an_option_of_reset_that_is_not_there_is_refused(env: gymnasium.Env[Any, Any]) -> None:
    """With the nearest one: it was passed over, and another start was played than the one that was meant."""
    with pytest.raises(UnknownName, match=r"unknown option of reset 'instnace'\. Did you mean 'instance'"):
        env.reset(options={"instnace": 3})
    env.reset(options={"instance": 3, "reconfigure": False})


def test_the_same_commands_drive_the_same_way(env: gymnasium.Env[Any, Any]) -> None:
    """Ten seconds of the same commands give paths of the base within 2 cm of each other all along."""
    env.reset()
    here, there = inner(env).world, core()
    begun = there.robot.proprioception().base_pose
    apart = []
    for action in wanders(300):
        env.step(action)
        there.robot.act(action)
        there.step()
        apart.append(here.robot.proprioception().base_pose - there.robot.proprioception().base_pose)
    assert np.linalg.norm((there.robot.proprioception().base_pose - begun)[:2]) > 0.3
    assert np.linalg.norm(np.array(apart)[:, :2], axis=1).max() < 0.02


def test_a_tree_drives_it_the_cores_way(env: gymnasium.Env[Any, Any]) -> None:
    """Stepped as a `SimWorld` with commands of all digits, robot and movable things are as in the core, bit by bit."""
    env.reset()
    here, there = inner(env).world, core()
    for action in wanders(60, seed=3).astype(float) + 1e-9:
        here.robot.act(action)
        here.step()
        there.robot.act(action)
        there.step()
    ours, theirs = here.save(), there.save()
    assert ours["robot"] == theirs["robot"]
    assert [ours["things"][name] for name in here.objects] == [theirs["things"][name] for name in here.objects]


def test_a_seed_gives_the_same_episode(env: gymnasium.Env[Any, Any]) -> None:
    """The same seed and actions give the same observations, bit by bit, whatever came before."""
    runs = []
    for _ in range(2):
        first, _ = env.reset(seed=5, options={"instance": None})
        last = [env.step(action)[0] for action in wanders(20, seed=1)][-1]
        runs.append([inner(env).instance, *leaves(first), *leaves(last)])
        env.reset(seed=6)
        env.step(wanders(1)[0])
    assert all(np.array_equal(a, b) for a, b in zip(*runs, strict=True))


def leaves(tree: Any) -> Iterator[np.ndarray]:
    """The arrays of an observation."""
    if isinstance(tree, dict):
        for part in tree.values():
            yield from leaves(part)
    else:
        yield np.asarray(tree)


def test_what_sleeps_keeps_its_contacts(env: gymnasium.Env[Any, Any]) -> None:
    """A can that has fallen asleep still touches the floor: goals are judged at each step without waking anything."""
    env.reset()
    world = inner(env).world
    can = next(name for name in world.objects if name.startswith("can"))
    floor = next(name for name in world.things if name.startswith("floor_") and world.touching(can, name))
    for _ in range(60):
        world.step()
    assert world.thing(can).rigid_body.is_sleeping
    assert world.touching(can, floor)
    world.place(can, kin.transform(np.eye(3), (0.0, 0.0, 5.0)))
    world.step()
    assert not world.touching(can, floor)


def test_q_grows_with_what_is_done_and_rewards_sum_up_to_it(env: gymnasium.Env[Any, Any]) -> None:
    """Cans in the bin raise q one by one; increments sum up to it; with the last the episode ends in success."""
    env.reset()
    world = inner(env).world
    cans = [name for name in world.objects if name.startswith("can")]
    bin_ = next(name for name in world.objects if name.startswith("ashcan"))
    rewards = []
    for k, can in enumerate(cans):
        inside = world.pose(bin_)[:3, 3] + [0.0, 0.0, 0.1 + 0.05 * k]
        world.place(can, kin.transform(np.eye(3), inside), fixed=True)
        _, reward, terminated, _, info = env.step(world.robot.action.astype(np.float32))
        rewards.append(float(reward))
        assert bool(terminated) == (can == cans[-1])
    assert info["q"].shape == info["success"].shape == (1,)
    assert float(info["q"]) == pytest.approx(sum(rewards)) == 1.0
    assert bool(info["success"])
    assert [bool(holds) for holds in info["predicates"].values()] == [True] * len(cans)


@pytest.mark.parametrize("batched", [True, False])
def test_a_state_is_restored(env: gymnasium.Env[Any, Any], batched: bool) -> None:
    """A state that is set comes back the same, commands and all; one from a file has no row for each environment."""
    env.reset()
    for action in wanders(10):
        env.step(action)
    state = inner(env).get_state_dict()
    for action in wanders(10, seed=2):
        env.step(action)
    inner(env).set_state_dict(state if batched else common.to_numpy(common.unbatch(state)))
    for now, then in zip(leaves(inner(env).get_state_dict()), leaves(state), strict=True):
        np.testing.assert_allclose(now, then, atol=1e-5)


def test_putting_things_back_is_as_good_as_building_anew() -> None:
    """Where resets only put things back, they stand within 1 mm of where a new scene has them."""
    env = make(instance=None, reconfiguration_freq=0)
    for instance in (1, 2, 1):
        env.reset(options={"instance": instance})
        here, there = inner(env).world, core(instance)
        for name in there.objects:
            assert np.abs(here.pose(name)[:3, 3] - there.pose(name)[:3, 3]).max() < 1e-3, name
        assert np.abs(here.robot.proprioception().base_pose - there.robot.proprioception().base_pose).max() < 1e-3
        for action in wanders(15):
            env.step(action)
    env.close()


def test_what_is_observed_and_done_is_documented(env: gymnasium.Env[Any, Any]) -> None:
    """The page names each key of an observation, each mode of control with its size, and each reward."""
    page = (Path(__file__).parent.parent / "docs" / "maniskill.md").read_text(encoding="utf-8")
    obs, _ = env.reset()
    named = set(re.findall(r"`([^`\n]+)`", page))
    for group in ("agent", "extra"):
        for name, part in obs[group].items():
            inside = [f"{group}/{name}/{key}" for key in part] if isinstance(part, dict) else [f"{group}/{name}"]
            assert named.issuperset(inside) or f"{group}/{name}/NAME" in named, inside
    for mode, config in inner(env).agent._controller_configs.items():
        assert f"| `{mode}` | {len(config.controller_cls.lowest)}" in page
    assert not [name for name in MpviHouseEnv.SUPPORTED_REWARD_MODES if f'"{name}"' not in page]


def test_physics_are_set_as_in_the_core(env: gymnasium.Env[Any, Any]) -> None:
    """Both simulators step 120 times a second with the same settings."""
    import sapien

    from mpvi_bt.house.sim.shaders import new_scene

    def settings() -> list[str]:
        physx = sapien.physx
        configs = (physx.get_shape_config(), physx.get_body_config(), physx.get_scene_config())
        return [f"{n}={getattr(c, n)}" for c in configs for n in sorted(dir(c)) if not n.startswith("_")]

    env.reset()
    ours = settings()
    scene = new_scene(render=False)
    assert settings() == ours
    assert inner(env).scene.timestep == pytest.approx(scene.timestep)


@pytest.mark.rare
def test_deltas_of_zero_leave_the_joints_where_they_are() -> None:
    """In both delta modes a robot that is asked for nothing stays as it stands."""
    for mode in ("pd_joint_target_delta_pos", "pd_ee_target_delta_pose"):
        env = make(control_mode=mode)
        env.reset()
        robot = inner(env).world.robot
        before = robot.proprioception()
        nothing = np.zeros_like(env.action_space.sample())
        for _ in range(20):
            env.step(nothing)
        after = robot.proprioception()
        assert np.abs(after.base_pose - before.base_pose).max() < 1e-3
        assert np.abs(after.arm["left"] - before.arm["left"]).max() < 0.01
        env.close()


def test_a_hand_goes_where_it_is_asked_to() -> None:
    """Deltas of a hand move it along the base's axes, and the other hand not at all."""
    env = make(control_mode="pd_ee_target_delta_pose")
    env.reset()
    robot = inner(env).world.robot
    action = np.zeros(21, np.float32)
    action[[13, 20]] = 1.0
    action[7] = 1.0  # the left hand forward
    begin = {side: R1.tcp(f.torso, f.arm[side], side) for f in [robot.proprioception()] for side in SIGN}
    for _ in range(20):
        env.step(action)
    end = {side: R1.tcp(f.torso, f.arm[side], side) for f in [robot.proprioception()] for side in SIGN}
    moved = {side: end[side][:3, 3] - begin[side][:3, 3] for side in SIGN}
    assert moved["left"][0] == pytest.approx(20 * 0.5 / 30, abs=0.03)
    assert np.abs(moved["left"][1:]).max() < 0.02
    assert np.abs(moved["right"]).max() < 0.01
    env.close()


def test_what_cannot_be_made_is_refused() -> None:
    """Unknown tasks, robots and instances, and physics on a GPU that is not there, are one clear line."""
    with pytest.raises(UnknownName, match="picking_up_trash"):
        make(task="picking_up_thrash")
    with pytest.raises(UserError, match="instance 9999"):
        make(instance=9999)
    with pytest.raises(UserError, match="num_envs=2"):
        make(num_envs=2)
    with pytest.raises(UnknownName, match="robot 'panda'"):
        make(robot_uids="panda")


@pytest.mark.rare
@pytest.mark.slow
def test_gymnasium_finds_nothing_wrong() -> None:
    """Gymnasium's own checker passes the environment."""
    from gymnasium.utils.env_checker import check_env

    env = CPUGymWrapper(make(obs_mode="state"))
    check_env(env, skip_render_check=True, skip_close_check=True)  # these make it anew, without ManiSkill's wrappers
    env.close()


@pytest.mark.rare
@pytest.mark.slow
def test_a_recorded_episode_replays(tmp_path: Path) -> None:
    """What `RecordEpisode` writes holds actions and states, and its actions lead through the same states again."""
    import h5py

    env = RecordEpisode(make(instance=None), str(tmp_path), trajectory_name="demo", save_video=False)
    env.reset(seed=7)
    for action in wanders(30):
        env.step(action)
    env.close()
    told = json.loads((tmp_path / "demo.json").read_text())
    command = [
        sys.executable,
        "-m",
        "mani_skill.trajectory.replay_trajectory",
        "--traj-path",
        str(tmp_path / "demo.h5"),
    ]
    options = ["--obs-mode", "state", "--save-traj", "--allow-failure"]
    done = subprocess.run([*command, *options], capture_output=True, text=True, timeout=600)
    assert "1/1=100.00% demos saved" in done.stdout + done.stderr  # it has imported nothing of ours
    with h5py.File(tmp_path / "demo.h5") as file:
        recorded = file["traj_0"]
        actions, states = recorded["actions"][:], recorded["env_states"]
        again = gymnasium.make("MpviHouse-v1", **told["env_info"]["env_kwargs"])
        again.reset(**told["episodes"][0]["reset_kwargs"])
        for action in actions:
            again.step(action)
        end = inner(again).get_state_dict()
        np.testing.assert_array_equal(end["articulations"]["r1"][0], states["articulations"]["r1"][-1])
        for name, state in end["actors"].items():
            np.testing.assert_array_equal(state[0], states["actors"][name][-1])
        again.close()


@pytest.mark.rare
@pytest.mark.slow
def test_random_steps_leave_numbers_finite_and_memory_alone() -> None:
    """Random actions over several episodes give no NaN, and no episode keeps memory."""
    env = make(obs_mode="state", instance=None)
    kept = []
    env.action_space.seed(0)
    for episode in range(6):
        obs, _ = env.reset(seed=episode)
        for _ in range(60):
            obs, reward, *_ = env.step(env.action_space.sample())
            assert bool(torch.isfinite(obs).all())
            assert bool(torch.isfinite(reward).all())
        kept.append(int(Path("/proc/self/statm").read_text().split()[1]) * 4096)
    assert kept[-1] - kept[2] < 20e6
    env.close()


@pytest.mark.render
@pytest.mark.slow
def test_pictures_are_those_of_the_core() -> None:
    """In one process both draw, and every pixel is the same."""
    there = core(render=True)
    env = make(obs_mode="rgb")
    obs, _ = env.reset()
    for camera in r1.CAMERAS:
        ours = obs["sensor_data"][camera]["rgb"][0].numpy()
        assert np.abs(ours.astype(int) - there.robot.look(camera).rgb).max() <= 1, camera
    env.close()


@pytest.mark.render
@pytest.mark.slow
@pytest.mark.parametrize("mode", ["rgb", "rgbd", "rgb+segmentation"])
def test_pictures_show_the_house(mode: str) -> None:
    """Each camera gives the pictures of its mode; labels name things of the house; depth is within its range."""
    env = make(obs_mode=mode)
    obs, _ = env.reset()
    known = inner(env).segmentation_id_map
    for name, camera in r1.CAMERAS.items():
        pictures = obs["sensor_data"][name]
        assert pictures["rgb"].shape == (1, camera.height, camera.width, 3)
        assert pictures["rgb"].float().std() > 5
        if mode == "rgbd":
            assert 0 < int(pictures["depth"].max()) <= camera.far_m * 1000
        if "segmentation" in mode:
            seen = {known[k].name for k in np.unique(pictures["segmentation"]).tolist() if k in known}
            assert any(name.startswith(("floor_", "wall_")) for name in seen) or name != "head"
    assert obs["extra"]["base_pose"].shape == (1, 3)
    assert "objects" not in obs["extra"]
    env.close()


@pytest.fixture(scope="module")
def fetch() -> Iterator[gymnasium.Env[Any, Any]]:
    """ManiSkill's own Fetch in the house."""
    made = make(robot_uids="fetch", obs_mode="state_dict")
    yield made
    made.close()


def test_maniskills_fetch_begins_where_the_r1_does(fetch: gymnasium.Env[Any, Any]) -> None:
    """It stands at the instance's pose, its arm folded, touches nothing but the ground, and is felt where it is."""
    fetch.reset()
    world = inner(fetch).world
    felt = world.robot.proprioception()
    np.testing.assert_allclose(felt.base_pose, inner(fetch).start.base_pose, atol=1e-4)
    np.testing.assert_allclose(felt.arm["right"], FETCH.travel_arm["right"], atol=1e-2)
    touched = {other for pair in world.contacts() if "robot" in pair[:2] for other in pair[:2]} - {"robot"}
    assert not [name for name in touched if not name.startswith("floor_")]
    hand = world.robot.links["gripper_link"].entity.pose.to_transformation_matrix()
    np.testing.assert_allclose(world.robot.hand_pose_world("right")[:3, 3], (hand @ [0.019, 0, 0, 1])[:3], atol=1e-3)


def test_maniskills_fetch_does_as_its_controllers_are_told(fetch: gymnasium.Env[Any, Any]) -> None:
    """Two seconds at 0.3 m/s take it 0.6 m ahead over the floor; what is commanded is felt."""
    obs, _ = fetch.reset()
    assert obs["agent"]["qpos"].shape == (1, 15)
    world = inner(fetch).world
    begun = world.robot.proprioception().base_pose
    action = np.zeros(fetch.action_space.shape or (), np.float32)
    action[7], action[-2] = -1.0, 0.3  # gripper, ahead
    for _ in range(60):
        fetch.step(action)
    felt = world.robot.proprioception()
    gone = felt.base_pose - begun
    ahead = gone[0] * np.cos(begun[2]) + gone[1] * np.sin(begun[2])
    assert ahead == pytest.approx(0.6, abs=0.08)
    assert felt.gripper_command["right"] == pytest.approx(-1.0)
    assert felt.gripper_width["right"] < 0.01


def test_maniskills_fetch_is_judged_as_the_r1_is(fetch: gymnasium.Env[Any, Any]) -> None:
    """Cans in the bin are q 1, whoever put them there; trees do not drive it, which is one clear line."""
    fetch.reset()
    world = inner(fetch).world
    bin_ = next(name for name in world.objects if name.startswith("ashcan"))
    for k, can in enumerate(name for name in world.objects if name.startswith("can")):
        world.place(can, kin.transform(np.eye(3), world.pose(bin_)[:3, 3] + [0.0, 0.0, 0.1 + 0.05 * k]), fixed=True)
    _, reward, terminated, _, info = fetch.step(np.zeros(fetch.action_space.shape or (), np.float32))
    assert float(info["q"]) == float(reward) == 1.0
    assert bool(terminated)
    with pytest.raises(BackendError, match="its own controllers"):
        world.step()


@pytest.mark.rare
@pytest.mark.slow
def test_random_steps_of_maniskills_fetch_are_finite_and_repeat() -> None:
    """Random actions give finite observations, and the same ones again for the same seed."""
    runs = []
    for _ in range(2):
        env = make(robot_uids="fetch", obs_mode="state")
        env.action_space.seed(0)
        env.reset(seed=3)
        runs.append(np.stack([env.step(env.action_space.sample())[0].numpy() for _ in range(40)]))
        env.close()
    assert np.isfinite(runs[0]).all()
    np.testing.assert_array_equal(runs[0], runs[1])
