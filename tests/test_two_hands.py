"""Lifting with both hands: boxes about things, motions in step, and that heavy boxes really leave the floor."""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mpvi_bt.executive.plan.skills import load_skills
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.solids import Array, Solid, bounds
from mpvi_bt.ground.robot.motion import Actions, Motion
from mpvi_bt.ground.robot.protocol import SIDES, Side
from mpvi_bt.ground.robot.squeeze import squeezes
from mpvi_bt.hands.motion.both_hands import look_over, open_wide, together
from mpvi_bt.hands.motion.work import Work
from mpvi_bt.hands.robots.r1 import R1
from mpvi_bt.hands.skills.box_grip import Box, boxes_about, carcass
from mpvi_bt.hands.skills.lift import lift
from mpvi_bt.hands.skills.set_down import set_down
from mpvi_bt.hands.stance.base_search import RUN_UPS_M, BaseSearch, behind
from mpvi_bt.house.sim.world import Placement
from mpvi_bt.house.states.relations import ontop
from mpvi_bt.house.truth.expert import ExpertPolicy
from mpvi_bt.house.truth.true_scene import TrueScene
from mpvi_bt.testing.full_hands import put_in_hands
from tests.layouts import LAYOUT
from tests.small_house import LARGE, placed, small_world
from tests.test_open import play

half_sizes = st.tuples(*[st.floats(0.03, 0.3)] * 3)


@given(half_sizes, st.floats(-3.1, 3.1), st.floats(-2, 2), st.floats(-2, 2))
def test_a_box_is_seen_from_its_four_sides(half: tuple[float, float, float], yaw: float, x: float, y: float) -> None:
    """All four are the box itself, a quarter turn apart; length and width change places from each to the next."""
    T = kin.transform(kin.rot_z(yaw), (x, y, half[2]))
    boxes = list(boxes_about(T, [Solid("box", np.array(half), T)]))
    assert len(boxes) == 4
    for k, box in enumerate(boxes):
        np.testing.assert_allclose(box.middle, T[:3, 3], atol=1e-9)
        sizes = (2 * half[0], 2 * half[1]) if abs(np.cos(box.heading - yaw)) > 0.5 else (2 * half[1], 2 * half[0])
        np.testing.assert_allclose((box.length, box.width, box.height), (*sizes, 2 * half[2]), atol=1e-9)
        assert box.bottom == pytest.approx(0.0, abs=1e-9)
        turn = float(kin.wrap(boxes[(k + 1) % 4].heading - box.heading))
        assert abs(turn) == pytest.approx(np.pi / 2)


@given(half_sizes, st.floats(-3.1, 3.1), st.floats(-0.08, 0.08))
def test_hands_face_each_other_across_the_box(half: tuple[float, float, float], yaw: float, reach: float) -> None:
    """They come from the two sides, as far off as is asked for, and are nearer to each other than without."""
    T = kin.transform(kin.rot_z(yaw), (0.0, 0.0, half[2]))
    for box in boxes_about(T, [Solid("box", np.array(half), T)]):
        hands = box.hands(R1.hand, reach)
        tips = {s: hands[s][:3, 3] + 0.012 * hands[s][:3, 2] for s in SIDES}
        assert np.linalg.norm(tips["left"] - tips["right"]) == pytest.approx(abs(box.width + 2 * reach), abs=1e-6)
        across = tips["right"] - tips["left"]
        if box.width + 2 * reach > 0.01:
            assert hands["left"][:3, 2] @ across > 0
            assert hands["right"][:3, 2] @ across < 0


@given(st.floats(0.014, 0.068), st.floats(0.1, 0.3), st.floats(-3.1, 3.1))
def test_fingertips_meet_the_side_of_what_is_low_and_not_its_edge(height: float, half: float, yaw: float) -> None:
    """The whole end of a finger is between its upper edge and what it lies on: on the edge it would press it down."""
    box = Box(np.array([0.4, 0.1, 0.3 + height / 2]), yaw, 0.5, 2 * half, height)
    for T in box.hands(R1.hand, 0.0).values():
        ends = [T[2, 3] + 0.012 * T[2, 2] + sign * 0.011 * T[2, 0] for sign in (-1, 1)]
        assert min(ends) > 0.3 + 0.004
        assert max(ends) < 0.3 + height - 0.004


