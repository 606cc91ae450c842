"""The r1pro: BEHAVIOR's joints, limits and frames, a trunk that folds, and arms with an inverse in closed form.

Numbers that are compared with were computed from the URDF that BEHAVIOR uses, or measured in its simulator.
"""

from __future__ import annotations

import time
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.rotations import rotation
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.collision import Body
from mpvi_bt.ground.robot.protocol import SIDES, Side
from mpvi_bt.hands.robots import r1pro
from mpvi_bt.hands.robots.r1pro import R1PRO, TRUNK
from mpvi_bt.hands.robots.r1pro_urdf import r1pro_urdf
from mpvi_bt.house.sim.world import SimWorld
from mpvi_bt.testing import check_robot
from tests.layouts import BASE, LAYOUT
from tests.small_house import placed, small_world

START = np.array([1.025, -1.45, -0.47, 0.0])
HANGING = np.zeros(7)
MIRROR = np.array([1, -1, -1, 1, -1, 1, -1])
TO_OPTICAL = kin.transform(kin.LINK_TO_OPTICAL, (0.0, 0.0, 0.0))
TO_USD = np.diag([1.0, -1.0, -1.0])  # whose cameras look along -z, with y up

seeds = st.integers(0, 2**32 - 1)


@pytest.fixture(scope="module")
def world() -> SimWorld:
    """An r1pro in an empty room; tests leave it in the posture that it begins with."""
    return small_world(robot=R1PRO)


def postures(side: Side, seed: int, n: int) -> Array:
    """Random postures (n, 7) of an arm within the limits."""
    low, high = R1PRO.arms[side].limits.T
    return np.random.default_rng(seed).uniform(low, high, (n, 7))


@pytest.mark.parametrize(
    ("torso", "chest_xz", "pitch", "eef", "head_xz"),
    [
        ((0.0, 0.0, 0.0, 0.0), (-0.079, 1.142), 0.0, (-0.0795, 0.252, 0.6566), (-0.004, 1.615)),
        ((1.025, -1.45, -0.47, 0.0), (0.1436, 0.9231), 0.045, (0.1213, 0.2520, 0.4380), (0.2397, 1.3918)),
        ((0.45, -0.4, 0.0, 0.0), (None, 1.102), 0.05, (0.090, 0.252, 0.617), (None, 1.570)),
        ((1.6, -2.5, -0.94, 0.0), (None, 0.617), 0.04, (0.070, 0.252, 0.132), (None, 1.086)),
        ((1.735, -2.57, -2.1, 0.0), (0.188, 0.509), 1.265, None, (0.661, 0.579)),
    ],
)
def test_the_trunk_is_where_behaviors_urdf_has_it(torso, chest_xz, pitch, eef, head_xz) -> None:
    """Chest, hanging hand and head camera of each posture are those that were computed, to half their last digit."""
    joints = np.array(torso)

    def agrees(p: Array, wanted: tuple[float | None, ...]) -> None:
        for value, known in zip(p, wanted, strict=True):
            if known is not None:
                digits = len(str(known).partition(".")[2])
                assert value == pytest.approx(known, abs=max(1e-5, 0.5001 * 10.0 ** -max(3, digits)))

    agrees(R1PRO.chest(joints)[[0, 2], 3], chest_xz)
    assert TRUNK.posture(joints)[2] == pytest.approx(pitch, abs=1e-5)
    agrees(R1PRO.head_camera(joints)[[0, 2], 3], head_xz)
    if eef is not None:
        agrees(R1PRO.tcp(joints, HANGING, "left")[:3, 3], eef)


@pytest.mark.parametrize("side", SIDES)
def test_the_posture_to_begin_with_is_behaviors(side: Side) -> None:
    """Hands, shoulders and wrist cameras at the start, with their orientations, and the robot drives so."""
    sign = 1 if side == "left" else -1
    T = R1PRO.tcp(START, HANGING, side)
    np.testing.assert_allclose(T[:3, 3], (0.1213, sign * 0.2520, 0.4380), atol=5e-5)
    np.testing.assert_allclose(np.abs(rotation(T[:3, :3]).as_quat()), (0, 0.9997, 0, 0.0225), atol=5e-5)
    shoulder = (R1PRO.chest(START) @ R1PRO.arm_frames(HANGING, side)[0])[:3, 3]
    np.testing.assert_allclose(shoulder, (0.157, sign * 0.252, 1.226), atol=5e-4)
    wrist = R1PRO.wrist_camera(START, HANGING, side)[:3, 3]
    np.testing.assert_allclose(wrist, (0.1747, 0.2549 if sign > 0 else -0.2491, 0.5007), atol=5e-5)
    np.testing.assert_array_equal(R1PRO.travel_torso, START)
    np.testing.assert_array_equal(R1PRO.travel_arm[side], HANGING)


