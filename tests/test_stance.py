"""Stances: places to stand from which the hand really reaches, clear of everything."""

from __future__ import annotations

import re
from collections.abc import Generator
from contextlib import nullcontext
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mpvi_bt.finding.scene.hands import Held
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.ground.geometry.solids import Array, Solid, box
from mpvi_bt.ground.robot.collision import NOTHING, Body, Load, Surroundings
from mpvi_bt.ground.robot.motion import Actions, Motion, MotionFailure
from mpvi_bt.ground.robot.protocol import SIDES, Proprioception, Side, other
from mpvi_bt.hands.motion import approach as motions
from mpvi_bt.hands.motion.approach import approach, go_around
from mpvi_bt.hands.motion.work import Work
from mpvi_bt.hands.robots import r1
from mpvi_bt.hands.robots.r1 import R1
from mpvi_bt.hands.robots.r1pro import R1PRO
from mpvi_bt.hands.skills.pick import options as pick_options
from mpvi_bt.hands.stance.detour import Detours
from mpvi_bt.hands.stance.effort import Effort
from mpvi_bt.hands.stance.grasps import grasps
from mpvi_bt.hands.stance.stance import Option, Stance, upright_options
from mpvi_bt.hands.stance.stance_search import Search, _bases
from mpvi_bt.house.sim.world import SimWorld
from mpvi_bt.house.truth.true_scene import TrueScene
from tests.small_house import ODD, placed, small_world

TABLE = "{entry: table, at: [0.9, 0.6]}"
CAN_AT = (0.9, -0.4)


def work(world: SimWorld) -> Work:
    return Work(TrueScene(world), Motion(world.robot.proprioception()), np.random.default_rng(0))


def carrying(world: SimWorld, felt: Proprioception, hand: Side, name: str) -> Search:
    """The search for a robot that holds a thing, as things stand in the world."""
    scene = TrueScene(world)
    scene.holding = lambda side: name if side == hand else None
    return Work(scene, Motion(felt), np.random.default_rng(0)).search(hand, set())


def options(world: SimWorld, name: str = "can") -> list[Option]:
    """Ways to take hold of a thing: 10 cm before it, then at it."""
    out = []
    for grasp in grasps(TrueScene(world), R1.hand, name, 0.0):
        before = grasp.T_world_tcp.copy()
        before[:3, 3] -= 0.1 * before[:3, 2]
        out.append(Option(np.stack([before, grasp.T_world_tcp]), 1, grasp.cost))
    return out


def find(world: SimWorld, side: Side, tried: list[Array] | None = None) -> tuple[Search, list[Option], Stance | None]:
    search = work(world).search(side, {"can"})
    search.tried.extend(tried or [])
    ways = options(world)
    return search, ways, search.find(world.pose("can")[:2, 3], ways)


@pytest.fixture(scope="module")
def world() -> SimWorld:
    world = small_world({"can": placed("can_of_soda", *CAN_AT)}, table_1=TABLE)
    world.settle()
    return world


@pytest.mark.parametrize("side", SIDES)
def test_a_stance_serves_its_option(world: SimWorld, side: Side) -> None:
    """From the stance's base and torso every waypoint of its option is in reach, and the path leads to the first."""
    _, ways, stance = find(world, side)
    assert stance is not None
    to_base = kin.inverse(kin.base(stance.base))
    for waypoint, expected in zip(stance.waypoints, ways[stance.option].waypoints, strict=True):
        np.testing.assert_allclose(waypoint, to_base @ expected, atol=1e-9)
        chest = kin.inverse(R1.chest(stance.torso))
        assert R1.nearest_posture(chest @ waypoint, side, stance.path[-1]) is not None
    np.testing.assert_allclose(stance.path[0], r1.TRAVEL_ARM[side], atol=0.01)
    np.testing.assert_allclose(R1.tcp(stance.torso, stance.path[-1], side), stance.waypoints[0], atol=1e-6)
    low, high = r1.TORSO_LIMITS.T
    assert ((stance.torso >= low) & (stance.torso <= high)).all()
    limits = r1.ARM_LIMITS[side]
    assert all(((q >= limits[:, 0]) & (q <= limits[:, 1])).all() for q in stance.path)


