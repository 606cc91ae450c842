"""Picking up: what counts as done."""

from __future__ import annotations

from collections.abc import Generator
from itertools import combinations
from typing import Any

import numpy as np
import pytest

from mpvi_bt.ground.geometry.solids import Array, pose
from mpvi_bt.ground.robot.motion import Actions, Motion, MotionFailure
from mpvi_bt.ground.robot.protocol import SIDES, Side
from mpvi_bt.hands.motion.approach import arrive
from mpvi_bt.hands.motion.work import Work
from mpvi_bt.hands.skills import pick as picking
from mpvi_bt.hands.skills.openings import thing_meant
from mpvi_bt.hands.skills.pick import _bring, pick
from mpvi_bt.hands.stance.stance import Stance
from mpvi_bt.house.sim.world import SimWorld
from mpvi_bt.house.truth.true_scene import TrueScene
from tests.small_house import placed, small_house, small_world

CAN = {"object": "can of soda"}
TABLE = "{entry: table, at: [0.9, 0.0]}"


def lowest(world: SimWorld, name: str = "can") -> float:
    return float(min(s.aabb()[0, 2] for s in world.solids(name)))


def played(world: SimWorld, task: Work, actions: Actions) -> None:
    """Perform it."""
    until_s = world.time_s + 60.0
    for action in actions:
        world.robot.act(action)
        world.step()
        task.motion.felt = world.robot.proprioception()
        assert world.time_s < until_s


@pytest.fixture
def held() -> tuple[SimWorld, Work, float]:
    """A can that has been picked up from a table, and how high it lay."""
    world = small_world({"can": placed("can_of_soda", 0.7, 0.0, 0.76)}, (-0.2, 0.0, 0.0), table_1=TABLE)
    world.settle()
    rest = lowest(world)
    task = Work(TrueScene(world), Motion(world.robot.proprioception()), np.random.default_rng(0))
    played(world, task, pick(task, CAN, []))
    return world, task, rest


@pytest.mark.slow
def test_what_is_picked_up_is_off_what_it_lay_on(held: tuple[SimWorld, Work, float]) -> None:
    """A pick that says nothing against it has the thing in hand, 5 cm and more above where it lay or well away."""
    world, task, rest = held
    assert task.scene.holding("left") == "can" or task.scene.holding("right") == "can"
    assert lowest(world) > rest + 0.05
    assert task.lay["can"][2] == pytest.approx(rest, abs=0.005)


@pytest.mark.slow
def test_what_is_in_hand_where_it_lay_is_not_picked_up(held: tuple[SimWorld, Work, float]) -> None:
    """A retry with the thing in hand raises it first; where it comes no higher, the pick fails."""
    world, task, _ = held
    side: Side = "left" if task.scene.holding("left") == "can" else "right"
    at = task.scene.pose("can")[:2, 3]
    task.lay["can"] = np.append(at, lowest(world))  # as if it had been gripped up here
    before = lowest(world)
    played(world, task, pick(task, CAN, []))
    assert lowest(world) > before + 0.05
    task.lay["can"] = np.append(task.scene.pose("can")[:2, 3], 1.5)
    with pytest.raises(MotionFailure, match="slipped"):
        played(world, task, _bring(task, "can", side))


