"""BEHAVIOR's numbers as what settings of remote policies may choose: `executive.remote.joint_dialects` loads this."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from mpvi_bt.executive.remote.joint_dialects import DIALECTS, BaseVelocity, Dialect
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import Proprioception
from mpvi_bt.hands.behavior_robot.behavior_layout import ACTION_SIZE, BODY, SIZE, TYPE, action_from, encoded
from mpvi_bt.hands.behavior_robot.retargeting import from_r1pro


@dataclass(frozen=True)
class BehaviorNumbers:
    """`executive.remote.joint_dialects.JointDialect` of a year."""

    name: Dialect
    robot: str = BODY
    title: str = f"BEHAVIOR's {TYPE}"
    action_size: int = ACTION_SIZE

    @property
    def state_size(self) -> int:
        """How many numbers its proprioception has."""
        return SIZE[self.name]

    def encoded(self, body: Proprioception, base_velocity: BaseVelocity | None) -> Array:
        """As `behavior_layout.encoded`."""
        return encoded(body, self.name, base_velocity)

    def actions(self, theirs: Array, body: Proprioception) -> Array:
        """(H, A) our actions, of its own (H, 23). Raises UserError if the robot is too unlike it."""
        return from_r1pro(action_from(theirs), body)


JOINT_DIALECTS: Mapping[Dialect, BehaviorNumbers] = {name: BehaviorNumbers(name) for name in DIALECTS}
