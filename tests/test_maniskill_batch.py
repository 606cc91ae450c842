"""What the ManiSkill environment does row by row: three rows on the CPU, and the many's way of one environment."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("mani_skill")

import gymnasium
import sapien
import torch
from mani_skill.utils.structs import Pose

from mpvi_bt.ground.errors import BackendError, UserError
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.robot.limits import within_limits
from mpvi_bt.hands.robots import r1
from mpvi_bt.house.goals.evaluate import snapshot
from mpvi_bt.house.goals.predicates import truth_in
from mpvi_bt.house.instances.instances import expanded_problem
from mpvi_bt.house.instances.tasks import load_task
from mpvi_bt.house.layout.house import load_house
from mpvi_bt.house.maniskill.agent import DeltaController, HandController, PositionController
from mpvi_bt.house.maniskill.batch import BatchState, StateLayout, Twin, begun, twin
from mpvi_bt.house.maniskill.drive_tensors import Drives
from mpvi_bt.house.maniskill.env import MpviHouseEnv
from mpvi_bt.house.sim.shaders import new_scene
from mpvi_bt.house.sim.sim_robot import SimRobot
from mpvi_bt.house.sim.world import SimWorld
from tests.layouts import LAYOUT

TASK = "picking_up_trash"


class Robots:
    """Robots of the core's, as far as ManiSkill's articulation of three would tell of them and be told."""

    def __init__(self, robots: Sequence[SimRobot]) -> None:
        names = [joint.name for joint in robots[0].articulation.active_joints]
        self.active_joints_map = {name: name for name in names}
        self._robots = robots
        self.told = {kind: np.full((len(robots), len(names)), np.nan, np.float32) for kind in ("target", "speed")}
        self._order = names

    def get_qpos(self) -> torch.Tensor:
        return torch.tensor(np.array([robot.articulation.get_qpos() for robot in self._robots]))

    def set_joint_drive_targets(self, targets: torch.Tensor, joints: list[str]) -> None:
        self.told["target"][:, [self._order.index(name) for name in joints]] = targets.numpy()

    def set_joint_drive_velocity_targets(self, targets: torch.Tensor, joints: list[str]) -> None:
        self.told["speed"][:, [self._order.index(name) for name in joints]] = targets.numpy()


@pytest.fixture
def three() -> tuple[list[sapien.Scene], list[SimRobot]]:
    """Three robots in scenes of their own, each turned another way."""
    scenes = [new_scene(render=False) for _ in range(3)]
    return scenes, [SimRobot(scene, np.array([k, -k, 1.3 * k]), None) for k, scene in enumerate(scenes)]


def commands(steps: int) -> np.ndarray:
    """(steps, 3, 23) commands near the posture to drive in; the last are the ones before over again."""
    rng = np.random.default_rng(0)
    wild = rng.uniform(-1, 1, (steps, 3, 23)) * 0.3
    wild[..., LAYOUT.torso] += r1.TRAVEL_TORSO
    for side, part in LAYOUT.arm.items():
        wild[..., part] += r1.TRAVEL_ARM[side]
    wild[-3:] = wild[-4]
    return np.array([[within_limits(r1.R1, row) for row in rows] for rows in wild])


def test_three_rows_of_drives_are_told_what_three_robots_are(
    three: tuple[list[sapien.Scene], list[SimRobot]],
) -> None:
    """Targets and speeds that a batch sends are, bit by bit, those that each robot of the core sends by itself."""
    scenes, robots = three
    batch = Robots(robots)
    drives = Drives(3, torch.device("cpu"))
    drives.take(batch)
    for rows in commands(8):
        drives.command[:] = torch.tensor(rows)
        drives.send()
        for robot, row in zip(robots, rows, strict=True):
            robot.act(row)
            robot.apply()
        for k, robot in enumerate(robots):
            for i, joint in enumerate(robot.articulation.active_joints):
                kinds = {"target": joint.drive_target[0], "speed": joint.drive_velocity_target[0]}
                for kind, told in kinds.items():
                    sent = batch.told[kind][k, i]
                    assert np.isnan(sent) or sent == told, (joint.name, kind)
            scenes[k].step()
    assert np.isfinite(batch.told["target"]).any(axis=1).all()
    np.testing.assert_array_equal(drives.base_velocity.numpy(), [robot.save()["base"] for robot in robots])


def test_some_rows_begin_anew_and_the_others_go_on(three: tuple[list[sapien.Scene], list[SimRobot]]) -> None:
    """What is restored for two of three robots leaves the command and the speed of the third as they were."""
    drives = Drives(3, torch.device("cpu"))
    first, second = torch.tensor(commands(8)[:2])
    drives.command[:] = first
    drives.base_velocity[:] = 0.2
    drives.restore(torch.tensor([0, 2]), second[[0, 2]], torch.zeros(2, 3))
    torch.testing.assert_close(drives.command[1], first[1], rtol=0, atol=0)
    torch.testing.assert_close(drives.command[[0, 2]], second[[0, 2]], rtol=0, atol=0)
    assert drives.base_velocity.any(dim=1).tolist() == [False, True, False]


@pytest.mark.parametrize("kind", [PositionController, DeltaController, HandController])
def test_three_actions_are_carried_out_as_each_alone(
    kind: type[PositionController], three: tuple[list[sapien.Scene], list[SimRobot]]
) -> None:
    """A controller's commands for three robots are those that it has for each of them in a batch of one."""
    _, robots = three
    controller: PositionController = object.__new__(kind)
    actions = torch.tensor(np.random.default_rng(1).uniform(-1, 1, (3, len(kind.lowest))))
    starts = torch.tensor(commands(8)[0])

    def carried_out(which: list[int]) -> torch.Tensor:
        drives = Drives(len(which), torch.device("cpu"))
        drives.take(Robots([robots[k] for k in which]))
        drives.command[:] = starts[which]
        return controller.command(drives, actions[which])

    together = carried_out([0, 1, 2])
    assert together.shape == (3, 23)
    assert (together - starts).abs().amax(dim=1).min() > 1e-3
    for k in range(3):
        torch.testing.assert_close(together[k], carried_out([k])[0], rtol=0, atol=1e-12)