def test_the_head_camera_is_where_the_simulator_has_it() -> None:
    """Place and direction agree with a measurement in BEHAVIOR's simulator, to 3.5e-6; at the start, with its turn."""
    T = R1PRO.head_camera(np.array([1.2, -1.7, -0.9, 0.0]))
    np.testing.assert_allclose(T[:3, 3], (0.44177, 0.0, 1.248709), atol=3.5e-6)
    np.testing.assert_allclose(T[:3, 2], (0.7323, 0.0, -0.6810), atol=5e-5)
    start = R1PRO.head_camera(START)[:3, :3]
    np.testing.assert_allclose(
        rotation(start @ TO_USD).as_quat() * -np.sign(rotation(start @ TO_USD).as_quat()[0]),
        (-0.392, 0.392, 0.588, -0.588), atol=5e-4,
    )  # fmt: skip
    assert np.rad2deg(np.arcsin(-start[2, 2])) == pytest.approx(22.6, abs=0.05)


def test_the_wrist_camera_sits_in_the_eef_frame_as_behaviors() -> None:
    """Its place, and where it looks, to half the last digit."""
    T = R1PRO.hand_to_camera
    np.testing.assert_allclose(T[:3, 3] - [0, 0, R1PRO.tcp_m], (-0.0505, 0.0029, -0.0651), atol=5e-5)
    np.testing.assert_allclose(T[:3, 2], (0.4226, -0.0033, 0.9063), atol=5e-5)
    np.testing.assert_allclose(T[:3, 0], (0, -1, 0), atol=5e-3)
    np.testing.assert_allclose(T[:3, 1], (0.906, 0, -0.423), atol=2e-3)


def test_ready_postures_of_others_reach_where_they_are_meant_to() -> None:
    """One that was made for a round target, straight down; the "untucked" one; and one of a challenge's solution."""
    aimed = np.array([-1.6312, 0.2636, -1.812, -1.4576, -0.0508, -0.3727, -1.3193])
    T = R1PRO.tcp(START, aimed, "left")
    np.testing.assert_allclose(T[:3, 3], (0.55, 0.10, 0.95), atol=1.5e-5)  # joints have four decimals
    np.testing.assert_allclose(T[:3, 2], (0, 0, -1), atol=1e-4)
    for side, y in zip(SIDES, (0.562, -0.562), strict=True):
        untucked = np.array([0, 1.57, 0, -1.57, 1.57, 0, 0]) * (1 if y > 0 else MIRROR)
        np.testing.assert_allclose(R1PRO.tcp(START, untucked, side)[:3, 3], (0.635, y, 1.204), atol=5e-4)
    ready = np.array([-0.2, 0, 0.1, -1.4, 0.1, 0.7, 0])
    for side, y in zip(SIDES, (0.278, -0.227), strict=True):
        np.testing.assert_allclose(R1PRO.tcp(START, ready, side)[:3, 3], (0.629, y, 0.771), atol=6e-4)


@settings(max_examples=20, deadline=None)
@given(seeds)
def test_a_mirrored_posture_reaches_the_mirror_image(seed: int) -> None:
    """But for the 2 micrometers by which the arms' bases differ."""
    q = postures("left", seed, 5)
    limits = R1PRO.arms["right"].limits
    assert ((limits[:, 0] <= q * MIRROR) & (q * MIRROR <= limits[:, 1])).all()
    left, right = R1PRO.arm(q, "left"), R1PRO.arm(q * MIRROR, "right")
    np.testing.assert_allclose(left[:, :3, 3] * [1, -1, 1], right[:, :3, 3], atol=5e-6)


@pytest.mark.parametrize("side", SIDES)
def test_of_1000_reachable_poses_all_are_reached(side: Side, record_property) -> None:
    """At 360 swivels there is a posture within limits, exact to rounding, for each; the time is printed."""
    T = R1PRO.arm(postures(side, 0, 1000), side)
    R1PRO.arm_inverse(T[:1], side)
    started = time.perf_counter()
    index, q = R1PRO.arm_inverse(T, side, swivels=360)
    milliseconds = time.perf_counter() - started
    record_property("ms_per_pose", milliseconds)
    print(
        f"\n{side}: {len(set(index.tolist()))} of 1000 poses reached, {milliseconds:.2f} ms a pose, {len(q)} postures"
    )
    assert set(index.tolist()) == set(range(1000))
    limits = R1PRO.arms[side].limits
    assert ((limits[:, 0] <= q) & (q <= limits[:, 1])).all()
    np.testing.assert_allclose(R1PRO.arm(q[::50], side), T[index[::50]], atol=1e-9)


