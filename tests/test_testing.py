"""The shipped doubles keep the contracts, and the contracts catch those who do not."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from mpvi_bt.behaviors.protocols import Judgement
from mpvi_bt.plan.skills import load_skills
from mpvi_bt.robot.protocol import CameraImage
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


class Short(GripPolicy):
    """Gives actions of the wrong size."""

    def infer(self, observation: Mapping[str, Any]) -> Array:
        return np.zeros((3, 22))


class YesMan(ScriptedChecker):
    """Says yes to everything."""

    def check(self, criterion: str, image: CameraImage | None) -> Judgement:
        return Judgement(True, "sure")


def test_a_bad_policy_and_a_bad_checker_are_caught() -> None:
    """Wrong shapes, and a yes to nonsense, fail the checks."""
    with pytest.raises(AssertionError, match=r"\(H, 23\)"):
        check_policy(Short({}))
    with pytest.raises(AssertionError, match="so it is a no"):
        check_checker(YesMan({}))
