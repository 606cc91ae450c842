"""The simulated robot does what it is told, feels what it does, and sees what is there."""

from __future__ import annotations

import numpy as np
import pytest

from mpvi_bt.ground.errors import BackendError, NoRenderingDevice
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, SIDES, CameraImage, Side
from mpvi_bt.hands.robots import r1
from mpvi_bt.hands.robots.r1 import R1
from mpvi_bt.house.sim.world import SimWorld
from mpvi_bt.testing import check_robot
from tests.layouts import ACTION_SIZE, BASE, LAYOUT
from tests.small_house import placed, run, small_world

TO_OPTICAL = kin.transform(kin.LINK_TO_OPTICAL, (0.0, 0.0, 0.0))
SPREAD = np.array([-0.5, 0.4, 0.2, -1.1, 0.3, 0.4, -0.6])


@pytest.fixture
def world() -> SimWorld:
    return small_world()


def spread(world: SimWorld) -> Array:
    """An action that bends the torso and stretches both arms, the base at rest."""
    action = world.robot.action
    action[LAYOUT.torso] = (0.4, 0.3, 0.4, 0.6)
    for s in SIDES:
        action[LAYOUT.arm[s]] = r1.mirrored(SPREAD, s)
    return action


def test_it_keeps_the_robots_contract(world: SimWorld) -> None:
    """The simulated robot passes the check that every robot passes."""
    check_robot(world.robot, world.step)


def test_it_reaches_a_commanded_posture(world: SimWorld) -> None:
    """Torso and arms settle on their targets within a second, and the base stays."""
    action = spread(world)
    run(world, action, 2.5)
    felt = world.robot.proprioception()
    np.testing.assert_allclose(felt.torso, action[LAYOUT.torso], atol=0.005)
    for s in SIDES:
        np.testing.assert_allclose(felt.arm[s], action[LAYOUT.arm[s]], atol=0.01)
        np.testing.assert_allclose(felt.arm_velocity[s], 0.0, atol=0.02)
    np.testing.assert_allclose(felt.base_pose, 0.0, atol=0.005)


def test_kinematics_agree_with_the_simulator(world: SimWorld) -> None:
    """Chest, tcps and camera links are where forward kinematics of what is felt puts them, to a millimeter."""
    action = spread(world)
    action[BASE] = (0.3, 0.2, 0.4)
    run(world, action, 1.5)
    felt = world.robot.proprioception()
    T = kin.base(felt.base_pose)
    expected = {"chest_link": R1.chest(felt.torso), "head_camera_link": R1.head_camera(felt.torso)}
    for s in SIDES:
        expected[f"{s}_tcp"] = R1.tcp(felt.torso, felt.arm[s], s)
        expected[f"{s}_wrist_camera_link"] = R1.wrist_camera(felt.torso, felt.arm[s], s)
        np.testing.assert_allclose(world.robot.hand_pose_world(s), T @ expected[f"{s}_tcp"], atol=1e-9)
    for name, pose in expected.items():
        truth = np.asarray(world.robot.links[name].entity_pose.to_transformation_matrix(), float)
        if "camera" in name:
            truth = truth @ TO_OPTICAL
        np.testing.assert_allclose(truth[:3, 3], (T @ pose)[:3, 3], atol=1e-3, err_msg=name)
        np.testing.assert_allclose(truth[:3, :3], (T @ pose)[:3, :3], atol=2e-3, err_msg=name)


