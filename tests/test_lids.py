"""Movable things with a lid: how a hand goes along with one, and that it really opens and closes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from mpvi_bt.finding.shapes.moving_parts import lid, moved, outward
from mpvi_bt.ground.robot.motion import Actions, MotionFailure
from mpvi_bt.ground.robot.protocol import Side
from mpvi_bt.hands.robots.r1 import R1
from mpvi_bt.hands.skills.bar_courses import swings
from mpvi_bt.hands.skills.open import _rise_off
from mpvi_bt.hands.skills.push_courses import pushes
from mpvi_bt.hands.stance.grasps import grasps
from mpvi_bt.house.sim.world import SimWorld
from mpvi_bt.house.states.relations import open_
from mpvi_bt.house.truth.true_scene import TrueScene
from tests.small_house import placed, small_world
from tests.test_open import play, work_in

DESK = "{entry: desk, at: [0.85, 0.0], yaw_deg: 180}"


def lidded(entry: str, fraction: float) -> SimWorld:
    """A thing on a desk, its front toward the robot, its lid open so far."""
    world = small_world({"thing": placed(entry, 0.75, 0.0, 0.741, np.pi)}, desk=DESK)
    world.set_opening("thing", "lid", fraction)
    world.settle(0.3)
    return world


@pytest.mark.parametrize("entry", ["toolbox", "laptop", "hinged_jar"])
def test_a_lid_is_told_from_a_flap(entry: str) -> None:
    """What closes a thing from above is a lid, however far it is open; an oven's door and a car's trunk are none."""
    for fraction in (0.0, 0.5, 0.9):
        assert lid(lidded(entry, fraction).doors("thing")[0])
    for flap in ("oven", "car"):
        world = small_world(thing=f"{{entry: {flap}, at: [1.1, 0.0], yaw_deg: 180}}")
        assert not lid(world.doors("thing")[0])


@pytest.mark.parametrize("entry", ["toolbox", "laptop"])
def test_a_fist_goes_down_on_the_outside_of_a_lid(entry: str) -> None:
    """All the way the fingertips are on the outer side of the lid, near its free edge; at the end they are on top."""
    door = lidded(entry, 0.8).doors("thing")[0]
    courses = pushes(R1.hand, door, beyond=0.0)
    assert courses
    for course in courses:
        for x in (0.0, 0.5, 1.0):
            tip = course.hand(x) @ [0.0, 0.0, 0.012, 1.0]
            T = moved(door, -door.position * x)
            out = T[:3, :3] @ outward(door)
            face = max(float(out @ solid.moved(T).T[:3, 3]) for solid in door.solids[:1])
            assert -0.001 < float(out @ tip[:3]) - face < 0.03
        assert course.hand(1.0)[2, 2] < -0.4


@pytest.mark.parametrize("entry", ["toolbox", "hinged_jar"])
def test_a_hand_turns_with_a_lid_as_it_opens(entry: str) -> None:
    """Fingers hold the bar fast: a hand that turned less would tilt what stands loose."""
    door = lidded(entry, 0.0).doors("thing")[0]
    assert door.bar is not None
    easiest = min(swings(door, door.bar, 1.5), key=lambda course: course.cost)
    for x in (0.3, 1.0):
        turned = moved(door, (1.5 - door.position) * x)[:3, :3] @ easiest.hand(0.0)[:3, :3]
        np.testing.assert_allclose(easiest.hand(x)[:3, :3], turned, atol=1e-9)


def test_no_hand_lifts_a_thing_by_the_bar_of_its_lid() -> None:
    """It would open: what is taken hold of is the jar, between its sides."""
    world = lidded("hinged_jar", 0.0)
    assert not world.handles("thing")
    bar = world.doors("thing")[0].bar
    assert bar is not None
    found = grasps(TrueScene(world), R1.hand, "thing", 0.0)
    assert found
    assert all(abs(g.T_world_tcp[:3, 1] @ [0.0, 1.0, 0.0]) > 0.9 for g in found)


def test_a_hand_at_its_end_is_raised_off_a_bar_by_the_torso(monkeypatch: pytest.MonkeyPatch) -> None:
    """One that stayed would draw the lid shut as the base backs off."""
    world = lidded("hinged_jar", 0.8)
    work = work_in(world)

    def no_reach(side: Side, shares: Sequence[float]) -> Actions:
        raise MotionFailure("no_reach")

    monkeypatch.setattr(work, "rise", no_reach)
    before = work.motion.felt.torso[0]
    for action in _rise_off(work, "right"):
        world.robot.act(action)
        world.step()
        work.motion.felt = world.robot.proprioception()
    assert work.motion.felt.torso[0] == pytest.approx(before + 0.1, abs=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("entry", ["toolbox", "hinged_jar"])
def test_a_lid_is_opened_by_its_bar(entry: str) -> None:
    """It is wide open in the end, and the thing stands where it stood."""
    world = lidded(entry, 0.0)
    before = world.pose("thing")[:3, 3]
    assert play(world, f"open the {entry.replace('_', ' ')}")[-1] == "done"
    assert world.joint_fractions("thing")[0] > 0.55
    assert np.linalg.norm(world.pose("thing")[:3, 3] - before) < 0.03


@pytest.mark.slow
@pytest.mark.parametrize("entry", ["toolbox", "laptop", "hinged_jar"])
def test_a_lid_is_closed(entry: str) -> None:
    """It counts as closed in the end, and the thing stands where it stood."""
    world = lidded(entry, 0.75)
    before = world.pose("thing")[:3, 3]
    assert play(world, f"close the {entry.replace('_', ' ')}")[-1] == "done"
    assert not open_(world, "thing")
    assert np.linalg.norm(world.pose("thing")[:3, 3] - before) < 0.1


@pytest.mark.slow
def test_a_lid_is_closed_at_the_back_of_a_long_deep_board() -> None:
    """No base comes nearer than 75 cm to where a fist goes behind it, and there is no way around the board."""
    desk = "{entry: desk, at: [0.95, 0.0], yaw_deg: 180, shape: {size_m: [0.8, 2.6, 0.741]}}"
    world = small_world({"thing": placed("toolbox", 1.15, 0.0, 0.741, np.pi)}, desk=desk)
    world.set_opening("thing", "lid", 0.8)
    world.settle(0.3)
    assert play(world, "close the toolbox")[-1] == "done"
    assert not open_(world, "thing")
