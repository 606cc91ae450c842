"""Motions of the whole body that need neither a policy nor a navigator: posture and look_around."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from py_trees.common import Status

from mpvi_bt.executive.behaviors.node import Leaf
from mpvi_bt.executive.behaviors.saved_state import number
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, Proprioception
from mpvi_bt.ground.robot.robots import layout_of, robot_named
from mpvi_bt.ground.robot.stow import stow_of

# All our choice: slow enough that what a hand holds by friction stays there.
_TURN_RAD_S = 0.8
_TURN_RAD_S2 = 1.2
_LAST_PER_S = 6.0  # rate by what is left, at the end
_DONE_RAD = 0.01  # so near to the angle that was asked for the turn ends;
_STALL_S = 3.0  # so long without coming nearer, it has failed
_ARM_RAD = 0.1  # so near to their posture arms
_TORSO = 0.05  # and torso are in it [m, rad]


class Posture(Leaf):
    """Folds empty hands and straightens up, as before a drive; a hand that holds something keeps its pose.

    The robot may draw back a little first. If it ends in another posture it fails with reason "not_reached".

    Args:
        name: In the tree.
        posture: "travel" (Paper, Navigation appendix: fixed arms while driving).
    """

    def __init__(self, name: str, posture: str) -> None:
        super().__init__(name)
        self.posture = posture

    def initialise(self) -> None:
        """Start moving."""
        super().initialise()
        self._stow = stow_of(self.context.robot)
        self._stow.start()
        self.feedback_message = "folding the arms"

    def update(self) -> Status:
        """Move for one step."""
        robot = self.context.robot
        with self.context.stopwatch("motion"):
            robot.hold()
            if not self._stow.step():
                return Status.RUNNING
            away = _away_from_travel(robot.proprioception())
        if away:
            return self.fail("not_reached", f"{' and '.join(away)} did not get into the travel posture")
        self.feedback_message = "arms folded"
        return Status.SUCCESS


def _away_from_travel(body: Proprioception) -> list[str]:
    """What is not in the travel posture."""
    home = robot_named(body.robot)
    arms = [s for s, q in home.travel_arm.items() if not body.holds(s) and np.abs(body.arm[s] - q).max() > _ARM_RAD]
    torso = np.abs(body.torso - home.travel_torso).max(initial=0.0) > _TORSO
    return [f"the {side} arm" for side in arms] + (["the torso"] if torso else [])


class LookAround(Leaf):
    """Turns on the spot; fails with reason "blocked" if the base does not turn.

    It knows nothing of what stands around the robot: have the arms folded (posture: travel) where there is little room.

    Args:
        name: In the tree.
        degrees: How far, counter-clockwise; 360 if None.
    """

    def __init__(self, name: str, degrees: float | None = None) -> None:
        super().__init__(name)
        self._goal_rad = math.radians(360.0 if degrees is None else degrees)
        self._turned_rad = 0.0
        self._yaw: float | None = None
        self._speed = 0.0
        self._best_rad, self._best_s = math.inf, 0.0  # when it was last nearer

    def initialise(self) -> None:
        """Start from where it stands; a resumed turn goes on."""
        super().initialise()
        self._yaw, self._speed, self._best_rad = None, 0.0, math.inf

    def update(self) -> Status:
        """Turn for one step."""
        with self.context.stopwatch("motion"):
            return self._turn()

    def terminate(self, new_status: Status) -> None:
        """Hold, and forget how far it has turned; not when it begins, so that a resumed run turns only the rest."""
        super().terminate(new_status)
        self._turned_rad = 0.0

    def state(self) -> dict[str, Any]:
        """How far it has turned."""
        return super().state() | ({"turned_rad": self._turned_rad} if self._turned_rad else {})

    def restore(self, state: dict[str, Any]) -> None:
        """Turn the rest."""
        super().restore(state)
        self._turned_rad = number(state, "turned_rad", -math.inf)

    def _turn(self) -> Status:
        robot, now = self.context.robot, self.context.clock.time_s
        body = robot.proprioception()
        yaw = float(body.base_pose[2])
        if self._yaw is not None:
            self._turned_rad += math.remainder(yaw - self._yaw, math.tau)
        self._yaw = yaw
        left = self._goal_rad - self._turned_rad
        if abs(left) < _DONE_RAD:
            self.feedback_message = "turned"
            return Status.SUCCESS
        if self._best_rad - abs(left) > _DONE_RAD:
            self._best_rad, self._best_s = abs(left), now
        if now - self._best_s > _STALL_S:
            return self.fail("blocked", f"the base stopped turning {abs(math.degrees(left)):.0f} degrees short")
        self.feedback_message = "turning"
        braking = math.sqrt(2 * _TURN_RAD_S2 * abs(left))
        self._speed = min(self._speed + _TURN_RAD_S2 / CONTROL_HZ, _TURN_RAD_S, braking, _LAST_PER_S * abs(left))
        robot.hold()
        action = robot.action
        layout_of(body).set_velocity(action, np.array([0.0, 0.0, math.copysign(self._speed, left)]))
        robot.act(action)
        return Status.RUNNING