@pytest.mark.parametrize("side", SIDES)
def test_a_stance_and_its_path_are_free(world: SimWorld, side: Side) -> None:
    """Base, trunk, the idle arm and, checked finely, the path of the working arm are clear of everything there."""
    _, _, stance = find(world, side)
    assert stance is not None
    solids = world.obstacles(stance.base[:2], 2.0)
    around = Surroundings(solids).seen_from(kin.base(stance.base))
    arms = {side: stance.path[0], other(side): r1.TRAVEL_ARM[other(side)]}
    body = Body(R1, stance.torso, arms, {}, around)
    assert body.all_free()
    heights = np.array([[0.0, 0.0, z] for z in (0.04, 0.14, 0.24)])
    assert (around.distance(heights) > r1.BASE_RADIUS_M).all()
    for a, b in pairwise(stance.path):
        line = a + (b - a) * np.linspace(0, 1, int(np.abs(b - a).max() / 0.01) + 2)[:, None]
        # edges are checked each 0.07 rad; what is between may graze
        assert (np.stack(body.clearance(side, line)) > -0.01).all()


def test_torsos_are_free_and_between_a_free_one_and_one_that_is_not_there_is_another(world: SimWorld) -> None:
    """Of two pitches, one free and one not, the one halfway is tried, too; in the open none is."""
    search, pitches = work(world).search("left", set()), (0.0, 0.5, 1.0)
    _, postures = search.torsos_amid(pitches, NOTHING)
    assert set(postures[:, 2]) == {*pitches}
    table = Surroundings([box((0.9, 0.0, 0.45), (0.8, 2.0, 0.9))])  # half a meter ahead
    joints, postures = search.torsos_amid(pitches, table)
    whole = search.torsos(sorted([*pitches, 0.25, 0.75]))[1]
    for torso in joints:
        assert Body(R1, torso, {}, {}, table).trunk_free()
    free = {tuple(p) for p in postures}
    assert {p[2] for p in free} & {0.25, 0.75}
    for lift in {p[0] for p in whole}:
        at = {p: (lift, 0.0, p, whole[0][3]) in free for p in (0.0, 0.25, 0.5, 0.75, 1.0)}
        assert not (at[0.25] and at[0.0] == at[0.5])
        assert not (at[0.75] and at[0.5] == at[1.0])


def test_the_same_search_finds_the_same(world: SimWorld) -> None:
    """Nothing about a search is left to chance that its randomness does not fix."""
    (_, _, first), (_, _, second) = find(world, "left"), find(world, "left")
    assert first is not None
    assert second is not None
    np.testing.assert_array_equal(first.base, second.base)
    np.testing.assert_array_equal(np.stack(first.path), np.stack(second.path))


def test_what_was_tried_is_not_found_again(world: SimWorld) -> None:
    """A base pose that did not do is not offered again, nor one next to it."""
    tried: list[Array] = []
    for _ in range(3):
        _, _, stance = find(world, "right", tried)
        assert stance is not None
        for old in tried:
            near = np.linalg.norm(stance.base[:2] - old[:2]) < 0.1
            assert not (near and abs(kin.wrap(stance.base[2] - old[2])) < 0.4)
        tried.append(stance.base)


def test_what_is_out_of_reach_has_no_stance(world: SimWorld) -> None:
    """A hand pose under the ceiling, or in the middle of the table's top, has none."""
    search = work(world).search("left", set())
    top = max(s.aabb()[1, 2] for s in world.solids("table_1"))
    for p in ((0.9, -0.4, 2.6), (0.9, 0.6, top - 0.02)):
        T = kin.transform(kin.hand_rotation((0, 0, -1), (0, 1, 0)), p)
        ways = upright_options([(T, 0.0)], above_m=0.1, contact=2)
        assert search.find(np.array(p[:2]), ways) is None


