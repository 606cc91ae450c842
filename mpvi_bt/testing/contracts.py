"""The contracts of robots, policies, navigators, checkers and detectors, as checks that fakes and real ones pass."""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from mpvi_bt.finding.perception.detector import ROBOT, Detection, Detector, check_detection
from mpvi_bt.ground.errors import BackendError, DetectorError, shown
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.protocols import Checker, Navigator, Policy, Progress, Report
from mpvi_bt.ground.robot.protocol import CameraImage, Robot
from mpvi_bt.ground.robot.robots import layout_of, robot_named
from mpvi_bt.testing.doubles import KinematicRobot


def _require(condition: bool, what: str) -> None:
    """Raises AssertionError naming the broken clause of the contract (kept under `python -O`)."""
    if not condition:
        raise AssertionError(what)


def check_robot(robot: Robot, step: Callable[[], None]) -> None:
    """The contract of a Robot.

    Args:
        robot: At rest.
        step: Carries out the command of `robot` for one control step.

    Raises:
        AssertionError: What it breaks.
    """
    body = robot.proprioception()
    model = robot_named(body.robot)
    size, joints = model.layout.size, len(model.torso_joints)
    for name, value, shape in (
        ("base_pose", body.base_pose, (3,)),
        ("base_velocity", body.base_velocity, (3,)),
        ("torso", body.torso, (joints,)),
        ("torso_velocity", body.torso_velocity, (joints,)),
        *((f"arm[{s}]", body.arm[s], (len(model.arm_joints[s]),)) for s in body.sides),
        *((f"arm_velocity[{s}]", body.arm_velocity[s], (len(model.arm_joints[s]),)) for s in body.sides),
    ):
        _require(value.shape == shape and bool(np.isfinite(value).all()), f"{name} must be {shape} and finite")
    _require(len(body.sides) >= 1, "a robot must have a hand")
    for side in body.sides:
        _require(-0.005 <= body.gripper_width[side] <= body.open_m + 0.005, "gripper_width must be 0 to open_m")
        _require(-1 <= body.gripper_command[side] <= 1, "gripper_command must be -1 to 1")
    for bad in (np.zeros(size - 1), np.zeros((1, size)), np.full(size, np.nan)):
        try:
            robot.act(bad)
        except BackendError:
            continue
        _require(False, f"act must refuse an action of shape {bad.shape} and what is not finite")
    robot.hold()
    held = robot.action
    _require(held.shape == (size,), f"action must be ({size},)")
    _require(not model.layout.velocity(held).any(), "hold must command the base to stand still")
    held[:] = 99.0
    _require(not np.array_equal(robot.action, held), "action must be a copy")
    before = robot.proprioception()
    for _ in range(5):
        robot.hold()
        step()
    after = robot.proprioception()
    _require(bool(np.allclose(before.base_pose, after.base_pose, atol=5e-3)), "hold must keep the base in place")
    for side in body.sides:
        _require(bool(np.allclose(before.arm[side], after.arm[side], atol=2e-2)), "hold must keep the arms in place")