@settings(max_examples=30, deadline=None)
@given(seeds)
def test_the_nearest_solution_to_a_posture_is_that_posture(seed: int) -> None:
    """Asked for what a posture reaches, near it, the inverse gives that posture, also beyond half a turn."""
    q = postures("left", seed, 1)[0]
    q = np.clip(q, R1PRO.arms["left"].limits[:, 0] + 0.1, R1PRO.arms["left"].limits[:, 1] - 0.1)
    found = R1PRO.nearest_posture(R1PRO.arm(q, "left"), "left", q)
    assert found is not None
    np.testing.assert_allclose(found, q, atol=3e-3)


@settings(max_examples=100, deadline=None)
@given(st.floats(0, 1), st.floats(-1, 1), st.floats(0, 1))
def test_every_posture_within_the_limits_is_taken_as_it_is(lift: float, yaw: float, pitch: float) -> None:
    """The trunk's joints for a posture are within theirs and in that posture; each lift goes with each pitch."""
    low, high = TRUNK.limits.T
    posture = low + (high - low) * np.array([lift, (yaw + 1) / 2, pitch, 0.0])
    joints = TRUNK.joints(posture)
    assert ((TRUNK.joint_limits[:, 0] <= joints) & (joints <= TRUNK.joint_limits[:, 1])).all()
    np.testing.assert_allclose(TRUNK.posture(joints), posture, atol=1e-7)
    assert 0.0 < R1PRO.chest(joints)[0, 3] < 0.25


def test_the_start_is_a_posture_of_its_own() -> None:
    """Taking the posture that the robot begins in moves no joint, and neighboring postures have neighboring joints."""
    np.testing.assert_allclose(TRUNK.joints(TRUNK.posture(START)), START, atol=1e-9)
    low, high = TRUNK.limits.T
    lifts, pitches = np.meshgrid(np.linspace(low[0], high[0], 60), np.linspace(low[2], high[2], 60), indexing="ij")
    joints = TRUNK.joints(np.stack([lifts, 0 * lifts, pitches, 0 * lifts], -1))
    assert max(np.abs(np.diff(joints, axis=axis)).max() for axis in (0, 1)) < 0.12
    beyond = TRUNK.joints(np.array([9.0, 0.0, 0.0, 0.5]))
    np.testing.assert_allclose(TRUNK.posture(beyond), (high[0], 0, 0, 0), atol=1e-7)


def test_the_urdf_names_the_joints_of_the_model_and_their_limits() -> None:
    """Names, limits, speeds and torques are BEHAVIOR's, in its order."""
    joints = {joint.get("name"): joint for joint in ElementTree.fromstring(r1pro_urdf()).iter("joint")}
    wanted = dict(zip(R1PRO.torso_joints, r1pro.TORSO_LIMITS, strict=True))
    for side in SIDES:
        wanted |= dict(zip(R1PRO.arm_joints[side], R1PRO.arms[side].limits, strict=True))
        wanted |= dict.fromkeys(R1PRO.finger_joints[side], np.array([0.0, 0.05]))
    for name, bounds in wanted.items():
        limit = joints[name].find("limit")
        assert limit is not None
        assert [float(limit.get(k, "nan")) for k in ("lower", "upper")] == pytest.approx(bounds.tolist())
    assert list(R1PRO.torso_joints) == ["torso_joint1", "torso_joint2", "torso_joint3", "torso_joint4"]
    assert R1PRO.arm_joints["left"][6] == "left_arm_joint7"


def test_it_keeps_the_robots_contract() -> None:
    """It passes the check that every robot passes."""
    world = small_world(robot=R1PRO)
    check_robot(world.robot, world.step)


def test_it_stands_still_in_the_posture_of_rest(world: SimWorld) -> None:
    """Told BEHAVIOR's posture of rest, which it begins in, for 2 s, no joint moves by 0.1 mrad, nor the base."""
    felt = world.robot.proprioception()
    np.testing.assert_allclose(felt.torso, START, atol=1e-6)
    assert list(felt.gripper_width.values()) == pytest.approx([0.10, 0.10], abs=1e-6)
    action = np.zeros(23)
    action[LAYOUT.torso] = START
    for side in SIDES:
        action[LAYOUT.gripper[side]] = 1.0
    for _ in range(60):
        world.robot.act(action)
        world.step()
    after = world.robot.proprioception()
    np.testing.assert_allclose(after.torso, START, atol=1e-4)
    np.testing.assert_allclose(after.base_pose, felt.base_pose, atol=1e-4)
    for side in SIDES:
        np.testing.assert_allclose(after.arm[side], HANGING, atol=1e-4)


