"""The physical world: its clock, what touches, what is held, what is in the way, and that it repeats itself."""

from __future__ import annotations

import hashlib
import json

import numpy as np
import pytest

from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.rays import distance
from mpvi_bt.ground.geometry.solids import Array, Solid, box, pose
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, SIDES, Side, other
from mpvi_bt.hands.robots.r1 import R1
from mpvi_bt.house.sim.builder import Thing
from mpvi_bt.house.sim.world import SimWorld
from mpvi_bt.house.states.relations import inside, ontop
from tests.layouts import BASE, LAYOUT
from tests.small_house import placed, run, small_world

TABLE = "{entry: table, at: [1.2, 0.0]}"


def thing(world: SimWorld, name: str) -> Thing:
    return world._things[name]


def bodies(world: SimWorld) -> dict[str, Array]:
    return {name: world.pose(name) for name in world.objects}


def fingerprint(world: SimWorld) -> str:
    """A hash of everything that moves."""
    felt = world.robot.proprioception()
    parts = [*(world.pose(n) for n in world.objects), felt.base_pose, felt.torso, *felt.arm.values()]
    return hashlib.sha256(b"".join(np.ascontiguousarray(p).tobytes() for p in parts)).hexdigest()


def place_in_hand(world: SimWorld, name: str, side: Side) -> None:
    """Put a can between the open fingers, its axis along the hand's, and close them."""
    T = world.robot.hand_pose_world(side)
    down = pose((0.0, 0.0, -0.061))
    thing(world, name).place(T @ down)
    action = world.robot.action
    action[LAYOUT.gripper[side]] = -1.0
    run(world, action, 1.0)


def test_the_clock_counts_control_steps() -> None:
    """Time is steps over 30 Hz; settling and refreshing do not advance it."""
    world = small_world()
    assert (world.steps, world.time_s) == (0, 0.0)
    run(world, world.robot.action, 0.5)
    world.settle(0.2)
    world.refresh()
    assert world.steps == 15
    assert world.time_s == pytest.approx(0.5)
    assert world.physics_s > 0


def test_one_step_is_a_thirtieth_of_a_second() -> None:
    """What falls freely for a number of steps falls as far as in their time."""
    world = small_world({"can": placed("can_of_soda", 1.0, 0.0, 2.0)})
    n = 12
    for _ in range(n):
        world.step()
    fallen = 2.0 - world.pose("can")[2, 3]
    assert fallen == pytest.approx(9.81 / 2 * (n / CONTROL_HZ) ** 2, rel=0.05)


def test_things_come_to_rest() -> None:
    """After settling, what stood just above floor and table stands on them and moves no more."""
    objects = {"can": placed("can_of_soda", 1.2, 0.1, 0.80), "bin": placed("trash_can", -1.0, 0.5)}
    world = small_world(objects, table_1=TABLE)
    top = max(s.aabb()[1, 2] for s in world.solids("table_1"))
    thing(world, "can").place(pose((1.2, 0.1, top + 0.002)))
    world.settle()
    before = bodies(world)
    assert before["can"][2, 3] == pytest.approx(top, abs=0.003)
    assert before["bin"][2, 3] == pytest.approx(0.0, abs=0.003)
    run(world, world.robot.action, 1.0)
    for name, T in bodies(world).items():
        np.testing.assert_allclose(T, before[name], atol=1e-3, err_msg=name)


def test_contacts_are_told_after_a_refresh() -> None:
    """What has slept for long still touches what it stands on, once contacts are reported anew, and nothing else."""
    world = small_world({"can": placed("can_of_soda", 1.0, 0.0), "other": placed("can_of_soda", 1.0, 0.5)})
    world.settle()
    run(world, world.robot.action, 4.0)
    world.refresh()
    assert world.touching("can", "floor_hall")
    assert world.touching("floor_hall", "can")
    assert not world.touching("can", "other")
    assert not world.touching("can", "wall_hall")
    assert ontop(world, "can", "floor_hall")


def test_a_world_repeats_itself_bit_for_bit() -> None:
    """The same construction and the same actions give the same state after any number of steps."""

    def hashes() -> list[str]:
        world = small_world({"can": placed("can_of_soda", 0.6, 0.0, 0.3, 0.3), "bin": placed("trash_can", 1.0, 0.6)})
        world.settle(0.3)
        rng, found = np.random.default_rng(1), []
        for k in range(90):
            action = world.robot.action
            if k % 10 == 0:
                action[BASE] = rng.uniform(-0.6, 0.6, 3)
                action[LAYOUT.arm["left"]] += rng.uniform(-0.3, 0.3, 7)
            world.robot.act(action)
            world.step()
            if k % 30 == 29:
                found.append(fingerprint(world))
        return found

    first = hashes()
    assert len(set(first)) == 3
    assert hashes() == first