def test_a_search_that_finds_nothing_says_what_its_candidates_died_of(world: SimWorld) -> None:
    """By number, with what is in the way: there is no room beside a table, and in its top no room for an arm."""
    task = work(world)
    top = max(s.aabb()[1, 2] for s in world.solids("table_1"))
    T = kin.transform(kin.hand_rotation((0, 0, -1), (0, 1, 0)), (0.9, 0.6, top - 0.02))
    assert task.search("left", set()).find(np.array([0.9, 0.6]), upright_options([(T, 0.0)], 0.1, contact=2)) is None
    failure = task.no_stance()
    assert failure.reason == "no_stance"
    total, parts = failure.evidence.split(" candidates: ")
    counts = [int(n) for n in re.findall(r"(?:^|, )(\d+) ", parts)]
    assert int(total) == sum(counts)
    assert counts == sorted(counts, reverse=True)
    assert re.search(r"\d+ no room for the base \(table_1\)", parts)
    assert re.search(r"\d+ arm in the way \(table_1\)", parts)
    assert "out of reach" in parts
    assert str(failure) == f"no_stance ({failure.evidence})"


def test_a_blocked_base_names_what_it_stands_at(world: SimWorld) -> None:
    """With how far it is off its goal; other failures keep their evidence."""
    task = work(world)
    leg = min((s.aabb() for s in world.solids("table_1")), key=lambda box: float(box[0, 2]))
    before = np.array([leg[0, 0] - R1.base.radius_m, leg[:, 1].mean(), 0.0])
    task.motion.felt = replace(task.motion.felt, base_pose=before)
    told = task.explained(MotionFailure("base_blocked", "9 cm and 0 degrees off its goal"))
    assert str(told) == "base_blocked (9 cm and 0 degrees off its goal; at table_1)"
    assert str(task.explained(MotionFailure("no_reach", "far"))) == "no_reach (far)"


def test_a_place_without_room_tells_the_payload_and_what_is_there() -> None:
    """Sizes in centimeters, and the names of what lies on it; the floor has no name."""
    world = small_world({"can": placed("can_of_soda", 0.9, 0.6), "sack": placed("sack", -1.5, 0.5)}, table_1=TABLE)
    world.settle()
    task = work(world)
    told = task.no_free_spot("sack", "table_1").evidence
    size = np.ptp(np.concatenate([s.aabb() for s in world.solids("sack")]), axis=0) * 100
    assert (
        told == f"no room for {max(size[:2]):.0f} x {min(size[:2]):.0f} cm, {size[2]:.0f} cm high, at table_1 with can"
    )
    assert task.no_free_spot("can", None).evidence.endswith("cm high, on the floor")


def test_without_options_there_is_no_stance(world: SimWorld) -> None:
    """A thing that can be let go of nowhere, or grasped nowhere, is no error: there is just no place to stand."""
    assert work(world).search("left", {"can"}).find(world.pose("can")[:2, 3], []) is None


def test_upright_options_come_down() -> None:
    """Each option first stands above its pose, then at it, and carries its cost."""
    T = kin.transform(kin.rot_x(0.3), (1.0, 2.0, 0.5))
    (option,) = upright_options([(T, 0.7)], above_m=0.2)
    np.testing.assert_allclose(option.waypoints[1], T)
    np.testing.assert_allclose(option.waypoints[0] - T, np.array([[0] * 4, [0] * 4, [0, 0, 0, 0.2], [0] * 4]))
    assert option.cost == 0.7


def test_a_search_ends_when_nothing_is_left_to_spend(world: SimWorld) -> None:
    """A search that may check no base pose finds nothing, whatever there is to find."""
    search = work(world).search("right", {"can"})
    search.effort.left = 0.0
    assert search.find(world.pose("can")[:2, 3], options(world)) is None