@pytest.mark.parametrize(
    "velocity", [(0.5, 0.0, 0.0), (0.0, -0.4, 0.0), (0.0, 0.0, 1.0), (0.4, 0.2, 0.6), (-0.3, 0.3, -1.2)]
)
def test_the_base_keeps_its_velocity(velocity: tuple[float, float, float]) -> None:
    """After the ramp the base moves at the commanded speed and turn rate within three percent, on the arc they make.

    While it turns, its direction trails by the drive's lag of 0.07 s, a tenth of a radian at the most.
    """
    world = small_world(base=(0.5, -0.5, 1.0))
    action = world.robot.action
    action[BASE] = velocity
    run(world, action, 0.7)
    before = world.robot.proprioception().base_pose
    run(world, action, 1.0)
    felt = world.robot.proprioception()
    assert np.hypot(*felt.base_velocity[:2]) == pytest.approx(np.hypot(*velocity[:2]), rel=0.03, abs=0.01)
    assert felt.base_velocity[2] == pytest.approx(velocity[2], rel=0.03, abs=0.01)
    expected = before.copy()
    for _ in range(1000):  # the arc that this velocity describes in a second
        c, s = np.cos(expected[2]), np.sin(expected[2])
        vx, vy, w = velocity
        expected += np.array([c * vx - s * vy, s * vx + c * vy, w]) / 1000
    lag = (0.03 + 0.08 * abs(velocity[2])) * np.hypot(*velocity[:2])
    np.testing.assert_allclose(felt.base_pose[:2], expected[:2], atol=lag + 0.005)
    assert abs(kin.wrap(felt.base_pose[2] - expected[2])) < 0.03 * abs(velocity[2]) + 0.005


def test_the_base_stops_and_stands(world: SimWorld) -> None:
    """Told to hold in full drive it comes to rest within a second and its braking way, and stays there."""
    action = world.robot.action
    action[BASE] = (0.8, 0.0, 0.0)
    run(world, action, 1.0)
    start = world.robot.proprioception().base_pose
    for _ in range(CONTROL_HZ):
        world.robot.hold()
        world.step()
    rest = world.robot.proprioception()
    np.testing.assert_allclose(rest.base_velocity, 0.0, atol=1e-3)
    assert 0.05 < rest.base_pose[0] - start[0] < 0.35
    run(world, world.robot.action, 2.0)
    np.testing.assert_allclose(world.robot.proprioception().base_pose, rest.base_pose, atol=1e-3)


def test_the_base_does_not_jerk(world: SimWorld) -> None:
    """Its speed changes by no more than its acceleration allows, whatever the commands."""
    rng, speeds = np.random.default_rng(0), []
    for _ in range(90):
        action = world.robot.action
        action[BASE] = rng.uniform(-r1.BASE_SPEED, r1.BASE_SPEED)
        world.robot.act(action)
        world.step()
        speeds.append(world.robot.proprioception().base_velocity)
    change = np.abs(np.diff(speeds, axis=0)).max(0) * CONTROL_HZ
    assert (change < [2.2, 2.2, 3.6]).all()


def test_what_is_restored_to_rest_stays_at_rest(world: SimWorld) -> None:
    """A robot that drives, and is brought back to how it stood, stands there: it does not go on driving."""
    saved = world.robot.save()
    action = world.robot.action
    action[BASE] = (0.4, 0.2, 0.5)
    run(world, action, 0.5)
    world.robot.restore(saved)
    run(world, np.array(saved["action"]), 0.5)
    np.testing.assert_allclose(world.robot.proprioception().base_pose, 0.0, atol=0.005)


def test_holding_keeps_every_joint(world: SimWorld) -> None:
    """A robot that holds in the middle of a motion goes on to its targets, base at rest, and stays."""
    action = spread(world)
    world.robot.act(action)
    world.step()
    world.robot.hold()
    np.testing.assert_array_equal(world.robot.action[3:], action[3:])
    run(world, world.robot.action, 2.0)
    before = world.robot.proprioception()
    run(world, world.robot.action, 2.0)
    after = world.robot.proprioception()
    for s in SIDES:
        np.testing.assert_allclose(after.arm[s], before.arm[s], atol=1e-3)
    np.testing.assert_allclose(after.base_pose, before.base_pose, atol=1e-3)


@pytest.mark.parametrize(
    "bad", [np.zeros(22), np.zeros((1, 23)), np.zeros(0), np.full(23, np.nan), np.append(np.zeros(22), np.inf)]
)
def test_an_action_that_is_none_is_refused(world: SimWorld, bad: Array) -> None:
    """A wrong shape or a number that is not finite is an error, and the command stays as it was."""
    before = world.robot.action
    with pytest.raises(BackendError, match="action"):
        world.robot.act(bad)
    np.testing.assert_array_equal(world.robot.action, before)


