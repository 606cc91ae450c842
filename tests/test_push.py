"""Pushing things: where the hand goes, how the base goes along, and that things really move where they should."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.solids import Solid, bounds
from mpvi_bt.ground.robot.motion import Motion
from mpvi_bt.hands.motion.work import Work
from mpvi_bt.hands.robots.r1 import R1
from mpvi_bt.hands.skills.push import _way, pushes
from mpvi_bt.house.sim.world import Placement, SimWorld
from mpvi_bt.house.states.relations import nextto
from mpvi_bt.house.truth.true_scene import TrueScene
from tests.small_house import CATALOGUE, placed, small_world
from tests.test_open import play

CHAIR = CATALOGUE["chair"].changed(mass_kg=4.0, friction=0.3)


def chair_world(yaw: float = 0.4) -> SimWorld:
    T = kin.transform(kin.rot_z(yaw), (0.4, 0.1, 0.001))
    return small_world({"seat": Placement(CHAIR, T)}, base=(-0.6, 0.0, 0.1), t="{entry: table, at: [1.6, 0.1]}")


@pytest.mark.parametrize("way", [(0.3, 0.0), (0.0, -0.2), (-0.1, 0.1)])
def test_the_hand_starts_behind_and_ends_ahead_by_the_way(way: tuple[float, float]) -> None:
    """Every course begins on the far side of the thing's middle, and leads hand and thing by the same way."""
    world = small_world({"box": placed("box", 0.4, 0.1, yaw=0.3)})
    solids, middle = world.solids("box"), world.pose("box")[:2, 3]
    courses = pushes(R1.hand, solids, np.array(way))
    assert courses
    for course in courses:
        start, end = course.hand(0.0), course.hand(1.0)
        assert (start[:2, 3] - middle) @ way < 0
        np.testing.assert_allclose(end[:3, 3] - start[:3, 3], (*way, 0.0), atol=1e-9)
        np.testing.assert_allclose(end[:3, :3], start[:3, :3])
        shift = course.moving(1.0)[0].T[:3, 3] - solids[0].T[:3, 3]
        np.testing.assert_allclose(shift, (*way, 0.0), atol=1e-9)
        assert (course.before[:2, 3] - start[:2, 3]) @ way < 0


def test_fingertips_stay_off_the_support_and_behind_the_thing() -> None:
    """However steep the hand, two tips are behind what they push, nearer to each other than it is wide."""
    world = small_world({"can": placed("can_of_soda", 0.4, 0.1)})
    (solid,) = world.solids("can")
    way = np.array([0.2, 0.1])
    for course in pushes(R1.hand, [solid], way):
        tip = (course.hand(0.0) @ [0.0, 0.0, 0.012, 1.0])[:3]
        assert tip[2] > solid.aabb()[0, 2] + 0.02
        assert (tip[:2] - world.pose("can")[:2, 3]) @ way < 0
        assert course.opening_m < 2 * solid.half_m[0]


@pytest.mark.parametrize("entry", ["folder", "notebook", "keyboard"])
def test_what_lies_flat_is_pushed_by_tips_behind_its_edge(entry: str) -> None:
    """From steeply above, neither over its upper edge nor down on what it lies on."""
    world = small_world({"flat": placed(entry, 0.4, 0.1)})
    solids = world.solids("flat")
    low, high = bounds(solids)
    courses = pushes(R1.hand, solids, np.array([0.0, 0.2]))
    assert courses
    for course in courses:
        tip = (course.hand(0.0) @ [0.0, 0.0, 0.012, 1.0])[:3]
        assert low[2] + 0.01 < tip[2] < high[2]


@pytest.mark.parametrize("apart", [0.3, 0.5])
def test_what_is_light_is_pushed_up_to_and_not_along(apart: float) -> None:
    """A folder goes until it meets a mouse, and little farther."""
    things = {"folder": placed("folder", 0.9, 0.0), "mouse": placed("mouse", 0.9, apart)}
    work = Work(TrueScene(world := small_world(things)), Motion(world.robot.proprioception()), np.random.default_rng(0))
    way, near = _way(work, "folder", {"object": "folder", "target": "mouse"})
    gap = bounds(world.solids("mouse"))[0, 1] - bounds(world.solids("folder"))[1, 1]
    assert near == pytest.approx(gap, abs=0.01)
    assert gap < np.linalg.norm(way) < gap + 0.06


def test_what_is_tall_and_thin_is_pushed_low() -> None:
    """A standing book is pushed no higher than it takes to stay clear of the table, if that can be had."""
    book = Solid("box", np.array([0.015, 0.09, 0.12]), kin.transform(np.eye(3), (0.5, 0.0, 0.12)))
    cheapest = min(pushes(R1.hand, [book], np.array([0.3, 0.0])), key=lambda course: course.cost)
    assert cheapest.hand(0.0)[2, 3] < 0.05


def test_left_stays_left_wherever_it_is_tried_again() -> None:
    """A second try, from elsewhere, pushes the same way in the world."""
    world = small_world({"can": placed("can_of_soda", 0.9, 0.0)})
    work = Work(TrueScene(world), Motion(world.robot.proprioception()), np.random.default_rng(0))
    words = {"object": "can of soda", "direction": "left"}
    first, _ = _way(work, "can", words)
    work.motion.felt = replace(work.motion.felt, base_pose=np.array([0.9, -1.0, np.pi / 2]))
    np.testing.assert_allclose(_way(work, "can", words)[0], first)


@pytest.mark.slow
@pytest.mark.parametrize("direction", ["away", "to the left", "to the right"])
def test_a_box_goes_where_it_is_pushed(direction: str) -> None:
    """It has moved at least 15 cm that way, and hardly aside."""
    world = small_world({"box": placed("box", 0.4, 0.1, yaw=0.2)}, base=(-0.6, 0.1, 0.0))
    world.settle(0.3)
    before = world.pose("box")[:2, 3]
    assert play(world, f"push the box {direction}")[-1] == "done"
    x, y = world.pose("box")[:2, 3] - before
    ahead, aside = {"away": (x, y), "to the left": (y, x), "to the right": (-y, x)}[direction]
    assert ahead > 0.15
    assert abs(aside) < 0.12


@pytest.mark.slow
def test_a_chair_is_pushed_to_the_table_and_stands() -> None:
    """It ends up within a few centimeters of the table, or under it, upright."""
    world = chair_world()
    world.settle(0.3)
    assert play(world, "push the chair to the table")[-1] == "done"
    reach = max(solid.aabb()[1, 0] for solid in world.solids("seat"))
    edge = min(solid.aabb()[0, 0] for solid in world.solids("t"))
    assert edge - reach < 0.08
    assert world.pose("seat")[2, 2] > 0.95


@pytest.mark.slow
def test_a_chair_that_rolls_is_pushed_up_to_a_desk() -> None:
    """By the edge of its seat, which reaches farthest back: it comes to stand next to the desk, upright."""
    chair, desk = "{entry: swivel_chair, at: [0.0, 0.0], yaw_deg: 180}", "{entry: desk, at: [1.5, 0.0], yaw_deg: 180}"
    world = small_world(base=(-0.9, 0.1, 0.0), chair=chair, desk=desk)
    world.settle(0.5)
    assert play(world, "push the swivel chair up to the desk")[-1] == "done"
    assert nextto(world, "chair", "desk")
    assert world.pose("chair")[2, 2] > 0.99
