"""Driving by sight and following whole instructions: what the stand-ins for a VLA can do, and what they cannot."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from mpvi_bt.executive.plan.planners import RecordedPlanner
from mpvi_bt.executive.plan.skills import load_skills
from mpvi_bt.executive.tree.compile import prompts_of
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import CONTROL_HZ
from mpvi_bt.hands.policies.demonstrated import DemonstratedPolicy
from mpvi_bt.hands.policies.reactive import ReactivePolicy
from mpvi_bt.hands.policies.scripted_policy import ScriptedPolicy
from mpvi_bt.house.sim.world import SimWorld
from mpvi_bt.house.truth.expert import ExpertPolicy
from mpvi_bt.testing import KinematicRobot, check_policy
from tests.serving import observation
from tests.small_house import placed, small_world

SKILLS = load_skills()
VOCABULARY = {"can": ("can of soda",), "bin": ("trash can",), "table_1": ("table",)}
SCREEN = "{entry: bookcase, at: [1.2, 0.0]}"


def play(world: SimWorld, policy: ScriptedPolicy | DemonstratedPolicy, prompt: str, limit_s: float) -> Array:
    """Have a policy follow a prompt until it thinks that it is done; where the base then is, (3,)."""
    for _ in range(round(limit_s * CONTROL_HZ)):
        images = {camera: world.robot.look(camera) for camera in policy.cameras}
        felt = world.robot.proprioception()
        (action,) = policy.infer({"prompt": prompt, "proprioception": felt, "images": images})
        world.robot.act(action)
        world.step()
        if getattr(policy, "ended", False):
            break
    return world.robot.proprioception().base_pose


def reactive() -> ReactivePolicy:
    return ReactivePolicy(SKILLS, vocabulary=VOCABULARY)


def off(world: SimWorld, name: str, base: Array) -> float:
    """How far the base is from a thing [m]."""
    return float(np.linalg.norm(world.pose(name)[:2, 3] - base[:2]))


# ------------------------------------------------------------------------------------------------- driving


@pytest.mark.render
@pytest.mark.slow
@pytest.mark.parametrize("yaw", [0.0, 2.5, -1.6])
def test_it_turns_until_it_sees_a_thing_and_drives_up_to_it(yaw: float) -> None:
    """From wherever it looks at first; it stops within the handoff distance, the thing before it."""
    world = small_world({"bin": placed("trash_can", 2.0, 1.0)}, base=(-1.5, -1.0, yaw), render=True)
    world.settle()
    policy = reactive()
    base = play(world, policy, "go to the trash can", 60)
    assert policy.note == "done"
    assert 0.4 < off(world, "bin", base) < 1.1
    toward = np.arctan2(*(world.pose("bin")[:2, 3] - base[:2])[::-1])
    assert abs(np.angle(np.exp(1j * (toward - base[2])))) < 0.3


@pytest.mark.render
@pytest.mark.slow
def test_what_bars_the_straight_way_is_driven_around() -> None:
    """It sees the thing past a cabinet's side only after it has turned away from what it bumps into."""
    things = {"bin": placed("trash_can", 2.4, -0.3)}
    world = small_world(things, base=(-1.0, 0.3, 0.0), render=True, screen=SCREEN)
    world.settle()
    base = play(world, reactive(), "go to the trash can", 150)
    assert off(world, "bin", base) < 1.3


def test_where_nobody_says_that_it_is_there_it_looks_again_from_aside() -> None:
    """What it carries may hide the thing: it turns to either side of it, so that there is something new to see."""
    world = small_world({"bin": placed("trash_can", 1.2, 0.0)})
    world.settle()
    policy = ExpertPolicy(world, SKILLS)
    there = play(world, policy, "go to the trash can", 20)
    yaws = []
    for _ in range(10 * CONTROL_HZ):
        felt = world.robot.proprioception()
        (action,) = policy.infer({"prompt": "go to the trash can", "proprioception": felt, "images": {}})
        world.robot.act(action)
        world.step()
        yaws.append(felt.base_pose[2] - there[2])
    assert (min(yaws), max(yaws)) == pytest.approx((-0.4, 0.4), abs=0.1)