@pytest.mark.slow
@pytest.mark.parametrize("shove_m", [-0.025, 0.025])
def test_fingers_go_straight_down_beside_a_thing_wherever_the_base_has_come_to_stand(
    shove_m: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What leaves a hand 8 mm to spare on either side is taken upright by a base that was shoved along by 2.5 cm."""
    toaster = {"toaster": placed("toaster", 0.7, 0.0, 0.76, np.pi / 2)}
    world = small_world(toaster, (-0.2, 0.0, 0.0), table_1=TABLE)
    world.settle()

    def shoved(work: Work, *args: Any) -> Generator[Array, None, Stance]:
        stance = yield from arrive(work, *args)
        across = work.scene.pose("toaster")[:2, 1]  # its narrow sides are apart along this
        yield from work.motion.drive(work.motion.felt.base_pose + np.append(across * shove_m, 0.0))
        return stance

    tilts: list[float] = []
    monkeypatch.setattr(picking, "arrive", shoved)
    task = Work(TrueScene(world), Motion(world.robot.proprioception()), np.random.default_rng(0))
    for action in pick(task, {"object": "toaster"}, []):
        world.robot.act(action)
        world.step()
        task.motion.felt = world.robot.proprioception()
        tilts.append(float(world.pose("toaster")[2, 2]))
    assert "toaster" in (task.scene.holding("left"), task.scene.holding("right"))
    assert min(tilts) > 0.99


@pytest.mark.slow
def test_what_is_picked_up_out_of_a_container_is_above_its_rim() -> None:
    """Both hands take a thing out of a basket; neither is left low in it, and it stands where it stood."""
    eggs = {f"egg_{k}": placed("easter_egg", 0.7, y, 0.1) for k, y in enumerate((0.06, -0.06))}
    world = small_world({"basket": placed("wicker_basket", 0.7, 0.0), **eggs}, (-0.2, 0.0, 0.0))
    world.settle()
    stood = world.pose("basket")
    for side in SIDES:
        task = Work(TrueScene(world), Motion(world.robot.proprioception()), np.random.default_rng(0))
        played(world, task, pick(task, {"object": "Easter egg", "source": "wicker basket", "hand": side}, []))
        held = task.scene.holding(side)
        assert held is not None
        assert lowest(world, held) > max(float(s.aabb()[1, 2]) for s in world.solids("basket"))
    np.testing.assert_allclose(world.pose("basket"), stood, atol=0.02)


def test_a_thing_is_taken_from_where_it_is_said_to_be() -> None:
    """Of two alike the one in or on the source is meant, though it is farther away; elsewhere if none is there."""
    cans = {"near": placed("can_of_soda", 0.4, 0.0), "far": placed("can_of_soda", 0.9, 0.0, 0.73)}
    world = small_world({**cans, "basket": placed("wicker_basket", 0.0, 1.0)}, (-0.2, 0.0, 0.0), table_1=TABLE)
    task = Work(TrueScene(world), Motion(world.robot.proprioception()), np.random.default_rng(0))
    assert task.nearest("can of soda") == "near"
    assert task.nearest("can of soda", "table") == "far"
    assert task.nearest("can of soda", "basket") == "near"
    world = small_world({"laid": placed("easter_egg", 0.4, 0.0), "egg": placed("easter_egg", 0.9, 0.0, 0.02),
                         "basket": placed("wicker_basket", 0.9, 0.0)}, (-0.2, 0.0, 0.0))  # fmt: skip
    task = Work(TrueScene(world), Motion(world.robot.proprioception()), np.random.default_rng(0))
    assert task.nearest("Easter egg") == "laid"
    assert task.nearest("Easter egg", "wicker basket") == "egg"


def test_where_the_nearest_is_out_of_reach_the_next_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of things alike each near by is tried, the nearest first, and other failures stand.

    One that is far off is tried where no hand can take any that is nearer.
    """
    cans = {f"can_{k}": placed("can_of_soda", x, 0.0) for k, x in enumerate((0.6, 0.4, 3.5))}
    world = small_world(cans, (-0.2, 0.0, 0.0))
    task = Work(TrueScene(world), Motion(world.robot.proprioception()), np.random.default_rng(0))
    tried: list[str] = []

    def pick_up(work: Work, name: str, side: Side, bases: list[Array]) -> Actions:
        tried.append(name)
        yield from ()
        if reasons:
            raise MotionFailure(reasons.pop(0))

    def nowhere(work: Work, place: Array, been: list[Array]) -> Generator[Array, None, bool]:
        yield from ()
        return False

    monkeypatch.setattr(picking, "pick_up", pick_up)
    monkeypatch.setattr(picking, "go_around", nowhere)
    cases: tuple[tuple[list[str], str], ...] = (
        ([], "1"), (["no_stance"], "10"), (["no_stance"] * 9, "10"), (["slipped"], "1"),
        (["no_grasp"], "10"), (["no_grasp"] * 2, "102"), (["no_grasp"] * 9, "102"), (["no_grasp", "no_stance"], "10"),
    )  # fmt: skip
    for failures, names in cases:
        reasons, passes = list(failures), len(failures) < len(names)
        tried.clear()
        try:
            list(pick(task, {**CAN, "hand": "left"}, []))
        except MotionFailure as failure:
            assert not passes
            assert failure.reason == failures[-1]
        else:
            assert passes
        assert tried == [f"can_{k}" for k in names]


def test_what_stands_open_is_meant_where_things_are_put() -> None:
    """Of two cabinets the nearer is meant, but to put something in or to close it the one whose door is open."""
    near, far = (f"{{entry: base_cabinet, at: [1.0, {y}]}}" for y in (0.0, 0.9))
    world = small_world({}, (-0.2, 0.0, 0.0), cabinet_1=near, cabinet_2=far)
    task = Work(TrueScene(world), Motion(world.robot.proprioception()), np.random.default_rng(0))
    assert task.nearest("cabinet", ajar=True) == "cabinet_1"
    world.set_opening("cabinet_2", "door", 0.8)
    assert task.nearest("cabinet") == "cabinet_1"
    assert task.nearest("cabinet", ajar=True) == "cabinet_2"


def test_what_has_the_content_is_meant_where_something_is_to_be_taken_out() -> None:
    """Of three cabinets the one with the can is opened to take a can out; the nearest one where none has any."""
    cabinets = [f"{{entry: base_cabinet, at: [1.0, {y}], yaw_deg: 180}}" for y in (-0.1, 0.9, 1.8)]
    can = placed("can_of_soda", 1.0, 0.9, 0.12)
    for things, opened in (({"can": can}, "cabinet_2"), ({}, "cabinet_1")):
        house = small_house(cabinet_1=cabinets[0], cabinet_2=cabinets[1], cabinet_3=cabinets[2])
        world = SimWorld(house, things, np.array((-0.2, 0.0, 0.0)))
        task = Work(TrueScene(world), Motion(world.robot.proprioception()), np.random.default_rng(0))
        assert thing_meant(task, "the cabinet", content="can of soda")[0] == opened
        assert thing_meant(task, "the cabinet")[0] == opened, "it is the same one again"


def test_what_is_no_more_is_unknown() -> None:
    """A log that was chopped is nowhere: no skill ends an episode over it."""
    world = small_world({"can": placed("can_of_soda", 1.0, 0.0, 0.12)}, (-0.2, 0.0, 0.0))
    work = Work(TrueScene(world), Motion(world.robot.proprioception()), np.random.default_rng(0))
    with pytest.raises(MotionFailure, match="unknown_object"):
        work.middle("log")


def test_of_cabinets_above_one_another_the_one_in_easy_reach_is_meant() -> None:
    """A wall cabinet straight ahead is farther off for the hands than a low one beside it."""
    low, high = "{entry: base_cabinet, at: [1.0, 0.6]}", "{entry: wall_cabinet, at: [1.0, 0.0], z_m: 1.41}"
    world = small_world({}, (-0.2, 0.0, 0.0), cabinet_1=low, cabinet_2=high)
    task = Work(TrueScene(world), Motion(world.robot.proprioception()), np.random.default_rng(0))
    assert task.nearest("cabinet") == "cabinet_1"


def test_what_is_said_of_containers_tells_them_apart() -> None:
    """Of two bowls the empty one, or the one with an egg in it or without, is meant though the other is nearer."""
    bowls = {"near": placed("mixing_bowl", 0.5, 0.0), "far": placed("mixing_bowl", 0.9, 0.0)}
    world = small_world({**bowls, "egg": placed("easter_egg", 0.5, 0.0, 0.02)}, (-0.2, 0.0, 0.0))
    world.settle()
    task = Work(TrueScene(world), Motion(world.robot.proprioception()), np.random.default_rng(0))
    assert task.nearest("mixing bowl") == task.nearest("mixing bowl with the egg") == "near"
    assert task.nearest("empty mixing bowl") == task.nearest("mixing bowl without the egg") == "far"
    world.place("egg", world.pose("far") @ pose((0.0, 0.0, 0.02)))
    world.settle()
    assert task.nearest("mixing bowl with the egg") == "far"
    assert task.nearest("mixing bowl with the candle") == "near"


@pytest.mark.parametrize("tries", [1, 2, 3, 9])
def test_what_is_out_of_reach_is_gone_around(monkeypatch: pytest.MonkeyPatch, tries: int) -> None:
    """The robot drives on around it, twice at most, and tries again from there; in the end it cannot be reached."""
    world = small_world({"can": placed("can_of_soda", 1.2, 0.0)}, (0.0, 0.0, 0.0))
    task = Work(TrueScene(world), Motion(world.robot.proprioception()), np.random.default_rng(0))
    bases: list[Array] = []

    def pick_up(work: Work, name: str, side: Side, tried: list[Array]) -> Actions:
        bases.append(work.motion.felt.base_pose.copy())
        yield from ()
        if len(bases) < tries:
            raise MotionFailure("no_stance")

    monkeypatch.setattr(picking, "pick_up", pick_up)
    actions = pick(task, {**CAN, "hand": "left"}, [])
    if tries > 3:
        with pytest.raises(MotionFailure, match="no_stance"):
            played(world, task, actions)
    else:
        played(world, task, actions)
    assert len(bases) == min(tries, 3)
    assert all(np.linalg.norm(a[:2] - b[:2]) > 0.5 for a, b in combinations(bases, 2))


def test_the_other_one_is_not_the_one_that_was_taken_before(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of two as much put away "the other can" is the farther one, though the first was cut short in hand."""
    world = small_world({"near": placed("can_of_soda", 1.0, 0.0), "far": placed("can_of_soda", 1.4, 0.0)})
    task = Work(TrueScene(world), Motion(world.robot.proprioception()), np.random.default_rng(0))
    taken: list[str] = []

    def pick_up(work: Work, name: str, side: Side, tried: list[Array]) -> Actions:
        taken.append(name)
        monkeypatch.setattr(work.scene, "holding", lambda s: name if s == side else None)
        yield work.motion.still()

    monkeypatch.setattr(picking, "pick_up", pick_up)
    for said in ("can of soda", "the other can of soda", "another can of soda", "can of soda"):
        monkeypatch.setattr(task.scene, "holding", lambda s: None)
        actions = pick(task, {"object": said}, [])
        assert isinstance(actions, Generator)
        next(actions)
        actions.close()
    assert taken == ["near", "far", "near", "near"]


def test_slanted_ways_to_take_a_thing_leave_room_over_it() -> None:
    """Those of all ways whose hand comes from a side."""
    world = small_world({"can": placed("can_of_soda", 0.8, 0.0)})
    task = Work(TrueScene(world), Motion(world.robot.proprioception()), np.random.default_rng(0))
    ways, slanted = picking.options(task, "can"), picking.slanted_options(task, "can")
    tilts = [np.arccos(-option.waypoints[option.contact][2, 2]) for option in slanted]
    assert 0 < len(slanted) < len(ways)
    assert min(tilts) >= 0.8
