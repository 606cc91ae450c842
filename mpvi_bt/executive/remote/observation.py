"""The whole observation of a policy as a message of `mpvi serve`, so that it can serve any of our policies.

It has everything that a policy in process gets, with mappings for its parts (table in docs/serving_policies.md).
Reading gives back the written values bit by bit.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from mpvi_bt.executive.plan.schema import MOST_OF_PROMPT
from mpvi_bt.ground.errors import BadMessage, UnknownName, UserError, shown
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.action_rows import check_rate
from mpvi_bt.ground.robot.default_robot import DEFAULT_ROBOT
from mpvi_bt.ground.robot.protocol import CameraImage, Proprioception, Side
from mpvi_bt.ground.robot.robot_description import RobotDescription
from mpvi_bt.ground.robot.robots import robot_named

_BODY = ("base_pose", "base_velocity", "torso", "arm", "arm_velocity", "gripper_width", "gripper_command")
_MORE = ("arm_command", "torso_velocity", "gripper_velocity", "robot")

Vocabulary = Mapping[str, Iterable[str]]  # name of a thing, as labels of pictures have it: what people call it


@dataclass(frozen=True, eq=False)
class PolicyQuestion:
    """What a message asks of a policy.

    Attributes:
        observation: As `Policy.infer` takes it.
        reset: Whether the policy is to begin anew with it.
        vocabulary: What the labels of pictures are called, from now on; None: as before.
        rate_hz: Rows a second that the answer is to have; None: as the policy has them.
    """

    observation: dict[str, Any]
    reset: bool
    vocabulary: Vocabulary | None
    rate_hz: float | None = None


def write_observation(
    observation: Mapping[str, Any], reset: bool = False, vocabulary: Vocabulary | None = None
) -> dict[str, Any]:
    """The message of an observation; see `PolicyQuestion`."""
    body: Proprioception = observation["proprioception"]
    images: Mapping[str, CameraImage] = observation["images"]
    called = {} if vocabulary is None else {"vocabulary": {name: list(words) for name, words in vocabulary.items()}}
    return {
        "prompt": observation["prompt"],
        "reset": reset,
        **called,
        "proprioception": {
            "base_pose": body.base_pose,
            "base_velocity": body.base_velocity,
            "torso": body.torso,
            "arm": dict(body.arm),
            "arm_velocity": dict(body.arm_velocity),
            "gripper_width": dict(body.gripper_width),
            "gripper_command": dict(body.gripper_command),
            **({"arm_command": dict(body.arm_command)} if body.arm_command else {}),
            "torso_velocity": body.torso_velocity,
            **({"gripper_velocity": dict(body.gripper_velocity)} if body.gripper_velocity else {}),
            "robot": body.robot,
        },
        "images": {camera: _write_image(image) for camera, image in images.items()},
    }


def _write_image(image: CameraImage) -> dict[str, Any]:
    message = {"rgb": image.rgb, "depth": image.depth, "K": image.K, "T_world_camera": image.T_world_camera}
    if image.labels is None:
        return message
    return {**message, "labels": image.labels, "names": {str(id_): name for id_, name in image.names.items()}}


def read_observation(message: Any, robot: RobotDescription | None = None) -> PolicyQuestion:
    """What a message asks.

    Args:
        message: As unpacked; nothing is known of it.
        robot: Whose it is, where it names none; None: the default robot's.

    Raises:
        BadMessage: Something is missing, not known, or of the wrong kind, shape or dtype; says where, and what would
            be right.
    """
    top = _mapping(message, "", ("prompt", "proprioception"), ("images", "reset", "vocabulary", "rate_hz"))
    if not isinstance(prompt := top["prompt"], str):
        raise _wrong("prompt", prompt, "a text")
    if len(prompt) > MOST_OF_PROMPT:
        raise BadMessage(f"prompt: {len(prompt)} characters are given, at most {MOST_OF_PROMPT} are wanted")
    if not isinstance(reset := top.get("reset", False), bool):
        raise _wrong("reset", reset, "true or false")
    body = _read_body(top["proprioception"], robot)
    images = _mapping(top.get("images", {}), "images", (), tuple(robot_named(body.robot).cameras))
    observation = {
        "prompt": prompt,
        "proprioception": body,
        "images": {camera: _read_image(camera, image) for camera, image in images.items()},
    }
    vocabulary = read_vocabulary(top["vocabulary"]) if "vocabulary" in top else None
    return PolicyQuestion(observation, reset, vocabulary, _read_rate(top["rate_hz"]) if "rate_hz" in top else None)


def _read_rate(given: Any) -> float:
    try:
        return check_rate(given)
    except UserError as error:
        raise BadMessage(f"rate_hz: {error}") from None


def read_vocabulary(given: Any) -> Vocabulary:
    """What labels of pictures are called. Raises BadMessage."""
    if not isinstance(given, dict):
        raise _wrong("vocabulary", given, "a mapping of names to what they are called")
    for name, words in given.items():
        if not (isinstance(name, str) and isinstance(words, list) and all(isinstance(word, str) for word in words)):
            raise BadMessage(f"vocabulary: {shown(name)}: {shown(words)} is given, a list of texts is wanted")
    return given


def _read_body(given: Any, default: RobotDescription | None) -> Proprioception:
    body = _mapping(given, "proprioception", _BODY, _MORE)
    robot = body.get("robot", DEFAULT_ROBOT if default is None else default.name)
    if not isinstance(robot, str):
        raise _wrong("proprioception.robot", robot, "the name of a robot")
    try:
        model = robot_named(robot)
    except UnknownName as error:
        raise BadMessage(f"proprioception.robot: {error}") from None
    sides, joints = model.sides, len(model.torso_joints)

    def numbers(name: str, size: int) -> Array:
        return _numbers(body[name], f"proprioception.{name}", (size,))

    def arms(name: str) -> dict[Side, Array]:
        both = _mapping(body[name], f"proprioception.{name}", sides, ())
        size = {side: (len(model.arm_joints[side]),) for side in sides}
        return {side: _numbers(both[side], f"proprioception.{name}.{side}", size[side]) for side in sides}

    def hands(name: str) -> dict[Side, float]:
        both = _mapping(body[name], f"proprioception.{name}", sides, ())
        return {side: float(_numbers(both[side], f"proprioception.{name}.{side}", ())) for side in sides}

    return Proprioception(
        base_pose=numbers("base_pose", 3),
        base_velocity=numbers("base_velocity", 3),
        torso=numbers("torso", joints),
        arm=arms("arm"),
        arm_velocity=arms("arm_velocity"),
        gripper_width=hands("gripper_width"),
        gripper_command=hands("gripper_command"),
        arm_command=arms("arm_command") if "arm_command" in body else {},
        torso_velocity=numbers("torso_velocity", joints) if "torso_velocity" in body else np.zeros(joints),
        gripper_velocity=hands("gripper_velocity") if "gripper_velocity" in body else {},
        robot=robot,
        open_m=model.opening_m,
        grasp_m=model.grasp_m,
    )


def _read_image(camera: str, given: Any) -> CameraImage:
    where = f"images.{camera}"
    image = _mapping(given, where, ("rgb", "depth", "K", "T_world_camera"), ("labels", "names"))
    rgb, depth, labels = image["rgb"], image["depth"], image.get("labels")
    if not (isinstance(rgb, np.ndarray) and rgb.ndim == 3 and rgb.shape[2] == 3 and rgb.size and rgb.dtype == np.uint8):
        raise _wrong(f"{where}.rgb", rgb, "(H, W, 3) uint8")
    size = rgb.shape[:2]
    if not (isinstance(depth, np.ndarray) and depth.shape == size and depth.dtype.kind == "f"):
        raise _wrong(f"{where}.depth", depth, f"{size} float32, as rgb is")
    if not np.isfinite(depth).all():
        raise BadMessage(f"{where}.depth: not every value is finite; where nothing is seen, it is 0")
    if labels is not None and not (
        isinstance(labels, np.ndarray) and labels.shape == size and labels.dtype == np.int32
    ):
        raise _wrong(f"{where}.labels", labels, f"{size} int32, as rgb is, or none")
    return CameraImage(
        camera=camera,
        rgb=rgb,
        depth=depth.astype(np.float32, copy=False),
        labels=labels,
        names=read_names(image.get("names", {}), f"{where}.names"),
        K=_numbers(image["K"], f"{where}.K", (3, 3)),
        T_world_camera=_numbers(image["T_world_camera"], f"{where}.T_world_camera", (4, 4)),
    )


def read_names(given: Any, where: str) -> dict[int, str]:
    """What the label ids of a picture stand for. Raises BadMessage."""
    if not isinstance(given, dict):
        raise _wrong(where, given, "a mapping of label ids to names")
    names = {}
    for key, name in given.items():
        if not (isinstance(key, str) and key.isascii() and key.isdigit() and len(key) < 11 and isinstance(name, str)):
            raise BadMessage(
                f'{where}: {shown(key)}: {shown(name)} is not a label id and a name, such as "12": "apple"'
            )
        names[int(key)] = name
    return names


def _mapping(given: Any, where: str, needed: tuple[str, ...], more: tuple[str, ...]) -> dict[str, Any]:
    if not isinstance(given, dict):
        raise _wrong(where or "the observation", given, f"a mapping with {', '.join(needed or more)}")
    for key in given:
        if key not in needed and key not in more:
            key = key if isinstance(key, str) else repr(key)
            raise BadMessage(str(UnknownName("key", key, [*needed, *more], where or "the observation")))
    for key in needed:
        if key not in given:
            raise BadMessage(f"{where or 'the observation'}: {key} is missing")
    return given


def _numbers(given: Any, where: str, shape: tuple[int, ...]) -> Array:
    """(shape) float64. Raises BadMessage."""
    size = f"{shape} numbers" if shape else "a number"
    scalar = isinstance(given, int | float) and not isinstance(given, bool)
    if not scalar and not (isinstance(given, np.ndarray | np.generic) and given.dtype.kind in "iuf"):
        raise _wrong(where, given, size)
    numbers = np.array(given, float)  # a copy: what was received is read-only
    if numbers.shape != shape:
        raise _wrong(where, given, size)
    if not np.isfinite(numbers).all():
        raise BadMessage(f"{where}: not every value is finite")
    return numbers


def _wrong(where: str, given: Any, wanted: str) -> BadMessage:
    what = f"{given.shape} {given.dtype}" if isinstance(given, np.ndarray | np.generic) else shown(given)
    return BadMessage(f"{where}: {what} is given, {wanted} is wanted")
