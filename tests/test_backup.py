"""A policy with another one behind it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mpvi_bt.executive.actions.backup import WithBackup
from mpvi_bt.executive.plan.skills import load_skills
from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.robot.robots import layout_of
from mpvi_bt.runs.choices.backends import choose, pair
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.choices.policies import PolicyInputs, check_policy_choice, make_policy
from tests.test_frames import AT_REST

SKILLS = load_skills()


class Doer:
    """A policy that does prompts which begin with one of some verbs, each in two chunks."""

    cameras = ()

    def __init__(self, name, *verbs):
        self.name, self.verbs, self.did = name, verbs, []
        self.reset()

    def reset(self):
        self.note, self.ended, self.gave_up, self.asked = "", False, False, 0

    def infer(self, observation):
        said = observation["prompt"]
        self.asked += 1
        if " then " in said or not said.startswith(self.verbs):
            self.ended = self.gave_up = True
            self.note = "no_skill: that"
        elif self.asked == 2:
            self.ended = True
            self.did.append(said)
        return np.zeros((3, 23))


def play(policy, prompt, chunks=20):
    for _ in range(chunks):
        policy.infer({"prompt": prompt, "proprioception": AT_REST, "images": {}})


def test_each_clause_is_done_by_the_first_policy_that_has_a_skill_for_it():
    """The second one does what the first one refuses, in order, and nothing else."""
    first, second = Doer("a", "pick"), Doer("b", "pick", "put", "open")
    both = WithBackup(first, second, SKILLS)
    play(both, "open the drawer, then pick up the can, then put the can in the bin")
    assert first.did == ["pick up the can"]
    assert second.did == ["open the drawer", "put the can in the bin"]
    assert both.prompts == {"a": 1, "b": 2}
    assert both.ended
    assert not both.gave_up


def test_the_first_policy_may_be_held_to_some_skills():
    """What it could do besides is left to the second one, a prompt's clauses in order; it is never asked."""
    first, second = Doer("a", "pick", "put"), Doer("b", "put")
    both = WithBackup(first, second, SKILLS, only=("pick",))
    play(both, "pick up the can, then put the can in the bin")
    play(both, "put the can on the table")
    assert first.did == ["pick up the can"]
    assert second.did == ["put the can in the bin", "put the can on the table"]
    assert both.prompts == {"a": 1, "b": 2}


class Silent:
    """A policy that does whatever it is told, and never says that it has ended, such as one of LeRobot's."""

    name, cameras, rate_hz, actions = "silent", (), 10.0, "delta"

    def __init__(self, gripper=-1.0):
        self.told, self.gripper = [], gripper

    def reset(self):
        pass

    def infer(self, observation):
        self.told.append(observation["prompt"])
        chunk = np.zeros((5, 23))
        chunk[:, list(layout_of(observation["proprioception"]).gripper.values())] = self.gripper
        return chunk


def felt(holding):
    """A robot at rest whose right hand holds something, or is closed and empty."""
    widths = {**AT_REST.gripper_width, "right": 0.05 if holding else 0.0}
    commands = {**AT_REST.gripper_command, "right": -1.0}
    return replace(AT_REST, gripper_width=widths, gripper_command=commands)


@pytest.mark.parametrize(
    ("prompt", "only", "held", "chunks"),
    [
        # One look before the first chunk of half a second tells how it began; then two chunks make a second.
        ("pick up the can, then put the can in the bin", "pick", "--++++", 2),
        ("pick up the can, then put the can in the bin", "pick", "--+-++", 4),
        ("pick up the can, then put the can in the bin", "pick", "------", 5),
        ("put the can in the bin, then pick up the can", "place_in", "++----", 2),
        ("open the drawer, then pick up the can", "open", "--++++", 5),
    ],
)
def test_a_policy_that_cannot_say_that_it_has_ended_is_felt_to(prompt, only, held, chunks):
    """A clause that brings something into a hand, or out of it, ends once that has been so for a second."""
    first, second = Silent(), Doer("b", "pick", "put")
    both = WithBackup(first, second, SKILLS, only=(only,))
    for sign in held:
        both.infer({"prompt": prompt, "proprioception": felt(sign == "+"), "images": {}})
    assert first.told == [prompt.partition(", then ")[0]] * chunks
    assert second.asked == (2 if chunks == 2 else 0)


