"""Where a held thing would be laid: on faces and beside things."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mpvi_bt.finding.shapes.from_above import outline
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.next_to import beside as in_line
from mpvi_bt.ground.geometry.solids import bounds
from mpvi_bt.ground.robot.collision import Surroundings
from mpvi_bt.ground.robot.motion import Motion, MotionFailure
from mpvi_bt.hands.motion.work import Work
from mpvi_bt.hands.skills import place, spots
from mpvi_bt.hands.skills.placing import Pose, leaning
from mpvi_bt.house.sim.world import SimWorld
from mpvi_bt.house.states.relations import nextto, under
from mpvi_bt.house.truth.true_scene import TrueScene
from tests.small_house import placed, small_world

WORLD = small_world(table="{entry: table, at: [1.0, 0.0]}")
TOP = max((s for s in WORLD.solids("table")), key=lambda s: float(s.aabb()[1, 2])).aabb()
NARROW_M = float(np.ptp(TOP, axis=0)[:2].min())


@settings(max_examples=20, deadline=None)
@given(st.floats(0.02, 0.499))
def test_spots_lie_about_the_middle_of_a_face(share: float) -> None:
    """Nothing depends on which edge they are counted from: a thing about as broad as a board goes on its middle."""
    found = np.array(TrueScene(WORLD).spots("table", share * NARROW_M, 0.1, np.zeros(2)))
    np.testing.assert_allclose(found[:, :2].min(0) + found[:, :2].max(0), TOP[:, :2].sum(0), atol=1e-6)
    assert len({tuple(spot) for spot in found.round(6)}) == len(found)


class Holding(TrueScene):
    """A scene in which the left hand holds a thing, wherever that is."""

    def __init__(self, world: SimWorld, name: str) -> None:
        super().__init__(world)
        self.holding = lambda side: name if side == "left" else None


@pytest.mark.parametrize("yaw", [0.0, 0.7])
def test_a_long_thing_is_best_laid_along_what_it_lies_beside(yaw: float) -> None:
    """It reaches away from the target as little as it can, however the hand has it."""
    world = small_world({"sandal": placed("sandal", -1.0, 0.5, 0.01, yaw)}, bed="{entry: bed, at: [1.5, 0.0]}")
    work = Work(Holding(world, "sandal"), Motion(world.robot.proprioception()), np.random.default_rng(0))
    held = work.held()["left"]
    group = next(spots.beside(work, held, "bed", (0.0,)))
    bed = spots.size(world.solids("bed"))[0].mean(0)[:2]
    away = work.motion.felt.base_pose[:2] - bed
    away /= np.linalg.norm(away)

    def reach_m(pose: Pose) -> float:
        moved = [s.moved(pose.T_world_thing @ np.linalg.inv(world.pose("sandal"))) for s in world.solids("sandal")]
        return float(np.ptp(outline(moved) @ away))

    best = min(group, key=lambda pose: pose.cost)
    reaches = [reach_m(pose) for pose in group]
    assert reach_m(best) < min(reaches) + 0.05 < max(reaches) - 0.05


def test_beside_a_bed_there_is_room_left_before_what_lies_on_it() -> None:
    """A sandal goes to where nobody stands to take the book; with no book, straight to the robot's side."""
    bed = "{entry: bed, at: [1.5, 0.0]}"
    for book_y, kept in ((0.0, True), (3.0, False)):
        things = {"sandal": placed("sandal", -1.0, 0.5), "book": placed("book", 0.6, book_y, 0.6)}
        world = small_world(things, bed=bed)
        x_low = float(spots.size(world.solids("bed"))[0][0, 0])
        world.place("book", kin.transform(np.eye(3), (x_low + 0.15, book_y, 0.6)))
        work = Work(Holding(world, "sandal"), Motion(world.robot.proprioception()), np.random.default_rng(0))
        group = next(spots.beside(work, work.held()["left"], "bed", (0.0,)))
        at = np.mean([pose.T_world_thing[:2, 3] for pose in group], axis=0)
        assert (np.linalg.norm(at - [x_low + 0.15, 0.0]) > 0.6) == kept


