"""What physics needs to know of a robot besides its description: its drives, fingers, and where cameras are fixed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Literal

from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.described import DescribedRobot
from mpvi_bt.ground.robot.model import Drive, RobotModel
from mpvi_bt.ground.robot.protocol import Side
from mpvi_bt.ground.robot.robot_description import RobotDescription


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


@cache
def physics_of(robot: RobotDescription) -> RobotPhysics:
    """What physics needs to know of a robot: by its model, or by the URDF of its file."""
    if isinstance(robot, DescribedRobot):
        from mpvi_bt.house.sim.described_physics import described_physics

        return described_physics(robot)
    assert isinstance(robot, RobotModel)
    return RobotPhysics(
        urdf=robot.urdf(),
        base_joints=robot.base_joints,
        drives=robot.drives,
        mode="force",
        fingers={side: tuple(map(Finger, names)) for side, names in robot.finger_joints.items()},
        finger_links=robot.finger_links,
        hand_links=robot.hand_links,
        tip_m=robot.hand.tip_m,
        finger_half_m=robot.hand.finger_half_m,
        neighbors=robot.neighbors,
        still=robot.still,
    )