def put_in_bin(world: SimWorld, count: int) -> None:
    """Put the first cans into the bin, where they stay."""
    bin_ = next(name for name in world.objects if name.startswith("ashcan"))
    for k, can in enumerate([name for name in world.objects if name.startswith("can")][:count]):
        world.place(can, kin.transform(np.eye(3), world.pose(bin_)[:3, 3] + [0.0, 0.0, 0.1 + 0.05 * k]), fixed=True)


def as_saved(world: SimWorld) -> dict[str, Any]:
    """What `SimWorld.save` tells, with the robot's joints by name."""
    saved = world.save()
    names = [joint.name for joint in world.robot.articulation.active_joints]
    return {**saved, "joints": dict(zip(names, saved["robot"]["q"], strict=True))}


def test_one_twin_judges_three_rows_as_their_worlds_are_judged() -> None:
    """Worlds with no, one and two cans in the bin become three rows, and a twin that stands as each has its goal."""
    task = load_task(TASK)
    house = load_house(task.house)
    problem = expanded_problem(task, house)
    worlds = [twin(house, begun(TASK, k, "public"), "r1") for k in range(3)]
    for k, world in enumerate(worlds):
        put_in_bin(world, k)
        world.refresh()
    names = begun(TASK, 0, "public").start.scene_names
    due = [snapshot(problem, truth_in(world, names)) for world in worlds]
    assert len({sum(truth.values()) for truth in due}) == 3
    layout = StateLayout(
        {name: worlds[0].thing(name) for name in worlds[0].things},
        [joint.name for joint in worlds[0].robot.articulation.active_joints],
    )
    standing = layout.standing([as_saved(world) for world in worlds])
    follower = twin(house, begun(TASK, 0, "public"), "r1")
    for (poses, joints, robot), truth, world in zip(standing.rows(), due, worlds, strict=True):
        follower.follow(layout, poses, joints, robot)
        assert snapshot(problem, truth_in(follower, names)) == truth
        np.testing.assert_allclose(
            follower.robot.proprioception().base_pose, world.robot.proprioception().base_pose, atol=1e-5
        )
        for name in world.objects:
            assert np.abs(follower.pose(name) - world.pose(name)).max() < 1e-5, name


