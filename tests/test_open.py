"""Doors, drawers and lids: which one a phrase means, how hand and base go along with it, and that it really opens."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from mpvi_bt.executive.plan.skills import load_skills
from mpvi_bt.finding.shapes.moving_parts import moved
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.motion import Motion, MotionFailure
from mpvi_bt.ground.robot.protocol import Side
from mpvi_bt.hands.motion.follow import _reach, go_along
from mpvi_bt.hands.motion.work import Work
from mpvi_bt.hands.robots.r1 import R1
from mpvi_bt.hands.skills.bar_courses import swings
from mpvi_bt.hands.skills.close import is_closed
from mpvi_bt.hands.skills.open import is_open
from mpvi_bt.hands.skills.openings import doors_meant, thing_meant
from mpvi_bt.hands.skills.push_courses import pushes
from mpvi_bt.hands.stance.course import Course
from mpvi_bt.house.sim.world import SimWorld
from mpvi_bt.house.truth.expert import ExpertPolicy
from mpvi_bt.house.truth.true_scene import TrueScene
from tests.layouts import BASE, LAYOUT
from tests.small_house import placed, small_world

SKILLS = load_skills()
CHEST = "{entry: chest_of_drawers, at: [1.0, 0.0], yaw_deg: 180}"
TWO_DOORS = "{entry: base_cabinet, at: [1.0, 0.0], yaw_deg: 180, shape: {size_m: [0.5, 0.9, 0.86], doors: 2}}"
FIXTURES = {
    "refrigerator": "{entry: refrigerator, at: [1.0, 0.0], yaw_deg: 180}",
    "base cabinet": "{entry: base_cabinet, at: [1.0, 0.0], yaw_deg: 180}",
    "wall cabinet": "{entry: wall_cabinet, at: [1.0, 0.0], yaw_deg: 180, z_m: 1.35}",
    "oven": "{entry: oven, at: [1.0, 0.0], yaw_deg: 180}",
    "washer": "{entry: washer, at: [1.0, 0.0], yaw_deg: 180}",
    "chest of drawers": CHEST,
    "car": "{entry: car, at: [1.1, 0.0], yaw_deg: 180}",
}


def work_in(world: SimWorld) -> Work:
    return Work(TrueScene(world), Motion(world.robot.proprioception()), np.random.default_rng(0))


def play(
    world: SimWorld, prompt: str, limit_s: float = 60.0, watch: Callable[[int, ExpertPolicy], None] | None = None
) -> list[str]:
    """Have the expert follow a prompt; what it said, in order."""
    expert, said = ExpertPolicy(world, SKILLS), [""]
    for step in range(round(limit_s * 30)):
        (action,) = expert.infer({"prompt": prompt, "proprioception": world.robot.proprioception(), "images": {}})
        world.robot.act(action)
        world.step()
        if watch is not None:
            watch(step, expert)
        if expert.note != said[-1]:
            said.append(expert.note)
        if expert.note == "done":
            break
    return said[1:]


@pytest.mark.parametrize(
    ("fixture", "phrase", "names"),
    [
        (CHEST, "chest of drawers", ["drawer_3", "drawer_2", "drawer_1"]),
        (CHEST, "the top drawer of the chest of drawers", ["drawer_3"]),
        (CHEST, "middle drawer of the dresser", ["drawer_2"]),
        (CHEST, "lowest drawer in the chest of drawers", ["drawer_1"]),
        (CHEST, "the second drawer of the dresser", ["drawer_2"]),
        (CHEST, "drawer 3 of the dresser", ["drawer_1"]),
        (CHEST, "dresser drawer 1", ["drawer_3"]),
        (TWO_DOORS, "left door of the cabinet", ["left_door"]),
        (TWO_DOORS, "the right cabinet door", ["right_door"]),
        (TWO_DOORS, "right cabinet", ["right_door"]),
        (TWO_DOORS, "cabinet door", ["left_door", "right_door"]),
        (FIXTURES["car"], "boot of the car", ["boot_lid"]),
        (FIXTURES["refrigerator"], "fridge door", ["door"]),
    ],
)
def test_a_phrase_tells_doors_apart(fixture: str, phrase: str, names: list[str]) -> None:
    """Words of place and rank choose among a thing's doors, counted from the top; without them all are meant."""
    work = work_in(small_world(thing=fixture))
    thing, places = thing_meant(work, phrase)
    assert thing == "thing"
    assert [door.name for door in doors_meant(work, thing, places)] == names


def test_left_stays_left_when_a_door_is_open() -> None:
    """A door is told apart by where it is when closed, however it stands."""
    world = small_world(thing=TWO_DOORS)
    for body in ("left_door", "right_door"):
        world.set_opening("thing", body, 0.75)
        world.refresh()
        work = work_in(world)
        (door,) = doors_meant(work, *thing_meant(work, f"{body.removesuffix('_door')} door of the cabinet"))
        assert door.name == body