def check_policy(
    policy: Policy, observation: Mapping[str, Any] | None = None, make: Callable[[], Policy] | None = None
) -> None:
    """The contract of a Policy.

    Args:
        policy: Any.
        observation: What to show it; by default a robot at rest, black pictures, and "pick up the cup".
        make: Makes a policy like it, with the same seed: then it is checked, too, that equal ones do the same, and that
            what came before a reset makes no difference after it.

    Raises:
        AssertionError: What it breaks.
    """
    for part in ("name", "cameras", "reset", "infer"):
        _require(hasattr(policy, part), f"a policy has {part!r}")
    _require(isinstance(policy.name, str) and bool(policy.name), "a policy has a name")
    body = observation["proprioception"] if observation else KinematicRobot().proprioception()
    robot = KinematicRobot(robot_named(body.robot))
    shown = dict(observation or {"prompt": "pick up the cup", "proprioception": body, "images": {}})
    shown.setdefault("command", robot.action)
    every = {camera: shown["images"].get(camera) or robot.look(camera) for camera in robot.model.cameras}
    for _ in range(2):
        policy.reset()
        policy.reset()
        for _ in range(3):
            chunk = _chunk(policy, shown, every)
            if chunk.flags.writeable and chunk.dtype.kind == "f":
                chunk[:] = np.nan  # it is the caller's now: the next one must not be made of it
    _chunk(policy, {**shown, "prompt": "put the bowl on the table"}, every)
    _chunk(policy, {**shown, "prompt": ""}, every)
    policy.reset()
    try:
        _actions(policy.infer({**shown, "images": dict(every)}), layout_of(body).size)
    except Exception as error:
        _require(False, f"it must not mind more pictures than it asked for: {error}")
    note = getattr(policy, "note", "")
    _require(isinstance(note, str) and note.isprintable(), "a note is one line of text")
    for said in ("gave_up", "ended"):
        _require(isinstance(getattr(policy, said, False), bool), f"{said} is true or false")
    progress = getattr(policy, "progress", None)
    _require(progress is None or 0.0 <= progress <= 1.0, "progress is 0 to 1, or None")
    policy.reset()
    _require(not getattr(policy, "gave_up", False), "after a reset nothing has been given up")
    _require(not getattr(policy, "ended", False), "after a reset nothing has ended")
    if make is not None:
        _check_memory(make, shown, every)


def _check_memory(make: Callable[[], Policy], shown: Mapping[str, Any], every: Mapping[str, CameraImage]) -> None:
    """Equal policies do the same, and forget at a reset, whatever was asked for before it and how often."""

    def after(policy: Policy, prompt: str, calls: int) -> list[Array]:
        policy.reset()
        before = [_chunk(policy, {**shown, "prompt": prompt}, every) for _ in range(calls)]
        policy.reset()
        return before + [_chunk(policy, shown, every) for _ in range(3)]

    first, twin = after(make(), shown["prompt"], 3), after(make(), shown["prompt"], 3)
    _require(all(map(np.array_equal, first, twin)), "equal policies with one seed must act alike")
    for prompt, calls in (("put the bowl on the table", 3), (shown["prompt"], 1), (shown["prompt"], 5)):
        other = after(make(), prompt, calls)
        same = all(map(np.array_equal, first[-3:], other[-3:]))
        _require(same, "reset must forget: what was asked for before it, or how often, changes what is done after it")


def _chunk(policy: Policy, observation: Mapping[str, Any], every: Mapping[str, CameraImage]) -> Array:
    """Get the next chunk with the requested pictures, and check that the policy did not change its input."""
    cameras = policy.cameras
    _require(isinstance(cameras, tuple), "cameras is a tuple")
    _require(set(cameras) <= set(every), f"cameras are among {', '.join(every)}, not {cameras}")
    images = {camera: every[camera] for camera in cameras}
    given, before = {**observation, "images": dict(images)}, copy.deepcopy({**observation, "images": images})
    try:
        said = policy.infer(given)
    except BackendError:
        raise  # what it needs is away or broke; that breaks no contract
    except Exception as error:
        kind = f"{type(error).__name__}: {error}"
        raise AssertionError(f"infer raised, with the pictures of {cameras} that it asked for: {kind}") from error
    actions = _actions(said, layout_of(observation["proprioception"]).size)
    _require(_same(given, before), "an observation is not to be changed")
    return actions


def _same(one: Any, other: Any) -> bool:
    """Whether two observations, or parts of them, hold the same, arrays by what is in them."""
    if isinstance(one, np.ndarray):
        return isinstance(other, np.ndarray) and np.array_equal(one, other, equal_nan=one.dtype.kind == "f")
    if isinstance(one, Mapping):
        return isinstance(other, Mapping) and one.keys() == other.keys() and all(_same(one[k], other[k]) for k in one)
    if isinstance(one, list):
        return isinstance(other, list) and len(one) == len(other) and all(map(_same, one, other))
    if dataclasses.is_dataclass(one):
        return type(one) is type(other) and _same(vars(one), vars(other))
    return bool(one == other)