def test_rows_are_told_apart_by_what_moved() -> None:
    """Only the rows in which a thing or a door has moved are followed; what the robot does is no matter."""
    before = BatchState(torch.zeros(3, 2, 7), torch.zeros(3, 4), torch.zeros(3, 5))
    now = BatchState(before.poses.clone(), before.joints.clone(), torch.ones(3, 5))
    now.poses[1, 0, 2], now.joints[2, 3] = 0.01, 0.02
    assert now.moved_since(before).tolist() == [False, True, True]
    assert now.moved_since(None).all()
    rows = torch.tensor([1])
    followed = before.replaced(rows, now.only(rows))
    assert now.moved_since(followed).tolist() == [False, False, True]


@pytest.mark.parametrize(
    ("made_for", "options", "rows", "expected"),
    [
        (4, {}, [0, 1, 2], [4, 4, 4]),
        ([3, 7], {}, [0, 1, 2], [3, 7, 3]),
        ([3, 7], {"instance": 5}, [1], [0, 5, 0]),
        (4, {"instance": [8, 9]}, [0, 2], [8, 0, 9]),
    ],
)
def test_instances_are_spread_over_environments(
    made_for: int | list[int], options: dict[str, Any], rows: list[int], expected: list[int]
) -> None:
    """One instance is that of all; several go round; a reset's own go to the environments that it resets."""
    env = SimpleNamespace(
        _fixed_instance=made_for, instances=[0, 0, 0], task=SimpleNamespace(check_instance=lambda instance: None)
    )
    MpviHouseEnv._choose(env, rows, options)  # type: ignore[arg-type]
    assert env.instances == expected