def test_motions_run_in_step_until_the_last_has_ended() -> None:
    """Each action carries what all of them did at that step; none runs ahead of the others."""
    world = small_world({})
    work = Work(None, Motion(world.robot.proprioception()), np.random.default_rng(0))  # type: ignore[arg-type]
    motion, count = work.motion, {"left": 12, "right": 5}

    def closing(side: str) -> Iterator[Array]:
        for k in range(count[side]):
            motion.action[LAYOUT.gripper[side]] = -k / 20  # type: ignore[index]
            yield motion.still()

    actions = list(together(closing("left"), closing("right"), motion_of=work))
    assert len(actions) == 12
    for k, action in enumerate(actions):
        assert action[LAYOUT.gripper["left"]] == -k / 20
        assert action[LAYOUT.gripper["right"]] == -min(k, 4) / 20


def test_what_no_hand_spans_is_fetched_with_both() -> None:
    """A crate is lifted, a can is picked up, before they are put somewhere."""
    crate = Placement(LARGE["drinks_crate"], kin.transform(np.eye(3), (1.0, 0.3, 0.001)))
    world = small_world({"crate": crate, "can": placed("can_of_soda", 1.0, -0.3)})
    work = Work(TrueScene(world), Motion(world.robot.proprioception()), np.random.default_rng(0))
    policy = ExpertPolicy(world, load_skills())
    assert not policy._graspable(work, "drinks crate")
    assert policy._graspable(work, "can of soda")


def test_who_holds_something_does_not_try_to_fetch_with_both() -> None:
    """A saucer that had been dropped, seen in part, was no thing for one hand; the other one held the cup."""
    crate = Placement(LARGE["drinks_crate"], kin.transform(np.eye(3), (1.0, 0.3, 0.001)))
    world = small_world({"crate": crate, "can": placed("can_of_soda", 1.0, -0.3)})
    put_in_hands(world, {"right": "can"})
    work = Work(TrueScene(world), Motion(world.robot.proprioception()), np.random.default_rng(0))
    assert ExpertPolicy(world, load_skills())._graspable(work, "drinks crate")


def test_a_failure_leaves_between_the_hands_what_they_hold() -> None:
    """Recovering, the robot may back off, but moves neither arm nor finger: nothing else holds the box up."""
    world = small_world({"box": placed("box", 1.5, 0.0)})
    scene = TrueScene(world)
    scene.between = lambda: "box"
    work = Work(scene, Motion(world.robot.proprioception()), np.random.default_rng(0))
    before = work.motion.still()
    for action in ExpertPolicy(world, load_skills())._recover(work):
        for side in SIDES:
            np.testing.assert_array_equal(action[LAYOUT.arm[side]], before[LAYOUT.arm[side]])
            assert action[LAYOUT.gripper[side]] == before[LAYOUT.gripper[side]]
        world.robot.act(action)
        world.step()
        work.motion.felt = world.robot.proprioception()


def test_what_has_a_lid_is_pressed_below_it() -> None:
    """Hands on the lid of a laptop would raise that and leave the rest: it is taken by what the lid is hinged to."""
    world = small_world({"laptop": placed("laptop", 0.8, 0.0, 0.5), "crate": placed("packing_box", -1.0, 0.5)})
    work = Work(TrueScene(world), Motion(world.robot.proprioception()), np.random.default_rng(0))
    (box, *_) = boxes_about(world.pose("laptop"), carcass(work, "laptop"))
    (whole, *_) = boxes_about(world.pose("laptop"), list(world.solids("laptop")))
    assert box.bottom == pytest.approx(whole.bottom)
    assert box.bottom + box.height < whole.bottom + 0.7 * whole.height
    assert len(carcass(work, "crate")) == len(list(world.solids("crate")))


