"""Making a little room: back, or obliquely back where something stands in the way."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Collection

import numpy as np
import pytest

from mpvi_bt.ground.geometry.solids import Array, box
from mpvi_bt.ground.robot.collision import NOTHING, Surroundings
from mpvi_bt.ground.robot.motion import Actions, Motion, MotionFailure
from mpvi_bt.ground.robot.protocol import SIDES
from mpvi_bt.hands.motion.carry import back_off, settle, step_back
from mpvi_bt.hands.motion.work import Work
from mpvi_bt.hands.policies.visual_search import look_from_elsewhere
from mpvi_bt.hands.robots.r1 import R1
from mpvi_bt.house.sim.world import SimWorld
from mpvi_bt.house.truth.true_scene import TrueScene
from tests.layouts import LAYOUT
from tests.small_house import placed, run, small_world

BEHIND = {side: placed("carton_of_milk", -0.58, y) for side, y in (("left", 0.2), ("right", -0.2))}


def backed_off(*sides: str, by: Callable[[Work], Actions] = back_off) -> Array:
    """Where the base goes (3,) from the origin with cartons behind it on these sides."""
    world = small_world({side: BEHIND[side] for side in sides})
    work = Work(TrueScene(world), Motion(world.robot.proprioception()), np.random.default_rng(0))
    for action in by(work):
        world.robot.act(action)
        world.step()
        work.motion.felt = world.robot.proprioception()
    return np.asarray(work.motion.felt.base_pose)


@pytest.mark.parametrize(("side", "away"), [("left", -1.0), ("right", 1.0)])
def test_what_stands_behind_on_one_side_is_passed_on_the_other(side: str, away: float) -> None:
    """It goes about as far back as in the open, away from what straight back would be too near to."""
    assert backed_off()[0] == pytest.approx(-0.35, abs=0.02)
    x, y, yaw = backed_off(side)
    assert x < -0.28
    assert y * away > 0.05
    assert yaw == pytest.approx(0.0, abs=0.03)


def test_between_things_it_goes_less_far() -> None:
    """With something on both sides it goes straight, as far as that is clear."""
    x, y, _ = backed_off("left", "right")
    assert -0.25 < x < -0.1
    assert abs(y) < 0.02


def test_close_before_something_it_goes_aside() -> None:
    """What stands right behind it bars every way that is nearly straight: it slips past, still facing ahead."""
    world = small_world({"box": placed("carton_of_milk", -0.4, 0.0)})
    work = Work(TrueScene(world), Motion(world.robot.proprioception()), np.random.default_rng(0))
    for action in back_off(work):
        world.robot.act(action)
        world.step()
        work.motion.felt = world.robot.proprioception()
    x, y, yaw = work.motion.felt.base_pose
    assert -0.3 < x < -0.1
    assert abs(y) > 0.2
    assert yaw == pytest.approx(0.0, abs=0.03)


def test_a_step_back_ends_before_what_stands_there() -> None:
    """After a failure the robot steps back in the open; with its back to something it stays where it is."""
    assert backed_off(by=step_back)[0] == pytest.approx(-0.15, abs=0.02)
    world = small_world({"box": placed("carton_of_milk", -0.45, 0.0)})
    work = Work(TrueScene(world), Motion(world.robot.proprioception()), np.random.default_rng(0))
    assert not list(step_back(work))


def test_who_touches_something_backs_off_it() -> None:
    """A head that is bent into the edge of a shelf, by what a picture shows, comes out of there with the base."""
    world = small_world()
    bent = world.robot.action.copy()
    bent[LAYOUT.torso] = (0.3, 0.0, 0.8, 0.0)
    run(world, bent, 2.0)
    world.robot.act(bent)
    scene = Unseeing(world)
    scene.obstacles = lambda *_, **__: Surroundings([box((0.6, 0.0, 1.1), (0.2, 0.6, 0.02))])  # type: ignore[method-assign]
    work = Work(scene, Motion(world.robot.proprioception()), np.random.default_rng(0))
    assert not work.body().trunk_free()
    assert played(world, work, back_off(work))[0] == pytest.approx(-0.35, abs=0.02)
    assert work.body().trunk_free()


class Unseeing(TrueScene):
    """A scene of which no picture has shown what stands about the robot."""

    def obstacles(
        self, xy: Array, radius_m: float, without: Collection[str] = (), beside: str | None = None
    ) -> Surroundings:
        """Nothing."""
        return NOTHING


def before_a_wall(yaw: float) -> tuple[SimWorld, Work]:
    """The robot 9 cm off the wall at x = -3, which it has not seen."""
    world = small_world(base=(-2.64, 0.0, yaw))
    return world, Work(Unseeing(world), Motion(world.robot.proprioception()), np.random.default_rng(0))


def played(world: SimWorld, work: Work, actions: Actions) -> Array:
    """Where the base is (3,) after these actions."""
    for action in actions:
        world.robot.act(action)
        world.step()
        work.motion.felt = world.robot.proprioception()
    return np.asarray(work.motion.felt.base_pose)


def test_what_the_base_has_met_it_does_not_drive_into_again() -> None:
    """With its back to a wall that it has never seen the robot is held up once, and stays where it is then."""
    world, work = before_a_wall(yaw=0.0)
    with pytest.raises(MotionFailure, match="base_blocked"):
        played(world, work, back_off(work))
    assert not list(back_off(work))
    assert not list(step_back(work))
    assert not work.search("right", ()).drivable(work.motion.felt.base_pose, np.array([-3.0, 0.0, 0.0]))
    assert work.search("right", ()).drivable(work.motion.felt.base_pose, np.array([-2.4, 0.0, 0.0]))


def test_held_up_obliquely_it_goes_along() -> None:
    """A wall that stands obliquely behind the robot holds it up at the most twice; then it backs off along that."""
    world, work = before_a_wall(yaw=0.9)
    for _ in range(3):
        start = work.motion.felt.base_pose.copy()
        with contextlib.suppress(MotionFailure):
            played(world, work, back_off(work))
            break
    assert np.linalg.norm((work.motion.felt.base_pose - start)[:2]) > 0.18
    assert len(work.motion.bumps) in (1, 2)


def test_what_the_base_has_met_is_not_strolled_through() -> None:
    """Another side to look at a place from is not sought behind what held the base up on its way to the first."""
    world, work = before_a_wall(yaw=0.0)
    place = np.array([-2.64, -1.2])  # first seen from x = -3.4
    for _ in range(2):
        played(world, work, look_from_elsewhere(work, place, lambda: NOTHING))
    assert len(work.motion.bumps) == 1


def test_an_arm_that_meets_what_nobody_knows_of_is_folded_from_farther_back() -> None:
    """No picture need have shown the shelf that an arm is still in: nothing on the way home seems to be there."""
    world = small_world()
    reaching = world.robot.action.copy()
    reaching[LAYOUT.arm["left"]] = (-0.9, 0.3, 0.0, -0.9, 0.0, 0.2, 0.0)
    run(world, reaching, 2.0)
    world.robot.act(reaching)
    work = Work(Unseeing(world), Motion(world.robot.proprioception()), np.random.default_rng(0))
    for action in settle(work):
        felt = work.motion.felt
        if felt.base_pose[0] > -0.1:
            action[LAYOUT.arm["left"]] = felt.arm["left"]
        world.robot.act(action)
        world.step()
        work.motion.felt = world.robot.proprioception()
    for side in SIDES:
        np.testing.assert_allclose(work.motion.felt.arm[side], R1.travel_arm[side], atol=0.03)


def test_a_robot_with_empty_hands_straightens_up_out_of_what_it_takes_itself_to_be_in() -> None:
    """What pictures hide counts as solid, above a desk that it is bent over, too: it would stay bent for ever."""
    world = small_world()
    bent = world.robot.action.copy()
    bent[LAYOUT.torso] = (0.3, 0.0, 0.6, 0.2)
    run(world, bent, 2.0)
    world.robot.act(bent)
    scene = Unseeing(world)
    scene.obstacles = lambda *_, **__: Surroundings([box((0.0, 0.0, 1.1), (2.0, 2.0, 1.2))])  # type: ignore[method-assign]
    work = Work(scene, Motion(world.robot.proprioception()), np.random.default_rng(0))
    played(world, work, settle(work))
    np.testing.assert_allclose(work.motion.felt.torso[:3], R1.travel_torso[:3], atol=0.02)
