"""The shipped doubles keep the contracts, and the contracts catch those who do not."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from mpvi_bt.behaviors.protocols import Judgement
from mpvi_bt.plan.skills import load_skills
from mpvi_bt.robot.protocol import ACTION_SIZE, CameraImage
from mpvi_bt.robot.solids import Array
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
    for robot, what in ((Restless(), "stand still"), (Gullible(), "refuse")):
        with pytest.raises(AssertionError, match=what):
            check_robot(robot, robot.advance)


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


class YesMan(ScriptedChecker):
    """Says yes to everything."""

    def check(self, criterion: str, image: CameraImage | None) -> Judgement:
        return Judgement(True, "sure")


def test_a_bad_checker_is_caught() -> None:
    """A yes to nonsense fails the check."""
    with pytest.raises(AssertionError, match="so it is a no"):
        check_checker(YesMan({}))
