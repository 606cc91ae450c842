"""Looking at what is to be worked on."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest

from mpvi_bt.ground.geometry.solids import Array, Solid, pose
from mpvi_bt.ground.robot.collision import Body, Surroundings
from mpvi_bt.ground.robot.model import RobotModel
from mpvi_bt.ground.robot.motion import Actions, Motion, MotionFailure
from mpvi_bt.ground.robot.protocol import CameraImage, Proprioception
from mpvi_bt.hands.motion.approach import close_in
from mpvi_bt.hands.motion.gaze import studied, study
from mpvi_bt.hands.motion.viewpoints import Look
from mpvi_bt.hands.motion.work import Work
from mpvi_bt.hands.policies.visual_search import look_from_elsewhere
from mpvi_bt.hands.robots import r1
from mpvi_bt.hands.robots.r1 import R1
from mpvi_bt.hands.robots.r1pro import R1PRO
from mpvi_bt.hands.skills.inside import looks_inside
from mpvi_bt.hands.skills.place import place_in
from mpvi_bt.hands.stance.stance import Stance
from mpvi_bt.hands.stance.stance_search import Search
from mpvi_bt.house.sim.world import SimWorld
from mpvi_bt.house.truth.true_scene import TrueScene
from mpvi_bt.testing.full_hands import put_in_hands
from tests.layouts import LAYOUT
from tests.small_house import placed, small_world

HUNG = "{entry: wall_cabinet, at: [1.2, 0.0], yaw_deg: 180, z_m: 1.35, shape: {size_m: [0.36, 0.6, 0.7]}}"


class Blind(TrueScene):
    """The truth to a robot that looks all the same, and learns nothing by it."""

    needs_looks, pose_error_m = True, 0.06

    def __init__(self, world: SimWorld) -> None:
        super().__init__(world)
        self.felt = world.robot.proprioception()
        self.lifts: list[float] = []

    def see(self, images: Mapping[str, CameraImage], felt: Proprioception) -> None:
        """As `Scene` says."""
        self.lifts.append(float(felt.torso[0]))


def looking(sight: Blind) -> Work:
    """A robot that looks, and whose pictures are not looked at."""
    work = Work(sight, Motion(sight.felt), np.random.default_rng(0))
    work.images = {"head": None}  # type: ignore[dict-item]
    return work


def test_what_was_just_studied_is_not_studied_again_from_there() -> None:
    """Only once: as soon as the base or an arm has moved, or for another thing, there is something to see again."""
    world = small_world({"can": placed("can_of_soda", 1.0, 0.0)})
    work = looking(Blind(world))
    assert not studied(work, "can")
    for action in study(work, "can"):
        work.motion.felt = replace(work.motion.felt, torso=action[LAYOUT.torso])
    assert studied(work, "can")
    assert not studied(work, None)
    there = work.motion.felt
    work.motion.felt = replace(there, base_pose=there.base_pose + [0.02, 0.0, 0.0])
    assert not studied(work, "can")
    work.motion.felt = replace(there, arm={**there.arm, "left": there.arm["left"] + 0.02})
    assert not studied(work, "can")
    work.motion.felt = there
    assert studied(work, "can")


@pytest.mark.parametrize("board_m", [0.4, 0.9, 1.35, 1.6])
def test_no_look_asks_more_of_the_torso_than_it_can(board_m: float) -> None:
    """However high a compartment is, the torso stays within its limits while it is looked into, and what it is told."""
    cabinet = (
        f"{{entry: wall_cabinet, at: [1.2, 0.0], yaw_deg: 180, z_m: {board_m}, shape: {{size_m: [0.36, 0.6, 0.7]}}}}"
    )
    world = small_world({"can": placed("can_of_soda", 1.2, 0.0, board_m + 0.02)}, wall_cabinet_1=cabinet)
    work = looking(Blind(world))
    told = []
    for action in study(work, "can"):
        told.append(action[LAYOUT.torso])
        work.motion.felt = replace(work.motion.felt, torso=told[-1])
    low, high = r1.TORSO_LIMITS.T
    assert len(told) > 1
    assert (np.stack(told) >= low - 1e-9).all()
    assert (np.stack(told) <= high + 1e-9).all()


@pytest.mark.parametrize("board_m", [0.02, 0.3, 0.6, 0.9])
def test_hanging_hands_do_not_meet_the_base_while_a_low_thing_is_looked_at(board_m: float) -> None:
    """A trunk that folds takes the hands down with it, to where the r1pro's wide base is."""
    cabinet = (
        f"{{entry: wall_cabinet, at: [1.2, 0.0], yaw_deg: 180, z_m: {board_m}, shape: {{size_m: [0.36, 0.6, 0.7]}}}}"
    )
    world = small_world({"can": placed("can_of_soda", 1.2, 0.0, board_m + 0.02)}, robot=R1PRO, wall_cabinet_1=cabinet)
    work = looking(Blind(world))
    told = 0
    for action in study(work, "can"):
        work.motion.felt = felt = replace(work.motion.felt, torso=action[LAYOUT.torso].copy())
        assert Body(R1PRO, felt.torso, felt.arm).all_free(), R1PRO.trunk.posture(felt.torso)
        told += 1
    assert told > 1


