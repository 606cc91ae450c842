"""The scene that pictures show."""

from __future__ import annotations

import contextlib
from dataclasses import replace

import numpy as np
import pytest

from mpvi_bt.finding.perception.segmentation import SegmentationDetector
from mpvi_bt.finding.scene import associator, seen_parts
from mpvi_bt.finding.scene.hands import TOUCH
from mpvi_bt.finding.scene.occupancy import Occupancy
from mpvi_bt.finding.scene.seen import Seen
from mpvi_bt.finding.scene.thing_store import SeenThing
from mpvi_bt.finding.shapes.furniture_shape import furniture
from mpvi_bt.finding.shapes.moving_parts import Door
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.solids import Array, bounds
from mpvi_bt.ground.robot.motion import MotionFailure
from mpvi_bt.ground.robot.protocol import Proprioception, Side
from mpvi_bt.ground.words.phrases import kinds
from mpvi_bt.hands.robots.r1 import R1
from mpvi_bt.house.sim.world import SimWorld
from mpvi_bt.testing.full_hands import put_in_hands
from tests.layouts import LAYOUT
from tests.small_house import placed, run, small_world

pytestmark = pytest.mark.render

VOCABULARY = {"can_1": ("can of soda",), "can_2": ("can of soda",), "bin": ("trash can",), "table_1": ("table",),
              "egg_0": ("Easter egg",)}  # fmt: skip
TABLE = "{entry: table, at: [1.0, 0.0]}"


def tilted(world: SimWorld, tilt: float = 0.75) -> SimWorld:
    """The head looks down."""
    action = world.robot.action
    action[LAYOUT.torso] = [0.42, 0.0, 0.0, tilt]
    world.settle(0.3)
    run(world, action, 1.5)
    return world


def looking(world: SimWorld, *phrases: str) -> Seen:
    seen = Seen(SegmentationDetector(VOCABULARY, least_px=1))
    seen.forget(phrases)
    look(world, seen)
    return seen


def look(world: SimWorld, seen: Seen, camera: str = "head") -> None:
    seen.see({camera: world.robot.look(camera)}, world.robot.proprioception())


def hand_at(
    seen: Seen, begin: Proprioception, at: Array, closed: bool, side: Side = "left", width_m: float = 0.06
) -> None:
    """A hand at a place (3,), as if base and trunk moved it there from `begin`, open or closed on something."""
    tcp = (kin.base(begin.base_pose) @ R1.tcp(begin.torso, begin.arm[side], side))[:3, 3]
    torso = begin.torso + np.array([at[2] - tcp[2], 0.0, 0.0, 0.0])
    felt = replace(
        begin,
        base_pose=begin.base_pose + np.append(at[:2] - tcp[:2], 0.0),
        torso=torso,
        gripper_command={**begin.gripper_command, side: -1.0 if closed else 1.0},
        gripper_width={**begin.gripper_width, side: width_m if closed else 0.1},
    )
    for _ in range(1 + TOUCH.steady_steps):  # fingers that come to rest have met something
        seen.feel(replace(felt))


def cans() -> SimWorld:
    return tilted(small_world({"can_1": placed("can_of_soda", 1.0, 0.2), "can_2": placed("can_of_soda", 1.0, -0.2)},
                              render=True))  # fmt: skip


def names(seen: Seen, phrase: str) -> list[str]:
    return [e.name for e in seen.knowledge().find(phrase)]


def test_things_are_where_they_are_and_as_large() -> None:
    """Two cans are two things, each within 5 mm of the truth."""
    world = cans()
    seen = looking(world, "can of soda")
    known = sorted(seen.knowledge().find("can of soda"), key=lambda e: e.center[1])
    assert len(known) == 2
    for entry, name in zip(known, ("can_2", "can_1"), strict=True):
        (solid,) = world.solids(name)
        np.testing.assert_allclose([entry.lowest, entry.highest], solid.aabb(), atol=0.005)


def test_the_other_one_is_no_thing_of_its_own() -> None:
    """A prompt of "a can" and "the other can" knows each can once: twice, it would be in its own way when taken."""
    seen = looking(cans(), *kinds(["can of soda", "other can of soda", "another can of soda"]))
    assert len(list(seen.knowledge())) == 2
    assert names(seen, "the other can of soda") == names(seen, "can of soda")