def test_without_pictures_it_drives_by_what_it_knows() -> None:
    """The expert knows where things are, and finds no way either: it goes straight."""
    world = small_world({"bin": placed("trash_can", 2.0, 1.0)}, base=(-1.5, -1.0, 2.0))
    world.settle()
    assert off(world, "bin", play(world, ExpertPolicy(world, SKILLS), "go to the trash can", 40)) < 1.1


@pytest.mark.render
@pytest.mark.slow
def test_what_is_not_there_is_looked_for_in_vain() -> None:
    """It wanders, and never thinks that it is there."""
    world = small_world(base=(0.0, 0.0, 0.0), render=True)
    policy = reactive()
    base = play(world, policy, "go to the trash can", 40)
    assert not policy.ended
    assert np.linalg.norm(base[:2]) > 0.5


# -------------------------------------------------------------------------------------------- instructions


class Ends(ScriptedPolicy):
    """Notes what it is told, and ends every prompt after three steps."""

    def __init__(self) -> None:
        self.told: list[str] = []
        super().__init__(None, {})  # type: ignore[arg-type]

    def infer(self, observation: Mapping[str, Any]) -> Array:
        """Nothing, three times."""
        prompt = observation["prompt"]
        self.told.append(prompt)
        self.ended = self.told[-3:] == [prompt] * 3
        return np.zeros((1, 23))


def tell(policy: DemonstratedPolicy, prompt: str, steps: int) -> None:
    felt = KinematicRobot().proprioception()
    for _ in range(steps):
        policy.infer({"prompt": prompt, "proprioception": felt, "images": {}})


def test_an_instruction_is_followed_prompt_by_prompt() -> None:
    """In the order of the demonstration, each until the policy thinks that it is done; the last one for ever."""
    inner = Ends()
    policy = DemonstratedPolicy(inner, {"Tidy  up.": ["go to the cup", "pick up the cup", "go to the sink"]})
    tell(policy, "tidy up.", 20)
    assert inner.told == ["go to the cup"] * 3 + ["pick up the cup"] * 3 + ["go to the sink"] * 14
    assert policy.note.startswith("3 of 3, go to the sink")


def test_an_instruction_is_given_up_with_its_last_prompt() -> None:
    """What is given up before that is passed over, as a plan does."""
    inner = Ends()
    policy = DemonstratedPolicy(inner, {"a": ["x", "y"]})
    for steps, last in ((3, False), (1, True)):
        tell(policy, "a", steps)
        inner.gave_up = True
        assert policy.gave_up is last


def test_a_handoff_begins_the_instruction_anew() -> None:
    """As for any policy; another instruction does, too."""
    inner = Ends()
    policy = DemonstratedPolicy(inner, {"a": ["x", "y"], "b": ["z"]})
    tell(policy, "a", 4)
    policy.reset()
    tell(policy, "a", 1)
    tell(policy, "b", 1)
    assert inner.told == ["x", "x", "x", "y", "x", "z"]


def test_what_was_not_demonstrated_is_taken_for_a_prompt() -> None:
    """It does what the other policy alone does; a handoff, or another prompt, begins anew there, too."""
    prompts = ["pick up the can of soda"] * 3 + ["sing a song"] * 2
    here, there = reactive(), DemonstratedPolicy(reactive(), {"a": ["x"]})
    for prompt in prompts:
        seen = observation(prompt)
        np.testing.assert_array_equal(there.infer(seen), here.infer(seen))
        assert (there.note, there.cameras) == (here.note, here.cameras)
    assert there.note == "no skill for 'sing a song'"


def test_it_keeps_the_contract_of_a_policy() -> None:
    """Whatever it is told."""
    told = {"prompt": "a", "proprioception": KinematicRobot().proprioception(), "images": {}}
    for shown in (None, told):
        check_policy(DemonstratedPolicy(reactive(), {"a": ["pick up the can of soda"]}), shown)


def test_every_recorded_plan_comes_apart_into_prompts() -> None:
    """A prompt for each unit, in the plan's own words and order."""
    for plan in RecordedPlanner().all():
        joined = ", then ".join(prompts_of(plan))
        assert joined == ", then ".join(segment.description for segment in plan.segments)
