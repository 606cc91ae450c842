"""What messages of cameras say: color, depth and labels as arrays, and the intrinsics, checked."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.executive.remote.observation import Vocabulary, read_vocabulary
from mpvi_bt.ground.errors import BadMessage, shown
from mpvi_bt.ground.geometry.solids import Array

# By encoding: type, channels, and the order of channels for red, green, blue.
_COLORS: Mapping[str, tuple[int, list[int]]] = {
    "rgb8": (3, [0, 1, 2]),
    "bgr8": (3, [2, 1, 0]),
    "rgba8": (4, [0, 1, 2]),
    "bgra8": (4, [2, 1, 0]),
}


def color_of(message: Any, topic: str) -> NDArray[np.uint8]:
    """(H, W, 3) red, green, blue of a sensor_msgs/Image. Raises BadMessage."""
    if message.encoding not in _COLORS:
        raise BadMessage(f"{topic}: the encoding {message.encoding!r} is not known: {', '.join(_COLORS)}")
    channels, order = _COLORS[message.encoding]
    pixels = _pixels(message, np.dtype(np.uint8), channels, topic)
    return np.ascontiguousarray(pixels[:, :, order])


def compressed_color_of(message: Any, topic: str) -> NDArray[np.uint8]:
    """(H, W, 3) of a sensor_msgs/CompressedImage: JPEG or PNG. Raises BadMessage."""
    import cv2

    read = cv2.imdecode(np.frombuffer(bytes(message.data), np.uint8), cv2.IMREAD_COLOR)
    if read is None:
        raise BadMessage(f"{topic}: the compressed picture ({message.format}) cannot be read")
    return np.ascontiguousarray(read[:, :, ::-1]).astype(np.uint8)


def depth_of(message: Any, topic: str) -> NDArray[np.float32]:
    """(H, W) [m], 0 where nothing is seen, of a sensor_msgs/Image. Raises BadMessage."""
    if message.encoding in ("16UC1", "mono16"):
        depth = _pixels(message, np.dtype(np.uint16), 1, topic)[:, :, 0].astype(np.float32) / np.float32(1000)
    elif message.encoding == "32FC1":
        depth = _pixels(message, np.dtype(np.float32), 1, topic)[:, :, 0].astype(np.float32)
    else:
        raise BadMessage(f"{topic}: the encoding {message.encoding!r} is no depth: 32FC1 [m] or 16UC1 [mm]")
    return np.where(np.isfinite(depth) & (depth > 0), depth, np.float32(0.0)).astype(np.float32)


def labels_of(message: Any, topic: str) -> NDArray[np.int32]:
    """(H, W) of a sensor_msgs/Image in 32SC1. Raises BadMessage."""
    if message.encoding != "32SC1":
        raise BadMessage(f"{topic}: labels come in 32SC1, not in {message.encoding!r}")
    return _pixels(message, np.dtype(np.int32), 1, topic)[:, :, 0].astype(np.int32)


def names_of(text: str, topic: str) -> tuple[dict[int, str], Vocabulary]:
    """What labels stand for, and what those things are called, of JSON. Raises BadMessage."""
    try:
        told = json.loads(text)
        names = {int(label): str(name) for label, name in told["names"].items()}
        return names, read_vocabulary(told.get("vocabulary", {}))
    except (ValueError, TypeError, KeyError, AttributeError):
        raise BadMessage(f'{topic}: {shown(text[:80])} is given, {{"names": {{"1": "..."}}}} is wanted') from None


def intrinsics_of(message: Any, topic: str) -> tuple[Array, tuple[int, int]]:
    """K (3, 3) [px], by which the middle of the first pixel is at 0.5, and height and width. Raises BadMessage."""
    K = np.array(message.k, float).reshape(3, 3)
    if not np.isfinite(K).all() or K[0, 0] <= 0 or K[1, 1] <= 0:
        raise BadMessage(f"{topic}: the camera is not calibrated: its focal length is {K[0, 0]:g}")
    K[:2, 2] += 0.5  # ROS has it at 0
    return K, (int(message.height), int(message.width))


def check_size(size: tuple[int, ...], due: tuple[int, int], topic: str, info: str, file: str) -> None:
    """Raise BadMessage if a picture has another size than the intrinsics are for."""
    if size[:2] != due:
        raise BadMessage(
            f"{topic}: a picture of {size[1]} x {size[0]} pixels, but {info} is for {due[1]} x {due[0]}: "
            f"the intrinsics do not fit it ({file})"
        )


def _pixels(message: Any, kind: np.dtype[Any], channels: int, topic: str) -> NDArray[Any]:
    """(H, W, channels) of a sensor_msgs/Image, whose rows may be padded. Raises BadMessage."""
    height, width, step = int(message.height), int(message.width), int(message.step)
    row = width * channels * kind.itemsize
    data = np.frombuffer(message.data, np.uint8)
    if not height or not width or step < row or data.size != step * height:
        raise BadMessage(
            f"{topic}: {data.size} bytes do not make {height} rows of {step} bytes with {width} pixels of "
            f"{message.encoding}"
        )
    values = data.reshape(height, step)[:, :row].copy().view(kind.newbyteorder(">" if message.is_bigendian else "<"))
    return values.reshape(height, width, channels)