def test_a_second_look_finds_the_same_things() -> None:
    """What is seen again is the same thing by place: names and count stay."""
    world = cans()
    seen = looking(world, "can of soda")
    before = names(seen, "can of soda")
    look(world, seen)
    assert names(seen, "can of soda") == before


@pytest.mark.parametrize("tilts", [(0.1, 1.3), (1.3, 0.1)])
def test_a_leg_of_a_table_is_no_other_table(tilts: tuple[float, float]) -> None:
    """Also where its foot is seen alone, before the top or after it: nothing could be set down on it."""
    world = small_world({}, base=(-0.8, 0.0, 0.0), render=True, table_1=TABLE)
    seen = looking(tilted(world, tilts[0]), "table")
    look(tilted(world, tilts[1]), seen)
    (table,) = names(seen, "table")
    assert seen.spots(table, 0.08, 0.3, np.zeros(2))


@pytest.mark.parametrize("yaw", [2.0, 2.8, 4.0])
def test_what_is_open_at_its_side_has_a_top_to_set_things_on(yaw: float) -> None:
    """Past the jug one sees into a coffee maker, which was then taken for a vessel without a top."""
    objects = {"maker": placed("coffee_maker", 1.0, 0.1, 0.92, yaw=yaw)}
    world = tilted(small_world(objects, render=True, worktop="{entry: counter, at: [1.2, 0.0]}"), 0.3)
    seen = Seen(SegmentationDetector({"maker": ("coffee maker",)}, least_px=1))
    seen.forget(("coffee maker",))
    look(world, seen)
    (maker,) = names(seen, "coffee maker")
    assert seen.volumes(maker)
    assert any(spot[2] == pytest.approx(1.14, abs=0.015) for spot in seen.spots(maker, 0.04, 0.1, np.zeros(2)))


def test_what_lies_in_a_vessel_goes_along_with_it_though_nobody_asked_for_it() -> None:
    """A carton stood in a sack, in the way of lifting the sack, and no stance was found; then none to carry it from."""
    objects = {"basket": placed("wicker_basket", 0.9, 0.0), "can": placed("can_of_soda", 0.9, 0.0, 0.03)}
    world = tilted(small_world(objects, render=True), 0.9)
    seen = Seen(SegmentationDetector({"basket": ("basket",), "can": ("can of soda",)}, least_px=1))
    seen.forget(("basket",))
    look(world, seen)
    (basket,) = names(seen, "basket")
    can = world.pose("can")[None, :3, 3]
    here = np.zeros(2)
    assert seen.obstacles(here, 1.5, {basket}).distance(can) == pytest.approx(0.0, abs=0.01)
    (others,) = seen.others(basket)
    assert not seen.within(basket)
    assert (np.abs(bounds(seen.solids(others)).mean(0)[:2] - can[0, :2]) < 0.03).all()
    assert seen.obstacles(here, 1.5, {basket, others}).distance(can)[0] > 0.03
    assert not any(entry.name == others for entry in seen.knowledge())
    low, high = bounds(seen.solids(basket))
    rim, away = np.array([(low + high)[0] / 2, high[1], high[2]]), [0.0, 1.0, 0.0]
    hand_at(seen, world.robot.proprioception(), rim, closed=True, width_m=0.02)
    assert seen.holding("left") == basket
    hand_at(seen, world.robot.proprioception(), rim + away, closed=True, width_m=0.02)
    assert seen.obstacles(here, 1.5).distance(can)[0] > 0.03


@pytest.mark.parametrize(("apart_m", "count"), [(0.25, 1), (0.95, 2)])
def test_two_ends_of_a_table_are_no_two_tables(apart_m: float, count: int) -> None:
    """The head saw the one, a hand the other: what was set down on the second one found no place on it.

    Two tables side by side stay two.
    """
    world = small_world({}, base=(-3.0, 0.0, 0.0), render=True)
    seen = looking(world, "table")
    for k in range(2):
        points = np.random.default_rng(k).uniform(0, 1, (800, 3)) * [0.9, 0.6, 0.4] + [1.0 + k * apart_m, 0.0, 0.0]
        shape = furniture(points)
        assert shape is not None
        name = f"table {k + 1}"
        seen.things.put(SeenThing(name, "table", shape))
    seen.things.put(SeenThing("can 1", "can", shape, inside="table 2"))
    look(world, seen)
    assert len(names(seen, "table")) == count
    assert seen.things["can 1"].inside == f"table {count}"