def test_places_on_the_floor_are_free_and_in_the_room_that_is_named() -> None:
    """No other room's, if the phrase names one; clear of what stands there; the nearest to a place first."""
    work = Work(TrueScene(WORLD), Motion(WORLD.robot.proprioception()), np.random.default_rng(0))
    place = np.array([0.4, -0.3])
    found = np.array(spots.floor_around(work, "the hall floor", 0.3, 0.2, place))
    hall = next(e for e in WORLD.knowledge() if e.kind == "room")
    assert ((found[:, :2] > hall.lowest[:2] + 0.3) & (found[:, :2] < hall.highest[:2] - 0.3)).all()
    assert (Surroundings(WORLD.solids("table")).distance(found + [0, 0, 0.1]) > 0.3).all()
    assert (np.diff(np.linalg.norm(found[:, :2] - place, axis=1)) > -1e-9).all()
    assert [spots.is_floor(phrase) for phrase in ("floor", "the hall floor", "the table")] == [True, True, False]


def test_beside_a_table_is_neither_under_its_top_nor_between_its_legs() -> None:
    """What is set down there is clear of the top, for the arm that brings it, and level with a leg."""
    world = small_world({"pot": placed("caldron", -1.0, 0.5, 0.01)}, table="{entry: table, at: [1.0, 0.0]}")
    work = Work(Holding(world, "pot"), Motion(world.robot.proprioception()), np.random.default_rng(0))
    top = max(world.solids("table"), key=lambda s: float(s.aabb()[1, 2])).aabb()
    for pose in next(spots.beside(work, work.held()["left"], "table", (0.0,))):
        moved = [s.moved(pose.T_world_thing @ np.linalg.inv(world.pose("pot"))) for s in world.solids("pot")]
        low, high = bounds(moved)
        assert (low[:2] > top[1, :2]).any() or (high[:2] < top[0, :2]).any()
        assert in_line((low + high) / 2, world.solids("table")) or in_line(bounds(world.solids("table")).mean(0), moved)


def test_what_is_set_down_beside_a_thing_stands_out_over_no_edge_if_it_need_not() -> None:
    """By what stands near the edge of a table it goes to its side, with all of it over the top."""
    edge = TOP[0, 0]
    target = placed("saucer", edge + 0.14, 0.0, float(TOP[1, 2]) + 0.001)
    world = small_world(
        {"saucer": target, "cup": placed("coffee_cup", -1.0, 0.5, 0.01)}, table="{entry: table, at: [1.0, 0.0]}"
    )
    work = Work(Holding(world, "cup"), Motion(world.robot.proprioception()), np.random.default_rng(0))
    for pose in next(spots.beside(work, work.held()["left"], "saucer", (0.0,))):
        moved = [s.moved(pose.T_world_thing @ np.linalg.inv(world.pose("cup"))) for s in world.solids("cup")]
        assert (outline(moved)[:, 0] > edge - 0.006).all()


@pytest.mark.parametrize("yaw", [0.0, 0.26, 1.57])
def test_the_first_of_two_long_things_leaves_room_for_the_second(yaw: float) -> None:
    """On a newspaper that is hardly wider a piece of firewood lies along it, however it is turned, at one end."""
    things = {"paper": placed("newspaper", 0.6, 0.0, 0.001, yaw), **{n: placed("firewood", -1.0, 0.5) for n in "ab"}}
    world = small_world(things)
    for name in "ab":
        work = Work(Holding(world, name), Motion(world.robot.proprioception()), np.random.default_rng(0))
        group = next(spots.on(work, work.held()["left"], "paper", (0.0,)), None)
        assert group
        world.place(name, group[0].T_world_thing)