def with_can(fixture: str) -> tuple[Work, Blind]:
    """A robot that holds a can before a fixture."""
    world = small_world({"can": placed("can_of_soda", 3.0, 0.0)}, wall_cabinet_1=fixture)
    put_in_hands(world, {"right": "can"})
    sight = Blind(world)
    return looking(sight), sight


def obeyed(work: Work, actions: Actions | Look) -> None:
    """The torso is where it is told to be."""
    for action in actions:
        work.motion.felt = replace(work.motion.felt, torso=action[LAYOUT.torso].copy())


def test_full_hands_keep_nobody_from_looking_into_what_is_high_up() -> None:
    """Before a cabinet on the wall the torso rises with what is held; before one on the floor it stays where it was."""
    work, sight = with_can(HUNG)
    obeyed(work, study(work, "wall_cabinet_1"))
    assert min(sight.lifts) > r1.TORSO_LIMITS[0, 1] - 0.01
    work, sight = with_can("{entry: base_cabinet, at: [1.2, 0.0], yaw_deg: 180}")
    before = work.motion.torso[0]
    obeyed(work, study(work, "wall_cabinet_1"))
    np.testing.assert_allclose(sight.lifts, before, atol=1e-3)


def test_nothing_is_said_to_be_no_container_before_it_was_looked_at() -> None:
    """What a picture happened to show of a cabinet, such as its lower edge, is no reason to give up."""
    work, sight = with_can(HUNG)
    work.scene.volumes = lambda name: ()  # type: ignore[method-assign]
    with pytest.raises(MotionFailure, match="not_a_container"):
        obeyed(work, place_in(work, {"object": "can_of_soda", "container": "wall_cabinet"}, []))
    assert len(sight.lifts) >= 2


@pytest.mark.parametrize("robot", [R1, R1PRO], ids=lambda robot: robot.name)
def test_a_container_in_a_hand_that_shows_no_opening_is_held_out(robot: RobotModel) -> None:
    """Where it is carried the head may see past its rim: it is shown in other places before it is called none."""
    world = small_world({"bin": placed("trash_can", 3.0, 0.0)}, robot=robot)
    put_in_hands(world, {"left": "bin"})
    work = looking(Blind(world))
    room, shown = work.scene.volumes("bin"), [work.motion.hand("left")]
    work.scene.volumes = lambda name: room if len(shown) > 2 else ()  # type: ignore[method-assign]
    for look in looks_inside(work, "bin"):
        if work.scene.volumes("bin"):
            break
        for action in look:
            world.robot.act(action)
            world.step()
            work.motion.felt = world.robot.proprioception()
        T = work.motion.hand("left")
        if min(np.abs(T - before).max() for before in shown) > 0.1:
            shown.append(T)
    assert len(shown) == 3


def test_what_is_larger_than_a_picture_is_looked_at_to_both_sides() -> None:
    """Room that is beside what is in view is found by turning there, before anything is said to be no container."""
    work, _ = with_can(HUNG)
    faced: list[float] = []

    def drive(goal: Array, speed: float = 0.5) -> Actions:
        faced.append(float(goal[2]))
        work.motion.felt = replace(work.motion.felt, base_pose=goal.copy())
        yield from ()

    work.motion.drive = drive  # type: ignore[method-assign]
    room = work.scene.volumes("wall_cabinet_1")
    work.scene.volumes = lambda name: room if min(faced, default=0.0) < -0.4 else ()  # type: ignore[method-assign]
    for look in looks_inside(work, "wall_cabinet_1"):
        obeyed(work, look)
        if work.scene.volumes("wall_cabinet_1"):
            break
    assert max(faced) > 0.4
    assert len(faced) <= 4