def test_what_is_not_asked_for_is_no_thing() -> None:
    """Only what a prompt names is tracked; the rest is in the way, without a name."""
    world = cans()
    assert names(looking(world, "trash can"), "can of soda") == []


def test_a_thing_that_is_gone_is_forgotten() -> None:
    """Where a picture shows the floor behind a thing, the thing is not there any more; asking for it says so."""
    world = cans()
    seen = looking(world, "can of soda")
    gone = min(seen.knowledge().find("can of soda"), key=lambda e: e.center[1]).name
    T = world.pose("can_2")
    T[0, 3] = -2.0
    world.place("can_2", T)
    assert gone in names(seen, "can of soda")
    look(world, seen)
    assert gone not in names(seen, "can of soda")
    with pytest.raises(MotionFailure, match="lost_sight"):
        seen.pose(gone)


def test_what_was_cut_is_no_whole_any_more() -> None:
    """Its halves lie where it was, so that no picture shows the floor behind it; another one stays."""
    called = {"can_1": ("onion",), "can_2": ("onion",)}
    world = cans()
    seen = Seen(SegmentationDetector(called, least_px=1))
    seen.forget(("onion", "half onion"))
    look(world, seen)
    assert len(names(seen, "onion")) == 2
    called["can_2"] = ("half onion",)
    seen._pictures._detector = SegmentationDetector(called, least_px=1)
    look(world, seen)
    assert len(names(seen, "onion")) == len(names(seen, "half onion")) == 1


def test_what_is_worked_on_is_not_in_the_way() -> None:
    """The field is blocked where a can stands, and free there once the can is left out; the space before it is free."""
    world = cans()
    seen = looking(world, "can of soda")
    can = names(seen, "can of soda")[0]
    at = seen.knowledge().entries[can].center
    here = world.robot.proprioception().base_pose[:2]
    assert seen.obstacles(here, 1.7).distance(at) < 0.03
    assert seen.obstacles(here, 1.7, without={can}).distance(at) > 0.05
    assert seen.obstacles(here, 1.7).distance(np.array([0.6, 0.0, 0.3])) > 0.1


def test_a_bin_has_a_volume_and_a_bar() -> None:
    """What things can be put into, and what it is carried by, is seen."""
    world = tilted(small_world({"bin": placed("trash_can", 1.0, 0.0, yaw=0.3)}, render=True))
    seen = looking(world, "trash can")
    (name,) = names(seen, "trash can")
    (volume,), (true,) = seen.volumes(name), world.volumes("bin")
    np.testing.assert_allclose(volume.aabb(), true.aabb(), atol=0.03)
    (bar,), (handle,) = seen.handles(name), world.handles("bin")
    np.testing.assert_allclose(bar.center, handle.center, atol=0.01)


def test_one_bin_that_two_phrases_name_is_not_in_itself() -> None:
    """A bin without a can and one without an egg are loose, wherever that bin stands."""
    phrases = "trash can without a can", "trash can without an egg"
    seen = looking(tilted(small_world({"bin": placed("trash_can", 1.0, 0.0, yaw=0.3)}, render=True)), *phrases)
    assert [e.inside for phrase in phrases for e in seen.knowledge() if phrase in e.phrases] == [None, None]