@pytest.mark.parametrize("extreme", [1e6, -1e6])
def test_actions_are_brought_within_the_limits(world: SimWorld, extreme: float) -> None:
    """Whatever is asked for, the command is within speeds, joint limits and -1..1."""
    world.robot.act(np.full(ACTION_SIZE, extreme))
    action = world.robot.action
    np.testing.assert_allclose(np.abs(action[BASE]), r1.BASE_SPEED)
    column = int(extreme > 0)
    np.testing.assert_allclose(action[LAYOUT.torso], r1.TORSO_LIMITS[:, column])
    for s in SIDES:
        np.testing.assert_allclose(action[LAYOUT.arm[s]], r1.ARM_LIMITS[s][:, column])
        assert action[LAYOUT.gripper[s]] == np.sign(extreme)


def test_acting_copies(world: SimWorld) -> None:
    """Neither the array that was given nor the one that is read is the command itself."""
    given = world.robot.action
    world.robot.act(given)
    given[:] = 0.123
    world.robot.action[:] = 0.123
    assert not (world.robot.action == 0.123).any()


@pytest.mark.parametrize("side", SIDES)
def test_a_gripper_opens_and_closes_evenly(world: SimWorld, side: Side) -> None:
    """The width follows the command from 0 to 10 cm, both fingers alike, and the other hand stays."""
    action = world.robot.action
    other: Side = "left" if side == "right" else "right"
    for value in (-1.0, 0.0, 1.0):
        action[LAYOUT.gripper[side]] = value
        run(world, action, 1.0)
        felt = world.robot.proprioception()
        assert felt.gripper_command[side] == value
        # closed aims 1 cm inside, so that the fingers press
        assert felt.gripper_width[side] == pytest.approx(max(0.0, -0.02 + (value + 1) / 2 * 0.12), abs=0.004)
        assert felt.gripper_width[other] == pytest.approx(2 * r1.FINGER_TRAVEL_M, abs=0.004)
        to_tcp = kin.inverse(world.robot.hand_pose_world(side))
        fingers = [world.robot.links[name].entity_pose.p for name in r1.FINGER_LINKS[side]]
        left, right = (float((to_tcp @ np.append(p, 1.0))[1]) for p in fingers)
        assert left == pytest.approx(-right, abs=0.003)
        assert left - right == pytest.approx(felt.gripper_width[side], abs=0.003)


def test_heading_is_wrapped_however_far_it_turns(world: SimWorld) -> None:
    """After turns beyond half a circle the felt heading is still within -pi..pi, and no step of it is a leap."""
    action = world.robot.action
    action[BASE] = (0.0, 0.0, 1.5)
    yaws = []
    for _ in range(round(10 * CONTROL_HZ)):
        world.robot.act(action)
        world.step()
        yaws.append(float(world.robot.proprioception().base_pose[2]))
    assert np.abs(yaws).max() <= np.pi
    assert np.abs(kin.wrap(np.diff(yaws))).max() < 1.5 / CONTROL_HZ * 1.1
    assert np.sum(kin.wrap(np.diff(yaws))) > 4 * np.pi


def test_what_is_felt_is_of_this_step(world: SimWorld) -> None:
    """Physics that runs outside of a control step is felt too."""
    before = world.robot.proprioception()
    action = spread(world)
    world.robot.act(action)
    world.robot.apply()
    assert world.robot.proprioception() is not before
    world.settle(0.5)
    assert np.abs(world.robot.proprioception().arm["left"] - before.arm["left"]).max() > 0.1


def test_without_rendering_there_is_no_picture(world: SimWorld) -> None:
    """A world that was built without pictures says so when one is asked for."""
    with pytest.raises(NoRenderingDevice, match="mpvi doctor"):
        world.robot.look("head")
    with pytest.raises(NoRenderingDevice, match="mpvi doctor"):
        world.look_from(np.eye(4))


@pytest.fixture(scope="module")
def pictured() -> SimWorld:
    """A box on the floor 1.5 m ahead, its face to the robot, and the wall at x = 2.95 behind."""
    world = small_world({"block": placed("box_of_oatmeal", 1.5, 0.0)}, render=True)
    world.settle(0.2)
    return world


def project(image: CameraImage, p: Array) -> tuple[int, int]:
    """(row, column) of a world point (3,)."""
    x, y, z = (kin.inverse(image.T_world_camera) @ np.append(p, 1.0))[:3]
    u, v = image.K[0, 0] * x / z + image.K[0, 2], image.K[1, 1] * y / z + image.K[1, 2]
    return int(v), int(u)