def test_a_stance_that_needed_the_benefit_of_the_doubt_is_not_left_for_a_surer_one() -> None:
    """From each next place some other one would seem surer: the base would be driven about, and end nowhere."""
    work, sight = with_can(HUNG)
    doubted, went = [False], list[Array]()

    @contextmanager
    def trusting(remembering: bool = False) -> Iterator[None]:
        doubted[0] = True
        yield
        doubted[0] = False

    def drive(goal: Array, speed: float = 0.5) -> Actions:
        went.append(goal)
        work.motion.felt = replace(work.motion.felt, base_pose=goal.copy())
        yield from ()

    def find(search: Search, here_first: bool) -> Stance | None:
        here = work.motion.felt.base_pose
        if not doubted[0] and not went:
            return None
        base = here if here_first and doubted[0] else here + [0.3, 0.0, 0.0]
        return Stance(base, work.motion.torso, 0, [], np.zeros((0, 4, 4)), [], {}, [base], 0.1)

    sight.trusting = trusting  # type: ignore[method-assign]
    work.motion.drive = drive  # type: ignore[method-assign]
    obeyed(work, close_in(work, "left", (), None, find, []))
    assert len(went) == 1


def test_the_base_does_not_drive_into_what_is_remembered_though_hidden_space_is_trusted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """An arm that is stretched into a compartment needs the benefit of the doubt; the cabinet beside it stands there.

    What is out of view from before a door was seen on the way there.
    """
    work, sight = with_can(HUNG)
    remembers, searched = [True], list[Search]()
    post = Solid("cylinder", np.array([0.05, 0.05, 0.5]), pose((0.0, 1.0, 0.5)))

    @contextmanager
    def trusting(remembering: bool = False) -> Iterator[None]:
        remembers[0] = remembering
        yield
        remembers[0] = True

    def find(search: Search, here_first: bool) -> Stance | None:
        searched.append(search)
        return None

    monkeypatch.setattr(sight, "trusting", trusting)
    monkeypatch.setattr(work, "near", lambda without: Surroundings([post] if remembers[0] else []))
    with pytest.raises(MotionFailure, match="no_stance"):
        obeyed(work, close_in(work, "left", (), None, find, []))
    surely, trusted = searched
    beside = np.array([[0.0, 0.7, 1.57], [0.0, -0.7, 1.57]])
    np.testing.assert_array_equal(surely.stands(beside), [False, True])
    np.testing.assert_array_equal(trusted.stands(beside), [False, True])
    at = np.array([[0.0, 1.0, 0.5]])
    assert surely.everything.distance(at) == 0 < trusted.everything.distance(at)


@pytest.mark.parametrize(("around_m", "far_m"), [((), 0.9), ((0.9,), 1.3), ((0.9, 1.3, 1.8), None)])
def test_what_is_closed_in_is_looked_at_from_farther_off(around_m: tuple[float, ...], far_m: float | None) -> None:
    """From the nearest circle about the place on which something is free to go to; from nowhere if there is none."""
    work, _ = with_can(HUNG)
    place, went = np.array([1.8, 0.0]), list[Array]()
    posts = [
        Solid("cylinder", np.array([0.05, 0.05, 1.0]), pose((*(place - r * np.array([np.cos(a), np.sin(a)])), 1.0)))
        for r in around_m for a in np.arange(-2.8, 2.81, 0.2)
    ]  # fmt: skip

    def drive(goal: Array, speed: float = 0.5) -> Actions:
        went.append(goal)
        yield from ()

    work.motion.drive = drive  # type: ignore[method-assign]
    obeyed(work, look_from_elsewhere(work, place, lambda: Surroundings(posts)))
    assert [pytest.approx(np.linalg.norm(goal[:2] - place)) for goal in went] == ([] if far_m is None else [far_m])
