"""The dialects of BEHAVIOR's evaluators, 2025 and 2026: their observations read and answered, and written.

`write` is for whoever stands in for an evaluator. Keys beginning with "mpvi::" are our own: what a simulator that
labels its pictures may add.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from mpvi_bt.executive.remote.joint_dialects import Dialect
from mpvi_bt.executive.remote.observation import Vocabulary, read_names, read_vocabulary
from mpvi_bt.executive.remote.reading import CHUNK, Reading, chunk_of, spoken
from mpvi_bt.ground.errors import BadMessage, shown
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.camera import Camera
from mpvi_bt.ground.robot.protocol import CameraImage, Proprioception
from mpvi_bt.ground.robot.robot_description import RobotDescription
from mpvi_bt.hands.behavior_robot import behavior_layout as layout

ROBOT = "robot_r1"  # what evaluators call the robot
LINKS: Mapping[str, str] = {"head": "zed_link", "left": "left_realsense_link", "right": "right_realsense_link"}
NAMES, VOCABULARY = "mpvi::names", "mpvi::vocabulary"
TASK = "task_id"
_SQUARE = 0.01  # sides of pictures may differ from what the camera has by this part, which is rounding
_WRAPPERS = {
    "behavior-2025": "omnigibson.learning.wrappers.DefaultWrapper",
    "behavior-2026": "RGBDFullResWrapper",
}  # those that show depth


class Behavior:
    """One of the two.

    Args:
        name: Which.

    Attributes:
        name: Which.
    """

    def __init__(self, name: Dialect) -> None:
        self.name: Dialect = name

    def read(self, message: Mapping[str, Any], robot: RobotDescription) -> Reading:
        """What an observation says. Raises BadMessage."""
        if (other := spoken(message)) not in ("", self.name):
            raise BadMessage(f"this is an observation of --protocol {other}, and --protocol {self.name} was chosen")
        prefix, numbers = _proprio(message)
        fields = layout.fields_of(_single(numbers, 1, f"{prefix}::proprio"), self.name)
        pose = layout.pose_in_world(fields)
        body = layout.decoded(fields, np.zeros(3) if pose is None else pose, {})
        cameras = self._cameras(message, prefix, robot, body)
        if pose is not None:
            cameras = {camera: matmul(kin.base(pose), T) for camera, T in cameras.items()}
        names = read_names(message[NAMES], NAMES) if NAMES in message else None
        keys = {camera: f"{prefix}::{prefix}:{link}:Camera:0" for camera, link in LINKS.items()}
        images = LazyPictures(
            {
                camera: self._picture(message, key, camera, robot, cameras[camera], names)
                for camera, key in keys.items()
                if f"{key}::rgb" in message
            }
        )
        return Reading(
            body=body,
            images=images,
            placed=pose is not None,
            task=_task(message[TASK]) if TASK in message else None,
            vocabulary=read_vocabulary(message[VOCABULARY]) if VOCABULARY in message else None,
            steps=chunk_of(message),
        )

    def answer(
        self, actions: Array, asked: Mapping[str, Any], robot: RobotDescription, before: Array
    ) -> dict[str, Any]:
        """`action`, and `action_chunk` if several are wanted; with a leading 1 if observations have one."""
        theirs = layout.action_for(actions).astype(np.float32)
        if any(isinstance(v, np.ndarray) and v.ndim == 2 for k, v in asked.items() if str(k).endswith("::proprio")):
            theirs = theirs[None]
        chunk = {"action_chunk": theirs} if CHUNK in asked else {}
        return {"action": theirs[..., 0, :], **chunk}

    def write(
        self,
        body: Proprioception,
        images: Mapping[str, CameraImage],
        T_base_camera: Mapping[str, Array],
        task: int | None = None,
        *,
        batched: bool = False,
        labels: bool = False,
        vocabulary: Vocabulary | None = None,
    ) -> dict[str, Any]:
        """The observation of a robot, as the evaluator sends it.

        Args:
            body: What it feels.
            images: What it sees.
            T_base_camera: (4, 4) of every camera, optical frames.
            task: Number of the task.
            batched: Whether every array has a leading 1, as since 3.9.3.
            labels, vocabulary: What things in pictures are, which no evaluator sends.
        """
        message: dict[str, Any] = {
            f"{ROBOT}::proprio": layout.encoded(body, self.name).astype(np.float32),
            f"{ROBOT}::cam_rel_poses": layout.camera_poses(T_base_camera).astype(np.float32),
        }
        if task is not None:
            message[TASK] = np.array([task], np.int64)
        for camera, image in images.items():
            key = f"{ROBOT}::{ROBOT}:{LINKS[camera]}:Camera:0"
            alpha = np.full((*image.rgb.shape[:2], 1), 255, np.uint8)
            message[f"{key}::rgb"] = np.concatenate([image.rgb, alpha], axis=2)
            message[f"{key}::depth_linear"] = np.where(image.depth > 0, image.depth, np.inf).astype(np.float32)
            if labels and image.labels is not None:
                message[f"{key}::seg_instance_id"] = image.labels
        if batched:
            message = {key: value[None] for key, value in message.items()}
        if labels:
            tables = [image.names for image in images.values()]
            message[NAMES] = {str(id_): name for table in tables[:1] for id_, name in table.items()}
        if vocabulary is not None:
            message[VOCABULARY] = {name: list(words) for name, words in vocabulary.items()}
        return message

    def _cameras(
        self, message: Mapping[str, Any], prefix: str, robot: RobotDescription, body: Proprioception
    ) -> Mapping[str, Array]:
        """T_base_camera of each camera, as told or by the robot's joints."""
        key = f"{prefix}::cam_rel_poses"
        if key in message:
            return layout.cameras_in_base(_array(message[key], key))
        return robot.camera_poses(body.torso, body.arm)

    def _picture(
        self,
        message: Mapping[str, Any],
        key: str,
        camera: str,
        robot: RobotDescription,
        T: Array,
        names: dict[int, str] | None,
    ) -> Callable[[], CameraImage]:
        """What makes a picture, once its shapes are known to be right."""
        rgb = _single(message[f"{key}::rgb"], 3, f"{key}::rgb")
        if rgb.dtype != np.uint8 or rgb.shape[2] not in (3, 4) or not rgb.size:
            raise BadMessage(f"{key}::rgb: {rgb.shape} {rgb.dtype} is given, (H, W, 4) uint8 is wanted")
        size = rgb.shape[:2]
        K = _intrinsics(robot.cameras[camera], camera, *size)
        if (there := f"{key}::depth_linear") not in message:
            raise BadMessage(
                f"no depth_linear of the {camera} camera: choose the evaluator's wrapper {_WRAPPERS[self.name]}"
            )
        depth = _single(message[there], 2, there)
        if depth.shape != size or depth.dtype.kind != "f":
            raise BadMessage(f"{there}: {depth.shape} {depth.dtype} is given, {size} float32, as rgb is, is wanted")
        given: np.ndarray[Any, Any] | None = None
        if names is not None and (there := f"{key}::seg_instance_id") in message:
            given = _single(message[there], 2, there)
            if given.shape != size or given.dtype.kind not in "iu":
                raise BadMessage(f"{there}: {given.shape} {given.dtype} is given, {size} int32, as rgb is, is wanted")

        def make() -> CameraImage:
            return CameraImage(
                camera=camera,
                rgb=np.ascontiguousarray(rgb[..., :3]),
                depth=np.where(np.isfinite(depth), depth, 0.0).astype(np.float32),
                labels=None if given is None else given.astype(np.int32),
                names=names or {},
                K=K,
                T_world_camera=T,
            )

        return make