@pytest.mark.parametrize(
    ("prompt", "hand", "missed"),
    [
        ("pick up the can, then put the can in the bin", "o" + "-" * 17, True),
        ("pick up the can", "o" + "-" * 16, True),
        ("pick up the can", "o" + "-" * 15, False),
        ("pick up the can", "o" + "-" * 10 + "o" + "-" * 10, False),  # it opens again
        ("pick up the can", "o" + "-" * 10 + "+" + "-" * 10, False),  # it held something in between
        ("pick up the can", "-" * 40, False),  # it has not been open yet
        ("put the can in the bin", "o" + "-" * 40, False),
    ],
)
def test_a_hand_that_stays_closed_on_nothing_has_missed(prompt, hand, missed):
    """After 8 s a policy that never says so has given up a pick, and the robot stands still; "o" is an open hand."""
    both = WithBackup(Silent(), Doer("b"), SKILLS, only=("pick",) if " then " in prompt else None)
    chunk = np.zeros((0, 0))
    for sign in hand:
        body = felt(sign == "+") if sign != "o" else AT_REST
        chunk = both.infer({"prompt": prompt, "proprioception": body, "images": {}})
    assert both.gave_up is missed
    assert both.ended is missed
    assert len(chunk) == (1 if missed else 5)
    assert ("closed_empty" in both.note) is missed
    assert both.actions == ("absolute" if missed else "delta")  # its one row is where the joints are
    both.reset()  # the next handoff
    assert not both.gave_up


def test_a_hand_that_opens_between_two_looks_has_not_missed():
    """A policy that tries again within its chunk is closed on nothing at each look."""
    both = WithBackup(Silent(gripper=0.5), Doer("b"), SKILLS)
    for sign in "o" + "-" * 40:
        both.infer(
            {"prompt": "pick up the can", "proprioception": felt(False) if sign == "-" else AT_REST, "images": {}}
        )
    assert not both.gave_up


def test_what_neither_can_do_is_given_up():
    """The second one's refusal is that of both, and its note says whose it is."""
    both = WithBackup(Doer("a", "pick"), Doer("b", "put"), SKILLS)
    play(both, "wipe the table", 4)
    assert both.gave_up
    assert both.note == "b: no_skill: that"


def test_every_action_is_counted_for_the_policy_that_gave_it():
    """A result says which of the two did what."""
    both = WithBackup(Doer("a", "pick"), Doer("b", "put"), SKILLS)
    play(both, "pick up the can", 5)
    assert both.steps == {"a": 15}
    assert both.prompts["b"] == 0


@pytest.mark.parametrize(
    ("given", "both"),
    [("learned+reactive", ("learned", "reactive")), ("learned+openpi:ws://h:1/a+b", ("learned", "openpi:ws://h:1/a+b")),
     ("learned:my.npz+reactive", ("learned:my.npz", "reactive")),
     ("learned[pick]+reactive", ("learned[pick]", "reactive")),
     ("openpi:ws://[::1]:8000[pick, open]+reactive", ("openpi:ws://[::1]:8000[pick, open]", "reactive")),
     ("openpi:ws://[::1]+reactive", ("openpi:ws://[::1]", "reactive")),
     ("openpi:ws://h/a+b", None), ("reactive", None)],
)  # fmt: skip
def test_a_plus_joins_two_policies_unless_it_is_of_an_address(given, both):
    """An address may have a plus of its own."""
    assert pair(given) == both


def test_skills_stand_in_brackets_behind_the_first_policy():
    """Both policies are chosen as without them; an IPv6 address is no list of skills."""
    choice = choose("policy", "openpi:ws://[::1]:8000[pick, open]+reactive")
    assert choice.only == ("pick", "open")
    assert choice.both is not None
    assert choice.both[0].address == "ws://[::1]:8000"
    assert choose("policy", "openpi:ws://[::1]+reactive").only is None


@pytest.mark.parametrize("given", ["learned[pick]", "learned+reactive[pick]", "openpi:ws://h:1[pick]"])
def test_skills_without_anyone_for_the_others_are_refused(given):
    """Nobody would do what the first policy is not to do."""
    with pytest.raises(UserError, match="nobody does the other skills"):
        choose("policy", given)


def test_an_unknown_skill_in_brackets_is_refused_before_the_episode():
    """With the nearest one that there is."""
    with pytest.raises(UserError, match="pick"):
        check_policy_choice(EpisodeConfig(task="picking_up_trash", policy="learned[pik]+reactive"))


def test_the_pair_is_privileged_and_sees_as_either_of_the_two():
    """Reports name what reads simulator truth, behind a plus too."""
    assert choose("policy", "learned+expert").backend.privileged
    assert choose("policy", "learned+expert").backend.sees
    assert not choose("policy", "learned+reactive").backend.privileged


def test_a_policy_does_not_stand_behind_itself():
    """It would refuse twice."""
    with pytest.raises(UserError, match="cannot stand behind itself"):
        make_policy("learned+learned", PolicyInputs(SKILLS))