def test_a_cup_finds_room_on_its_saucer() -> None:
    """Where there is no room to spare, what is needed has to do, however the saucer is turned; a plate finds none."""
    for cup, finds in (("small_coffee_cup", True), ("plate", False)):
        world = small_world({"saucer": placed("saucer", 0.6, 0.0, 0.01, 0.26), "cup": placed(cup, -1.0, 0.5)})
        work = Work(Holding(world, "cup"), Motion(world.robot.proprioception()), np.random.default_rng(0))
        found = list(spots.on(work, work.held()["left"], "saucer", (0.0,)))
        assert bool(found) is finds


def test_what_goes_into_a_cabinet_goes_to_its_back_first() -> None:
    """What is put to the front would bar the way for what comes after it."""
    world = small_world(
        {"candle": placed("candle", -1.0, 0.5)}, cabinet="{entry: base_cabinet, at: [1.2, 0.0], yaw_deg: 180}"
    )
    work = Work(Holding(world, "candle"), Motion(world.robot.proprioception()), np.random.default_rng(0))
    groups = list(spots.on(work, work.held()["left"], "cabinet", (0.0,), inside=True))
    depths = [float(group[0].T_world_thing[0, 3]) for group in groups]
    assert depths[0] == max(depths)
    assert min(depths) < max(depths) - 0.2


@given(st.integers(4, 12), st.integers(4, 12), st.floats(0.1, 0.4))
def test_a_board_is_filled_from_a_corner_at_its_back(wide: int, deep: int, apart: float) -> None:
    """All are offered by turns: one from back and corners, apart from those before, and one from the front."""
    grid = [np.array([x * 0.05, y * 0.05, 0.5]) for x in range(deep) for y in range(wide)]
    before = np.array([-0.8, (wide - 1) * 0.025])
    offered = [grid[k] for k in spots._packed(grid, before, apart)]
    assert sorted(map(tuple, offered)) == sorted(map(tuple, grid))
    assert offered[0][0] == (deep - 1) * 0.05
    assert offered[0][1] in (0.0, (wide - 1) * 0.05)
    assert np.linalg.norm(offered[1][:2] - before) == min(np.linalg.norm(spot[:2] - before) for spot in grid)
    if (wide - 1) * 0.05 >= 2 * apart:
        assert np.linalg.norm(offered[2] - offered[0]) >= apart


def test_what_has_something_in_it_is_set_down_upright() -> None:
    """A bowl may lean as it is set down, but not with an egg in it, unless it leans already."""
    for egg_x, hangs, leans in ((0.5, 0.0, True), (-1.0, 0.0, False), (-1.0, 0.2, True)):
        things = {"bowl": placed("bowl", -1.0, 0.5), "egg": placed("easter_egg", egg_x, 0.5, 0.02)}
        world = small_world(things)
        world.place("bowl", world.pose("bowl") @ kin.transform(kin.rot_y(hangs), (0.0, 0.0, 0.0)))
        work = Work(Holding(world, "bowl"), Motion(world.robot.proprioception()), np.random.default_rng(0))
        held = work.held()["left"]
        assert leaning(work, held, 0.0) is not None
        assert (leaning(work, held, 0.25) is not None) is leans


def test_a_thing_is_set_down_on_the_uppermost_board_first() -> None:
    """Of the boards of a shelf none is above the first that is tried; of those below there is one among the next."""
    world = small_world({"can": placed("can_of_soda", -1.0, 0.5)}, shelf="{entry: shelf, at: [1.0, 0.0], yaw_deg: 180}")
    work = Work(Holding(world, "can"), Motion(world.robot.proprioception()), np.random.default_rng(0))
    held = work.held()["left"]
    heights = [group[0].T_world_thing[2, 3] for group in spots.on(work, held, "shelf", (0.0,))]
    top = max(float(solid.aabb()[1, 2]) for solid in world.solids("shelf"))
    assert heights[0] > top - 0.1
    assert min(heights[1:4]) < top - 0.3


