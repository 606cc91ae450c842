"""The contracts of robots, policies, navigators and checkers, as checks that fakes and real ones pass."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from mpvi_bt.behaviors.protocols import Checker, Navigator, Policy, Progress, Report
from mpvi_bt.errors import BackendError
from mpvi_bt.robot.protocol import (
    ACTION_SIZE,
    SIDES,
    ActionLayout,
    Robot,
)
from mpvi_bt.robot.solids import Array
from mpvi_bt.testing.doubles import OPEN_M, KinematicRobot


def _require(condition: bool, what: str) -> None:
    """Raises AssertionError naming the broken clause of the contract (kept under `python -O`)."""
    if not condition:
        raise AssertionError(what)


def check_robot(robot: Robot, step: Callable[[Array], None]) -> None:
    """The contract of a Robot.

    Args:
        robot: At rest.
        step: Carries out one control step of an action.

    Raises:
        AssertionError: What it breaks.
    """
    body = robot.proprioception()
    for name, value, shape in (
        ("base_pose", body.base_pose, (3,)),
        ("base_velocity", body.base_velocity, (3,)),
        ("torso", body.torso, (4,)),
        *((f"arm[{s}]", body.arm[s], (7,)) for s in SIDES),
        *((f"arm_velocity[{s}]", body.arm_velocity[s], (7,)) for s in SIDES),
    ):
        _require(value.shape == shape and bool(np.isfinite(value).all()), f"{name} must be {shape} and finite")
    for side in SIDES:
        _require(-0.005 <= body.gripper_width[side] <= OPEN_M + 0.005, "gripper_width must be 0 to 0.10 m")
        _require(-1 <= body.gripper_command[side] <= 1, "gripper_command must be -1 to 1")
    for bad in (np.zeros(ACTION_SIZE - 1), np.zeros((1, ACTION_SIZE)), np.full(ACTION_SIZE, np.nan)):
        try:
            robot.act(bad)
        except BackendError:
            continue
        _require(False, f"act must refuse an action of shape {bad.shape} and what is not finite")
    robot.hold()
    held = robot.action
    _require(held.shape == (ACTION_SIZE,), "action must be (23,)")
    _require(not held[ActionLayout.BASE].any(), "hold must command the base to stand still")
    held[:] = 99.0
    _require(not np.array_equal(robot.action, held), "action must be a copy")
    before = robot.proprioception()
    for _ in range(5):
        robot.hold()
        step(robot.action)
    after = robot.proprioception()
    _require(bool(np.allclose(before.base_pose, after.base_pose, atol=5e-3)), "hold must keep the base in place")
    for side in SIDES:
        _require(bool(np.allclose(before.arm[side], after.arm[side], atol=2e-2)), "hold must keep the arms in place")


def check_policy(policy: Policy, observation: Mapping[str, Any] | None = None) -> None:
    """The contract of a Policy.

    Args:
        policy: Any.
        observation: What to show it; by default a robot at rest, black pictures, and "pick up the cup".

    Raises:
        AssertionError: What it breaks.
    """
    _require(bool(policy.name), "a policy has a name")
    _require(set(policy.cameras) <= {"head", *SIDES}, "cameras are among head, left, right")
    if observation is None:
        robot = KinematicRobot()
        images = {camera: robot.look(camera) for camera in policy.cameras}
        observation = {"prompt": "pick up the cup", "proprioception": robot.proprioception(), "images": images}
    for _ in range(2):
        policy.reset()
        policy.reset()
        for _ in range(3):
            chunk = np.asarray(policy.infer(observation))
            _require(chunk.ndim == 2 and len(chunk) >= 1, "infer must give (H, 23), H >= 1")
            _require(chunk.shape[1] == ACTION_SIZE, f"infer must give (H, 23), not {chunk.shape}")
            _require(bool(np.isfinite(chunk).all()), "actions must be finite")


def check_navigator(
    navigator: Navigator, robot: Robot, step: Callable[[Array], None], target: str, max_steps: int = 3000
) -> None:
    """The contract of a Navigator.

    Args:
        navigator: Drives `robot`.
        robot: At rest.
        step: Carries out one control step of an action.
        target: Somewhere that can be reached.
        max_steps: How many steps it may take.

    Raises:
        AssertionError: What it breaks.
    """
    navigator.stop()
    navigator.stop()
    report = _drive(navigator, robot, step, target, max_steps)
    _require(report.progress is Progress.SUCCEEDED, f"it must get to {target!r}, not {report}")
    report = _drive(navigator, robot, step, "a thing that nobody has ever put there", max_steps)
    _require(report.progress is Progress.FAILED, "an unknown target is a failure, not an exception or a success")
    _require(bool(report.reason), "a failure has a reason code")


def _drive(navigator: Navigator, robot: Robot, step: Callable[[Array], None], target: str, max_steps: int) -> Report:
    navigator.start(target, None)
    report = Report(Progress.RUNNING)
    for _ in range(max_steps):
        report = navigator.step()
        if report.progress is not Progress.RUNNING:
            break
        step(robot.action)
    navigator.stop()
    _require(not robot.action[ActionLayout.BASE].any(), "stop must let the base stand still")
    return report


def check_checker(checker: Checker) -> None:
    """The contract of a Checker: it answers, and what it cannot decide is a no.

    Raises:
        AssertionError: What it breaks.
    """
    _require(bool(checker.name), "a checker has a name")
    image = KinematicRobot().look("head") if checker.needs_image else None
    for criterion in ("the moon is inside the kettle", "%&/ {} \u2603", "x" * 300):
        judgement = checker.check(criterion, image)
        _require(judgement.complete is False, f"{criterion!r:.30} cannot be decided, so it is a no")
        _require(isinstance(judgement.reason, str) and bool(judgement.reason), "a judgement has a reason")
