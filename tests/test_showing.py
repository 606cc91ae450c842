"""Showing what has been done, while nobody says that it is complete."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mpvi_bt.executive.completion.triggers import ProprioceptiveTriggers
from mpvi_bt.executive.plan.clauses import match
from mpvi_bt.executive.plan.skills import load_skills
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.motion import Motion
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, Side
from mpvi_bt.hands.motion.gaze import look_into
from mpvi_bt.hands.motion.viewpoints import step_up
from mpvi_bt.hands.motion.work import Work
from mpvi_bt.hands.policies.result_views import done_at, fell_beside, views
from mpvi_bt.hands.policies.scripted_policy import Performance, ScriptedPolicy
from mpvi_bt.house.sim.world import SimWorld
from mpvi_bt.house.truth.true_scene import TrueScene
from mpvi_bt.testing.full_hands import put_in_hands
from tests.layouts import BASE, LAYOUT
from tests.small_house import placed, small_world

SKILLS = load_skills()
BIN = placed("trash_can", 1.0, 0.0)


class Done(ScriptedPolicy):
    """It believes to be done at once; it counts how often it began."""

    begun = 0

    def perform(self, work: Work, prompt: str) -> Performance:
        """As of a prompt that has been done."""
        yield from ()
        self.begun += 1
        return match(prompt, self._skills)


def asked_at(world: SimWorld, prompt: str, seconds: float) -> list[Array]:
    """Where torso and base (7,) were at each question that standing still brought."""
    policy = Done(TrueScene(world), SKILLS)
    triggers = ProprioceptiveTriggers(world.robot)
    triggers.reset({"idle": None})
    seen = []
    for _ in range(round(seconds * CONTROL_HZ)):
        felt = world.robot.proprioception()
        world.robot.act(policy.infer({"prompt": prompt, "proprioception": felt, "images": {}})[0])
        world.step()
        if triggers.update() is not None:
            seen.append(np.concatenate([felt.torso, felt.base_pose]))
    return seen


def test_who_is_done_and_not_told_so_shows_it_from_a_few_sides_and_then_stands() -> None:
    """Each question has a view of its own, and there are no more of them however long it lasts."""
    world = small_world({"can": placed("can_of_soda", 2.0, 1.0), "bin": BIN})
    seen = asked_at(world, "put the can of soda in the trash can", 60.0)
    assert 2 <= len(seen) <= 4
    for k, view in enumerate(seen[1:], 1):
        assert min(np.abs(view - before).max() for before in seen[:k]) > 0.1
    assert min(at[4] for at in seen) < seen[0][4] - 0.1, "it has not stood back"
    assert seen[-1][4] > seen[0][4] + 0.1, "it has not gone up to it"


def work_in(world: SimWorld) -> Work:
    """Of a robot that stands before the bin."""
    return Work(TrueScene(world), Motion(world.robot.proprioception()), np.random.default_rng(0))


def test_eyes_that_look_into_a_thing_are_farther_above_it_than_before() -> None:
    """Over the near wall of a bin one sees its floor only from above."""
    work = work_in(small_world({"bin": BIN}))

    def steepness() -> float:
        down = work.motion.robot.head_camera(work.motion.torso)[:3, 3] - work.middle("bin")  # the base is at the origin
        return float(np.arctan2(down[2], -down[0]))

    before = steepness()
    for action in look_into(work, "bin"):
        work.motion.felt = replace(work.motion.felt, torso=action[LAYOUT.torso].copy())
    assert steepness() > before + 0.1


@pytest.mark.parametrize("barred", [False, True])
def test_what_a_wall_may_hide_is_looked_at_from_as_near_as_there_is_a_way(barred: bool) -> None:
    """The eyes come nearer to a bin; before what is in the way they stay where they are."""
    post = {"post": placed("trash_can", 0.6, 0.0)} if barred else {}
    work = work_in(small_world({"bin": placed("trash_can", 1.3, 0.0), **post}))
    for action in step_up(work, "bin"):
        at = work.motion.felt.base_pose + action[BASE] / CONTROL_HZ
        work.motion.felt = replace(work.motion.felt, torso=action[LAYOUT.torso].copy(), base_pose=at)
    gap = float(np.linalg.norm(work.middle("bin")[:2] - work.motion.felt.base_pose[:2]))
    assert gap == pytest.approx(1.3) if barred else gap < 0.85


@pytest.mark.parametrize(
    ("prompt", "names"),
    [
        ("put the can of soda in the trash can", ["bin", "can"]),
        ("put the can of soda on the floor", ["can"]),
        ("pick up the can of soda", ["can"]),
        ("put the can of soda on the moon", ["can"]),
        ("put the can of soda on the floor next to the trash can", ["bin", "can"]),
    ],
)
def test_what_is_looked_at_is_where_it_was_to_be_done(prompt: str, names: list[str]) -> None:
    """The place if there is one, and of several things the one there, which is what was put."""
    far = placed("can_of_soda", 0.2, 2.0)
    work = work_in(small_world({"other": far, "can": placed("can_of_soda", 1.0, 0.4), "bin": BIN}))
    call = match(prompt, SKILLS)
    assert call is not None
    shown = done_at(work, call)
    assert shown[0] == names[0] if len(names) == 2 else shown[0] in ("can", "other")
    assert shown[1:] == names[1:]


@pytest.mark.parametrize(
    ("prompt", "ways"),
    [
        ("put the can of soda in the trash can", ["look_into", "stand_back", "step_up"]),
        ("put the can of soda under the trash can", ["stand_back", "look_into"]),
        ("put the can of soda on the moon of the earth", ["stand_back", "look_into"]),
    ],
)
def test_only_a_container_is_looked_into_first(prompt: str, ways: list[str]) -> None:
    """What lies under a thing or beside it is seen together with it from farther off."""
    work = work_in(small_world({"can": placed("can_of_soda", 1.0, 0.4), "bin": BIN}))
    call = match(prompt, SKILLS)
    assert call is not None
    assert [way.__name__ for way in views(work, call)] == ways  # type: ignore[attr-defined]


def test_what_a_hand_has_is_for_its_own_camera_to_see() -> None:
    """The head need not turn to it."""
    world = small_world({"can": placed("can_of_soda", 1.0, 1.0)})
    put_in_hands(world, {"right": "can"})
    call = match("pick up the can of soda", SKILLS)
    assert call is not None
    assert done_at(work_in(world), call) == []


@pytest.mark.parametrize(("held", "begun"), [({"right": "can"}, 1), ({}, 2)])
def test_what_slipped_out_after_it_was_taken_is_taken_anew(held: dict[Side, str], begun: int) -> None:
    """Empty hands show nothing to wait for."""
    world = small_world({"can": placed("can_of_soda", 1.0, 1.0)})
    put_in_hands(world, held)
    policy = Done(TrueScene(world), SKILLS)
    for _ in range(5 * CONTROL_HZ):
        felt = world.robot.proprioception()
        world.robot.act(policy.infer({"prompt": "pick up the can of soda", "proprioception": felt, "images": {}})[0])
        world.step()
    assert policy.begun == begun


@pytest.mark.parametrize(("at", "missed"), [((1.22, 0.0), True), ((1.0, 0.0), False), ((1.0, 1.0), False)])
def test_what_was_to_be_in_a_bin_and_stands_right_beside_it_has_missed_it(
    at: tuple[float, float], missed: bool
) -> None:
    """Another can, farther off, was perhaps never meant."""
    work = work_in(small_world({"can": placed("can_of_soda", *at, z=0.02), "bin": BIN}))
    call = match("put the can of soda in the trash can", SKILLS)
    assert call is not None
    assert fell_beside(work, call) is missed