def test_of_two_things_under_a_sink_the_second_stands_next_to_the_first() -> None:
    """Where it is said so, what is set down there first of all counts as next to it, and is below the sink."""
    bottles = {name: placed("bottle_of_detergent", x, 0.0) for name, x in (("first", 0.9), ("second", -1.0))}
    world = small_world(bottles, (-0.2, 0.0, 0.0), sink="{entry: bathroom_sink, at: [1.0, 0.15], yaw_deg: 180}")
    work = Work(Holding(world, "second"), Motion(world.robot.proprioception()), np.random.default_rng(0))
    held = work.held()["left"]
    group = next(spots.under(work, held, "sink", (0.0,), by="first"))
    start = world.pose("second")
    for laid in group:
        world.place("second", laid.T_world_thing)
        assert nextto(world, "first", "second")
        assert under(world, "second", "sink")
    world.place("second", start)
    apart = [pose for group in spots.under(work, held, "sink", (0.0,)) for pose in group]
    assert len(apart) > 0


def test_nothing_is_set_down_beside_itself() -> None:
    """It goes next to the sandal that no hand holds; there is none where only the one in hand is known."""
    sandals = {name: placed("sandal", 1.0, y, 0.01) for name, y in (("sandal_1", 0.2), ("sandal_2", -0.5))}
    for known in (["sandal_1"], ["sandal_1", "sandal_2"]):
        world = small_world({name: sandals[name] for name in known})
        work = Work(Holding(world, "sandal_1"), Motion(world.robot.proprioception()), np.random.default_rng(0))
        if len(known) == 1:
            with pytest.raises(MotionFailure, match="unknown_object"):
                place._standing(work, "sandal")
        else:
            assert place._standing(work, "sandal") == "sandal_2"


@pytest.mark.parametrize(
    ("thing", "lies"), [("pen", False), ("bottle_of_olive_oil", True), ("small_box_of_oatmeal", True)]
)
def test_what_is_flat_is_not_stood_on_end_to_lie(thing: str, lies: bool) -> None:
    """A bottle that is tipped over comes to lie; a pen that is raised so far would fall anywhere."""
    world = small_world({"thing": placed(thing, -1.0, 0.5)})
    work = Work(Holding(world, "thing"), Motion(world.robot.proprioception()), np.random.default_rng(0))
    held = work.held()["left"]
    assert leaning(work, held, 0.0) is not None
    for lean in (1.2, -1.2, 1.5, -1.5):
        assert (leaning(work, held, lean) is not None) is lies


@pytest.mark.parametrize("gap_m", [0.11, 0.05, 0.02])
def test_a_pen_is_laid_lengthwise_where_there_is_no_room_across(gap_m: float) -> None:
    """Beside two boxes on a notebook it lies with all of it on the notebook and clear of both."""
    boxes = {name: placed("small_box_of_oatmeal", 0.6, 0.0, 0.03) for name in ("one", "two")}
    world = small_world({"notebook": placed("notebook", 0.6, 0.0), "pen": placed("pen", -1.0, 0.5), **boxes})
    wide = float(bounds(world.solids("one"))[1, 0]) - 0.6
    for name, sign in (("one", 1.0), ("two", -1.0)):
        T = world.pose(name)
        T[0, 3] += sign * (gap_m / 2 + wide)
        world.place(name, T, fixed=True)
    work = Work(Holding(world, "pen"), Motion(world.robot.proprioception()), np.random.default_rng(0))
    held = work.held()["left"]
    found = [pose for group in spots.on(work, held, "notebook", (0.0,)) for pose in group]
    assert found
    others = Surroundings([s for name in boxes for s in world.solids(name)])
    board = bounds(world.solids("notebook"))
    frame = kin.inverse(held.T_tcp_thing)
    for pose in found:
        edge = outline([s.moved(pose.T_world_thing @ frame) for s in held.solids])
        assert (edge > board[0, :2] - 0.006).all()
        assert (edge < board[1, :2] + 0.006).all()
        rows = np.column_stack([edge, np.full(len(edge), pose.T_world_thing[2, 3] + 0.015)])
        assert others.distance(rows).min() > 0.004
