"""Our observation as a frame of LeRobot's, by the names of a checkpoint's features."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.executive.remote.dialect_settings import DialectSettings
from mpvi_bt.executive.remote.joint_dialects import camera_numbers
from mpvi_bt.executive.remote.lerobot_checkpoint import PICTURES, POSE, STATE, LerobotCheckpoint
from mpvi_bt.executive.remote.wire_mapping import picture, resize_with_pad, state
from mpvi_bt.ground.robot.action_rows import state_of
from mpvi_bt.ground.robot.protocol import Proprioception
from mpvi_bt.ground.robot.robots import robot_named


def frame_of(
    observation: Mapping[str, Any], checkpoint: LerobotCheckpoint, settings: DialectSettings
) -> dict[str, NDArray[Any]]:
    """What the checkpoint wants, by feature: pictures (H, W, 3) uint8 of its size, numbers (n,) float32.

    Args:
        observation: As `Policy.infer` takes it.
        checkpoint: Which features it wants.
        settings: What they are; without `observation`, they are those of `mpvi dataset`.
    """
    body, layout = observation["proprioception"], settings.observation
    frame: dict[str, NDArray[Any]] = {}
    for key in checkpoint.numbers:
        frame[key] = _numbers(key, body, settings).astype(np.float32)
    for key, size in checkpoint.pictures.items():
        if layout is None:
            frame[key] = resize_with_pad(observation["images"][key.removeprefix(PICTURES)].rgb, *size)
        else:
            image = layout.images[key].model_copy(update={"size": size, "layout": "hwc"})
            frame[key] = picture(observation["images"][image.camera], image)
    return frame


def _numbers(key: str, body: Proprioception, settings: DialectSettings) -> NDArray[Any]:
    if (layout := settings.observation) is None:
        return {STATE: state_of(body), POSE: np.asarray(body.base_pose, float)}[key]
    if key == layout.camera_poses:
        return camera_numbers(robot_named(body.robot).camera_poses(body.torso, body.arm))
    return state(body, layout.state[key])


def cameras_of_checkpoint(checkpoint: LerobotCheckpoint, settings: DialectSettings) -> tuple[str, ...]:
    """Whose pictures it is shown."""
    layout = settings.observation
    if layout is None:
        return tuple(key.removeprefix(PICTURES) for key in checkpoint.pictures)
    return tuple(sorted({layout.images[key].camera for key in checkpoint.pictures}))