@pytest.mark.parametrize(("phrase", "reason"), [("elephant", "unknown_object"), ("table", "no_door")])
def test_what_cannot_be_opened_says_so(phrase: str, reason: str) -> None:
    """An unknown thing and a thing without doors have reasons of their own."""
    world = small_world(thing="{entry: table, at: [1.0, 0.0]}")
    work = work_in(world)
    with pytest.raises(MotionFailure) as failure:
        doors_meant(work, *thing_meant(work, phrase))
    assert failure.value.reason == reason


@pytest.mark.parametrize("name", FIXTURES)
def test_a_door_moves_as_its_joint_says(name: str) -> None:
    """`moved` predicts where the solids of a door are when it is opened further."""
    world = small_world(thing=FIXTURES[name])
    before = world.doors("thing")[-1]
    world.set_opening("thing", before.name, 0.6)
    world.refresh()
    after = world.doors("thing")[-1]
    T = moved(before, after.position - before.position)
    for was, now in zip(before.solids, after.solids, strict=True):
        np.testing.assert_allclose(T @ was.T, now.T, atol=2e-3)


@pytest.mark.parametrize("name", FIXTURES)
def test_a_course_begins_where_the_robot_is_and_stays_on_the_bar(name: str) -> None:
    """The base has not moved at the start; at every moment the hand is where the bar has gone."""
    door = small_world(thing=FIXTURES[name]).doors("thing")[-1]
    assert door.bar is not None
    for course in swings(door, door.bar, 0.8 * door.limit):
        np.testing.assert_allclose(course.carry(0.0), np.eye(4), atol=1e-9)
        held = course.hand(0.0)[:3, 3]
        for x in (0.3, 1.0):
            T = moved(door, 0.8 * door.limit * x)
            np.testing.assert_allclose(course.hand(x)[:3, 3], T[:3, :3] @ held + T[:3, 3], atol=1e-9)


@pytest.mark.parametrize("name", ["refrigerator", "base cabinet", "washer"])
def test_an_upright_door_leaves_the_arm_as_it_is(name: str) -> None:
    """The base turns about the bar as much as the hand does, so the hand hardly moves as the base sees it."""
    door = small_world(thing=FIXTURES[name]).doors("thing")[0]
    assert door.bar is not None
    for course in swings(door, door.bar, 1.4):
        start = np.array([0.1, -0.4, 0.3])
        first = kin.inverse(kin.base(start)) @ course.hand(0.0)
        for x in (0.4, 1.0):
            np.testing.assert_allclose(kin.inverse(kin.base(course.base(x, start))) @ course.hand(x), first, atol=1e-9)


def test_a_push_ends_with_the_door_shut_and_never_meets_the_bar() -> None:
    """The fist goes on a little beyond the closed door, and starts clear of the bar."""
    world = small_world(thing=FIXTURES["refrigerator"])
    world.set_opening("thing", "door", 0.7)
    world.refresh()
    door = world.doors("thing")[0]
    assert door.bar is not None
    courses = pushes(R1.hand, door)
    assert courses
    for course in courses:
        fist = course.hand(0.0)[:3, 3]
        beyond = abs(float((fist - door.bar.center) @ door.bar.axis)) - door.bar.length_m / 2
        beside = np.linalg.norm(np.cross(fist - door.bar.center, door.bar.axis))
        assert beyond > 0.05 or beside > 0.05
        assert abs(course.hand(1.0)[0, 3] - 0.68) < 0.03  # the front of the closed door


@pytest.mark.slow
@pytest.mark.parametrize("name", FIXTURES)
def test_what_has_a_door_is_opened_and_closed(name: str) -> None:
    """The expert opens it enough to reach in, and closes it again, with friction alone."""
    world = small_world(base=(-1.6 if name == "car" else -0.4, 0.2, 0.1), thing=FIXTURES[name])
    world.settle(0.3)
    assert play(world, f"open the {name}") == ["open", "done"]
    assert any(is_open(door) for door in world.doors("thing"))
    assert play(world, f"close the {name}") == ["close", "done"]
    assert all(is_closed(door) for door in world.doors("thing"))


