"""What a robot is made of, as a value: its joints and limits, arms, cameras, hull and postures.

Frames: base x forward, y left, z up, on the floor. Chest: moved by the trunk, carries shoulders and head.
Hand: z along the fingers (approach), y across them (closing), origin at the flange; the tcp lies between the pads.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.import_paths import imported
from mpvi_bt.ground.robot import arms
from mpvi_bt.ground.robot.action_layout import ActionLayout
from mpvi_bt.ground.robot.arms import Arm
from mpvi_bt.ground.robot.camera import Camera
from mpvi_bt.ground.robot.hand import Hand
from mpvi_bt.ground.robot.mobile_base import MobileBase
from mpvi_bt.ground.robot.protocol import EMPTY_M, SIDES, Side
from mpvi_bt.ground.robot.trunk import LiftTrunk, Trunk

SIGN: Mapping[Side, int] = {"left": 1, "right": -1}


def wrist_mount(p: Array, tilt_rad: float) -> Array:
    """T_hand_camera (4, 4), optical frame, of a camera at `p` (3,) that is tilted by so much toward the tcp."""
    R = kin.rot_y(-np.pi / 2 + tilt_rad)
    return kin.transform(R[:, [1, 2, 0]] * [-1, -1, 1], p)


@dataclass(frozen=True)
class Drive:
    """Gains of one kind of joint: force = stiffness * error - damping * velocity error, at most `force` [N, Nm]."""

    stiffness: float
    damping: float
    force: float


@dataclass(frozen=True, eq=False)
class Hull:
    """What of a robot may touch things and itself: spheres along an arm, boxes and spheres about the rest.

    Attributes:
        centers: (m, 3) of an arm's spheres, in the frames of `Arm.frames`; the first two are of the upper arm, those
            of the hand follow those of the arm, and those of the fingers come last.
        radii: (m,) [m].
        frame: (m,) the frame that each is in.
        fingers: How many of them are of fingers: what may be near a thing that is being grasped.
        boxes: (k, 6) centers and half extents in the chest frame, of chest and head.
        boxes_from: (k,) the first of the arm's spheres that has to keep clear of each; those before it are its
            neighbors.
        columns: (k, 6) boxes in the base frame, of what is fixed on the base.
        base: (2,) radius and height of the base.
        fold_m: The middles of a hand's spheres come no nearer to those of the first two.
        trunk: (n, 4) spheres in the chest frame, center and radius, that stand for head and chest among furniture.
        links: (n, 4) likewise in the frames of `Trunk.links`, which arms keep clear of, too.
        link: (n,) the frame that each is in.
        link_boxes: (k, 6) centers and half extents in those frames, one each: what arms keep clear of exactly.
        standing: (n, 4) likewise in the base frame, for the base and what is fixed above it, wherever the torso is.
    """

    centers: Array
    radii: Array
    frame: NDArray[np.intp]
    fingers: int
    boxes: Array
    boxes_from: NDArray[np.int64]
    columns: Array
    base: Array
    fold_m: float
    trunk: Array
    standing: Array
    links: Array = field(default_factory=lambda: np.zeros((0, 4)))
    link: NDArray[np.intp] = field(default_factory=lambda: np.zeros(0, np.intp))
    link_boxes: Array = field(default_factory=lambda: np.zeros((0, 6)))

    @cached_property
    def hand_frame(self) -> int:
        """The frame that the spheres of the hand are in."""
        return int(self.frame.max())

    @cached_property
    def hand_from(self) -> int:
        """The first of the spheres of the hand."""
        return int(np.argmax(self.frame == self.hand_frame))


@dataclass(frozen=True, eq=False)
class RobotModel:
    """A robot: a base, a torso, one or two arms with seven joints and a gripper each, and cameras.

    A torso is four joints, such as lift [m], waist yaw, waist pitch, head tilt [rad]; its trunk says what they do.
    Where a robot has no such joint its name is None and both limits are 0.

    Attributes:
        name: As `--robot` has it.
        layout: Of its actions.
        urdf_writer: Import path of the function that writes its links and joints as the text of a URDF.
        arms: Its arms; a robot with one has it on the "right".
        trunk: What carries the chest.
        base_joints: Along x, along y, about z.
        torso_joints: Names, or None.
        arm_joints, finger_joints: Names.
        hand_links, finger_links: What the fingers are fixed to, and what they are.
        arm_speed, arm_acceleration: (7,) what motions are planned with [rad/s, rad/s^2].
        torso_speed, torso_acceleration: (4,) likewise [m or rad].
        torso_give: (4,) something holds the torso up that is off its targets by more [m or rad].
        top_speed: (11,) of torso and arm, what the joints can do [m/s, rad/s]: how fast targets may run.
        base_speed: (3,) [m/s, m/s, rad/s] the most; the second is 0 for a base that cannot go sideways.
        drive_acceleration: (2,) of straight drives [m/s^2, rad/s^2].
        head_m: (3,) the head in the chest frame, on its tilt axis.
        head_to_camera: (4, 4) T_head_camera, optical frame.
        tcp_m: Flange to tcp.
        hand_to_camera: (4, 4) T_hand_camera of each wrist camera, optical frame.
        hand: What each arm ends in.
        base: From above.
        arm_m: Radius of elbow, wrist and hand, from above.
        travel_arm, travel_torso: Joints to drive in, and to begin with.
        lifts: Of the trunk [m], of which searches for a posture try each.
        aside: (k, 3) where a hand may bring a payload before the torso moves: ahead, toward its own side, up [m] in the
            base frame; in reach from bent torsos too.
        meets: (k, 3) likewise where it holds a payload out to the other hand, before the places that suit any robot.
        drives: Gains by joint.
        cameras: "head", and of each arm one by the name of its side.
        hull: Where it would touch.
        neighbors: Groups of links that may overlap where they are joined; physics exempts only parent and child.
        still: Joints that stay at 0.
    """

    name: str
    layout: ActionLayout
    urdf_writer: str
    arms: Mapping[Side, Arm]
    trunk: Trunk
    base_joints: tuple[str, str, str]
    torso_joints: tuple[str | None, ...]
    arm_joints: Mapping[Side, tuple[str, ...]]
    finger_joints: Mapping[Side, tuple[str, str]]
    hand_links: Mapping[Side, str]
    finger_links: Mapping[Side, tuple[str, str]]
    arm_speed: Array
    arm_acceleration: Array
    torso_speed: Array
    torso_acceleration: Array
    base_speed: Array
    drive_acceleration: Array
    torso_give: Array
    top_speed: Array
    head_m: Array
    head_to_camera: Array
    tcp_m: float
    hand_to_camera: Array
    hand: Hand
    base: MobileBase
    arm_m: float
    travel_arm: Mapping[Side, Array]
    travel_torso: Array
    lifts: tuple[float, ...]
    aside: Array
    drives: Mapping[str, Drive]
    cameras: Mapping[str, Camera]
    hull: Hull
    neighbors: tuple[tuple[str, ...], ...]
    still: tuple[str, ...] = ()
    meets: Array = field(default_factory=lambda: np.zeros((0, 3)))

    def urdf(self) -> str:
        """Its links and joints as the text of a URDF."""
        text: str = imported(self.urdf_writer, f"robot {self.name}: urdf_writer")()
        return text

    @property
    def arm_limits(self) -> Mapping[Side, Array]:
        """(7, 2) of each arm [rad]."""
        return {side: arm.limits for side, arm in self.arms.items()}

    @property
    def torso_top_speed(self) -> Array:
        """(4,) [m/s or rad/s]."""
        return self.top_speed[:4]

    @property
    def arm_top_speed(self) -> Mapping[Side, Array]:
        """(7,) of each arm [rad/s]."""
        return dict.fromkeys(self.arms, self.top_speed[4:])

    @property
    def linear_joints(self) -> frozenset[int]:
        """Indices into an action of the joints that are told in meters: a lift."""
        return frozenset({self.layout.torso.start} if isinstance(self.trunk, LiftTrunk) else ())

    @property
    def finger_range(self) -> Mapping[Side, Array]:
        """(n, 2) closed and open position of each joint of the fingers [m]."""
        ends = np.array([0.0, self.hand.travel_m])
        return {side: np.tile(ends, (len(names), 1)) for side, names in self.finger_joints.items()}

    @property
    def opening_m(self) -> float:
        """Between the fingers of a hand that is fully open."""
        return self.hand.opening_m

    @property
    def grasp_m(self) -> float:
        """Fingers that are held apart by more than this hold something [m]."""
        return EMPTY_M

    @property
    def sides(self) -> tuple[Side, ...]:
        """The hands that it has."""
        return tuple(side for side in SIDES if side in self.arms)

    @property
    def sideways(self) -> bool:
        """Whether its base can go sideways."""
        return bool(self.base_speed[1])

    @property
    def nods(self) -> bool:
        """Whether its head tilts."""
        return bool(np.ptp(self.trunk.limits[3]))

    @property
    def torso_limits(self) -> Array:
        """(4, 2) of the torso's joints [m or rad]."""
        return self.trunk.joint_limits

    def postures(self, pitches: Iterable[float], tilt: float) -> Array:
        """(n, 4) postures of the trunk for searches: all lifts, at each possible one of these pitches [rad]."""
        low, high = self.trunk.limits[2]
        able = [pitch for pitch in pitches if low <= pitch <= high]
        return np.array([(lift, 0.0, pitch, tilt) for lift in self.lifts for pitch in able])

    def chest(self, torso: Array) -> Array:
        """T_base_chest (..., 4, 4) of a torso's joints (..., 4)."""
        return self.trunk.chest(torso)

    def links(self, torso: Array) -> tuple[Array, Array]:
        """Spheres about the trunk's links at joints (4,), of which there may be none: centers (n, 3) and radii (n,)."""
        if not len(self.hull.links):  # searches ask thousands of times
            return np.zeros((0, 3)), np.zeros(0)
        T = self.trunk.links(torso)[self.hull.link]
        return matmul(T[:, :3, :3], self.hull.links[:, :3, None])[..., 0] + T[:, :3, 3], self.hull.links[:, 3]

    def head_camera(self, torso: Array) -> Array:
        """T_base_camera (4, 4), optical frame, of torso (4,)."""
        tilt = float(self.trunk.posture(torso)[3])
        T = matmul(self.chest(torso), kin.transform(kin.rot_y(tilt), self.head_m))
        return matmul(T, self.head_to_camera)

    def wrist_camera(self, torso: Array, q: Array, side: Side) -> Array:
        """T_base_camera (4, 4), optical frame, of torso (4,) and arm (7,)."""
        flange = matmul(self.tcp(torso, q, side), kin.transform(np.eye(3), (0.0, 0.0, -self.tcp_m)))
        return matmul(flange, self.hand_to_camera)

    def camera_poses(self, torso: Array, arm: Mapping[Side, Array]) -> dict[str, Array]:
        """T_base_camera (4, 4), optical frames, of each camera, of torso (4,) and arms (7,)."""
        poses: dict[str, Array] = {"head": self.head_camera(torso)}
        return poses | {side: self.wrist_camera(torso, arm[side], side) for side in self.sides}

    def arm_frames(self, q: Array, side: Side) -> Array:
        """Poses in the chest frame (..., F, 4, 4) of an arm's parts at angles (..., 7), as of `Arm.frames`."""
        q = np.asarray(q, float)
        frames = self.arms[side].frames(q.reshape(-1, 7))
        return frames.reshape(*q.shape[:-1], *frames.shape[1:])

    def arm(self, q: Array, side: Side) -> Array:
        """T_chest_tcp (..., 4, 4) of arm angles (..., 7)."""
        return self.arm_frames(q, side)[..., -1, :, :]

    def tcp(self, torso: Array, q: Array, side: Side) -> Array:
        """T_base_tcp (..., 4, 4) of torso (..., 4) and arm angles (..., 7)."""
        return matmul(self.chest(torso), self.arm(q, side))

    def arm_points(self, torso: Array, q: Array, side: Side) -> Array:
        """(4, 3) elbow, wrist, between wrist and tcp, and tcp, in the base frame."""
        elbow, hand = (matmul(self.chest(torso), T) for T in self.arm_frames(q, side)[-2:])
        wrist = hand[:3, 3] - self.tcp_m * hand[:3, 2]
        return np.stack([elbow[:3, 3], wrist, (wrist + hand[:3, 3]) / 2, hand[:3, 3]])

    def arm_inverse(self, T_chest_tcp: Array, side: Side, swivels: int = 36) -> tuple[NDArray[np.intp], Array]:
        """Every arm posture within the joint limits that brings the tcp to a target, at samples of the free angle.

        Args:
            T_chest_tcp: (n, 4, 4) targets in the chest frame.
            side: Which arm.
            swivels: Samples of the free angle.

        Returns:
            Index into the targets (m,), ascending, and joint angles (m, 7) [rad]; m may be 0. Exact to rounding.
        """
        T = np.ascontiguousarray(T_chest_tcp, float).reshape(-1, 4, 4)
        return self.arms[side].inverse(T, swivels)

    def nearest_posture(self, T_chest_tcp: Array, side: Side, q_near: Array, swivels: int = 72) -> Array | None:
        """The solution (7,) of one target (4, 4) nearest to posture `q_near` (7,), or None if it is out of reach."""
        found, q = self.nearest_postures(T_chest_tcp[None], side, q_near[None], swivels)
        return q[0] if found[0] else None

    def nearest_postures(
        self, T_chest_tcp: Array, side: Side, q_near: Array, swivels: int = 72
    ) -> tuple[NDArray[np.bool_], Array]:
        """Which targets (n, 4, 4) are within reach (n,), and the solution (n, 7) nearest to each of `q_near` (n, 7)."""
        T, near = np.ascontiguousarray(T_chest_tcp, float), np.ascontiguousarray(q_near, float)
        return self.arms[side].nearest(T, near, swivels)

    def postures_along(
        self, T_chest_tcp: Array, side: Side, start: Array, leap_rad: float, swivels: int = 72
    ) -> Array | None:
        """The postures (n, 7) of targets (n, 4, 4), each the nearest to the one before, the first to `start` (7,).

        None if one of them is out of reach, or a joint would turn by more than `leap_rad` from one to the next.
        """
        T, first = np.ascontiguousarray(T_chest_tcp, float), np.ascontiguousarray(start, float)
        q = self.arms[side].along(T, first, swivels, leap_rad)
        return q if len(q) == len(T) else None

    def limit_cost(self, q: Array, side: Side) -> Array:
        """(n,) how far joints of postures (n, 7) are into the last tenths of their ranges, summed, in half ranges."""
        return arms.limit_cost(q, self.arms[side].limits)
