"""The form of a robot's file, `robots/NAME.yaml`. What its URDF tells need not be in it."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from mpvi_bt.ground.marked_yaml import Record
from mpvi_bt.ground.robot.action_layout import ActionKind
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, EMPTY_M, Side

_Finite = Annotated[float, Field(ge=-1e6, le=1e6, allow_inf_nan=False)]
_Positive = Annotated[float, Field(gt=0, le=1e6, allow_inf_nan=False)]
_Vector = tuple[_Finite, _Finite, _Finite]
_Corner = tuple[_Finite, _Finite]
_Range = tuple[_Finite, _Finite]
_Name = Annotated[str, Field(min_length=1)]


class FramePart(Record):
    """A frame: a link, and a place in it [m, rad]."""

    link: _Name
    xyz: _Vector = (0.0, 0.0, 0.0)
    rpy: _Vector = (0.0, 0.0, 0.0)


class SpeedPart(Record):
    """The most that a base does [m/s, m/s, rad/s]."""

    ahead: _Positive
    sideways: _Positive | None = None
    turn: _Positive


class AccelerationPart(Record):
    """The most of straight drives and of turns [m/s^2, rad/s^2]. Our choice of defaults: gentle."""

    ahead: _Positive = 0.5
    turn: _Positive = 1.0


class BasePart(Record):
    """The base.

    Attributes:
        kind: How it drives.
        link: The link whose frame is the base frame; by default "base_footprint", "base_link" or the URDF's root.
        above_floor_m: How high that frame is above the floor.
        footprint_m: Radius of a round base, or (n, 2) the corners of a convex one, x forward and y left.
        speed, acceleration: Limits.
        folded_m: Radius about the base frame that is kept clear, arms in the travel posture; by default what base and
            arms take up.
        own_m: What the head sees nearer than this is the robot itself; by default 15 cm more.
        turn_m: A turn by a radian counts as a drive of this length; by default the radius.
    """

    kind: Literal["holonomic", "differential"]
    link: _Name | None = None
    above_floor_m: _Finite = 0.0
    footprint_m: _Positive | list[_Corner]
    speed: SpeedPart
    acceleration: AccelerationPart = AccelerationPart()
    folded_m: _Positive | None = None
    own_m: _Positive | None = None
    turn_m: _Positive | None = None


class CameraPart(FramePart):
    """A camera.

    Attributes:
        optical: Whether the link's frame looks along z with y down; else it looks along x with z up. By default its
            name tells: whether "optical" is in it.
        size: Width and height of its pictures [px].
        fov_rad: Vertical field of view; or
        fx, fy, cx, cy: intrinsics [px], of pictures of that size.
        depth: Whether it measures depth.
        near_m, far_m: Range of its depth.
    """

    optical: bool | None = None
    size: tuple[Annotated[int, Field(ge=1, le=16384)], Annotated[int, Field(ge=1, le=16384)]]
    fov_rad: Annotated[float, Field(gt=0, lt=3.1)] | None = None
    fx: _Positive | None = None
    fy: _Positive | None = None
    cx: _Positive | None = None
    cy: _Positive | None = None
    depth: bool = False
    near_m: _Positive = 0.05
    far_m: _Positive = 10.0


class GroupPart(Record):
    """Joints that are commanded together.

    Attributes:
        joints: Names, in the order of their numbers.
        limits: Of each joint, within the URDF's [m or rad].
        speed: The most of all, or of each [m/s or rad/s]; by default the URDF's.
        travel: Positions to drive in, and to begin with; by default 0, or the limit next to it.
    """

    joints: list[_Name]
    limits: list[_Range] | None = None
    speed: _Positive | list[_Positive] | None = None
    travel: list[_Finite] | None = None


class TorsoPart(GroupPart):
    """Joints of torso and head.

    Attributes:
        lift, turn, bend, tilt: Which joint lifts, turns and bends the chest, and which one tilts the head; by default
            what axes and places tell.
    """

    lift: _Name | None = None
    turn: _Name | None = None
    bend: _Name | None = None
    tilt: _Name | None = None


class GripperPart(Record):
    """A gripper.

    Attributes:
        joints: Of its fingers; those that follow another joint need not be named. None: the URDF has no fingers, and
            the robot's own side tells how wide it is open.
        tcp: The frame between the fingers: z along them, y across.
        open, closed: Positions of the joints; by default the limits, closed next to 0.
        opening_m: Between the fingers when open; by default what fingers travel that slide.
        grasp_m: A gripper that was told to close holds something if it is wider than it was told to be by more.
    """

    joints: list[_Name]
    tcp: FramePart
    open: list[_Finite] | None = None
    closed: list[_Finite] | None = None
    opening_m: _Positive | None = None
    grasp_m: Annotated[float, Field(ge=0, le=1)] = EMPTY_M


class ActionsPart(Record):
    """The numbers of an action, by name and in order.

    `base_vx`, `base_vy` and `base_yaw_rate` are velocities of the base frame, `gripper_left` and `gripper_right` go
    from -1 closed to 1 open, joints have their names; what begins with `unused` is 0.

    Attributes:
        numbers: By default base, torso, then each arm and its gripper, left first.
        kind: What joints are in the actions that the robot's own side is sent over a socket: targets, how far these go
            in an action, or how fast they go.
        rate_hz: How many of these actions a second; it divides 30.
    """

    numbers: list[_Name] | None = None
    kind: ActionKind = "absolute"
    rate_hz: _Positive = CONTROL_HZ


class RobotFile(Record):
    """A robot.

    Attributes:
        about: A line on it.
        urdf: Path of its URDF, from the folder of this file.
        model: "module:attribute" of a model of ours, for the hands of ours.
        base: What drives.
        cameras: By name; the one to search with is the "head".
        torso: Joints of torso and head.
        arms, grippers: By side; the only arm is the "right".
        arm_radius_m: Of elbow, wrist and hand, from above.
        actions: Layout of actions.
    """

    about: str = ""
    urdf: _Name
    model: str | None = None
    base: BasePart
    cameras: dict[str, CameraPart]
    torso: TorsoPart = TorsoPart(joints=[])
    arms: dict[Side, GroupPart] = {}
    grippers: dict[Side, GripperPart] = {}
    arm_radius_m: _Positive = 0.05
    actions: ActionsPart = ActionsPart()