@given(st.floats(0.0, 0.6), st.floats(-3.1, 3.1))
def test_hands_are_formed_as_far_behind_as_there_is_room(room_m: float, yaw: float) -> None:
    """Never farther, and nowhere if there is none; what has room behind it is left as far as before."""
    base = np.array([0.4, -0.2, yaw])

    def drivable(start: Array, goal: Array) -> bool:
        return float(np.linalg.norm(start[:2] - goal[:2])) <= room_m

    motion = SimpleNamespace(felt=SimpleNamespace(base_pose=np.zeros(3)))
    search: Any = SimpleNamespace(motion=motion, drivable=drivable, route=lambda here, goal: [goal])
    way = BaseSearch.way_behind(search, base, RUN_UPS_M, straight_in=True)
    if way is None:
        assert room_m < 0.2
        return
    away = float(np.linalg.norm(way[-1][:2] - base[:2]))
    assert away <= room_m
    assert away > min(0.4, room_m - 0.1) - 1e-9
    np.testing.assert_allclose(way[-1], behind(base, away))


@pytest.mark.slow
@pytest.mark.parametrize("inside_m", [0.22, 0.3])
def test_a_book_is_lifted_off_a_bed_that_stands_a_meter_from_a_wall(inside_m: float) -> None:
    """There was no stance as long as the base had to stand 40 cm farther back first, and no more than 47 cm off."""
    bed = "{entry: bed, at: [1.2, 0.0], yaw_deg: 270, shape: {size_m: [2.0, 1.6, 0.52]}}"
    world = small_world({"book": placed("book", 2.0 - inside_m, 0.1, 0.522)}, base=(2.5, 0.0, np.pi), bed=bed)
    world.settle()
    work = Work(TrueScene(world), Motion(world.robot.proprioception()), np.random.default_rng(0))
    for action in lift(work, {"object": "book"}, []):
        world.robot.act(action)
        world.step()
        work.motion.felt = world.robot.proprioception()
    assert world.between() == "book"
    assert world.solids("book")[0].aabb()[0, 2] > 0.58


@pytest.mark.slow
@pytest.mark.parametrize(("y", "yaw"), [(0.0, 0.2), (-0.3, 1.7)])
def test_a_thin_sheet_is_lifted_off_the_floor_and_stays_level(y: float, yaw: float) -> None:
    """Palms slipped off two centimeters of plywood as long as they pressed on its edge; lying across, both its ends are
    too far off to be seen from where the robot is.
    """
    world = small_world({"sheet": placed("plywood", 1.4, y, 0.001, yaw)})
    world.settle()
    work = Work(TrueScene(world), Motion(world.robot.proprioception()), np.random.default_rng(0))
    for action in lift(work, {"object": "sheet of plywood"}, []):
        world.robot.act(action)
        world.step()
        work.motion.felt = world.robot.proprioception()
    T = world.pose("sheet")
    assert world.between() == "sheet"
    assert T[2, 3] > 0.45
    assert T[2, 2] > np.cos(np.radians(5.0))


@pytest.mark.slow
def test_what_two_hands_hold_is_set_down_on_the_floor_straight_ahead() -> None:
    """The robot never backs toward what is behind it, which no picture shows: there it has driven into walls. It bends
    down with the box: the lift alone ended 29 cm above the floor, and the box fell.
    """
    world = small_world({"box": placed("storage_container", 1.2, 0.0)})
    world.settle()
    work = Work(TrueScene(world), Motion(world.robot.proprioception()), np.random.default_rng(0))

    let_go_at: list[float] = []

    def ahead(actions: Actions) -> list[float]:
        start, way = world.robot.proprioception().base_pose, []
        for action in actions:
            world.robot.act(action)
            world.step()
            felt = work.motion.felt = world.robot.proprioception()
            way.append(float((felt.base_pose - start)[:2] @ [np.cos(start[2]), np.sin(start[2])]))
            if squeezes(felt):
                let_go_at[:] = [world.solids("box")[0].aabb()[0, 2]]
        return way

    ahead(lift(work, {"object": "storage container"}, []))
    assert world.between() == "box"
    way = ahead(set_down(work, {"object": "storage container", "surface": "the hall floor"}, []))
    assert min(way) > -0.03
    assert max(way) > 0.3
    assert let_go_at[0] < 0.03
    assert world.between() is None
    assert world.solids("box")[0].aabb()[0, 2] < 0.05