def test_kinematics_agree_with_the_simulator() -> None:
    """Hands, trunk and cameras are where forward kinematics of what is felt puts them, to a tenth of a millimeter."""
    world = small_world(robot=R1PRO)
    action = world.robot.action
    action[LAYOUT.torso] = 1.2, -1.7, -0.9, 0.4
    action[LAYOUT.arm["left"]] = -0.6, 0.5, 0.3, -1.2, -0.4, 0.5, 0.3
    action[LAYOUT.arm["right"]] = -0.9, -0.4, 0.2, -0.8, 0.6, -0.4, -0.7
    action[BASE] = 0.2, 0.1, 0.3
    for _ in range(90):
        world.robot.act(action)
        world.step()
    felt = world.robot.proprioception()
    base = kin.base(felt.base_pose)
    there = {name: link.entity.pose.to_transformation_matrix() for name, link in world.robot.links.items()}
    thigh, shin, waist = TRUNK.links(felt.torso)
    expected = {"torso_link1": thigh, "torso_link2": shin, "torso_link3": waist, "torso_link4": R1PRO.chest(felt.torso),
                "head_camera_link": R1PRO.head_camera(felt.torso) @ kin.inverse(TO_OPTICAL)}  # fmt: skip
    for side in SIDES:
        expected[f"{side}_eef_link"] = R1PRO.tcp(felt.torso, felt.arm[side], side)
        wrist = R1PRO.wrist_camera(felt.torso, felt.arm[side], side)
        expected[f"{side}_wrist_camera_link"] = wrist @ kin.inverse(TO_OPTICAL)
    for name, pose in expected.items():
        np.testing.assert_allclose(there[name], base @ pose, atol=2e-4, err_msg=name)
    for side in SIDES:
        np.testing.assert_allclose(felt.arm[side], action[LAYOUT.arm[side]], atol=0.01)
    np.testing.assert_allclose(felt.torso, action[LAYOUT.torso], atol=0.005)


def test_no_hand_that_is_in_a_link_of_the_trunk_counts_as_clear() -> None:
    """Thigh and shin are boxes: a finger that met the corner of one let go of what it held, and stayed caught there."""
    rng, met = np.random.default_rng(0), 0
    for _ in range(40):
        posture = [rng.uniform(0.05, 0.5), 0.0, rng.uniform(0.0, 1.1), 0.0]
        torso = TRUNK.joints(np.array(posture))
        thigh, shin, _ = TRUNK.links(torso)
        low, high = r1pro.ARM_LIMITS["left"].T
        q = rng.uniform(low, high, (400, 7))
        body = Body(R1PRO, torso, {"left": HANGING})
        centers, radii = body.spheres("left", q)
        gap = np.full(len(q), np.inf)
        for T, length in ((thigh, r1pro.THIGH_M), (shin, r1pro.SHIN_M)):
            half = [0.063, 0.0905, length / 2 + 0.0625]
            off = np.abs((centers - T[:3, 3]) @ T[:3, :3] - [0.0, 0.0, length / 2]) - half
            gap = np.minimum(gap, (np.linalg.norm(np.maximum(off, 0.0), axis=-1) - radii)[:, 2:].min(1))
        met += int((gap < 0.0).sum())
        assert (body.clearance("left", q)[1][gap < -0.002] < 0.0).all()
    assert met > 50


def test_the_posture_to_drive_in_is_clear_of_the_robot_itself_and_over_its_base() -> None:
    """Hanging arms are 2 cm clear of everything of the robot, and nowhere beyond the base's bounds."""
    body = Body(R1PRO, START, R1PRO.travel_arm)
    (back, front), (right, left) = r1pro.BASE_M
    for side in SIDES:
        assert body.clearance(side, HANGING[None])[1][0] > 0.02
        centers, radii = body.spheres(side, HANGING[None])
        x, y, _ = centers[0].T
        assert ((back < x - radii) & (x + radii < front) & (right - 0.02 < y - radii) & (y + radii < left + 0.02)).all()


@pytest.mark.render
def test_its_cameras_show_what_is_before_them() -> None:
    """The head, which does not tilt, sees a can on the floor ahead, the wrists the fingers; all pictures are square."""
    world = small_world({"can_1": placed("can_of_soda", 1.1, 0.0)}, render=True, robot=R1PRO)
    world.step()
    for name, wanted in (("head", "can_1"), ("left", "robot"), ("right", "robot")):
        image = world.robot.look(name)
        height, width = image.rgb.shape[:2]
        assert height == width == R1PRO.cameras[name].width
        assert 2 * np.arctan(height / 2 / image.K[0, 0]) == pytest.approx(
            np.deg2rad(99.3 if name == "head" else 63.4), abs=1e-4
        )
        assert image.labels is not None
        assert wanted in {image.names.get(int(label)) for label in np.unique(image.labels)}