@pytest.mark.render
def test_a_pixel_is_where_the_world_is(pictured: SimWorld) -> None:
    """Points of wall, floor and box come back to a centimeter; the box and nothing else is labeled as the box."""
    action = pictured.robot.action
    action[LAYOUT.torso] = (0.30, 0.0, 0.0, 0.55)
    run(pictured, action, 1.0)
    image = pictured.robot.look("head")
    points, labels = image.points_world(), image.labels
    assert labels is not None
    low, high = np.array([s.aabb() for s in pictured.solids("block")]).reshape(2, 3)
    ids = [i for i, name in image.names.items() if name == "block"]
    on_box = points[np.isin(labels, ids)]
    assert len(on_box) > 50
    assert (on_box > low - 0.01).all()
    assert (on_box < high + 0.01).all()
    shown = {image.names[i] for i in np.unique(labels) if i in image.names}
    assert {"block", "floor_hall", "wall_hall"} <= shown
    floor = points[np.isin(labels, [i for i, name in image.names.items() if name == "floor_hall"])]
    assert np.abs(floor[:, 2]).max() < 0.01
    wall = points[np.isin(labels, [i for i, name in image.names.items() if name == "wall_hall"])]
    ahead = wall[np.abs(wall[:, 1]) < 2.0]
    assert np.abs(ahead[:, 0] - 2.95).max() < 0.015
    row, column = project(image, np.array([low[0], 0.0, (low + high)[2] / 2]))
    assert labels[row, column] in ids


@pytest.mark.render
@pytest.mark.parametrize("camera", sorted(r1.CAMERAS))
def test_a_picture_is_what_the_protocol_says(pictured: SimWorld, camera: str) -> None:
    """Shapes, types, size and pose of each camera are those of the model and its kinematics."""
    image = pictured.robot.look(camera)
    model = r1.CAMERAS[camera]
    assert image.camera == camera
    assert image.rgb.shape == (model.height, model.width, 3)
    assert image.rgb.dtype == np.uint8
    assert image.depth.shape == (model.height, model.width)
    assert image.depth.dtype == np.float32
    assert image.labels is not None
    assert image.labels.shape == image.depth.shape
    assert image.labels.dtype == np.int32
    assert ((image.depth == 0) | (image.depth >= model.near_m)).all()
    assert image.K[1, 1] == pytest.approx(model.height / 2 / np.tan(model.fov_rad / 2), rel=1e-4)
    felt = pictured.robot.proprioception()
    T = kin.base(felt.base_pose)
    expected = R1.head_camera(felt.torso) if camera == "head" else None
    for s in SIDES:
        if camera == s:
            expected = R1.wrist_camera(felt.torso, felt.arm[s], s)
    assert expected is not None
    np.testing.assert_allclose(image.T_world_camera, T @ expected, atol=2e-3)


@pytest.mark.render
@pytest.mark.parametrize("side", SIDES)
def test_a_wrist_sees_its_own_fingers(pictured: SimWorld, side: Side) -> None:
    """The robot's own parts are labeled "robot", and the fingertips are in the wrist's picture."""
    image = pictured.robot.look(side)
    assert image.labels is not None
    own = np.isin(image.labels, [i for i, name in image.names.items() if name == "robot"])
    assert own.mean() > 0.02
    assert (own & (image.depth < 0.25)).any()


@pytest.mark.render
def test_a_picture_from_outside_shows_the_robot(pictured: SimWorld) -> None:
    """A camera that looks down at the robot from above sees it under itself, and the floor beside."""
    T = np.diag([1.0, -1.0, -1.0, 1.0])
    T[2, 3] = 5.0
    image = pictured.look_from(T, (80, 60), 1.0)
    assert image.labels is not None
    assert image.names[int(image.labels[30, 40])] == "robot"
    assert image.points_world()[5, 40, 2] == pytest.approx(0.0, abs=0.02)


@pytest.mark.render
def test_an_unknown_camera_is_said(pictured: SimWorld) -> None:
    """A camera that there is not is an error that names those that there are."""
    with pytest.raises(BackendError, match="head"):
        pictured.robot.look("tail")
