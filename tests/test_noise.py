"""The error model of the senses has the sizes that it says, follows from its seed, and vanishes at zero."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import CameraImage, Proprioception
from mpvi_bt.hands.robots.r1 import R1
from mpvi_bt.house.sim.mistaken import MistakenTruth
from mpvi_bt.house.sim.noise import NONE, REALISTIC, Errors, NoisyRobot, StandingError
from mpvi_bt.testing import KinematicRobot
from tests.small_house import placed, run, small_world


class Seeing(KinematicRobot):
    """A kinematic robot that stands where it is put and sees a wall two meters away, half of it labeled 1."""

    def __init__(self, pose: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> None:
        super().__init__()
        self.pose = np.array(pose)

    def proprioception(self) -> Proprioception:
        return replace(super().proprioception(), base_pose=self.pose.copy(), base_velocity=np.zeros(3))

    def look(self, camera: str) -> CameraImage:
        labels = np.zeros((120, 160), np.int32)
        labels[:60, :80] = 1
        depth = np.full((120, 160), 2.0, np.float32)
        rgb = np.zeros((120, 160, 3), np.uint8)
        return CameraImage(camera, rgb, depth, labels, {1: "wall"}, np.eye(3), np.eye(4))


def noisy(errors: Errors, seed: int = 0, robot: Seeing | None = None) -> NoisyRobot:
    return NoisyRobot(robot or Seeing(), None, errors, seed)


def drive(robot: Seeing, senses: NoisyRobot, meters: float, steps: int = 50) -> Array:
    """The error of the believed pose (3,) after driving straight ahead."""
    for _ in range(steps):
        robot.pose = robot.pose + [meters / steps, 0, 0]
        senses.proprioception()
    return senses.proprioception().base_pose - robot.pose


def test_without_errors_everything_is_as_it_is() -> None:
    """At zero the robot feels, sees and believes the truth."""
    robot = Seeing((1.0, 2.0, 0.5))
    senses = noisy(NONE, robot=robot)
    drive(robot, senses, 1.0)
    np.testing.assert_allclose(senses.proprioception().base_pose, robot.pose, atol=1e-12)
    image, true = senses.look("head"), robot.look("head")
    np.testing.assert_array_equal(image.depth, true.depth)
    np.testing.assert_array_equal(image.labels, true.labels)
    felt = robot.proprioception()
    np.testing.assert_allclose(image.T_world_camera, kin.base(felt.base_pose) @ R1.head_camera(felt.torso), atol=1e-12)
    np.testing.assert_allclose(senses.mounts["left"], np.eye(4), atol=1e-12)


def test_depth_errors_grow_with_the_square_of_the_range() -> None:
    """Two meters away a pixel is off by four times 3 mm, and one in fifty has no depth."""
    depth = np.stack([noisy(REALISTIC, seed).look("head").depth for seed in range(20)])
    assert np.mean(depth == 0) == pytest.approx(0.02, abs=0.003)
    assert np.std(depth[depth > 0] - 2.0) == pytest.approx(0.012, rel=0.05)
    assert np.mean(depth[depth > 0]) == pytest.approx(2.0, abs=1e-3)


def test_labels_are_shifted_by_one_pixel() -> None:
    """Every picture's labels are those of a neighboring pixel, and all directions come up."""
    senses, true = noisy(REALISTIC), Seeing().look("head").labels
    assert true is not None
    seen = set()
    for _ in range(100):
        labels = senses.look("head").labels
        assert labels is not None
        corner = np.argwhere(labels == 1).max(0)
        seen.add((int(corner[0]) - 59, int(corner[1]) - 79))
        assert set(np.unique(labels)) == {0, 1}
    assert seen == {(y, x) for y in (-1, 0, 1) for x in (-1, 0, 1) if (y, x) != (0, 0)}


@pytest.mark.parametrize("meters", [1.0, 4.0])
@pytest.mark.parametrize("steps", [10, 50])
def test_odometry_walks_with_the_root_of_the_way(meters: float, steps: int) -> None:
    """After one meter the heading is off by 0.6 degrees, after four by twice that, however often it is asked."""
    off = []
    for seed in range(120):
        robot = Seeing()
        off.append(drive(robot, noisy(REALISTIC, seed, robot), meters, steps))
    deviation = np.std(off, axis=0)
    assert deviation[2] == pytest.approx(np.deg2rad(0.6) * np.sqrt(meters), rel=0.2)
    assert deviation[0] == pytest.approx(0.01 * np.sqrt(meters), rel=0.2)  # along the way; across it, heading adds
    assert deviation[1] >= 0.008 * np.sqrt(meters)


def test_who_stands_does_not_drift() -> None:
    """Asking again and again while standing changes nothing."""
    robot = Seeing()
    senses = noisy(REALISTIC, robot=robot)
    drive(robot, senses, 1.0)
    believed = senses.proprioception().base_pose
    for _ in range(100):
        senses.look("head")
        np.testing.assert_array_equal(senses.proprioception().base_pose, believed)


def test_mounts_are_off_by_their_sizes_and_stay_so() -> None:
    """Each camera sits one degree and 5 mm off, each in a direction of its own, all through an episode."""
    senses = noisy(REALISTIC, 3)
    for T in senses.mounts.values():
        assert np.linalg.norm(T[:3, 3]) == pytest.approx(0.005)
        assert np.rad2deg(np.arccos((np.trace(T[:3, :3]) - 1) / 2)) == pytest.approx(1.0)
    assert not np.allclose(senses.mounts["head"], senses.mounts["left"])