def test_a_hand_on_a_bar_is_drawn_back_before_it_is_folded() -> None:
    """Recovering, it opens, and the base moves against its fingers before an arm does; beside the bar the arm rises."""
    world = small_world(base=(0.0, 0.0, 0.0), thing=FIXTURES["refrigerator"])
    bar, work = world.doors("thing")[0].bar, work_in(world)
    side: Side = "left"
    assert bar is not None
    R = kin.hand_rotation(-bar.outward, np.cross(bar.axis, bar.outward))
    for aside, draws_back in ((0.0, True), (0.12, False)):
        T = kin.transform(R, bar.center + [0.0, aside, 0.0])
        felt = world.robot.proprioception()
        base = np.array([T[0, 3] - 0.6, T[1, 3] - 0.15, 0.0])
        q = R1.nearest_posture(kin.inverse(kin.base(base) @ R1.chest(felt.torso)) @ T, side, felt.arm[side])
        assert q is not None
        felt = replace(felt, base_pose=base, arm={**felt.arm, side: q}, arm_command={})
        work.motion = Motion(replace(felt, gripper_command={**felt.gripper_command, side: -1.0}))
        before = work.motion.still()
        moving = next(
            action
            for action in ExpertPolicy(world, SKILLS)._recover(work)
            if action[BASE].any() or (action[LAYOUT.arm[side]] != before[LAYOUT.arm[side]]).any()
        )
        assert moving[LAYOUT.gripper[side]] == 1.0
        assert bool(moving[BASE] @ [*(kin.rot_z(-base[2]) @ bar.outward)[:2], 0.0] > 0) == draws_back


@pytest.mark.slow
def test_the_other_hand_may_be_full() -> None:
    """A can that was picked up before is still held, upright, when the refrigerator stands open."""
    table = "{entry: table, at: [-1.6, 0.0]}"
    world = small_world(
        {"can": placed("can_of_soda", -1.4, 0.0, 0.721)}, base=(-0.4, 0.2, 3.1), thing=FIXTURES["refrigerator"], t=table
    )
    world.settle(0.3)
    assert play(world, "pick up the can of soda")[-1] == "done"
    assert play(world, "open the refrigerator")[-1] == "done"
    assert is_open(world.doors("thing")[0])
    assert "can" in (world.holding("left"), world.holding("right"))
    assert world.pose("can")[2, 2] > 0.9


@pytest.mark.slow
def test_a_lost_bar_is_noticed_at_once_and_taken_hold_of_again() -> None:
    """A door that is torn out of the hand is noticed within half a second, and opened all the same."""
    world = small_world(base=(-0.4, 0.2, 0.1), thing=FIXTURES["refrigerator"])
    world.settle(0.3)
    torn: list[int] = []
    noticed: list[int] = []

    def tear(step: int, expert: ExpertPolicy) -> None:
        if not torn and world.doors("thing")[0].position > 0.5:
            world.set_opening("thing", "door", 0.05)
            torn.append(step)
        if torn and not noticed and expert.note == "open: slipped":
            noticed.append(step)
        if torn and not noticed and world.robot.action[22] > -0.99 and world.robot.action[14] > -0.99:
            noticed.append(step)

    assert play(world, "open the refrigerator", watch=tear)[-1] == "done"
    assert noticed[0] - torn[0] <= 15
    assert is_open(world.doors("thing")[0])


def test_an_arm_that_leads_something_along_does_not_swing_to_another_elbow() -> None:
    """It follows what is near; for what only another posture reaches it stays where it is, and says so."""
    world = small_world()
    motion = Motion(world.robot.proprioception())
    T = kin.base(motion.felt.base_pose) @ motion.hand("left")
    before = motion.arm("left").copy()
    turned = T.copy()
    turned[:3, :3] = kin.rot_z(1.5) @ T[:3, :3]
    assert not _reach(motion, "left", turned)
    np.testing.assert_array_equal(motion.arm("left"), before)
    near = T.copy()
    near[2, 3] += 0.01
    assert _reach(motion, "left", near)
    assert (motion.arm("left") != before).any()


def test_a_base_that_is_held_up_goes_back_before_it_gives_up() -> None:
    """A course that leads into a wall that nobody saw ends with room between the base and that wall."""
    world = small_world(base=(0.0, 2.3, 0.0))
    world.settle(0.3)
    motion = Motion(world.robot.proprioception())
    T = kin.base(motion.felt.base_pose) @ motion.hand("left")

    def aside(x: float) -> Array:
        return kin.transform(np.eye(3), (0.0, 0.8 * x, 0.0))

    course = Course(T, lambda x: aside(x) @ T, aside, lambda x: [], 0.0)
    went = [0.0]

    def go() -> None:
        for action in go_along(motion, course, "left", motion.torso, lambda x: False):
            world.robot.act(action)
            world.step()
            motion.felt = world.robot.proprioception()
            went.append(float(motion.felt.base_pose[1]))

    with pytest.raises(MotionFailure, match="base_blocked"):
        go()
    assert max(went) - went[-1] > 0.02