@pytest.mark.render
def test_pictures_change_nothing() -> None:
    """A world that is built to be seen, and looked at, moves exactly as one that is not."""

    def moved(render: bool) -> str:
        world = small_world({"can": placed("can_of_soda", 0.6, 0.1, 0.4, 0.3)}, render=render)
        world.settle(0.3)
        action = world.robot.action
        action[BASE] = (0.4, 0.1, 0.3)
        for _ in range(30):
            world.robot.act(action)
            world.step()
            if render and world.steps % 10 == 0:
                world.robot.look("head")
        return fingerprint(world)

    assert moved(True) == moved(False)


@pytest.mark.parametrize("side", SIDES)
def test_a_closed_hand_holds_what_is_between_its_fingers(side: Side) -> None:
    """A can between closed fingers is held by that hand only; open, it is not; it falls, and nothing is held."""
    world = small_world({"can": placed("can_of_soda", 2.0, 2.0), "far": placed("can_of_soda", -2.0, 2.0)})
    place_in_hand(world, "can", side)
    assert world.holding(side) == "can"
    assert world.holding(other(side)) is None
    entry = world.knowledge().entries["can"]
    assert entry.held
    assert not world.knowledge().entries["far"].held
    before = world.pose("can")[2, 3]
    run(world, world.robot.action, 2.0)
    assert world.pose("can")[2, 3] == pytest.approx(before, abs=0.005)
    action = world.robot.action
    action[LAYOUT.gripper[side]] = 1.0
    run(world, action, 1.0)
    assert world.holding(side) is None
    assert not world.knowledge().entries["can"].held


def test_what_was_held_and_lies_elsewhere_is_laid_down() -> None:
    """Near where a hand took it a thing slipped; away from there it was laid, which a saved world knows, too."""
    world = small_world({"can": placed("can_of_soda", 2.0, 2.0), "far": placed("can_of_soda", -2.0, 2.0)})
    place_in_hand(world, "can", "left")
    assert not world.knowledge().entries["can"].laid
    action = world.robot.action
    action[LAYOUT.gripper["left"]] = 1.0
    run(world, action, 1.0)
    x, y = world.pose("can")[:2, 3]
    for away, laid in ((0.0, False), (1.0, True)):
        world.place("can", pose((x + away, y, 0.001)))
        world.place("far", pose((x - 2 - away, y, 0.001)))
        assert [world.knowledge().entries[n].laid for n in ("can", "far")] == [laid, False]
    again = small_world({"can": placed("can_of_soda", 2.0, 2.0), "far": placed("can_of_soda", -2.0, 2.0)})
    again.restore(json.loads(json.dumps(world.save())))
    assert again.knowledge().entries["can"].laid


def test_what_is_taken_again_where_it_was_laid_is_laid_where_it_first_stood(monkeypatch: pytest.MonkeyPatch) -> None:
    """A jar from a cabinet, filled on a table and put back, is put away; a saved world knows it, too."""
    world = small_world({"can": placed("can_of_soda", 2.0, 2.0)})
    place_in_hand(world, "can", "left")
    first = world.pose("can")
    assert not world.knowledge().entries["can"].laid
    action = world.robot.action
    action[LAYOUT.gripper["left"]] = 1.0
    run(world, action, 1.0)
    world.place("can", pose((*world.pose("can")[:2, 3] + [1.0, 0.0], 0.001)))
    assert world.knowledge().entries["can"].laid
    again = small_world({"can": placed("can_of_soda", 2.0, 2.0)})
    again.restore(json.loads(json.dumps(world.save())))
    for each in (world, again):
        monkeypatch.setattr(each._whereabouts._holding, "in_hand", {"left": "can"}.get)
        each._whereabouts.forget()
        assert each.knowledge().entries["can"].held
        monkeypatch.undo()
        each.place("can", pose((*first[:2, 3], 0.001)))
        assert each.knowledge().entries["can"].laid


def test_a_jar_is_laid_where_it_is_put_however_seldom_one_looks(monkeypatch: pytest.MonkeyPatch) -> None:
    """It was taken from where it stood, not from where the hand had it by then; a hand on its lid takes it nowhere."""
    world = small_world({"can": placed("can_of_soda", 2.0, 2.0)})

    def laid(z: float, held: bool) -> bool:
        with monkeypatch.context() as hands:
            hands.setattr(world._whereabouts._holding, "in_hand", {"left": "can" if held else None}.get)
            world.place("can", pose((2.0, 2.0, z)))
            world._whereabouts.forget()
            return world.knowledge().entries["can"].laid

    told = [laid(z, held) for z, held in ((0.5, False), (0.8, True), (0.9, False), (0.9, True), (0.9, False))]
    assert told == [False, False, True, False, True]
    assert not laid(0.7, True)
    assert laid(0.5, False)  # put back into the cabinet that it was taken from first


