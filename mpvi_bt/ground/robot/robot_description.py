"""What everything but a policy of ours has to know of a robot; a file says it (`robots/NAME.yaml`)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.action_layout import ActionLayout
from mpvi_bt.ground.robot.camera import Camera
from mpvi_bt.ground.robot.mobile_base import MobileBase
from mpvi_bt.ground.robot.protocol import Side
from mpvi_bt.ground.robot.trunk import Trunk


class RobotDescription(Protocol):
    """A mobile manipulator: a base, perhaps torso and head, at most two arms with a gripper each, and cameras.

    Frames: base x forward, y left, z up, on the floor. Of a tcp z points along the fingers.
    """

    @property
    def name(self) -> str:
        """As `--robot` has it."""
        ...

    @property
    def layout(self) -> ActionLayout:
        """Where its parts stand in an action (A,)."""
        ...

    @property
    def sides(self) -> tuple[Side, ...]:
        """The arms that it has; a single one is the "right"."""
        ...

    @property
    def base(self) -> MobileBase:
        """Its base from above."""
        ...

    @property
    def base_speed(self) -> Array:
        """(3,) [m/s, m/s, rad/s] the most; the second is 0 for a base that cannot go sideways."""
        ...

    @property
    def sideways(self) -> bool:
        """Whether its base can go sideways."""
        ...

    @property
    def drive_acceleration(self) -> Array:
        """(2,) of straight drives and turns on the spot [m/s^2, rad/s^2]."""
        ...

    @property
    def torso_joints(self) -> tuple[str | None, ...]:
        """(T,) names of the joints of torso and head; None of a number that no joint follows."""
        ...

    @property
    def arm_joints(self) -> Mapping[Side, tuple[str, ...]]:
        """Names of the joints of each arm."""
        ...

    @property
    def finger_joints(self) -> Mapping[Side, tuple[str, ...]]:
        """Names of the joints of each gripper."""
        ...

    @property
    def finger_range(self) -> Mapping[Side, Array]:
        """(n, 2) closed and open position of each of these joints [m or rad]."""
        ...

    @property
    def torso_limits(self) -> Array:
        """(T, 2) lowest and highest [m or rad]."""
        ...

    @property
    def arm_limits(self) -> Mapping[Side, Array]:
        """(n, 2) of each arm [rad or m]."""
        ...

    @property
    def torso_top_speed(self) -> Array:
        """(T,) [m/s or rad/s] the most that the joints do."""
        ...

    @property
    def arm_top_speed(self) -> Mapping[Side, Array]:
        """(n,) likewise of each arm."""
        ...

    @property
    def linear_joints(self) -> frozenset[int]:
        """Indices into an action of the joints that are told in meters; all others turn."""
        ...

    @property
    def opening_m(self) -> float:
        """Between the fingers of a gripper that is fully open."""
        ...

    @property
    def grasp_m(self) -> float:
        """Fingers that are held apart by more than this hold something [m]."""
        ...

    @property
    def travel_torso(self) -> Array:
        """(T,) joints to drive in, and to begin with."""
        ...

    @property
    def travel_arm(self) -> Mapping[Side, Array]:
        """(n,) likewise of each arm."""
        ...

    @property
    def trunk(self) -> Trunk:
        """What lifts, turns and tilts the head: navigation nods by it."""
        ...

    @property
    def nods(self) -> bool:
        """Whether its head tilts."""
        ...

    @property
    def cameras(self) -> Mapping[str, Camera]:
        """By name; the one that is searched with is the "head"."""
        ...

    @property
    def arm_m(self) -> float:
        """Radius of an arm from above [m]."""
        ...

    def __hash__(self) -> int:
        """By identity: what follows from a robot is kept by it."""
        ...

    def urdf(self) -> str:
        """Its links and joints as the text of a URDF."""
        ...

    def camera_poses(self, torso: Array, arm: Mapping[Side, Array]) -> dict[str, Array]:
        """T_base_camera (4, 4), optical frames, of each camera, at joints of torso (T,) and arms (n,)."""
        ...

    def head_camera(self, torso: Array) -> Array:
        """T_base_camera (4, 4), optical frame, of the head's, at joints of the torso (T,)."""
        ...

    def wrist_camera(self, torso: Array, q: Array, side: Side) -> Array:
        """T_base_camera (4, 4), optical frame, of the camera of a hand, at joints of torso (T,) and arm (n,)."""
        ...

    def tcp(self, torso: Array, q: Array, side: Side) -> Array:
        """T_base_tcp (4, 4) at joints of torso (T,) and arm (n,)."""
        ...

    def arm_points(self, torso: Array, q: Array, side: Side) -> Array:
        """(n, 3) places along an arm in the base frame, from the elbow to the tcp: what it takes up from above."""
        ...