def test_spots_lie_on_the_table_and_clear_of_what_stands_there() -> None:
    """Every spot has its radius on the table and keeps it from the can."""
    world = small_world({"can_1": placed("can_of_soda", 0.9, 0.0, 0.76)}, base=(-0.2, 0.0, 0.0), render=True,
                        table_1=TABLE)  # fmt: skip
    seen = looking(tilted(world, 0.5), "table")
    (table,) = names(seen, "table")
    top = max(s.aabb()[1, 2] for s in world.solids("table_1"))
    spots = seen.spots(table, 0.08, 0.3, np.array([0.5, 0.0]))
    assert spots
    boxes = np.stack([s.aabb() for s in world.solids("table_1")])
    for spot in spots:
        assert spot[2] == pytest.approx(top, abs=0.006)
        assert (boxes[:, 0].min(0)[:2] < spot[:2] - 0.06).all()
        assert (spot[:2] + 0.06 < boxes[:, 1].max(0)[:2]).all()
        assert np.linalg.norm(spot[:2] - world.pose("can_1")[:2, 3]) > 0.08 + 0.02


def test_what_fingers_close_on_moves_with_the_hand_until_they_open() -> None:
    """The nearest thing is held once closed fingers feel something; it goes where the hand goes, and stays after."""
    world = cans()
    seen = looking(world, "can of soda")
    can = names(seen, "can of soda")[0]
    begin, at = world.robot.proprioception(), seen.pose(can)[:3, 3]
    there = at + [0.0, 0.3, 0.0]
    hand_at(seen, begin, at, closed=False)
    assert seen.holding("left") is None
    hand_at(seen, begin, at, closed=True)
    assert seen.holding("left") == can
    hand_at(seen, begin, there, closed=True)
    np.testing.assert_allclose(seen.pose(can)[:2, 3], there[:2], atol=0.04)
    hand_at(seen, begin, there, closed=False)
    assert seen.holding("left") is None
    hand_at(seen, begin, at, closed=False)
    np.testing.assert_allclose(seen.pose(can)[:2, 3], there[:2], atol=0.04)


def test_the_camera_is_where_the_joints_say() -> None:
    """The picture's own word on where it was taken is not heeded: a real one has none."""
    world = cans()
    seen = Seen(SegmentationDetector(VOCABULARY, least_px=1))
    felt, image = world.robot.proprioception(), world.robot.look("head")
    seen.forget(["can of soda"])
    seen.see({"head": replace(image, T_world_camera=np.eye(4))}, felt)
    other = looking(world, "can of soda")
    for a, b in zip(seen.knowledge(), other.knowledge(), strict=True):
        np.testing.assert_array_equal(a.center, b.center)


