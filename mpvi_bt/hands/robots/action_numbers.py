"""The action of our robots: 23 numbers in BEHAVIOR's order, whatever a robot lacks."""

from __future__ import annotations

from collections.abc import Mapping

from mpvi_bt.ground.robot.action_layout import ActionLayout
from mpvi_bt.ground.robot.protocol import Side

_ARM: Mapping[Side, slice] = {"left": slice(7, 14), "right": slice(15, 22)}
_GRIPPER: Mapping[Side, int] = {"left": 14, "right": 22}
_BASE = ("base_vx", "base_vy", "base_yaw_rate")


def action_layout(torso: tuple[str | None, ...], arms: Mapping[Side, tuple[str, ...]]) -> ActionLayout:
    """Base, four joints of the torso, then seven joints and a gripper of each arm; 0 of what the robot lacks.

    Args:
        torso: Names of its joints, or None.
        arms: Names of the joints of the arms that it has.
    """
    names = [*_BASE, *torso, *(None for _ in range(16))]
    for side, joints in arms.items():
        names[_ARM[side]] = joints
        names[_GRIPPER[side]] = f"gripper_{side}"
    return ActionLayout(
        names=tuple(name or f"unused_{i}" for i, name in enumerate(names)),
        base=(0, 1, 2),
        torso=slice(3, 7),
        arm={side: _ARM[side] for side in arms},
        gripper={side: _GRIPPER[side] for side in arms},
    )
