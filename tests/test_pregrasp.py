"""Planned pre-grasps: who is at work when, and where the hand is at the handoff."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from mpvi_bt.executive.plan.clauses import match
from mpvi_bt.executive.plan.skills import load_skills
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.robot.protocol import SIDES
from mpvi_bt.hands.policies.pregrasp import PregraspPolicy, WithPregrasp
from mpvi_bt.hands.robots.r1 import R1
from mpvi_bt.house.sim.world import ROBOT
from mpvi_bt.runs.choices.policies import PolicyInputs, with_pregrasp
from tests.numbered_body import numbered_body
from tests.small_house import placed, small_world

SKILLS = load_skills()


class Counting:
    """A policy that ends after so many actions of its own, and counts what it is asked for."""

    def __init__(self, name, camera, ends=10**9):
        self.name, self.cameras, self.note, self.gave_up, self._ends = name, (camera,), f"{name} at work", False, ends
        self.asked = 0

    @property
    def ended(self):
        return self.asked >= self._ends

    def reset(self):
        self.asked = 0

    def infer(self, observation):
        self.asked += 1
        return np.zeros((1, 23))


class Pregrasp(Counting):
    """Stands in for the motion."""

    first = staticmethod(PregraspPolicy(SKILLS).first)


def handed() -> Any:
    """A policy with a pre-grasp of three actions; that policy; that pre-grasp."""
    policy: Any = Counting("learned", "wrist")
    before: Any = Pregrasp("pregrasp", "head", 3)
    return WithPregrasp(policy, before), policy, before


def tell(both, prompt, steps):
    for _ in range(steps):
        both.infer({"prompt": prompt, "proprioception": numbered_body("r1"), "images": {}})


def test_the_policy_is_asked_once_the_pregrasp_has_ended():
    """Cameras and note are of the one at work; the policy looks through its own before it is asked."""
    both, policy, before = handed()
    tell(both, "pick up the can, then put the can in the bin", 2)
    assert (both.cameras, both.note, policy.asked) == (("head",), "pregrasp: pregrasp at work", 0)
    tell(both, "pick up the can, then put the can in the bin", 1)
    assert (both.cameras, both.note) == (("wrist",), "learned at work")
    tell(both, "pick up the can, then put the can in the bin", 4)
    assert (policy.asked, before.asked) == (4, 3)


@pytest.mark.parametrize("prompt", ["put the can in the bin", "open the fridge, then pick up the can", "hum a tune"])
def test_what_does_not_begin_with_picking_up_is_handed_over_at_once(prompt):
    """There is no pre-grasp of other skills."""
    both, policy, before = handed()
    tell(both, prompt, 2)
    assert (policy.asked, before.asked) == (2, 0)


def test_each_handoff_has_its_pregrasp():
    """A reset begins another handoff, of the same prompt too."""
    both, policy, before = handed()
    tell(both, "pick up the can", 5)
    both.reset()
    tell(both, "pick up the can", 1)
    assert (policy.asked, before.asked) == (0, 1)


def test_the_prompts_hand_comes_before_the_setting_s():
    """A hand that is given is meant where the prompt names none."""
    right = PregraspPolicy(SKILLS, hand="right")
    for prompt, hand in {"pick up the can": "right", "pick up the can with the left hand": "left"}.items():
        call = match(prompt, SKILLS)
        assert call is not None
        assert right.words(call)["hand"] == hand
        assert PregraspPolicy(SKILLS).words(call) == call.arguments


@pytest.mark.render
@pytest.mark.parametrize(("given", "used"), [(None, "left"), ("right", "right")])
def test_the_hand_is_before_the_thing_and_nothing_is_touched(given, used):
    """At the handoff a hand stands open within a hand's breadth of the thing, which is where it was.

    It is the hand on the thing's side, or the one that was given.
    What the navigator has seen to stand is asked for on the way, as by the reactive policy.
    """
    world = small_world({"can": placed("can_of_soda", 0.9, 0.1)}, render=True)
    world.settle()
    before = world.pose("can").copy()
    policy = Counting("learned", "head")
    asked = []

    def standing(x, y, z):
        asked.append(x)
        return np.zeros((len(x), len(y), len(z)), bool)

    both = with_pregrasp(policy, PolicyInputs(SKILLS, {"can": ("can of soda",)}, standing=standing), given)
    touched = False
    while not policy.asked and world.time_s < 30:
        images = {camera: world.robot.look(camera) for camera in both.cameras}
        felt = world.robot.proprioception()
        world.robot.act(both.infer({"prompt": "pick up the can of soda", "proprioception": felt, "images": images})[0])
        world.step()
        touched |= any({ROBOT, "can"} == {a, b} for a, b, _ in world.contacts())
    assert policy.asked
    assert asked
    assert not touched
    np.testing.assert_allclose(world.pose("can"), before, atol=2e-3)
    felt = world.robot.proprioception()
    T_world_base = kin.base(felt.base_pose)
    hands = {side: T_world_base @ R1.tcp(felt.torso, felt.arm[side], side) for side in SIDES}
    side = min(SIDES, key=lambda s: np.linalg.norm(hands[s][:3, 3] - before[:3, 3]))
    assert side == used
    assert np.linalg.norm(hands[side][:3, 3] - before[:3, 3]) < 0.2
    assert felt.gripper_width[side] > 0.05