def test_an_empty_fist_holds_nothing() -> None:
    """Hands that closed on nothing hold nothing, though a can is near."""
    world = small_world({"can": placed("can_of_soda", 2.0, 2.0)})
    action = world.robot.action
    for s in SIDES:
        action[LAYOUT.gripper[s]] = -1.0
    run(world, action, 1.0)
    assert [world.holding(s) for s in SIDES] == [None, None]


def test_what_lies_in_a_bin_is_within_it() -> None:
    """A can in the bin is within and inside it, one beside or under way above is not; held bins carry their content."""
    objects = {
        "in": placed("can_of_soda", 1.07, 0.0, 0.02),
        "beside": placed("can_of_soda", 1.5, 0.0),
        "above": placed("can_of_soda", 1.07, 0.05, 0.8),
        "bin": placed("trash_can", 1.0, 0.0),
    }
    world = small_world(objects)
    assert list(world.within("bin")) == ["in"]
    assert list(world.within("in")) == []
    world.settle()
    assert sorted(world.within("bin")) == ["above", "in"]  # it fell in
    assert inside(world, "in", "bin")
    entries = world.knowledge().entries
    assert entries["in"].inside == "bin"
    assert entries["beside"].inside is None
    assert not entries["in"].held


def test_what_is_in_a_held_bin_is_carried() -> None:
    """With the bin in a hand its content counts as held too."""
    objects = {"bin": placed("trash_can", 2.0, 2.0), "can": placed("can_of_soda", -2.0, 2.0)}
    world = small_world(objects)
    side: Side = "left"
    action = world.robot.action
    down = kin.transform(kin.hand_rotation((0, 0, -1), (0, 1, 0)), (0.5, 0.25, 0.8))
    near = np.array([-0.5, 0.3, 0.0, -1.1, 0.0, 0.0, 0.0])
    q = R1.nearest_posture(kin.inverse(R1.chest(action[LAYOUT.torso])) @ down, side, near)
    assert q is not None
    action[LAYOUT.arm[side]] = q
    run(world, action, 1.5)
    tcp = world.robot.hand_pose_world(side)[:3, 3]
    bar = thing(world, "bin").description.root.handles[0].center
    thing(world, "bin").place(pose(tcp - bar, np.pi / 2))  # the bar across the fingers
    action[LAYOUT.gripper[side]] = -1.0
    run(world, action, 0.7)
    thing(world, "can").place(world.pose("bin") @ pose((0.07, 0.0, 0.02)))
    run(world, action, 1.0)
    assert world.holding(side) == "bin"
    entries = world.knowledge().entries
    assert entries["bin"].held
    assert entries["can"].held
    assert entries["can"].inside == "bin"


def test_knowledge_follows_the_world() -> None:
    """Boxes and rooms of objects are those of the present step, rooms and fixtures are there by their phrases."""
    world = small_world({"can": placed("can_of_soda", 1.0, 0.0, 0.5)}, table_1="{entry: table, at: [-1.5, 0.0]}")
    before = world.knowledge().entries["can"]
    assert world.knowledge() is world.knowledge()
    run(world, world.robot.action, 1.0)
    (after,) = world.knowledge().find("the can of soda")
    assert after.lowest[2] < before.lowest[2] - 0.4
    np.testing.assert_allclose(np.stack([after.lowest, after.highest]), world.solids("can")[0].aabb(), atol=1e-6)
    assert after.room == "hall"
    assert after.source == "oracle"
    assert [e.name for e in world.knowledge().find("table")] == ["table_1"]
    assert [e.kind for e in world.knowledge().find("hall")] == ["room"]


def test_obstacles_are_what_is_near() -> None:
    """Walls, fixtures and objects within the radius are in the way; floors, the far and the excepted are not."""
    objects = {"can": placed("can_of_soda", 1.0, 0.0), "wallet": placed("book", 0.0, 1.0)}
    world = small_world(
        objects, wall_shelf_1="{entry: table, at: [-1.2, 0.0]}", floor_stand_1=TABLE.replace("1.2", "1.6")
    )

    def named(solids: list[Solid]) -> set[str]:
        found = set()
        for solid in solids:
            for name in ("can", "wallet", "wall_shelf_1", "floor_stand_1", "floor_hall"):
                found |= {name} if any(np.allclose(s.T, solid.T) for s in world.solids(name)) else set()
        return found

    place = np.zeros(2)
    assert named(world.obstacles(place, 1.7)) == {"can", "wallet", "wall_shelf_1", "floor_stand_1"}
    assert named(world.obstacles(place, 0.3)) == set()
    assert "can" not in named(world.obstacles(place, 1.7, without={"can"}))
    assert len(world.obstacles(place, 4.0)) > len(world.obstacles(place, 1.7))  # the walls
    for solid in world.obstacles(place, 1.7):
        low, high = solid.aabb()
        assert np.linalg.norm(np.maximum(np.maximum(low[:2], -high[:2]), 0)) < 1.7


