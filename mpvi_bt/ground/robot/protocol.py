"""The robot's protocol: proprioception, cameras, and one command a step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.default_robot import DEFAULT_ROBOT

Side = Literal["left", "right"]
SIDES: tuple[Side, Side] = ("left", "right")
CONTROL_HZ = 30  # control steps, and ticks, a second (BEHAVIOR's rate)
EMPTY_M = 0.003  # a closed hand that is no wider than this closed on nothing


def other(side: Side) -> Side:
    """The other hand."""
    return "left" if side == "right" else "right"


@dataclass(frozen=True, eq=False)
class Proprioception:
    """What the robot feels, measured at the present step.

    Attributes:
        base_pose: (3,) x, y [m] and yaw [rad, -pi..pi] in the world (Paper, Navigation: localization is assumed).
        base_velocity: (3,) vx, vy [m/s] and yaw rate [rad/s] in the base frame.
        torso: (T,) its joints, torso and head, in the order of its layout [m or rad].
        arm: (n,) joint angles [rad] of each arm; a robot with one has it on the "right".
        arm_velocity: (n,) [rad/s] of each arm.
        gripper_width: Opening between the fingers [m], 0 to `open_m`, of each hand.
        gripper_command: Last commanded value of each gripper, -1 closed ... 1 open.
        arm_command: (n,) last commanded joint angles [rad] of each arm; empty where the robot does not tell. What the
            arms press against keeps them from getting there.
        torso_velocity: (T,) of the torso's joints [m/s or rad/s]; 0 where it is not felt.
        gripper_velocity: How fast each hand opens [m/s]; empty where it is not felt.
        robot: What robot it is, by name.
        open_m: Between the fingers of a hand that is fully open.
        grasp_m: Fingers that are held apart by more than this hold something.
    """

    base_pose: Array
    base_velocity: Array
    torso: Array
    arm: Mapping[Side, Array]
    arm_velocity: Mapping[Side, Array]
    gripper_width: Mapping[Side, float]
    gripper_command: Mapping[Side, float]
    arm_command: Mapping[Side, Array] = field(default_factory=dict)
    torso_velocity: Array = field(default_factory=lambda: np.zeros(0))
    gripper_velocity: Mapping[Side, float] = field(default_factory=dict)
    robot: str = DEFAULT_ROBOT
    open_m: float = 0.10
    grasp_m: float = EMPTY_M

    def __post_init__(self) -> None:
        """A torso whose velocity is not told stands still."""
        if self.torso_velocity.shape != self.torso.shape:
            object.__setattr__(self, "torso_velocity", np.zeros(self.torso.shape))

    @property
    def sides(self) -> tuple[Side, ...]:
        """The hands that it has."""
        return tuple(side for side in SIDES if side in self.arm)

    def holds(self, side: Side) -> bool:
        """Whether a hand that was told to close has something between its fingers: it is wider than it was told to be.

        By over `grasp_m`: a hand that opens just enough to let go of a thin thing is told to be half closed.
        """
        if side not in self.arm:
            return False
        told_m = (self.gripper_command[side] + 1) / 2 * self.open_m
        return self.gripper_command[side] < 0 and self.gripper_width[side] > told_m + self.grasp_m


@dataclass(frozen=True, eq=False)
class CameraImage:
    """One picture.

    Attributes:
        camera: Its name, such as "head", or the side of a wrist.
        rgb: (H, W, 3) uint8.
        depth: (H, W) float32 [m] along the optical axis, 0 = nothing seen.
        labels: (H, W) int32 ids of what each pixel shows, or None where there is no labeler (a real camera).
        names: Label id to the name of the thing, such as "ashcan.n.01_1"; the robot's own parts map to "robot".
        K: (3, 3) intrinsics [px].
        T_world_camera: (4, 4) camera to world; optical frame: x right, y down, z forward.
    """

    camera: str
    rgb: NDArray[np.uint8]
    depth: NDArray[np.float32]
    labels: NDArray[np.int32] | None
    names: Mapping[int, str]
    K: Array
    T_world_camera: Array

    def points_world(self) -> Array:
        """(H, W, 3) world position [m] of every pixel; nan where depth is 0."""
        h, w = self.depth.shape
        u, v = np.meshgrid(np.arange(w) + 0.5, np.arange(h) + 0.5)
        z = np.where(self.depth > 0, self.depth, np.nan).astype(float)
        p = np.stack([(u - self.K[0, 2]) / self.K[0, 0] * z, (v - self.K[1, 2]) / self.K[1, 1] * z, z], -1)
        return matmul(p, self.T_world_camera[:3, :3].T) + self.T_world_camera[:3, 3]


class Robot(Protocol):
    """A robot that can be ticked: behaviors read it and write one command a step."""

    @property
    def action(self) -> Array:
        """(A,) the command that the next step will carry out."""
        ...

    def act(self, action: Array) -> None:
        """Set the command of the next step. Raises BackendError unless it is (A,) and finite."""
        ...

    def hold(self) -> None:
        """Command the base to stand still and every joint to keep its present target."""
        ...

    def proprioception(self) -> Proprioception:
        """What the robot feels now."""
        ...

    def look(self, camera: str) -> CameraImage:
        """Render one camera now. Raises NoRenderingDevice where nothing can be drawn."""
        ...
