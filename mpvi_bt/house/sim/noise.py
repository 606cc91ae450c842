"""An error model of the robot's senses: what a policy sees and feels of a simulated robot, made as bad as a real one's.

Commands stay what they are: they are in the base's frame. Everything that is drawn follows from the seed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.depth_noise import DEPTH_NOISE
from mpvi_bt.ground.robot.protocol import CameraImage, Proprioception, Robot
from mpvi_bt.ground.robot.robots import robot_named

_STANDING = 0.03  # [m/s, rad/s]: slower than this the base stands
_SAME_M = 0.05  # and this near it stands where it stood


@dataclass(frozen=True)
class Errors:
    """Sizes of the errors; 0 switches one off.

    Attributes:
        depth_per_m: Standard deviation of a pixel's depth [m] at 1 m; it grows with the square of the range.
        label_px: How far the label image is shifted, in a direction drawn for each picture.
        holes: Part of the pixels without depth.
        drift_m, drift_rad: Random walk of the odometry: standard deviation after 1 m, growing with the root of the way.
        mount_m, mount_rad: How far each camera sits from where the robot takes it to be, in directions drawn once.
        offset_m: Standard deviation, along x and along y, of an error of position that everything seen has in common;
            drawn anew wherever the base comes to stand.
    """

    depth_per_m: float = 0.0
    label_px: int = 0
    holes: float = 0.0
    drift_m: float = 0.0
    drift_rad: float = 0.0
    mount_m: float = 0.0
    mount_rad: float = 0.0
    offset_m: float = 0.0


NONE = Errors()
REALISTIC = Errors(
    depth_per_m=DEPTH_NOISE.sigma_m, label_px=1, holes=0.02, drift_m=0.01, drift_rad=np.deg2rad(0.6), mount_m=0.005,
    mount_rad=np.deg2rad(1.0),
)  # fmt: skip


class Mounted(Protocol):
    """Where cameras are mounted, such as `mpvi_bt.house.sim.cameras.Cameras`."""

    def misalign(self, camera: str, T_nominal_real: Array) -> None:
        """Have a camera sit off its nominal pose; (4, 4), between the two optical frames."""
        ...


class NoisyRobot:
    """`mpvi_bt.ground.robot.protocol.Robot` around another one, with errors in what is felt and seen.

    Pictures are really taken from where the cameras are; `T_world_camera` is where the robot believes them to be.

    Attributes:
        mounts: (4, 4) each camera's real optical frame to its nominal one.
    """

    def __init__(self, robot: Robot, cameras: Mounted | None, errors: Errors, seed: int) -> None:
        """Draw what stays the same for an episode; the belief starts at the true pose. Without cameras no pictures."""
        self._robot, self._cameras, self._errors = robot, cameras, errors
        fixed, self._walk, self._pixels, places = (np.random.default_rng([seed, k]) for k in range(4))
        felt = robot.proprioception()
        own = robot_named(felt.robot)
        self._turn_m = own.base.turn_m  # Our choice: turning on the spot drifts like driving as far as the wheels roll
        self.mounts: Mapping[str, Array] = {camera: _mount(errors, fixed) for camera in own.cameras}
        self._true = felt.base_pose
        self._believed = self._true.copy()
        self._standing = StandingError(errors.offset_m, places)

    @property
    def action(self) -> Array:
        """(A,) the command that the next step will carry out."""
        return self._robot.action

    def act(self, action: Array) -> None:
        """Set the command of the next step."""
        self._robot.act(action)

    def hold(self) -> None:
        """Stand still; every joint keeps its target."""
        self._robot.hold()

    def proprioception(self) -> Proprioception:
        """Proprioception with the base pose by odometry. Its drift grows with the motion between calls."""
        felt = self._robot.proprioception()
        self._drift(felt.base_pose)
        return replace(felt, base_pose=self._believed.copy())

    def look(self, camera: str) -> CameraImage:
        """A picture, with the pose that the robot believes its camera to have."""
        felt = self._robot.proprioception()
        self._drift(felt.base_pose)
        nominal = _nominal(camera, felt)
        T_world_camera = matmul(kin.base(self._true), nominal)
        aside = np.eye(4)
        aside[:2, 3] = -self._standing.offset(felt)  # what is seen from the left seems to be on the right
        if self._cameras is not None:
            real = matmul(aside, T_world_camera, self.mounts[camera])
            self._cameras.misalign(camera, matmul(kin.inverse(T_world_camera), real))
        image = self._robot.look(camera)
        labels = None if image.labels is None else _shifted(image.labels, self._errors.label_px, self._pixels)
        believed = matmul(kin.base(self._believed), nominal)
        return replace(image, depth=self._depth(image.depth), labels=labels, T_world_camera=believed)

    def _drift(self, true: Array) -> None:
        """Add the motion since the last call to the belief, with its error."""
        forth = matmul(kin.inverse(kin.base(self._true)), kin.base(true))
        turn = float(kin.wrap(true[2] - self._true[2]))
        way = float(np.hypot(*forth[:2, 3])) + self._turn_m * abs(turn)
        self._true = true.copy()
        if way == 0.0:
            return
        x, y, yaw = self._walk.normal(size=3) * np.sqrt(way)
        step = forth[:2, 3] + self._errors.drift_m * np.array([x, y])
        p = matmul(kin.base(self._believed), [*step, 0.0, 1.0])
        heading = float(kin.wrap(self._believed[2] + turn + self._errors.drift_rad * yaw))
        self._believed = np.array([p[0], p[1], heading])

    def _depth(self, depth: NDArray[np.float32]) -> NDArray[np.float32]:
        noise = self._pixels.normal(size=depth.shape)
        holes = self._pixels.random(depth.shape) < self._errors.holes
        noisy = np.maximum(depth + self._errors.depth_per_m * depth.astype(float) ** 2 * noise, 0.0)
        return np.where(holes | (depth <= 0), 0.0, noisy).astype(np.float32)


class StandingError:
    """An error of position, constant while the base stands at one place."""

    def __init__(self, deviation_m: float, rng: np.random.Generator) -> None:
        """Draw errors of a standard deviation along x and y."""
        self._deviation, self._rng = deviation_m, rng
        self._at: Array | None = None
        self._offset = np.zeros(2)

    def offset(self, felt: Proprioception) -> Array:
        """(2,) the error [m] of what is seen now, in the world."""
        at = felt.base_pose[:2]
        moving = float(np.abs(felt.base_velocity).max()) > _STANDING
        if self._at is None or (not moving and norm(at - self._at) > _SAME_M):
            self._at = np.array(at)
            self._offset = self._deviation * self._rng.normal(size=2)
        return self._offset


def _nominal(camera: str, felt: Proprioception) -> Array:
    """T_base_camera (4, 4) as the joints have it."""
    return robot_named(felt.robot).camera_poses(felt.torso, felt.arm)[camera]


def _mount(errors: Errors, rng: np.random.Generator) -> Array:
    """(4, 4) a turn and a shift of the given sizes about random axes."""
    axis, shift = (v / norm(v) for v in rng.normal(size=(2, 3)))
    K = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    R = np.eye(3) + np.sin(errors.mount_rad) * K + (1 - np.cos(errors.mount_rad)) * matmul(K, K)
    return kin.transform(R, errors.mount_m * shift)


def _shifted(labels: NDArray[np.int32], by_px: int, rng: np.random.Generator) -> NDArray[np.int32]:
    """The image shifted along x, y or both, its edge repeated."""
    directions = [(y, x) for y in (-1, 0, 1) for x in (-1, 0, 1) if (y, x) != (0, 0)]
    y, x = directions[rng.integers(len(directions))]
    if not by_px:
        return labels
    h, w = labels.shape
    rows = np.clip(np.arange(h) + y * by_px, 0, h - 1)
    columns = np.clip(np.arange(w) + x * by_px, 0, w - 1)
    return labels[np.ix_(rows, columns)]