@pytest.fixture(scope="module")
def twinned() -> Iterator[MpviHouseEnv]:
    """One environment on the CPU, gone about as many on a GPU are: built apart, put in place, judged by a twin."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(MpviHouseEnv, "_twinned", True)
        made = gymnasium.make("MpviHouse-v1", task=TASK, instance=0, obs_mode="state_dict", reconfiguration_freq=0)
        env = made.unwrapped
        assert isinstance(env, MpviHouseEnv)
        yield env
        made.close()


def test_what_is_put_in_place_stands_as_the_core_has_it(twinned: MpviHouseEnv) -> None:
    """After resets, whole and partial, things and robot stand within 1 mm of where they rest in the core."""
    for k, options in enumerate(({"instance": 2}, {"instance": 1, "env_idx": torch.tensor([0])})):
        obs, _ = twinned.reset(options=options)
        there = twin(load_house(load_task(TASK).house), begun(TASK, (2, 1)[k], "public"), "r1")
        assert twinned.instance == (2, 1)[k]
        for name in there.objects:
            assert np.abs(obs["extra"]["objects"][name][0, :3].numpy() - there.pose(name)[:3, 3]).max() < 1e-3, name
        np.testing.assert_allclose(obs["extra"]["base_pose"][0], there.robot.proprioception().base_pose, atol=1e-3)
        still = twinned.agent.drives.command.float()
        for _ in range(15):
            obs, *_ = twinned.step(still)
        for name in there.objects:
            assert np.abs(obs["extra"]["objects"][name][0, :3].numpy() - there.pose(name)[:3, 3]).max() < 2e-3, name


def test_twins_see_what_is_done(twinned: MpviHouseEnv) -> None:
    """Cans that are put into the bin where things are simulated raise q, and rewards sum up to it."""
    twinned.reset(options={"instance": 0})
    world = twinned.worlds[0]
    assert isinstance(world, Twin)
    cans = [name for name in world.objects if name.startswith("can")]
    bin_ = twinned._views[next(name for name in world.objects if name.startswith("ashcan"))]
    still, rewards = twinned.agent.drives.command.float(), []
    for k, can in enumerate(cans):
        pose = bin_.pose.raw_pose.clone()
        pose[:, 2] += 0.1 + 0.05 * k
        twinned._views[can].set_pose(Pose.create(pose))
        twinned._views[can].set_linear_velocity(torch.zeros(3))
        _, reward, terminated, _, info = twinned.step(still)
        rewards.append(reward)
        assert terminated.tolist() == [can == cans[-1]]
    assert info["q"].tolist() == [1.0]
    assert float(torch.stack(rewards).sum()) == pytest.approx(1.0)
    state = twinned.get_state_dict()
    twinned.reset(options={"instance": 0})
    assert twinned.evaluate()["q"].tolist() == [0.0]
    twinned.set_state_dict(state)
    assert twinned.evaluate()["q"].tolist() == [1.0]


def test_what_many_cannot_have_is_refused(twinned: MpviHouseEnv, monkeypatch: pytest.MonkeyPatch) -> None:
    """Trees, assisted grasps, many on the CPU, and a GPU asked for too late or in vain: each is one clear line."""

    def make(**kwargs: Any) -> None:
        gymnasium.make("MpviHouse-v1", task=TASK, **kwargs)

    with pytest.raises(UserError, match="trees drive one environment on the CPU"):
        assert twinned.world
    with pytest.raises(UserError, match="the CPU simulates one environment a process"):
        make(num_envs=3, sim_backend="physx_cpu")
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    for kwargs in ({"num_envs": 3}, {"sim_backend": "physx_cuda"}):
        with pytest.raises(UserError, match="needs CUDA"):
            make(**kwargs)
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    with pytest.raises(UserError, match="assisted"):
        make(num_envs=3, assisted=True)

    def too_late() -> None:
        raise RuntimeError("PhysX has begun")

    monkeypatch.setattr(sapien.physx, "enable_gpu", too_late)
    with pytest.raises(UserError, match="the first physics of a process"):
        make(num_envs=3)


def test_an_action_that_is_not_finite_is_refused(twinned: MpviHouseEnv) -> None:
    """One NaN among the actions is one clear line."""
    twinned.reset()
    with pytest.raises(BackendError, match="not finite"):
        twinned.step(np.full(23, np.nan, np.float32))


def test_a_finger_turns_on_what_a_twin_has() -> None:
    """A switch that stays at a fingertip where things are simulated is on in the twin after its five steps."""
    episode = begun("turning_on_radio", 0, "public")
    world = twin(load_house(load_task("turning_on_radio").house), episode, "r1")
    layout = StateLayout(
        {name: world.thing(name) for name in world.things},
        [joint.name for joint in world.robot.articulation.active_joints],
    )
    radio = world.objects[0]
    ((poses, joints, robot),) = layout.standing([episode.saved]).rows()
    poses = poses.copy()
    poses[layout.free.index(radio), :3] += world.robot.fingertips_world()[0] - world.switches(radio)[0][:3, 3]
    on = []
    for _ in range(6):
        world.follow(layout, poses, joints, robot)
        world.stepped()
        on.append(world.switched[radio])
    assert on == [False] * 4 + [True] * 2


@pytest.mark.rare
@pytest.mark.slow
def test_maniskills_fetch_is_gone_about_the_same_way(monkeypatch: pytest.MonkeyPatch) -> None:
    """Put in place and followed by a twin, ManiSkill's Fetch stands where it is due and drives as it is told."""
    monkeypatch.setattr(MpviHouseEnv, "_twinned", True)
    made = gymnasium.make("MpviHouse-v1", task=TASK, instance=0, robot_uids="fetch", obs_mode="state_dict")
    env = made.unwrapped
    assert isinstance(env, MpviHouseEnv)
    obs, _ = env.reset()
    np.testing.assert_allclose(obs["extra"]["base_pose"][0], env.start.base_pose, atol=1e-3)
    action = np.zeros(made.action_space.shape or (), np.float32)
    action[7], action[-2] = -1.0, 0.3  # gripper, ahead
    for _ in range(60):
        obs, _, _, _, info = env.step(action)
    assert float(torch.norm(obs["extra"]["base_pose"][0, :2] - torch.tensor(env.start.base_pose[:2]))) > 0.4
    assert obs["extra"]["gripper_width"].shape == (1, 1)
    assert info["q"].shape == (1,)
    made.close()
