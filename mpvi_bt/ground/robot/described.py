"""A robot as its file describes it: poses by its URDF, and no more of hands than where they are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from mpvi_bt.ground.geometry.linear_algebra import norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.action_layout import ActionLayout
from mpvi_bt.ground.robot.camera import Camera
from mpvi_bt.ground.robot.kinematic_chain import KinematicChain
from mpvi_bt.ground.robot.mobile_base import MobileBase
from mpvi_bt.ground.robot.protocol import SIDES, Side
from mpvi_bt.ground.robot.urdf_tree import UrdfTree

_ELBOW = 1 / 3  # our choice: of an arm's length, what is beyond it may be anywhere; what is before it is over the base


@dataclass(frozen=True, eq=False)
class DescribedTrunk:
    """Torso and head as joints of a URDF, some of which lift, turn, bend or tilt; it is a `Trunk`.

    Attributes:
        joint_limits: (T, 2) [m or rad].
        parts: Of lift, yaw, pitch and head tilt the index of the joint; None: there is none.
        signs: (4,) -1 where a joint counts the other way than the posture.
        chain: To the link that carries the arms.
    """

    joint_limits: Array
    parts: tuple[int | None, ...]
    signs: Array
    chain: KinematicChain

    @cached_property
    def limits(self) -> Array:
        """(4, 2) of postures; both 0 where no joint does it."""
        out = np.zeros((4, 2))
        for k, (i, sign) in enumerate(zip(self.parts, self.signs, strict=True)):
            if i is not None:
                out[k] = np.sort(self.joint_limits[i] * sign)
        out[0] -= out[0, 0]
        return out

    @cached_property
    def _lowest_m(self) -> float:
        """What the lift's joint is at, times its sign, when the chest is lowest."""
        return 0.0 if self.parts[0] is None else float(np.min(self.joint_limits[self.parts[0]] * self.signs[0]))

    def posture(self, joints: Array) -> Array:
        """(..., 4) lift above the lowest [m], yaw, pitch, head tilt [rad] of joints (..., T)."""
        joints = np.asarray(joints, float)
        out = np.zeros((*joints.shape[:-1], 4))
        for k, (i, sign) in enumerate(zip(self.parts, self.signs, strict=True)):
            if i is not None:
                out[..., k] = joints[..., i] * sign
        if self.parts[0] is not None:
            out[..., 0] -= self._lowest_m
        return out

    def joints(self, posture: Array, near: Array | None = None) -> Array:
        """(..., T) joints for postures (..., 4); those that do none of it as in `near` (T,), or else next to 0."""
        posture = np.asarray(posture, float)
        rest = np.clip(0.0, *self.joint_limits.T) if near is None else np.asarray(near, float)
        out = np.array(np.broadcast_to(rest, (*posture.shape[:-1], len(self.joint_limits))))
        for k, (i, sign) in enumerate(zip(self.parts, self.signs, strict=True)):
            if i is not None:
                out[..., i] = sign * (posture[..., k] + (self._lowest_m if k == 0 else 0.0))
        return out

    def chest(self, joints: Array) -> Array:
        """T_base_chest (..., 4, 4): of the link that carries the arms, as the URDF has it."""
        return self.chain.pose(joints)

    def links(self, joints: Array) -> Array:
        """T_base_link (F, 4, 4), at joints (T,), of what moves below the chest."""
        return np.array(self.chain.poses(joints)[1:-1]).reshape(-1, 4, 4)


