"""The shipped doubles keep the contracts, and the contracts catch those who do not."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from mpvi_bt.executive.plan.skills import load_skills
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.protocols import Judgement
from mpvi_bt.ground.robot.protocol import CameraImage
from mpvi_bt.testing import (
    GripPolicy,
    KinematicRobot,
    KinematicWorld,
    ScriptedChecker,
    StraightNavigator,
    check_checker,
    check_navigator,
    check_policy,
    check_robot,
)
from tests.layouts import ACTION_SIZE


def test_the_doubles_keep_their_contracts() -> None:
    """Robot, navigator, policy and checker pass the checks that real ones pass."""
    world = KinematicWorld()
    check_robot(world.robot, world.step)
    check_navigator(StraightNavigator(world.robot, {"sofa": (1, 2)}), world.robot, world.step, "sofa")
    check_policy(GripPolicy(load_skills()))
    check_checker(ScriptedChecker({}))
    check_checker(ScriptedChecker({}, needs_image=False))


class Restless(KinematicRobot):
    """Breaks the contract of hold."""

    def hold(self) -> None:
        action = self.action
        action[0] = 0.5
        self.act(action)


class Gullible(KinematicRobot):
    """Takes any action."""

    def act(self, action: Array) -> None:
        if np.shape(action) == (23,):
            self._action = action


def test_a_bad_robot_is_caught() -> None:
    """A robot that does not hold, or takes what is not finite, fails the check."""
    restless, gullible = Restless(), Gullible()
    with pytest.raises(AssertionError, match="stand still"):
        check_robot(restless, lambda: restless.advance(restless.action))
    with pytest.raises(AssertionError, match="refuse"):
        check_robot(gullible, lambda: gullible.advance(gullible.action))


class Odd(GripPolicy):
    """A policy that is wrong in one way."""

    def __init__(self, wrong: str = "") -> None:
        super().__init__(load_skills())
        self.wrong, self.asked, self.kept = wrong, 0, np.zeros((2, ACTION_SIZE))
        self.seen: list[str] = []

    @property
    def cameras(self) -> Any:  # type: ignore[override]
        return {"a list": ["head"], "an unknown camera": ("rear",), "more later": ("rear",) * (self.asked > 4)}.get(
            self.wrong, ("head",)
        )

    @property
    def note(self) -> Any:
        return {"two lines": "a\nb", "no text": 3}.get(self.wrong, "fine")

    def infer(self, observation: Mapping[str, Any]) -> Any:
        self.asked += 1
        self.seen.append(observation["prompt"])
        action = super().infer(observation)
        if self.wrong == "changes the observation":
            observation["images"].clear()
        elif self.wrong == "hands out its own":
            return self.kept
        elif self.wrong == "is random":
            action[0, 0] = np.random.default_rng().uniform()
        elif self.wrong == "remembers":
            action[0, 0] = 0.01 * len("".join(self.seen))
        elif self.wrong == "many pictures" and len(observation["images"]) > 1:
            return action * np.nan
        elif self.wrong == "another prompt" and "bowl" in observation["prompt"]:
            return np.full_like(action, np.inf)
        return {
            "too short": action[:, :22],
            "flat": action[0],
            "empty": action[:0],
            "not finite": action * np.nan,
            "text": action.astype(str),
            "complex": action.astype(complex),
        }.get(self.wrong, action)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ("a list", "tuple"), ("an unknown camera", "cameras are among"), ("more later", "cameras are among"),
        ("two lines", "note"), ("no text", "note"), ("changes the observation", "not to be changed"),
        ("hands out its own", "finite"), ("is random", "act alike"), ("remembers", "reset must forget"),
        ("many pictures", "more pictures"), ("another prompt", "finite"), ("too short", r"\(H, 23\)"),
        ("flat", r"\(H, 23\)"), ("empty", "H >= 1"), ("not finite", "finite"), ("text", "real numbers"),
        ("complex", "real numbers"),
    ],
)  # fmt: skip
def test_a_bad_policy_is_caught(wrong: str, said: str) -> None:
    """Whatever it breaks of the contract, the check says what that is."""
    with pytest.raises(AssertionError, match=said):
        check_policy(Odd(wrong), make=lambda: Odd(wrong))


def test_a_good_policy_passes_all_of_the_check() -> None:
    """The policy that the bad ones are made of, determinism and memory included; a nameless one does not."""
    check_policy(Odd(), make=Odd)
    nameless = Odd()
    nameless.name = ""
    with pytest.raises(AssertionError, match="name"):
        check_policy(nameless)


class Counting:
    """Drives a little farther at each step, and does not begin anew."""

    name = "counting"
    cameras = ("head",)

    def __init__(self) -> None:
        self.step = 0

    def reset(self) -> None:
        pass

    def infer(self, observation: Mapping[str, Any]) -> Any:
        self.step += 1
        chunk = np.zeros((2, ACTION_SIZE))
        chunk[:, 0] = 0.01 * self.step
        return chunk


def test_a_reset_that_does_nothing_is_caught() -> None:
    """A count of steps that goes on is a memory, too, though prompts make no difference to it."""
    with pytest.raises(AssertionError, match="reset must forget"):
        check_policy(Counting(), make=Counting)


@pytest.mark.parametrize("part", ["proprioception", "picture", "depth", "prompt"])
def test_what_is_changed_in_place_is_caught(part: str) -> None:
    """Arrays that a policy writes into are those of whoever asked."""

    class Writing(Counting):
        def infer(self, observation: Any) -> Any:
            if part == "prompt":
                observation["prompt"] = "another"
            elif part == "proprioception":
                observation["proprioception"].arm["left"][:] = 9.0
            else:
                image = observation["images"]["head"]
                (image.rgb if part == "picture" else image.depth)[:] = 9
            return super().infer(observation)

    with pytest.raises(AssertionError, match="not to be changed"):
        check_policy(Writing())


@pytest.mark.parametrize("part", ["name", "cameras", "reset", "infer"])
def test_what_a_policy_lacks_is_named(part: str) -> None:
    """In words, not as an AttributeError from within the check."""
    parts = {"name": "x", "cameras": (), "reset": lambda self: None, "infer": Counting.infer}
    del parts[part]
    with pytest.raises(AssertionError, match=f"a policy has '{part}'"):
        check_policy(type("Lacking", (), parts)())


@pytest.mark.parametrize(
    ("does", "said"),
    [
        (lambda observation: [[1.0, 2.0], [3.0]], "different lengths"),
        (lambda observation: observation["images"]["left"], r"the pictures of \('head',\).*KeyError: 'left'"),
    ],
    ids=["ragged", "a picture not asked for"],
)
def test_what_breaks_within_a_policy_is_told_in_words(does: Any, said: str) -> None:
    """As every other breach of the contract."""
    policy = Counting()
    policy.infer = does  # type: ignore[method-assign]
    with pytest.raises(AssertionError, match=said):
        check_policy(policy)


class YesMan(ScriptedChecker):
    """Says yes to everything."""

    def check(self, criterion: str, image: CameraImage | None) -> Judgement:
        return Judgement(True, "sure")


def test_a_bad_checker_is_caught() -> None:
    """A yes to nonsense fails the check."""
    with pytest.raises(AssertionError, match="so it is a no"):
        check_checker(YesMan({}))
