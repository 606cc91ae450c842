"""Our observation as a remote policy's message, and its answer as our actions, by settings."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.executive.remote.dialect_settings import Action, Felt, Image, Observation, PartPlace, Vector
from mpvi_bt.executive.remote.joint_dialects import camera_numbers, joint_dialect
from mpvi_bt.ground.errors import PolicyError, shown, with_article
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.action_layout import ActionLayout
from mpvi_bt.ground.robot.action_rows import command_of
from mpvi_bt.ground.robot.protocol import CameraImage, Proprioception, Side
from mpvi_bt.ground.robot.robots import layout_of, robot_named

_ANSWERED = {"settings such as openpi_comet or mpvi": "actions", "settings such as behavior_2026": "action"}  # keys
MOST_ACTIONS = 1024  # of a chunk: half a minute without a look


def message_of(observation: Mapping[str, Any], layout: Observation) -> dict[str, Any]:
    """The message of an observation; pictures that are not in it are left out.

    Args:
        observation: As `Policy.infer` takes it.
        layout: What goes where.
    """
    body: Proprioception = observation["proprioception"]
    flat: dict[str, Any] = {layout.prompt: observation["prompt"]} if layout.prompt else {}
    for key, image in layout.images.items():
        if image.camera in observation["images"]:
            flat[key] = picture(observation["images"][image.camera], image)
    flat |= {key: state(body, vector) for key, vector in layout.state.items()}
    if layout.camera_poses:
        poses = robot_named(body.robot).camera_poses(body.torso, body.arm)
        flat[layout.camera_poses] = camera_numbers(poses).astype(np.float32)
    for key, constant in layout.constants.items():
        flat[key] = np.array(constant) if isinstance(constant, tuple) else constant
    message: dict[str, Any] = {}
    for key, value in flat.items():
        _put(message, key, value[None] if layout.batched and isinstance(value, np.ndarray) else value)
    return message


def _put(message: dict[str, Any], key: str, value: Any) -> None:
    *outer, last = key.split(".")
    for name in outer:
        message = message.setdefault(name, {})
    message[last] = value


def picture(image: CameraImage, layout: Image) -> np.ndarray[Any, Any]:
    """(H, W, 3 or 4) uint8, or (H, W) float32 [m] if depth is shown; with "chw", channels come first."""
    pixels: np.ndarray[Any, Any] = image.depth if layout.show.startswith("depth") else image.rgb
    if layout.size is not None:
        resize = resize_with_pad if layout.fit == "pad" else resize_with_crop
        pixels = resize(pixels, *layout.size)
    if layout.show == "depth_linear":
        pixels = np.where(pixels > 0, pixels, np.float32(np.inf))
    if layout.show == "rgba":
        pixels = np.concatenate([pixels, np.full((*pixels.shape[:2], 1), 255, np.uint8)], axis=2)
    return np.moveaxis(pixels, -1, 0) if layout.layout == "chw" and pixels.ndim == 3 else pixels


def resize_with_pad(pixels: np.ndarray[Any, Any], height: int, width: int) -> np.ndarray[Any, Any]:
    """A picture (H, W) or (H, W, C) scaled to fit (height, width), with 0 around it, as openpi does.

    Colors come out as openpi's own function makes them, to within 1 of 255: what a model was trained on is what it is
    shown. Depth is not blended across edges: its nearest pixel is taken.
    """
    h, w = pixels.shape[:2]
    if (h, w) == (height, width):
        return pixels
    ratio = max(h / height, w / width)
    new_h, new_w = max(1, int(h / ratio)), max(1, int(w / ratio))
    padded = np.zeros((height, width, *pixels.shape[2:]), pixels.dtype)
    top, left = (height - new_h) // 2, (width - new_w) // 2
    padded[top : top + new_h, left : left + new_w] = _scaled(pixels, new_h, new_w)
    return padded


def resize_with_crop(pixels: np.ndarray[Any, Any], height: int, width: int) -> np.ndarray[Any, Any]:
    """The largest middle part of a picture (H, W) or (H, W, C) with this shape, scaled to (height, width)."""
    h, w = pixels.shape[:2]
    ratio = min(h / height, w / width)
    old_h, old_w = max(1, round(height * ratio)), max(1, round(width * ratio))
    top, left = (h - old_h) // 2, (w - old_w) // 2
    return _scaled(pixels[top : top + old_h, left : left + old_w], height, width)


def _scaled(pixels: np.ndarray[Any, Any], height: int, width: int) -> np.ndarray[Any, Any]:
    """A picture of another size: (H, W) by nearest pixels, (H, W, C) blended."""
    h, w = pixels.shape[:2]
    if (h, w) == (height, width):
        return pixels
    if pixels.ndim == 3:
        return _blended(_blended(pixels.swapaxes(0, 1), width).swapaxes(0, 1), height)
    rows, columns = ((np.arange(new) + 0.5) * old // new for new, old in ((height, h), (width, w)))
    return pixels[rows.astype(int)[:, None], columns.astype(int)]


def _blended(pixels: np.ndarray[Any, Any], size: int) -> np.ndarray[Any, Any]:
    """A picture (n, ...) uint8 scaled along its first axis to (size, ...)."""
    blended = np.zeros((size, *pixels.shape[1:]), np.float32)
    for rows, weights in _taps(len(pixels), size):
        blended += pixels[rows] * weights[:, None, None]
    return np.rint(blended).astype(np.uint8)


@lru_cache(maxsize=32)
def _taps(old: int, new: int) -> list[tuple[NDArray[np.intp], NDArray[np.float32]]]:
    """The rows and weights whose sum is each of `new` rows; nearer rows weigh more (a triangle).

    The triangle is as wide as two of the larger pixels, so that shrinking skips nothing.
    """
    scale = old / new
    reach = max(scale, 1.0)
    center = (np.arange(new) + 0.5) * scale
    first = np.maximum((center - reach + 0.5).astype(int), 0)
    last = np.minimum((center + reach + 0.5).astype(int), old)
    rows = first[:, None] + np.arange((last - first).max())
    weights = np.maximum(1 - np.abs(rows + 0.5 - center[:, None]) / reach, 0) * (rows < last[:, None])
    weights /= weights.sum(axis=1, keepdims=True)
    return [(np.minimum(rows[:, k], old - 1), weights[:, k].astype(np.float32)) for k in range(rows.shape[1])]


def state(body: Proprioception, layout: Vector) -> np.ndarray[Any, Any]:
    """(length,) the numbers of a state vector."""
    if layout.dialect is not None:
        return joint_dialect(layout.dialect).encoded(body, layout.base_velocity).astype(layout.dtype)
    numbers = np.zeros(layout.length)
    for piece in layout.parts or ():
        values = (felt(body, piece.part) - np.array(piece.offset)) / np.array(piece.scale)
        if piece.function is not None:
            values = np.sin(values) if piece.function == "sin" else np.cos(values)
        numbers[list(piece.indices)] = values
    return numbers.astype(layout.dtype)


def felt(body: Proprioception, part: Felt) -> Array:
    """(n,) a part of proprioception, by its name in settings."""
    name, _, last = part.rpartition("_")
    if last not in ("left", "right"):
        return np.asarray(getattr(body, part), float)
    side: Side = "left" if last == "left" else "right"
    if name == "hand_position":
        return np.asarray(robot_named(body.robot).tcp(body.torso, body.arm[side], side)[:3, 3], float)
    if name == "hand_quaternion":
        from mpvi_bt.ground.geometry.rotations import rotation

        T = robot_named(body.robot).tcp(body.torso, body.arm[side], side)
        return np.asarray(rotation(T[:3, :3]).as_quat(scalar_first=True), float)
    return np.atleast_1d(np.asarray(getattr(body, name)[side], float))


def actions_of(reply: Any, layout: Action, held: Proprioception, felt: Proprioception | None = None) -> Array:
    """(H, A) the actions of a reply.

    Args:
        reply: As unpacked; nothing is known of it.
        layout: Where our numbers are in it.
        held: What parts that the policy does not command are held at.
        felt: What the robot feels now, if that is something else.

    Raises:
        PolicyError: "bad_reply": there is no such array, it has another shape or dtype, or numbers that are not finite.
    """
    given = reply
    for name in layout.key.split("."):
        if not isinstance(given, dict) or name not in given:
            keys = [shown(key) for key in sorted(map(str, given))[:12]] if isinstance(given, dict) else [shown(given)]
            said = f"no {layout.key!r} in the reply, which has: {', '.join(keys)[:200] or 'nothing'}"
            raise PolicyError("bad_reply", said + _fitting(layout.key, given))
        given = given[name]
    robot = layout_of(held)
    theirs = _checked(
        given, layout.key, layout.told_size or robot.size, "the settings" if layout.told_size else "the robot"
    )
    if layout.dialect is not None:
        return joint_dialect(layout.dialect).actions(theirs, felt or held)
    if not layout.parts:
        return theirs
    ours = np.tile(command_of(held), (len(theirs), 1))
    for piece in layout.parts:
        _put_part(ours, robot, piece.part, _converted(theirs, piece))
    if not np.isfinite(ours).all():
        raise PolicyError("bad_reply", "actions that are not finite once scaled")
    return ours


def _put_part(ours: Array, robot: ActionLayout, part: str, values: Array) -> None:
    """Write a part (H, n), by its name in settings, into our actions (H, A)."""
    if part == "base_velocity":
        robot.set_velocity(ours, values)
        return
    side: Side = "left" if part.endswith("left") else "right"
    if part == "torso":
        ours[:, robot.torso] = values
    elif part.startswith("arm"):
        ours[:, robot.arm[side]] = values
    else:
        ours[:, robot.gripper[side]] = values[:, 0]


def _fitting(key: str, reply: Any) -> str:
    """A hint at settings that fit the reply, if it is of another dialect; else nothing."""
    for settings, theirs in _ANSWERED.items():
        if isinstance(reply, dict) and theirs in reply and theirs != key:
            return f". For a server that answers so, take {settings}"
    return ""


def _checked(given: Any, key: str, size: int, whose: str) -> Array:
    """(H, size) float64, finite; `whose` the size is, for messages."""
    if not isinstance(given, np.ndarray):
        raise PolicyError("bad_reply", f"{key!r} is {with_article(type(given).__name__)}, not an array")
    if given.dtype.kind not in "fiu":
        raise PolicyError("bad_reply", f"actions of dtype {given.dtype}, not numbers")
    shape = given.shape
    while given.ndim > 2 and given.shape[0] == 1:  # a batch of one
        given = given[0]
    given = given[None] if given.ndim == 1 else given
    if given.ndim != 2 or given.shape[1] != size or not 1 <= len(given) <= MOST_ACTIONS:
        raise PolicyError(
            "bad_reply", f"actions of shape {shape}, not (H, {size}) as {whose} would have it, 1 <= H <= {MOST_ACTIONS}"
        )
    if not np.isfinite(given).all():
        raise PolicyError("bad_reply", "actions that are not finite")
    return np.array(given, float)  # a copy: what was received is read-only


def _converted(theirs: Array, piece: PartPlace) -> Array:
    with np.errstate(over="ignore"):
        return theirs[:, list(piece.indices)] * np.array(piece.scale) + np.array(piece.offset)