@dataclass(frozen=True, eq=False)
class DescribedRobot:
    """A robot of a file; it is a `RobotDescription`, which says what its attributes are.

    Attributes:
        grasp_m: A gripper that was told to close holds something if it is wider than told by more.
        tree: Its URDF.
        link: Its base frame.
        camera_chains: To the optical frame of each camera; of those on an arm by joints of torso and that arm.
        above_floor_m: How high its base frame is above the floor.
        finger_range: (n, 2) closed and open position of each named joint of a gripper [m or rad].
        carried: The arm that each camera is on; None: none.
        hands: Chains to the tcp of each arm, by joints of torso and arm.
    """

    name: str
    layout: ActionLayout
    base: MobileBase
    base_speed: Array
    drive_acceleration: Array
    torso_joints: tuple[str | None, ...]
    arm_joints: Mapping[Side, tuple[str, ...]]
    finger_joints: Mapping[Side, tuple[str, ...]]
    torso_limits: Array
    arm_limits: Mapping[Side, Array]
    torso_top_speed: Array
    arm_top_speed: Mapping[Side, Array]
    linear_joints: frozenset[int]
    opening_m: float
    grasp_m: float
    travel_torso: Array
    travel_arm: Mapping[Side, Array]
    trunk: DescribedTrunk
    cameras: Mapping[str, Camera]
    arm_m: float
    tree: UrdfTree = field(repr=False)
    link: str
    camera_chains: Mapping[str, KinematicChain]
    carried: Mapping[str, Side | None]
    hands: Mapping[Side, KinematicChain]
    above_floor_m: float
    finger_range: Mapping[Side, Array]

    @property
    def sides(self) -> tuple[Side, ...]:
        """The arms that it has."""
        return tuple(side for side in SIDES if side in self.arm_joints)

    @property
    def sideways(self) -> bool:
        """Whether its base can go sideways."""
        return bool(self.base_speed[1])

    @property
    def nods(self) -> bool:
        """Whether its head tilts."""
        return self.trunk.parts[3] is not None

    def urdf(self) -> str:
        """The text of its URDF."""
        return self.tree.text

    def camera_poses(self, torso: Array, arm: Mapping[Side, Array]) -> dict[str, Array]:
        """T_base_camera (4, 4), optical frames, of each camera, at joints of torso (T,) and arms (n,)."""
        poses = {}
        for name, chain in self.camera_chains.items():
            side = self.carried[name]
            poses[name] = chain.pose(torso if side is None else np.concatenate([torso, arm[side]]))
        return poses

    def head_camera(self, torso: Array) -> Array:
        """T_base_camera (..., 4, 4), optical frame, of the head's, at joints of the torso (..., T)."""
        return self.camera_chains["head"].pose(torso)

    def wrist_camera(self, torso: Array, q: Array, side: Side) -> Array:
        """T_base_camera (4, 4), optical frame, of the first camera on an arm. Raises KeyError if it has none."""
        name = next((name for name, on in self.carried.items() if on == side), None)
        if name is None:
            raise KeyError(f"{self.name} has no camera on its {side} arm")
        return self.camera_chains[name].pose(np.concatenate([torso, q]))

    def tcp(self, torso: Array, q: Array, side: Side) -> Array:
        """T_base_tcp (..., 4, 4) at joints of torso (..., T) and arm (..., n)."""
        return self.hands[side].pose(np.concatenate([torso, q], -1))

    def arm_points(self, torso: Array, q: Array, side: Side) -> Array:
        """(n, 3) its joints from the elbow on, the tcp, and the middles between them, in the base frame."""
        places = self._points(torso, q, side)[self._elbow[side] :]
        return np.concatenate([places, (places[1:] + places[:-1]) / 2])

    def _points(self, torso: Array, q: Array, side: Side) -> Array:
        """(n + 1, 3) the joints of an arm, and the tcp."""
        poses = self.hands[side].poses(np.concatenate([torso, q]))
        return np.array([T[:3, 3] for T in poses[-1 - len(q) :]])

    @cached_property
    def _elbow(self) -> Mapping[Side, int]:
        """The first of an arm's joints that is beyond so much of its length."""
        found = {}
        for side in self.sides:
            places = self._points(self.travel_torso, self.travel_arm[side], side)
            along = np.concatenate([[0.0], norm(places[1:] - places[:-1], axis=1).cumsum()])
            found[side] = int(np.argmax(along >= _ELBOW * along[-1]))
        return found