def test_doors_are_searched_for_once_in_the_same_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Asked in turn for the doors of two things, it searches each once until a new picture shows them."""
    world = tilted(small_world({}, (-1.2, 0.0, 0.0), render=True, table_1="{entry: table, at: [1.0, 0.6]}",
                               table_2="{entry: table, at: [1.0, -0.6]}"), 0.4)  # fmt: skip
    searches: list[int] = []

    def fronts(points: Array, eye: Array) -> list[Door]:
        searches.append(len(points))
        return []

    monkeypatch.setattr(seen_parts, "fronts", fronts)
    seen = Seen(SegmentationDetector({"table_1": ("table",), "table_2": ("table",)}, least_px=1))
    seen.forget(["table"])
    look(world, seen)
    tables = names(seen, "table")
    assert len(tables) == 2
    for name in tables * 3:
        seen.doors(name)
    assert len(searches) == 2
    look(world, seen)
    seen.doors(tables[0])
    assert len(searches) == 3


def test_what_is_looked_at_closely_does_not_hang_on_an_order() -> None:
    """Of what a hand is to touch the smallest thing is seen finely, in whatever order the things are named."""
    world = tilted(
        small_world({"can_1": placed("can_of_soda", 1.0, 0.2)}, render=True, table_1="{entry: table, at: [1.3, -0.6]}")
    )
    seen = looking(world, "can of soda", "table")
    (can,), (table,) = names(seen, "can of soda"), names(seen, "table")
    here = world.robot.proprioception().base_pose[:2]
    for without in ([can, table], [table, can]):
        seen.obstacles(here, 2.0, without=without)
        assert seen.space.focus is not None
        np.testing.assert_allclose(seen.space.focus, world.solids("can_1")[0].aabb().mean(0), atol=0.01)


def basket(*eggs: tuple[float, float]) -> SimWorld:
    """A basket on the floor before the robot, with eggs at places in it."""
    things = {f"egg_{k}": placed("easter_egg", 0.75 + x, y, 0.02) for k, (x, y) in enumerate(eggs)}
    return tilted(small_world({"bin": placed("wicker_basket", 0.75, 0.0), **things}, render=True), 0.9)


def test_what_has_rolled_elsewhere_in_a_basket_is_not_where_it_was() -> None:
    """A picture that shows the basket's floor there tells as much as one that shows the room's."""
    world = basket((0.0, -0.1))
    seen = looking(world, "trash can", "Easter egg")
    assert len(names(seen, "Easter egg")) == 1
    assert seen.within(*names(seen, "trash can")) == names(seen, "Easter egg")
    T = world.pose("egg_0")
    T[1, 3] += 0.2
    world.place("egg_0", T)
    look(world, seen)
    (egg,) = names(seen, "Easter egg")
    assert abs(seen.pose(egg)[1, 3] - T[1, 3]) < 0.02


def test_a_vessel_that_was_filled_is_laden_when_it_is_taken_up_later() -> None:
    """Also under another prompt, which does not name what is in it; and where it was set down meanwhile."""
    world = basket((0.0, -0.5))
    seen = looking(world, "trash can", "Easter egg")
    (bin_,), (egg,) = names(seen, "trash can"), names(seen, "Easter egg")
    low, high = bounds(seen.solids(bin_))
    above, rim = np.array([*(low + high)[:2] / 2, high[2] + 0.1]), np.array([(low + high)[0] / 2, high[1], high[2]])
    aside, begin = rim + [0.0, 1.0, 0.0], world.robot.proprioception()

    def close(at: Array, closed: bool) -> None:
        hand_at(seen, begin, at, closed, "right", 0.03)

    def taken_up(at: Array) -> bool:
        close(at, False)
        close(at, True)
        (name,) = names(seen, "trash can")
        assert seen.holding("right") == name
        return seen.laden(name)

    assert not taken_up(rim)
    close(rim, False)
    seen.forget(["trash can", "Easter egg"])
    look(world, seen)
    (bin_,), (egg,) = names(seen, "trash can"), names(seen, "Easter egg")
    close(seen.pose(egg)[:3, 3], True)
    close(above, True)
    close(above, False)
    assert seen.within(bin_) == [egg]
    seen.forget(["trash can"])
    look(world, seen)
    assert seen.knowledge().find("trash can")[0].filled == ("Easter egg",)
    assert taken_up(rim)
    close(aside, True)
    close(aside, False)
    assert taken_up(aside)
    seen.forget(["trash can"])
    look(world, seen)
    assert not taken_up(rim)


def test_what_hands_put_down_is_put_away_also_under_a_later_prompt() -> None:
    """Of two cans the one that was put where it is comes after the other, until a hand takes it again."""
    world = cans()
    seen = looking(world, "can of soda")
    begin = world.robot.proprioception()
    taken, other = (seen.pose(name)[:3, 3] for name in names(seen, "can of soda"))
    for at, closed in ((taken, False), (taken, True), (other, True), (other, False)):
        hand_at(seen, begin, at, closed)
    seen.forget(["can of soda"])
    look(world, seen)
    ahead, put = seen.knowledge().find("can of soda")
    assert (ahead.laid, put.laid) == (False, True)
    np.testing.assert_allclose(put.center[:2], other[:2], atol=0.03)
    hand_at(seen, begin, put.center, True)
    assert seen.holding("left") == put.name
    assert not any(e.laid for e in seen.knowledge().find("can of soda"))


def test_what_a_hand_holds_is_known_again_under_the_next_prompt() -> None:
    """As it was known there, once a picture shows it; not where it looks to have slipped, or is called otherwise."""
    world = small_world({"can_1": placed("can_of_soda", 2.0, 1.0)}, render=True)
    put_in_hands(world, {"left": "can_1"})
    action = world.robot.action
    action[LAYOUT.torso] = [0.42, 0.0, 0.0, 0.9]
    run(world, action, 1.5)
    seen = looking(world, "can of soda")
    assert seen.holding("left") is not None
    assert not seen.recognized("left")  # it was never seen before

    def again(phrase: str, off_m: float = 0.0) -> bool:
        seen.forget([phrase])
        off = kin.transform(np.eye(3), (0.0, 0.0, off_m))
        taken = seen.history.taken
        taken.update({side: (called, shape.moved(off)) for side, (called, shape) in taken.items()})
        look(world, seen)
        return seen.recognized("left")

    before = seen.solids(str(seen.holding("left")))
    assert again("can of soda")
    for solid, same in zip(seen.solids(str(seen.holding("left"))), before, strict=True):
        np.testing.assert_allclose(solid.T, same.T, atol=1e-6)
    assert not again("soda can")
    assert again("soda can")
    assert not again("soda can", off_m=0.04)
    felt = world.robot.proprioception()
    seen.feel(replace(felt, gripper_command={**felt.gripper_command, "left": 1.0}))
    assert not again("soda can")  # it may hold another one by now


def test_the_near_wall_of_a_basket_is_in_the_way_though_only_its_rim_is_seen() -> None:
    """What hides below a rim is known by the shape of what it belongs to, also where hidden space is trusted."""
    world = basket()
    seen = looking(world, "trash can")
    low, high = seen.knowledge().find("trash can")[0].lowest, seen.knowledge().find("trash can")[0].highest
    foot = np.array([[low[0] + 0.004, y, z] for y in (-0.1, 0.0, 0.1) for z in (0.02, 0.06, 0.1)])
    with seen.trusting():
        assert (seen.obstacles((low + high)[:2] / 2, 1.0).distance(foot) < 0.01).all()


def test_what_was_set_down_in_furniture_is_still_in_the_way_there() -> None:
    """An arm that folds beside a shelf would sweep it off. What fell in lies anywhere."""
    things = {"bin": placed("wicker_basket", 0.75, 0.0), "egg_0": placed("easter_egg", 0.75, -0.1, 0.02)}
    world = tilted(small_world(things, render=True, table_1="{entry: table, at: [1.6, 0.0]}"), 0.75)
    seen = looking(world, "trash can", "Easter egg", "table")
    (bin_,), (egg,), (table,) = (names(seen, phrase) for phrase in ("trash can", "Easter egg", "table"))
    look(small_world(base=(-2.0, -1.2, 3.07), render=True), seen)
    low, high = seen.knowledge().entries[bin_].lowest, seen.knowledge().entries[bin_].highest
    foot = np.array([[low[0] + 0.004, y, z] for y in (-0.1, 0.0, 0.1) for z in (0.02, 0.06, 0.1)])
    for container, stands, known in ((None, False, True), (table, True, True), (table, False, False)):
        seen.things[bin_].inside, seen.things[bin_].stands = container, stands
        with seen.trusting():
            assert (seen.obstacles((low + high)[:2] / 2, 1.0).distance(foot) < 0.01).all() == known
    assert seen.within(bin_) == [egg]


def test_what_a_look_aside_has_shown_is_remembered_where_hidden_space_is_trusted() -> None:
    """A bin beside the base, out of view from before a door, is in the way of what leads the base there."""
    seen = Seen(SegmentationDetector({}, least_px=1))
    for yaw in (-3.07, -1.57):
        world = small_world({"bin": placed("trash_can", -2.8, -1.2)}, base=(-2.0, -1.2, yaw), render=True)
        tilted(world)
        look(world, seen)
    high, near = bounds(world.solids("bin"))[1], np.array([-2.0, -1.2])
    bin_ = np.array([high[0] - 0.01, -1.2, high[2] - 0.05])
    with seen.trusting(remembering=True):
        assert seen.obstacles(near, 1.7).distance(bin_) < 0.03
    with seen.trusting():
        assert seen.obstacles(near, 1.7).distance(bin_) > 0.1


def test_what_the_navigator_saw_stands_where_no_picture_of_the_policy_looks() -> None:
    """A bin beside the base that only the way there has shown is in its way; what is seen to be free is free."""
    world = small_world({"bin": placed("trash_can", -2.8, -1.2)}, base=(-2.0, -1.2, -3.07), render=True)
    tilted(world)
    driven = Occupancy.unknown((-2.0, -1.2))
    assert driven.update(world.robot.look("head"))
    high, near = bounds(world.solids("bin"))[1], np.array([-2.0, -1.2])
    bin_ = np.array([high[0] - 0.01, -1.2, high[2] - 0.05])
    for yaw, taken, clear in ((-1.57, False, False), (-3.07, True, True)):
        things = {} if taken else {"bin": placed("trash_can", -2.8, -1.2)}
        now = small_world(things, base=(-2.0, -1.2, yaw), render=True)
        tilted(now)
        for standing, gone in ((None, True), (driven.standing, clear)):
            seen = Seen(SegmentationDetector({}, least_px=1), standing)
            look(now, seen)
            for obstacles in (seen.obstacles(near, 1.7), seen.passable()):
                assert bool(obstacles.distance(bin_) > 0.05) is gone
            with seen.trusting():
                assert seen.obstacles(near, 1.7).distance(bin_) > 0.05


def test_walls_are_known_from_one_prompt_to_the_next() -> None:
    """What a prompt named is told anew by the next one; the wall beside the base is in the way still."""
    seen = Seen(SegmentationDetector(VOCABULARY, least_px=1))
    at, wall = np.array([-2.0, -1.2]), np.array([-2.98, -1.2, 0.5])
    for yaw in (-3.07, -1.57):
        seen.forget(["can of soda"])
        world = small_world({"can_1": placed("can_of_soda", -2.6, -1.2)}, base=(*at, yaw), render=True)
        world.refresh()
        look(world, seen)
    assert not list(seen.knowledge())
    for trusting in (contextlib.nullcontext(), seen.trusting(remembering=True)):
        with trusting:
            assert seen.obstacles(at, 1.7).distance(wall) < 0.03
    with seen.trusting():
        assert seen.obstacles(at, 1.7).distance(wall) > 0.1


def tall_cabinet(x: float, y: float, yaw: float, opened: float = 0.7) -> SimWorld:
    """One that stands open, seen from somewhere."""
    cabinet = "{entry: tall_cabinet, at: [1.0, 0.0], yaw_deg: 180, shape: {hinge: left}}"
    world = small_world(base=(x, y, yaw), render=True, cabinet=cabinet)
    world.set_opening("cabinet", "door", opened)
    world.refresh()
    return tilted(world, 0.3)


FRONT, BESIDE = (-0.5, 0.0, 0.0), (0.3, 1.3, -1.0)


@pytest.mark.parametrize("places", [(FRONT, BESIDE), (BESIDE, FRONT)])
def test_who_has_seen_into_furniture_knows_its_room(places: tuple[tuple[float, float, float], ...]) -> None:
    """From beside, only the open door and a side are in view: that counts neither before nor after a look inside."""
    seen = Seen(SegmentationDetector({"cabinet": ("cabinet",)}, least_px=1))
    seen.forget(["cabinet"])
    for place in places:
        look(tall_cabinet(*place), seen)
    (name,) = names(seen, "cabinet")
    assert len(seen.volumes(name)) >= 3
    assert len(seen.spots(name, 0.05, 0.2, np.zeros(2))) > 5


@pytest.mark.parametrize("place", [(-0.5, 0.0, 0.0), (-0.4, -0.6, 0.4)])
def test_a_cabinet_that_was_opened_is_the_one_that_was_closed(place: tuple[float, float, float]) -> None:
    """Known by its front alone: its open door reaches out far before that, and one sees far behind it."""
    seen = Seen(SegmentationDetector({"cabinet": ("cabinet",)}, least_px=1))
    seen.forget(["cabinet"])
    look(tall_cabinet(*FRONT, opened=0.0), seen)
    (name,) = names(seen, "cabinet")
    (closed,) = seen.doors(name)
    assert closed.position < 0.1
    look(tall_cabinet(*place, opened=0.9), seen)
    assert names(seen, "cabinet") == [name]
    assert any(door.position > 0.5 * door.limit for door in seen.doors(name))


@pytest.mark.parametrize("near", [None, (0.1, -0.3, -0.7), (0.25, -0.35, -0.5)])
def test_a_door_that_stands_open_is_in_the_way_also_once_it_is_out_of_view(
    near: tuple[float, float, float] | None,
) -> None:
    """From near, turned to the room behind it, a robot would else drive its base and its arm into the leaf."""
    seen = Seen(SegmentationDetector({"cabinet": ("cabinet",)}, least_px=1))
    seen.forget(["cabinet"])
    world = tall_cabinet(*FRONT)
    look(world, seen)
    (name,) = names(seen, "cabinet")
    leaf, place = world.doors("cabinet")[0].solids[0].T[:3, 3], np.array([0.5, 0.0])
    assert seen.obstacles(place, 1.7).distance(leaf) < 0.03
    if near is not None:
        look(tall_cabinet(*near), seen)
        with seen.trusting():
            assert seen.obstacles(place, 1.7).distance(leaf) < 0.03
    assert seen.obstacles(place, 1.7, without={name}).distance(leaf) > 0.05


def test_a_door_that_was_shut_is_where_it_stood_no_more() -> None:
    """A picture that shows what is behind its place says so."""
    seen = Seen(SegmentationDetector({"cabinet": ("cabinet",)}, least_px=1))
    seen.forget(["cabinet"])
    world = tall_cabinet(*FRONT)
    look(world, seen)
    leaf, place = world.doors("cabinet")[0].solids[0].T[:3, 3], np.array([0.5, 0.0])
    assert seen.obstacles(place, 1.7).distance(leaf) < 0.03
    world.set_opening("cabinet", "door", 0.0)
    world.refresh()
    look(tilted(world, 0.3), seen)
    assert seen.obstacles(place, 1.7).distance(leaf) > 0.1


def test_a_vessel_of_which_only_the_outside_is_seen_is_a_vessel_still() -> None:
    """A cup on a high shelf, or far off, looks massive; who has seen into it knows that something goes in."""
    world = small_world({"bin": placed("mixing_bowl", 0.8, 0.0)}, render=True)
    seen = looking(tilted(world), "trash can")
    (name,) = names(seen, "trash can")
    assert seen.volumes(name)
    massive = replace(seen.things[name].shape, kind="cylinder", volumes=())
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(associator, "fitted", lambda *_: massive)
        look(world, seen)
        assert seen.volumes(name)
        patch.setattr(associator, "fitted", lambda *_: massive.moved(kin.transform(np.eye(3), (0.1, 0.0, 0.0))))
        look(world, seen)
    assert not seen.volumes(name)  # what stands elsewhere may be something else


def test_what_is_set_down_beside_furniture_lies_at_its_foot() -> None:
    """Of a table its legs down to the floor are known, not the top alone; who sets down beside it is not in its way."""
    world = tilted(small_world(table_1=TABLE, render=True), 0.5)
    seen = looking(world, "table")
    (table,) = names(seen, "table")
    body, true = bounds(seen.body(table)), bounds(world.solids("table_1"))
    assert body[0, 2] == 0.0
    np.testing.assert_allclose(body[1, 2], true[1, 2], atol=0.02)
    assert seen.body(table) is seen.body(table)  # searches ask for every place beside it
    legs = [s.aabb().mean(0) for s in seen.body(table) if s.aabb()[0, 2] == 0.0]
    here = np.zeros(2)
    left_out, whole = seen.obstacles(here, 1.7, without={table}), seen.obstacles(here, 1.7, beside=table)
    assert legs
    assert (left_out.distance(np.array(legs)) < 0.03).any()
    assert (whole.distance(np.array(legs)) > 0.03).all()


def test_what_lies_as_flat_as_a_lawn_bars_no_base() -> None:
    """A base stands on it as on the floor."""
    world = tilted(small_world(table_1="{entry: driveway, at: [0.0, 0.0]}", render=True), 0.5)
    seen = looking(world, "table")
    (flat,) = names(seen, "table")
    assert bounds(seen.solids(flat))[1, 2] == pytest.approx(0.01, abs=0.01)
    on_it = np.array([[x, 0.0, 0.03] for x in (0.6, 1.0, 1.4)])
    assert (seen.obstacles(np.zeros(2), 1.7).distance(on_it) > 0.1).all()
