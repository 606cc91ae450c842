"""The Fetch: one arm with an inverse in closed form, on two wheels; a second robot behind the same protocol."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mpvi_bt.finding.navigation.footprint import Footprint
from mpvi_bt.finding.navigation.grid import shortest_path
from mpvi_bt.finding.navigation.loaded import loaded_path
from mpvi_bt.finding.navigation.pursuit import PathFollower
from mpvi_bt.finding.navigation.traversability import traversability
from mpvi_bt.ground.errors import BackendError, UnknownName, UserError
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.robot.collision import Body
from mpvi_bt.ground.robot.drives import legs
from mpvi_bt.ground.robot.limits import extremes
from mpvi_bt.ground.robot.motion import Motion
from mpvi_bt.ground.robot.robots import robot_named
from mpvi_bt.hands.robots.fetch import FETCH
from mpvi_bt.hands.robots.fetch_urdf import fetch_urdf
from mpvi_bt.hands.robots.r1 import R1
from mpvi_bt.house.sim.world import SimWorld
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.episode import episode
from mpvi_bt.runs.episode.prepare import prepare_episode
from mpvi_bt.testing import check_robot
from tests.layouts import BASE, LAYOUT
from tests.navigation_maps import KinematicRobot, two_rooms
from tests.small_house import placed, small_world

ARM = FETCH.arms["right"]
PLAN = Path(__file__).parent.parent / "examples" / "one_hand.json"
TO_OPTICAL = kin.transform(kin.LINK_TO_OPTICAL, (0.0, 0.0, 0.0))

seeds = st.integers(0, 2**32 - 1)


@pytest.fixture
def world() -> SimWorld:
    """A Fetch in an empty room."""
    return small_world(robot=FETCH)


def posture(seed: int, n: int = 1) -> np.ndarray:
    """Random postures (n, 7) within the limits."""
    low, high = ARM.limits.T
    return np.random.default_rng(seed).uniform(low, high, (n, 7))


@settings(max_examples=30, deadline=None)
@given(seeds)
def test_every_solution_of_the_inverse_reaches_the_target_within_limits(seed: int) -> None:
    """Forward undoes the inverse to rounding, and no joint is beyond its limits."""
    T = FETCH.arm(posture(seed, 5), "right")
    index, q = FETCH.arm_inverse(T, "right")
    np.testing.assert_allclose(FETCH.arm(q, "right"), T[index], atol=1e-9)
    assert ((ARM.limits[:, 0] <= q) & (q <= ARM.limits[:, 1])).all()
    assert (np.diff(index) >= 0).all()


@settings(max_examples=30, deadline=None)
@given(seeds)
def test_the_nearest_solution_to_a_posture_is_that_posture(seed: int) -> None:
    """Asked for what a posture reaches, near it, the inverse gives that posture."""
    q = posture(seed)[0]
    found = FETCH.nearest_posture(FETCH.arm(q, "right"), "right", q)
    assert found is not None
    np.testing.assert_allclose(found, q, atol=1e-3)


def test_along_a_line_the_arm_moves_evenly() -> None:
    """A hand that goes 30 cm straight ahead in steps of 1 cm turns no joint by more than 0.1 rad in any."""
    q = np.array([0.0, 0.4, 0.0, 1.0, 0.0, 0.17, 0.0])
    T = FETCH.arm(q, "right")
    for _ in range(30):
        T[0, 3] -= 0.01
        after = FETCH.nearest_posture(T, "right", q)
        assert after is not None
        assert np.abs(after - q).max() < 0.1
        q = after


def test_the_travel_posture_is_compact_and_clear_of_the_robot_itself() -> None:
    """At each lift the folded arm is within 0.33 m of the base's axis, and 2.5 cm clear of everything of the robot."""
    for lift in FETCH.lifts:
        body = Body(FETCH, np.array([lift, 0.0, 0.0, 0.5]), FETCH.travel_arm)
        assert body.clearance("right", FETCH.travel_arm["right"][None])[1][0] > 0.025
    centers, hull = body._arm_points("right", FETCH.travel_arm["right"], False)[0][0], FETCH.hull
    assert (np.hypot(*centers.T[:2]) + hull.radii).max() < 0.33


def test_it_keeps_the_robots_contract(world: SimWorld) -> None:
    """It passes the check that every robot passes."""
    check_robot(world.robot, world.step)