def test_the_belief_and_the_picture_are_of_one_frame() -> None:
    """The camera's believed pose is the believed base with the nominal mount, whatever has drifted."""
    robot = Seeing((1.0, -1.0, 2.0))
    senses = noisy(REALISTIC, 1, robot)
    drive(robot, senses, 3.0)
    felt = senses.proprioception()
    for side in ("left", "right"):
        nominal = kin.base(felt.base_pose) @ R1.wrist_camera(felt.torso, felt.arm[side], side)
        np.testing.assert_allclose(senses.look(side).T_world_camera, nominal, atol=1e-9)


def test_the_same_seed_errs_the_same() -> None:
    """Two robots of one seed feel and see alike, number for number; of another seed they do not."""

    def senses(seed: int) -> tuple[Any, ...]:
        robot = Seeing()
        other = noisy(REALISTIC, seed, robot)
        off = drive(robot, other, 2.0)
        image = other.look("head")
        return off, image.depth, image.labels

    for a, b in zip(senses(5), senses(5), strict=True):
        np.testing.assert_array_equal(a, b)
    assert not np.array_equal(senses(5)[0], senses(6)[0])


def test_an_error_of_position_lasts_as_long_as_the_base_stands() -> None:
    """It is drawn anew where the base comes to stand, not on the way there, and has the size asked for."""
    felt = KinematicRobot().proprioception()
    moving = np.array([0.4, 0.0, 0.0])
    drawn = []
    for seed in range(500):
        standing = StandingError(0.02, np.random.default_rng(seed))
        first = standing.offset(felt)
        there = replace(felt, base_pose=np.array([1.0, 0, 0]))
        np.testing.assert_array_equal(standing.offset(replace(there, base_velocity=moving)), first)
        second = standing.offset(there)
        assert not np.array_equal(first, second)
        np.testing.assert_array_equal(standing.offset(there), second)
        drawn.append(second)
    assert np.std(drawn, axis=0) == pytest.approx([0.02, 0.02], rel=0.1)


@pytest.mark.render
def test_pictures_are_taken_from_where_the_camera_really_is() -> None:
    """With a misaligned head camera a can appears where the mount's error puts it, not where it would without."""
    world = small_world({"can": placed("can_of_soda", 1.2, 0.0)}, render=True)
    world.settle()
    action = world.robot.action
    action[6] = 1.0  # look down
    run(world, action, 1.0)
    truth = world.pose("can")[:3, 3] + [0, 0, 0.06]

    def seen(errors: Errors) -> Array:
        image = NoisyRobot(world.robot, world.cameras, errors, 0).look("head")
        assert image.labels is not None
        mask = np.isin(image.labels, [k for k, name in image.names.items() if name == "can"])
        return np.asarray(image.points_world()[mask].mean(0))

    straight, off = seen(NONE), seen(Errors(mount_rad=np.deg2rad(1.0), mount_m=0.005))
    assert np.linalg.norm(straight[:2] - truth[:2]) < 0.04
    assert 0.003 < np.linalg.norm(off - straight) < 0.06
    np.testing.assert_allclose(seen(NONE), straight, atol=2e-3)
    aside = seen(Errors(offset_m=0.05)) - straight
    expected = 0.05 * np.random.default_rng([0, 3]).normal(size=2)
    np.testing.assert_allclose(aside[:2], expected, atol=0.015)


def test_mistaken_truth_moves_each_thing_whole() -> None:
    """Pose, solids, knowledge and obstacles of a thing are off by one vector, other things by others, walls not at all;
    heights are true.
    """
    table = "{entry: table, at: [1.5, 0.0]}"
    world = small_world({"can": placed("can_of_soda", 0.8, 0.5), "cup": placed("coffee_cup", 0.8, -0.5)}, table_1=table)
    world.settle()
    truth = MistakenTruth(world, 0.03, seed=1)
    off = {}
    for name in ("can", "cup", "table_1"):
        shift = truth.pose(name)[:3, 3] - world.pose(name)[:3, 3]
        assert shift[2] == 0.0
        off[name] = shift
        for mistaken, true in zip(truth.solids(name), world.solids(name), strict=True):
            np.testing.assert_allclose(mistaken.T[:3, 3] - true.T[:3, 3], shift, atol=1e-9)
        (seen,), (known,) = truth.knowledge().find(name), world.knowledge().find(name)
        np.testing.assert_allclose(seen.lowest - known.lowest, shift, atol=1e-9)
    assert len({tuple(shift) for shift in off.values()}) == 3
    near = truth.obstacles(np.array([0.8, 0.5]), 0.1, without=("table_1", "cup"))
    np.testing.assert_allclose([s.T[:3, 3] for s in near], [s.T[:3, 3] for s in truth.solids("can")])
    far = [s.T for s in truth.obstacles(np.zeros(2), 5.0, without=("can", "cup", "table_1"))]
    np.testing.assert_array_equal(far, [wall.solid.T for wall in world.house.walls])


def test_truth_that_is_not_mistaken_is_the_truth() -> None:
    """Without an error everything is where it is, doors and handles too."""
    world = small_world(
        {"bin": placed("trash_can", 1.0, 0.0)}, box_1="{entry: base_cabinet, at: [2.0, 0], yaw_deg: 180}"
    )
    truth = MistakenTruth(world, 0.0, seed=1)
    np.testing.assert_allclose(truth.pose("bin"), world.pose("bin"))
    np.testing.assert_allclose(truth.handles("bin")[0].center, world.handles("bin")[0].center)
    mistaken, true = truth.doors("box_1")[0], world.doors("box_1")[0]
    np.testing.assert_allclose(mistaken.origin, true.origin)
    assert mistaken.bar is not None
    assert true.bar is not None
    np.testing.assert_allclose(mistaken.bar.center, true.bar.center)