def _actions(given: Any, size: int) -> Array:
    try:
        chunk = np.asarray(given)
    except ValueError:
        raise AssertionError(f"infer must give (H, {size}), not lists of different lengths") from None
    _require(chunk.ndim == 2 and len(chunk) >= 1, f"infer must give (H, {size}), H >= 1, not {chunk.shape}")
    _require(chunk.shape[1] == size, f"infer must give (H, {size}), not {chunk.shape}")
    _require(chunk.dtype.kind in "fiu", f"actions are real numbers, not {chunk.dtype}")
    _require(bool(np.isfinite(chunk).all()), "actions must be finite")
    return chunk


def check_navigator(
    navigator: Navigator, robot: Robot, step: Callable[[], None], target: str, max_steps: int = 3000
) -> None:
    """The contract of a Navigator.

    Args:
        navigator: Drives `robot`.
        robot: At rest.
        step: Carries out the command of `robot` for one control step.
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


def _drive(navigator: Navigator, robot: Robot, step: Callable[[], None], target: str, max_steps: int) -> Report:
    navigator.start(target, None)
    report = Report(Progress.RUNNING)
    for _ in range(max_steps):
        report = navigator.step()
        if report.progress is not Progress.RUNNING:
            break
        step()
    navigator.stop()
    _require(not layout_of(robot.proprioception()).velocity(robot.action).any(), "stop must let the base stand still")
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


def check_detector(
    make: Callable[[], Detector],
    pictures: Sequence[CameraImage] = (),
    phrases: Sequence[str] = ("cup", "can of soda", "trash can"),
) -> None:
    """The contract of a Detector.

    Args:
        make: Makes one, each time with the same seed.
        pictures: What to show it; by default what a robot at rest sees, without labels.
        phrases: What to ask for.

    Raises:
        AssertionError: What it breaks.
    """
    detector = make()
    _require(isinstance(getattr(detector, "name", None), str) and bool(detector.name), "a detector has a name")
    views = list(pictures) or [KinematicRobot().look("head")]
    first = views[0]
    unmeasured = dataclasses.replace(first, depth=np.full_like(first.depth, np.nan))
    absurd = ["", " ", "?!", "the", "x" * 5000, "word " * 400, "\u2603 \U0001f916", "\x00"]
    for image in (*views, unmeasured, dataclasses.replace(first, labels=None, names={})):
        for asked in (list(phrases), list(phrases[:1]) * 2, [ROBOT], ["a. b. c."], absurd, []):
            _detections(detector, image, asked)
    for image in views:
        found = _detections(detector, image, [*absurd, *phrases])
        _require(not any(d.phrase in absurd for d in found), "a phrase that names nothing must find nothing")
    one, other = make(), make()
    for image in views * 2:
        twice = [_detections(each, image, phrases) for each in (one, other)]
        _require(_same([vars(d) for d in twice[0]], [vars(d) for d in twice[1]]), "equal detectors must find the same")
        for detection in twice[0]:  # they are the caller's now: the next ones must not be made of them
            for array in (detection.box, detection.mask):
                if array is not None and array.flags.writeable:
                    array[:] = 0


def _detections(detector: Detector, image: CameraImage, phrases: Sequence[str]) -> list[Detection]:
    """What it finds, all of it well formed; neither the picture nor the phrases are changed."""
    given, before = list(phrases), copy.deepcopy(image)
    try:
        found = detector.detect(image, given)
    except BackendError:
        raise  # what it needs is away or broke; that breaks no contract
    except Exception as error:
        raise AssertionError(f"detect raised for {shown(given)}: {type(error).__name__}: {error}") from error
    _require(_same(image, before), "a picture is not to be changed")
    _require(given == list(phrases), "phrases are not to be changed")
    _require(isinstance(found, list), "detect must give a list")
    try:
        for detection in found:
            check_detection(detection, image, phrases, "detect")
    except DetectorError as error:
        raise AssertionError(str(error)) from None
    return found
