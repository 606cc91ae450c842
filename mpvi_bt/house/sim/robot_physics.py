"""What physics needs to know of a robot besides its description: its drives, fingers, and where cameras are fixed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.model import Drive
from mpvi_bt.ground.robot.protocol import Side


@dataclass(frozen=True)
class Finger:
    """A joint of a gripper: at `closed + rate * m`, a finger is `m` [m] away from the middle of its gripper."""

    joint: str
    closed: float = 0.0
    rate: float = 1.0


@dataclass(frozen=True)
class MimicJoint:
    """A joint that follows another one: it is at `factor * q + offset`."""

    joint: str
    followed: str
    factor: float
    offset: float


@dataclass(frozen=True, eq=False)
class RobotPhysics:
    """A robot as the simulator builds it.

    Attributes:
        urdf: Text of its URDF, with the three joints that move the base over the floor.
        base_joints: Their names: along x, along y, about z.
        drives: Gains by joint.
        mode: What gains count in: forces, or accelerations, which suit a joint whatever it carries.
        fingers: Of each hand, all joints that move them.
        finger_links: Of each hand, the links that a thing is held between.
        hand_links: What the fingers are fixed to.
        tip_m: Fingertips reach this far past the tcp.
        finger_half_m: Half a finger's thickness.
        neighbors: Groups of links that may overlap.
        still: Joints that stay at 0.
        followers: Joints of torso and arms that follow another one.
        mounts: T_link_camera (4, 4), optical frame, of cameras that do not look along the x axis of their link.
    """

    urdf: str
    base_joints: tuple[str, str, str]
    drives: Mapping[str, Drive]
    mode: Literal["force", "acceleration"]
    fingers: Mapping[Side, tuple[Finger, ...]]
    finger_links: Mapping[Side, tuple[str, ...]]
    hand_links: Mapping[Side, str]
    tip_m: float
    finger_half_m: float
    neighbors: tuple[tuple[str, ...], ...]
    still: tuple[str, ...] = ()
    followers: tuple[MimicJoint, ...] = ()
    mounts: Mapping[str, Array] = field(default_factory=dict)