@pytest.mark.parametrize(("lift", "x"), [(0.14, 0.57), (0.1, 0.62), (0.05, 0.57)])
def test_hands_open_wide_wherever_they_are(lift: float, x: float) -> None:
    """Where the arms have no reach left outward the body bends otherwise: they opened by 3 cm, and a box came along."""
    world = small_world({})
    work = Work(TrueScene(world), Motion(world.robot.proprioception()), np.random.default_rng(0))
    motion, torso = work.motion, np.array([lift, 0.0, 0.8, 0.4])
    motion.action[LAYOUT.torso] = torso

    def step(action: Array) -> dict[Side, Array]:
        world.robot.act(action)
        world.step()
        motion.felt = world.robot.proprioception()
        return {side: motion.robot.tcp(motion.felt.torso, motion.felt.arm[side], side)[:3, 3] for side in SIDES}

    for side, T in Box(np.array([x, 0.0, 0.338]), 0.0, 0.31, 0.33, 0.22).hands(R1.hand, 0.0).items():
        q = motion.robot.nearest_posture(
            kin.inverse(motion.robot.chest(torso)) @ T, side, motion.robot.travel_arm[side]
        )
        assert q is not None
        motion.action[LAYOUT.arm[side]] = q
    for _ in range(60):
        before = step(motion.still())
    for action in open_wide(work):
        after = step(action)
    assert after["left"][1] - after["right"][1] > before["left"][1] - before["right"][1] + 0.1
    assert abs(after["left"][2] - before["left"][2]) < 0.02


@pytest.mark.slow
def test_the_head_looks_over_what_two_hands_hold_while_they_keep_it_where_it_is() -> None:
    """What stands on the floor before it, and was out of view, is in view then."""
    world = small_world({"box": placed("storage_container", 1.2, 0.0)})
    world.settle()
    work = Work(TrueScene(world), Motion(world.robot.proprioception()), np.random.default_rng(0))

    def hidden_m() -> float:
        """How far before the base the nearest place on the floor behind the box is that the head sees."""
        high = bounds(s.moved(kin.inverse(work.base)) for s in world.solids("box"))[1]
        eye = work.motion.robot.head_camera(work.motion.felt.torso)[:3, 3]
        return float(high[0] + (high[0] - eye[0]) * high[2] / (eye[2] - high[2]))

    def play_all(actions: Actions) -> None:
        for action in actions:
            world.robot.act(action)
            world.step()
            work.motion.felt = world.robot.proprioception()

    play_all(lift(work, {"object": "storage container"}, []))
    before, hidden = bounds(world.solids("box")), hidden_m()
    play_all(look_over(work))
    assert world.between() == "box"
    np.testing.assert_allclose(bounds(world.solids("box")), before, atol=0.03)
    assert hidden_m() < hidden - 0.2


@pytest.mark.slow
@pytest.mark.parametrize("y", [0.5, -0.25])
def test_what_two_hands_hold_is_set_down_among_things_that_stay_as_they_are(y: float) -> None:
    """Neither the elbows on the way in nor the hands that let go sweep away what stands and lies there."""
    things = {
        "folder": placed("folder", 0.75, 1.5, 0.521, np.pi / 2),
        "monitor": placed("monitor", 0.72, y, 0.741, np.pi),
        "notebook": placed("notebook", 0.65, y - np.sign(y) * 0.5, 0.741),
    }
    desk = "{entry: desk, at: [0.85, 0.0], yaw_deg: 180, shape: {size_m: [0.7, 1.6, 0.74]}}"
    stool = "{entry: table, at: [0.75, 1.5], shape: {size_m: [0.4, 0.4, 0.52]}}"
    world = small_world(things, base=(-0.2, 0.6, 0.5), desk=desk, stool=stool)
    world.settle()
    before = {name: world.pose(name) for name in ("monitor", "notebook")}
    assert play(world, "lift the folder with both hands, then put the folder on the desk", limit_s=120)[-1] == "done"
    assert ontop(world, "folder", "desk")
    for name, T in before.items():
        assert np.linalg.norm(world.pose(name)[:3, 3] - T[:3, 3]) < 0.02