def test_handles_move_with_their_thing() -> None:
    """The bar of a turned and shifted bin is where its pose puts it."""
    world = small_world({"bin": placed("trash_can", 1.0, 0.5, 0.2, 0.7)})
    description = thing(world, "bin").description.root.handles[0]
    (bar,) = world.handles("bin")
    T = pose((1.0, 0.5, 0.2), 0.7)
    np.testing.assert_allclose(bar.center, (T @ np.append(description.center, 1.0))[:3], atol=1e-6)
    np.testing.assert_allclose(bar.axis, T[:3, :3] @ description.axis, atol=1e-6)
    np.testing.assert_allclose(bar.outward, [0, 0, 1], atol=1e-6)


def test_existence_is_of_names() -> None:
    """Objects, fixtures, floors and walls exist; others do not."""
    world = small_world({"can": placed("can_of_soda", 1.0, 0.0)}, table_1=TABLE)
    assert all(world.exists(n) for n in ("can", "table_1", "floor_hall", "wall_hall"))
    assert not world.exists("floor_kitchen")
    assert world.objects == ["can"]


def test_gaps_to_solids() -> None:
    """The distance to a solid's surface from outside, negative inside, for every kind."""
    square, rod = box((1.0, 0.0, 0.0), (0.2, 0.2, 0.2)), Solid("cylinder", np.array([0.1, 0.1, 0.5]), pose((1, 0, 0)))
    ball = Solid("sphere", np.full(3, 0.1), pose((1, 0, 0)))
    for solid in (square, rod, ball):
        assert distance(solid, np.zeros(3)) == pytest.approx(0.9)
        assert distance(solid, np.array([1.05, 0.0, 0.0])) == pytest.approx(-0.05)
    assert distance(rod, np.array([1.0, 0.3, 0.9])) == pytest.approx(np.hypot(0.2, 0.4))
    assert distance(square, np.array([0.6, 0.5, 0.0])) == pytest.approx(np.hypot(0.3, 0.4))


def test_a_saved_world_is_restored_in_a_fresh_one() -> None:
    """Robot, things, doors, clock and what a hand holds are as they were, through JSON, and stay so."""
    objects = {"can": placed("can_of_soda", 1.0, 1.0), "bin": placed("trash_can", -1.0, 0.5)}
    fridge = "{entry: refrigerator, at: [0.0, 2.5], yaw_deg: 270}"
    one = small_world(objects, fridge_1=fridge)
    place_in_hand(one, "can", "right")
    action = one.robot.action
    action[BASE] = (0.4, 0.1, 0.5)
    run(one, action, 1.0)
    thing(one, "fridge_1").set_joint_fraction(
        next(b.name for b in thing(one, "fridge_1").description.bodies if b.joint), 0.5
    )
    assert one.holding("right") == "can"
    saved = json.loads(json.dumps(one.save()))

    other = small_world(objects, fridge_1=fridge)
    other.restore(saved)
    assert (other.steps, other.holding("right")) == (one.steps, "can")
    assert other.joint_fractions("fridge_1") == pytest.approx(one.joint_fractions("fridge_1"), abs=1e-5)
    felt, before = other.robot.proprioception(), one.robot.proprioception()
    for key in ("base_pose", "base_velocity", "torso"):
        np.testing.assert_allclose(getattr(felt, key), getattr(before, key), atol=1e-5)
    for name, T in bodies(other).items():
        np.testing.assert_allclose(T, one.pose(name), atol=1e-5)
    for world in (one, other):
        run(world, action, 2.0)
    assert other.holding("right") == "can"
    np.testing.assert_allclose(other.pose("can"), one.pose("can"), atol=0.02)


def test_a_saved_world_of_other_things_is_refused() -> None:
    """What is there here but not in the file is named."""
    saved = small_world({"can": placed("can_of_soda", 1.0, 1.0)}).save()
    with pytest.raises(UserError, match="bin"):
        small_world({"bin": placed("trash_can", 1.0, 1.0)}).restore(saved)