def test_kinematics_agree_with_the_simulator(world: SimWorld) -> None:
    """Hand and cameras are where forward kinematics of what is felt puts them, to half a millimeter."""
    action = world.robot.action
    action[LAYOUT.torso] = 0.3, 0.0, 0.0, 0.4
    action[LAYOUT.arm["right"]] = 0.4, 0.3, 0.5, 0.9, -0.4, 0.8, 0.3
    action[BASE] = 0.2, 0.0, 0.3
    for _ in range(150):
        world.robot.act(action)
        world.step()
    felt = world.robot.proprioception()
    base = kin.base(felt.base_pose)
    tcp = base @ FETCH.tcp(felt.torso, felt.arm["right"], "right")
    there = {name: world.robot.links[name].entity.pose.to_transformation_matrix() for name in
             ("gripper_link", "head_camera_link", "wrist_camera_link")}  # fmt: skip
    np.testing.assert_allclose(tcp[:3, 3], (there["gripper_link"] @ [0.019, 0, 0, 1])[:3], atol=5e-4)
    np.testing.assert_allclose(tcp[:3, 2], there["gripper_link"][:3, 0], atol=1e-3)
    head = base @ FETCH.head_camera(felt.torso)
    wrist = base @ FETCH.wrist_camera(felt.torso, felt.arm["right"], "right")
    np.testing.assert_allclose(there["head_camera_link"] @ TO_OPTICAL, head, atol=1e-3)
    np.testing.assert_allclose(there["wrist_camera_link"] @ TO_OPTICAL, wrist, atol=1e-3)
    np.testing.assert_allclose(felt.arm["right"], action[LAYOUT.arm["right"]], atol=0.01)


def test_it_drives_to_poses_without_going_sideways(world: SimWorld) -> None:
    """Also to one beside it: it turns, goes and turns; what is commanded sideways is 0, and so is what it has not."""
    motion = Motion(world.robot.proprioception())
    for goal in (np.array([0.4, 0.3, 1.0]), np.array([0.4, 0.1, 1.0]), np.zeros(3)):
        for action in motion.drive(goal):
            assert action[1] == 0.0
            world.robot.act(action)
            world.step()
            motion.felt = world.robot.proprioception()
        off = motion.felt.base_pose - goal
        assert np.linalg.norm(off[:2]) < 0.03
        assert abs(kin.wrap(off[2])) < 0.05
    lowest, highest = extremes(FETCH)
    assert not (highest - lowest)[[1, 4, 5, *range(7, 15)]].any()


def test_legs_go_straight_ahead_or_back() -> None:
    """On each leg a base on two wheels turns on the spot, or goes along its heading; the last leg ends at the goal."""
    rng = np.random.default_rng(0)
    for start, goal in rng.uniform(-2, 2, (50, 2, 3)):
        at = start
        for leg in legs(FETCH, start, goal):
            way = leg[:2] - at[:2]
            if np.linalg.norm(way) > 1e-9:
                assert abs(np.sin(np.arctan2(way[1], way[0]) - at[2])) < 1e-9
                assert leg[2] == at[2]
            at = leg
        np.testing.assert_allclose(at, goal)
    assert [leg.tolist() for leg in legs(R1, start, goal)] == [goal.tolist()]


@pytest.mark.parametrize("goal", [(6.5, 1.0, 2.0), (1.4, 1.2, -1.0), (5.0, 3.2, 0.0)])
def test_pursuit_on_two_wheels_reaches_the_pose(goal: tuple[float, float, float]) -> None:
    """Through the doorway, or to a place close by: nothing is commanded sideways, and the pose is reached."""
    grid = traversability(two_rooms(), 0.33)
    robot = KinematicRobot(1.0, 1.0)
    found = shortest_path(grid.cost, grid.map.cell(robot.pose[:2]), grid.map.cell(goal[:2]))
    assert found is not None
    follower = PathFollower(grid.points(found[0]), np.array(goal), grid, sideways=False)
    for _ in range(60 * 30):
        if follower.reached(robot.pose, robot.velocity):
            break
        command = follower.command(robot.pose)
        assert command[1] == 0.0
        robot.action[BASE] = command
        robot.advance()
    assert follower.reached(robot.pose, robot.velocity)


def test_what_is_carried_goes_no_step_sideways() -> None:
    """Of a path with a load ahead no step of a base on two wheels is more than 26 degrees off its heading, or back."""
    grid = traversability(two_rooms(), 0.33)
    footprint = Footprint(0.33, np.array([[0.45, 0.0, 0.08]]))
    path = loaded_path(grid, footprint, np.array([1.0, 1.0, 0.0]), np.array([6.5, 3.0, 1.5]), sideways=False)
    assert path is not None
    steps = np.diff(path[1:-1], axis=0)
    moves = np.hypot(*steps.T[:2]) > 1e-9
    away = np.arctan2(steps[:, 1], steps[:, 0]) - path[1:-2, 2]
    assert np.abs(np.sin(away[moves])).max() < np.sin(np.deg2rad(26.0))