def test_what_failed_is_not_searched_again(world: SimWorld, monkeypatch: pytest.MonkeyPatch) -> None:
    """A retry checks other base poses than the try before; once a stance was found everything may be tried again."""
    checked: list[Array] = []
    checks = Search._from

    def fail(self: Search, here: Array, base: Array, *rest: object) -> tuple[None, float]:
        checked.append(base)
        return None, 1.0

    monkeypatch.setattr(Search, "_from", fail)
    task = work(world)
    search, ways, left = task.search("right", {"can"}), options(world), list[int]()
    for _ in range(2):
        task.refusals.clear()
        assert search.find(world.pose("can")[:2, 3], ways, spacings=(0,)) is None
        told = re.search(r"(\d+) left for the next try", task.no_stance().evidence)
        left.append(int(told[1]) if told else 0)
    assert len({tuple(base) for base in checked}) == len(checked) > 12
    assert left[0] > left[1], "a search that ends before its candidates do says how many it leaves"
    monkeypatch.setattr(Search, "_from", checks)
    assert search.find(world.pose("can")[:2, 3], ways) is not None
    assert not search.effort.failed


def found_for(world: SimWorld, name: str) -> Stance | None:
    """A stance to pick a thing up from, with either hand."""
    world.settle()
    task = work(world)
    ways = pick_options(task, name)
    stances = (task.search(side, {name}).find(world.pose(name)[:2, 3], ways) for side in SIDES)
    return next((stance for stance in stances if stance is not None), None)


def leek_in_a_basket(off_m: float) -> SimWorld:
    """A leek that lies along the side of a basket, so far from its middle."""
    basket, leek = placed("large_wicker_basket", 1.0, 0.0), placed("leek", 1.0 + off_m, 0.0, 0.012)
    return small_world({"basket": basket, "leek": leek})


def test_beside_a_low_wall_the_hand_takes_hold_off_the_middle() -> None:
    """Where half a palm has no room beside the middle of a thing, and only there, it is not over that."""
    assert found_for(leek_in_a_basket(0.128), "leek") is not None
    in_the_middle, beside = (pick_options(work(leek_in_a_basket(off)), "leek") for off in (0.0, 0.128))
    assert len(beside) > 2 * len(in_the_middle)


def test_what_stands_at_a_wall_may_be_lifted_along_it() -> None:
    """A hollow thing a millimeter from a wall comes no nearer to it in the hand than where it stands."""
    world = small_world({"cup": placed("coffee_cup", 0.0, 0.0, yaw=np.pi)}, (2.0, 0.0, 0.0))
    T = world.pose("cup")
    T[0, 3] = 2.95 - 0.001 - max(s.aabb()[1, 0] for s in world.solids("cup"))
    world.place("cup", T)
    assert found_for(world, "cup") is not None


def test_ways_that_no_arm_can_take_do_not_hide_the_others() -> None:
    """Where a hand from above fits between two boards and its arm does not, one from before the boards is found."""
    size = [0.36, 0.9, 0.06 + 5 * 0.372 + 0.011]
    shelf = f"{{entry: shelf, at: [2.769, 0.0], yaw_deg: 180, shape: {{size_m: {size}, shelves: 6}}}}"
    dice = replace(placed("candle", 2.80, 0.0, 0.06 + 0.372 + 0.012, 1.5), entry=ODD["dice_cube"])
    world = small_world({"dice": dice}, (1.7, 0.0, 0.0), shelf_1=shelf)
    assert found_for(world, "dice") is not None