class LazyPictures(Mapping[str, CameraImage]):
    """Pictures that are made when somebody looks: of most steps nobody looks at any.

    Args:
        makers: What makes each, by camera.
    """

    def __init__(self, makers: Mapping[str, Callable[[], CameraImage]]) -> None:
        self._makers = makers

    def __getitem__(self, camera: str) -> CameraImage:
        return self._makers[camera]()

    def __iter__(self) -> Iterator[str]:
        return iter(self._makers)

    def __len__(self) -> int:
        return len(self._makers)


def _intrinsics(model: Camera, camera: str, height: int, width: int) -> Array:
    """(3, 3) of a picture of a camera, in whatever size it is rendered. Raises BadMessage: another shape."""
    if abs(width / height - model.width / model.height) > _SQUARE * model.width / model.height:
        raise BadMessage(
            f"a picture of {width} x {height} of the {camera} camera, which has {model.width} x {model.height}, or "
            "another size of that shape: choose the robot by --robot"
        )
    focal = height / 2 / np.tan(model.fov_rad / 2)
    return np.array([[focal, 0.0, width / 2], [0.0, focal, height / 2], [0.0, 0.0, 1.0]])


def _proprio(message: Mapping[str, Any]) -> tuple[str, Any]:
    """What the robot is called, and its numbers."""
    for key, value in message.items():
        if isinstance(key, str) and key.endswith("::proprio"):
            return key.removesuffix("::proprio"), value
    known = ", ".join(shown(key) for key in _some(message)) or "nothing"
    raise BadMessage(f"no key that ends with '::proprio' in the observation, which has {known}")


def _some(message: Mapping[str, Any]) -> Iterator[str]:
    yield from sorted(map(str, message))[:8]


def _single(given: Any, dimensions: int, key: str) -> np.ndarray[Any, Any]:
    """An array without its leading 1. Raises BadMessage: it is none, or a batch of several."""
    array = _array(given, key)
    if array.ndim == dimensions + 1:
        if len(array) != 1:
            raise BadMessage(
                f"{key}: a batch of {len(array)} environments; one a connection is driven here: start as many servers, "
                "or the evaluator with one environment"
            )
        array = array[0]
    if array.ndim != dimensions:
        raise BadMessage(f"{key}: {array.shape} is given, {dimensions} dimensions are wanted, or a leading 1 beside")
    return array


def _array(given: Any, key: str) -> np.ndarray[Any, Any]:
    if not isinstance(given, np.ndarray):
        raise BadMessage(f"{key}: {shown(given)} is given, an array is wanted")
    return given


def _task(given: Any) -> int:
    try:
        return int(np.asarray(given).reshape(()))
    except (TypeError, ValueError, OverflowError):
        raise BadMessage(f"{TASK}: {shown(given)} is given, one whole number is wanted") from None