def test_what_it_cannot_do_is_refused_in_one_line() -> None:
    """A plan for the left hand, an R1Pro's settings and a robot that is not there are refused before anything runs."""
    config = EpisodeConfig("picking_up_trash", robot="fetch")
    with pytest.raises(UserError, match=r"left hand.*fetch has the right one"):
        prepare_episode(config)
    remote = EpisodeConfig(
        "picking_up_trash", robot="fetch", policy="openpi:ws://localhost:1", policy_settings="openpi_comet"
    )
    with pytest.raises(UserError, match=r"BEHAVIOR's R1Pro, and the robot is the fetch: choose --robot r1pro"):
        prepare_episode(remote)
    with pytest.raises(UnknownName, match=r"fetch"):
        robot_named("fetsch")


def test_two_hands_are_refused() -> None:
    """A tree with a skill of both hands is not for it."""
    from mpvi_bt.executive.plan.skills import load_skills
    from mpvi_bt.executive.tree.compile import compile_instruction
    from mpvi_bt.runs.episode.capability_checks import check_hands

    spec = compile_instruction("both", "lift the box with both hands")
    with pytest.raises(UserError, match=r"takes two hands \(skill lift\); fetch has one"):
        check_hands("fetch", spec, load_skills())
    check_hands("r1", spec, load_skills())


def test_its_joints_are_those_that_its_maker_publishes() -> None:
    """Places, axes and limits of the joints are those of the description that ManiSkill ships, to a tenth of 1 mm."""
    spec = importlib.util.find_spec("mani_skill")
    if spec is None or not spec.submodule_search_locations:
        pytest.skip("ManiSkill is not installed")
    path = Path(spec.submodule_search_locations[0]) / "assets" / "robots" / "fetch" / "fetch.urdf"
    theirs = {joint.get("name"): joint for joint in ElementTree.parse(path).iter("joint")}
    ours = {joint.get("name"): joint for joint in ElementTree.fromstring(fetch_urdf()).iter("joint")}
    for name in (*FETCH.arm_joints["right"], *FETCH.finger_joints["right"], "torso_lift_joint", "head_pan_joint",
                 "head_tilt_joint", "gripper_axis", "head_camera_joint"):  # fmt: skip
        for tag, attribute in (("origin", "xyz"), ("axis", "xyz")):
            element, other = theirs[name].find(tag), ours[name].find(tag)
            if element is not None and other is not None:
                one, two = (np.array(e.get(attribute, "0 0 0").split(), float) for e in (element, other))
                np.testing.assert_allclose(two, one, atol=1e-4, err_msg=f"{name} {tag}")
        limit, own = theirs[name].find("limit"), ours[name].find("limit")
        if theirs[name].get("type") in ("revolute", "prismatic") and limit is not None and own is not None:
            for bound in ("lower", "upper"):
                assert float(own.get(bound, "nan")) == pytest.approx(float(limit.get(bound, "nan")), abs=1e-4)


@pytest.mark.render
def test_its_cameras_show_what_is_before_them() -> None:
    """The head sees a can on the floor ahead, the wrist the fingers; each in its own size."""
    world = small_world({"can_1": placed("can_of_soda", 1.1, 0.0)}, render=True, robot=FETCH)
    action = world.robot.action
    action[LAYOUT.torso] = 0.2, 0.0, 0.0, 0.75
    for _ in range(30):
        world.robot.act(action)
        world.step()
    for name, wanted in (("head", "can_1"), ("right", "robot")):
        image = world.robot.look(name)
        assert image.rgb.shape == (FETCH.cameras[name].height, FETCH.cameras[name].width, 3)
        assert image.labels is not None
        assert wanted in {image.names.get(int(label)) for label in np.unique(image.labels)}
    with pytest.raises(BackendError, match="no camera 'left'"):
        world.robot.look("left")


@pytest.mark.rare
@pytest.mark.slow
def test_the_expert_throws_the_cans_away_with_one_hand() -> None:
    """With a plan for one hand all cans of an instance come into the trash can."""
    config = EpisodeConfig("picking_up_trash", robot="fetch", plan=str(PLAN), detector="oracle", checker="oracle")
    result = episode.run(config)
    assert result["q_score"]["final"] == 1.0
    assert result["agent_distance"]["left"] == 0.0