def test_what_hangs_close_to_the_body_is_brought_out_as_the_torso_bends() -> None:
    """A sack held by its handle would meet the body where it is; on the way out it is level and clear of all."""
    world = small_world({"sack": placed("sack", -1.5, 0.5)})
    arm = np.array([0.061, -0.334, 0.969, -1.913, -2.088, -1.398, -0.099])
    felt = world.robot.proprioception()
    felt = replace(felt, arm={**felt.arm, "right": arm}, torso=np.array([0.3, 0.0, 0.0, 0.5]))
    hand = kin.base(felt.base_pose) @ R1.tcp(felt.torso, arm, "right")
    turned = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]])
    world.place("sack", hand @ kin.transform(turned, (0.0, -0.27, 0.0)))
    search = carrying(world, felt, "right", "sack")
    around, arms = search.around(felt.base_pose, touched=True), {s: search.motion.arm(s) for s in SIDES}
    for torso in ((0.0, 0.0, 0.0, 0.5), (0.0, 0.0, 0.5, 0.5), (0.2, 0.0, 0.8, 0.5)):
        standing = search.stood(np.array(torso), around, arms)
        assert standing is not None
        path = standing.level["right"]
        for u, q in zip(np.linspace(0, 1, len(path)), path, strict=True):
            now = felt.torso + (np.array(torso) - felt.torso) * u
            body = search.body(now, around, {**arms, "right": q})
            assert body.free("right", q)[0]
            np.testing.assert_allclose(R1.tcp(now, q, "right")[:3, :3], hand[:3, :3], atol=1e-6)


def test_what_hangs_on_the_near_side_of_its_hand_is_turned_outward_as_the_torso_bends() -> None:
    """A caldron held by its lip between hand and body has no level way down or forward but a turning one."""
    world = small_world({"caldron": placed("caldron", -1.5, 0.5)})
    felt = world.robot.proprioception()
    torso = np.array([0.3, 0.0, 0.0, 0.5])
    arm = np.array([-0.968, 0.837, -1.569, -1.977, 1.013, 1.334, 2.77])
    felt = replace(felt, arm={**felt.arm, "left": arm}, torso=torso)
    hand = kin.base(felt.base_pose) @ R1.tcp(torso, arm, "left")
    upside = np.array([[0.5, -0.866, 0.0], [-0.866, -0.5, 0.0], [0.0, 0.0, -1.0]])
    world.place("caldron", hand @ kin.transform(upside, (-0.01, 0.11, 0.16)))
    search = carrying(world, felt, "left", "caldron")
    around, arms = search.around(felt.base_pose, touched=True), {s: search.motion.arm(s) for s in SIDES}
    for bent in ((0.0, 0.0, 0.0, 0.5), (0.0, 0.0, 0.5, 0.5), (0.1, 0.0, 0.8, 0.5)):
        standing = search.stood(np.array(bent), around, arms)
        assert standing is not None
        path = standing.level["left"]
        for u, q in zip(np.linspace(0, 1, len(path)), path, strict=True):
            now = torso + (np.array(bent) - torso) * u
            np.testing.assert_allclose(R1.tcp(now, q, "left")[2, :3], hand[2, :3], atol=1e-3)


@pytest.mark.parametrize("hand", [((0.0, 0.0, -1.0), (0.97, -0.25, 0.0)), ((0.5, -0.87, 0.0), (-0.87, -0.5, 0.0))])
def test_a_payload_is_brought_to_where_it_can_stay_as_the_torso_bends(
    world: SimWorld, hand: tuple[tuple[float, float, float], tuple[float, float, float]]
) -> None:
    """Level in the other hand, at a place aside, while the torso goes down to where the floor is in reach."""
    robot = R1PRO
    felt = replace(world.robot.proprioception(), robot=robot.name, torso=robot.travel_torso)
    there = kin.hand_rotation(*hand)
    near = matmul(kin.inverse(robot.chest(felt.torso)), kin.transform(there, (0.35, 0.28, 0.75)))
    _, postures = robot.arm_inverse(near[None], "left")
    motion = Motion(replace(felt, arm={**robot.travel_arm, "left": postures[0]}))
    tub = (box((0.0, 0.0, 0.1), (0.12, 0.12, 0.2)),)
    held: dict[Side, Held] = {"left": Held("tub", "left", np.eye(4), tub, Load(tub), False)}
    site = Search(motion, "right", held, Surroundings([]), [], np.random.default_rng(0))
    torsos, _ = site.torsos([0.8])
    around = site.around(motion.felt.base_pose, touched=True)
    stood = []
    for path in site.holds:
        arms: dict[Side, Array] = {"left": path[-1], "right": robot.travel_arm["right"]}
        np.testing.assert_allclose(robot.tcp(motion.torso, path[-1], "left")[2, :3], there[2], atol=1e-3)
        stood.append(sum(site.stood(torso, around, arms) is not None for torso in torsos))
    assert max(stood[1:]) >= len(torsos) / 2, stood


@pytest.mark.parametrize("laden", [False, True])
def test_what_is_held_far_out_before_a_counter_is_brought_to_where_it_goes_as_the_torso_bends(laden: bool) -> None:
    """There is no room for it to stay out, nor to ride along, but it goes on; what is filled might be tipped."""
    world = small_world()
    felt = replace(world.robot.proprioception(), torso=np.array([0.3, 0.0, 0.0, 0.5]))
    down = kin.hand_rotation((0.0, 0.0, -1.0), (0.0, 1.0, 0.0))
    there = kin.inverse(R1.chest(felt.torso)) @ kin.transform(down, (0.56, 0.16, 1.07))
    arm = R1.nearest_posture(there, "left", felt.arm["left"])
    assert arm is not None
    motion = Motion(replace(felt, arm={**felt.arm, "left": arm}))
    plate = (box((0.08, 0.0, 0.0), (0.17, 0.17, 0.03)),)
    held = Held("plate", "left", np.eye(4), plate, Load(plate), laden)
    counter = box((1.0, 0.0, 0.88), (0.6, 2.0, 0.04)).moved(kin.base(felt.base_pose))
    search = Search(motion, "left", {"left": held}, Surroundings([counter]), [], np.random.default_rng(0))
    around, arms = search.around(felt.base_pose, touched=True), {s: motion.arm(s) for s in SIDES}
    first, bent = kin.transform(down, (0.6, 0.1, 0.6)), np.array([0.0, 0.0, 0.5, 0.5])
    assert search.stood(bent, around, arms) is None
    standing = search.stood(bent, around, arms, first)
    assert (standing is None) is laden
    if standing is not None:
        np.testing.assert_allclose(R1.tcp(bent, standing.body.arms["left"], "left"), first, atol=1e-6)
        assert standing.body.all_free()


@given(st.floats(0.46, 0.96), st.floats(-3.0, 3.0), st.sampled_from(SIDES))
def test_some_base_nearly_touches_what_stands_before_a_place(depth_m: float, yaw: float, side: Side) -> None:
    """Deep in a compartment no arm reaches from farther off: one stands before it, within 3 cm of its front."""
    bases = _bases(np.array([-1.5 * np.cos(yaw), -1.5 * np.sin(yaw), yaw]), np.zeros(2), side)
    ahead = -bases[:, :2] @ [np.cos(yaw), np.sin(yaw)]
    straight = np.abs(kin.wrap(bases[:, 2] - yaw)) < 1e-6
    assert ((ahead >= depth_m) & (ahead <= depth_m + 0.03 + 1e-9) & straight).any()


def test_what_has_something_on_it_is_not_tipped_on_its_way() -> None:
    """A plate with a pizza keeps its tilt along the arm's whole path to where it is set down."""
    world = small_world({"plate": placed("plate", -1.5, 0.5)}, table_1=TABLE)
    felt = world.robot.proprioception()
    T = kin.transform(kin.hand_rotation((0, 0, -1), (0, 1, 0)), (0.45, -0.15, 0.85))
    arm = R1.nearest_posture(kin.inverse(R1.chest(felt.torso)) @ T, "right", r1.TRAVEL_ARM["right"])
    assert arm is not None
    felt = replace(felt, arm={**felt.arm, "right": arm})
    hand = kin.base(felt.base_pose) @ T
    world.place("plate", kin.transform(np.eye(3), hand[:3, 3] - [0.0, 0.09, 0.02]))
    scene = TrueScene(world)
    scene.holding = lambda side: "plate" if side == "right" else None
    scene.within = lambda name: ["pizza"] if name == "plate" else []
    task = Work(scene, Motion(felt), np.random.default_rng(0))
    scene_solids = scene.solids
    scene.solids = lambda name: [] if name == "pizza" else scene_solids(name)
    assert task.held()["right"].laden
    search = task.search("right", set())
    spots = [(kin.transform(kin.rot_z(turn) @ hand[:3, :3], (0.9, 0.6, 0.80)), 0.0) for turn in (0.0, 0.8, -0.8, 1.6)]
    found = search.find(np.array([0.9, 0.6]), upright_options(spots, 0.12))
    assert found is not None
    for before, after in pairwise(found.path):
        for q in np.linspace(before, after, 5):
            np.testing.assert_allclose(R1.tcp(found.torso, q, "right")[2, :3], hand[2, :3], atol=0.02)


def test_a_search_is_the_same_whatever_order_what_is_touched_is_told_in() -> None:
    """Sets of names come in another order in another process; no episode may depend on that."""
    world = small_world({name: placed("can_of_soda", 0.6, y) for name, y in (("a", -0.3), ("b", 0.0), ("c", 0.3))})
    one, two = (work(world).search("right", names).touched for names in (["a", "b", "c"], ["c", "a", "b"]))
    assert len(one) == len(two)
    for solid, same in zip(one, two, strict=True):
        np.testing.assert_array_equal(solid.T, same.T)


def test_a_search_leaves_a_part_of_its_effort_to_the_next() -> None:
    """Half of what is left is out of its reach, and is there again afterwards, also if it fails."""
    effort = Effort(10.0)
    with effort.sparing(0.5):
        effort.left -= 5.5
        assert effort.left <= 0
    assert effort.left == 4.5
    with pytest.raises(ZeroDivisionError), effort.sparing(0.5):
        effort.left /= 0
    assert effort.left == 4.5
    with (spent := Effort(-1.0)).sparing(0.5):
        assert spent.left == -1.0
    with (endless := Effort()).sparing(0.5):
        assert endless.left == np.inf
    assert endless.left == np.inf


def approaching(z: float, effort: float) -> tuple[Work, Actions]:
    """A robot that is to find a stance to pick a cup up at a height, with so much that the search may take."""
    world = small_world({"cup": placed("coffee_cup", 0.0, 0.0, z)}, (-0.9, 0.0, 0.0))
    task = work(world)
    task.effort = Effort(effort)
    return task, approach(task, "right", "cup", lambda: pick_options(task, "cup"), [])


def test_a_search_that_used_up_what_it_may_take_goes_on_once_it_may_again() -> None:
    """With nothing left to take it waits for more instead of giving up on places that it has not looked at."""
    task, steps = approaching(0.0, effort=0.0)
    for _ in steps:
        task.effort.left += 0.1
    assert task.effort.left > 0


def test_a_search_that_has_looked_everywhere_gives_up_at_once() -> None:
    """Waiting mends nothing where there is no place left to look at."""
    _, steps = approaching(5.0, effort=100.0)
    with pytest.raises(MotionFailure, match="no_stance"):
        next(steps)


def test_what_is_too_far_off_is_driven_up_to_by_legs() -> None:
    """Each leg ends nearer, around what is in the way, until what is around the goal is known; then there is none."""
    world = small_world({"crate": placed("packing_box", 0.9, 0.0)}, (0.0, 0.0, 0.0))
    goal, legs = np.array([[2.2, 0.0, np.pi]]), 0
    while True:
        work = Work(TrueScene(world), Motion(world.robot.proprioception()), np.random.default_rng(0))
        here = work.motion.felt.base_pose
        search = work.search("right", {"crate"})
        if (way := search.toward(goal)) is None:
            break
        assert search.route(here, way[-1]) is not None
        assert np.linalg.norm(goal[0, :2] - way[-1][:2]) < np.linalg.norm(goal[0, :2] - here[:2])
        legs += 1
        for pose in way:
            for action in work.motion.drive(pose):
                world.robot.act(action)
                world.step()
                work.motion.felt = world.robot.proprioception()
    assert 1 <= legs <= 3
    assert search.stands(goal)[0]
    assert search.toward(here[None]) is None


@pytest.mark.parametrize("open_m", [0.75, 0.0])
def test_what_is_behind_a_wall_is_gone_around_to(open_m: float) -> None:
    """A place that no two legs lead to is driven to by more, each of them free; where there is no gap there is none."""
    world = small_world({}, (0.0, 0.0, 0.0))
    search = replace(work(world).search("right", ()), obstacles=Surroundings(walls(open_m)))
    here, beyond = np.zeros(3), np.array([0.95, 0.3, 0.0])
    assert search.stands(beyond[None])[0]
    assert search.route(here, beyond) is None
    way = Detours(search).way(beyond)
    focus = beyond[:2] + [0.58, -0.16]
    if not open_m:
        assert way is None
        return
    assert way is not None
    assert len(way) > 2
    np.testing.assert_array_equal(way[-1], beyond)
    assert all(search.drivable(a, b) for a, b in pairwise([here, *way]))
    around = search.go_around(focus, [])
    assert around is not None
    assert around[-1][0] > 0.8
    again = search.go_around(focus, [around[-1]])
    assert again is None or np.linalg.norm(again[-1][:2] - around[-1][:2]) > 0.4


def test_what_opens_of_a_thing_is_in_the_way_of_going_around_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """A hand that works on a cabinet may touch its leaf; a base that drives around it, and what it carries, may not."""
    around = work(small_world({"can": placed("can_of_soda", 1.5, 0.0)}, (0.0, 0.0, 0.0)))
    leaves, went = walls(0.75), [np.zeros(3)]

    def drive(goal: Array, speed: float = 0.5) -> Actions:
        went.append(goal)
        yield from ()

    monkeypatch.setattr(around.motion, "drive", drive)
    monkeypatch.setattr(around, "near", lambda without: Surroundings([] if "can" in without else leaves))
    list(go_around(around, around.middle("can")[:2], []))
    search = replace(around.search("right", ()), obstacles=Surroundings(leaves))
    assert len(went) > 1
    assert all(search.drivable(a, b) for a, b in pairwise(went))


@pytest.mark.parametrize(
    ("failures", "ways", "tries", "fails"),
    [
        ([], 0, 1, None),
        (["no_stance"], 1, 2, None),
        (["no_stance"] * 2, 2, 3, None),
        (["no_stance"] * 9, 9, 3, "no_stance"),
        (["no_stance"] * 9, 1, 2, "no_stance"),
        (["no_stance", "slipped"], 9, 2, "slipped"),
    ],
)
def test_what_has_no_stance_is_tried_again_from_beyond_what_is_in_the_way(
    monkeypatch: pytest.MonkeyPatch, failures: list[str], ways: int, tries: int, fails: str | None
) -> None:
    """Twice, as long as there is a way around; what fails for another reason is not tried again."""
    around, reasons, tried, went = work(small_world({})), list(failures), [0], list[list[float]]()

    def attempt() -> Generator[Array, None, None]:
        tried[0] += 1
        yield from ()
        if reasons:
            raise MotionFailure(reasons.pop(0))

    def around_it(work: Work, place: Array, been: list[Array]) -> Generator[Array, None, bool]:
        went.append(place.tolist())
        yield from ()
        return len(went) <= ways

    monkeypatch.setattr(motions, "go_around", around_it)
    with nullcontext() if fails is None else pytest.raises(MotionFailure, match=fails):
        list(motions.going_around(around, np.array([1.0, 2.0, 0.4]), attempt))
    assert tried[0] == tries
    assert all(place == [1.0, 2.0] for place in went)


def walls(open_m: float) -> list[Solid]:
    """A wall before a robot, from a long way to its left to less far to its right, and walls about both sides of it."""
    sides = [box((0.3, y, 0.5), (3.0, 0.1, 1.0)) for y in (-1.6, 1.3)] + [box((2.0, 0.0, 0.5), (0.1, 4.0, 1.0))]
    end = -1.6 + open_m
    return [box((0.475, (1.3 + end) / 2, 0.5), (0.05, 1.3 - end, 1.0)), *sides]
