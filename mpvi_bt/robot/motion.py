"""Turns postures, hand lines and drives into actions, one a control step.

Every motion is a generator of (23,) actions. Whoever plays it writes what the robot feels into `Motion.felt` before
each step; the hand lines and drives are closed loops around that.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from mpvi_bt.robot import kinematics as kin
from mpvi_bt.robot import r1
from mpvi_bt.robot.protocol import ACTION_SIZE, CONTROL_HZ, SIDES, ActionLayout, Proprioception, Side
from mpvi_bt.robot.solids import Array

Actions = Iterator[Array]

_TORSO_SPEED = np.array([0.25, 0.8, 0.7, 2.0])  # [m/s, rad/s, rad/s, rad/s]
_PRESSING_RAD = 0.4  # a command farther than this from where the arm is has been given up
_CARRY_SPEED = 1.0  # of the fastest joint of an arm that moves with the torso [rad/s]
_JUMP_RAD = 0.5  # a nearest posture farther than this is another elbow, not the next step of a line


class MotionFailure(Exception):
    """A motion cannot go on; `reason` is a stable code such as "no_reach" or "arm_blocked"."""

    def __init__(self, reason: str) -> None:
        super().__init__(reason)
        self.reason = reason


def smooth(u: float) -> float:
    """0..1 eased at both ends."""
    return u * u * (3 - 2 * u)


class Motion:
    """The robot's present command, and motions that change it.

    Attributes:
        felt: What the robot feels at this step; the player keeps it fresh.
        action: (23,) the command that the last yielded action carried.
    """

    def __init__(self, felt: Proprioception) -> None:
        """Start from a robot as it stands."""
        self.felt = felt
        self.action = np.zeros(ACTION_SIZE)
        self.action[ActionLayout.TORSO] = felt.torso
        for s in SIDES:
            told = felt.arm_command.get(s, felt.arm[s])
            # An arm that presses against something goes on pressing: two hands hold a box by nothing else.
            pressing = np.abs(told - felt.arm[s]).max() < _PRESSING_RAD
            self.action[ActionLayout.ARM[s]] = told if pressing else felt.arm[s]
            self.action[ActionLayout.GRIPPER[s]] = felt.gripper_command[s]

    @property
    def torso(self) -> Array:
        """(4,) commanded torso."""
        return self.action[ActionLayout.TORSO].copy()

    def arm(self, side: Side) -> Array:
        """(7,) commanded posture of an arm."""
        return self.action[ActionLayout.ARM[side]].copy()

    def hand(self, side: Side) -> Array:
        """T_base_tcp (4, 4) as commanded."""
        return kin.tcp(self.torso, self.arm(side), side)

    def wait(self, seconds: float) -> Actions:
        """Stand still."""
        for _ in range(round(seconds * CONTROL_HZ)):
            yield self.still()

    def grip(self, side: Side, value: float, seconds: float = 0.6) -> Actions:
        """Move a gripper to `value` (-1 closed ... 1 open) at an even pace: fast fingers bat light things away."""
        i = ActionLayout.GRIPPER[side]
        start, n = self.action[i], max(1, round(seconds * CONTROL_HZ))
        for k in range(1, n + 1):
            self.action[i] = start + (value - start) * k / n
            yield self.still()

    def follow(self, side: Side, path: Sequence[Array], speed: float = 1.3) -> Actions:
        """Move one arm through postures (7,), the fastest joint at `speed` [rad/s].

        Raises:
            MotionFailure: "arm_blocked" if the arm does not arrive.
        """
        legs = np.array([max(float(np.abs(b - a).max()), 1e-9) for a, b in pairwise(path)])
        if len(legs):
            at = np.concatenate([[0.0], np.cumsum(legs)])
            n = max(2, round((at[-1] / speed * 1.2 + 0.2) * CONTROL_HZ))
            for k in range(1, n + 1):
                x = smooth(k / n) * at[-1]
                i = min(int(np.searchsorted(at, x, "right")) - 1, len(legs) - 1)
                self.action[ActionLayout.ARM[side]] = path[i] + (path[i + 1] - path[i]) * min(
                    1.0, (x - at[i]) / legs[i]
                )
                yield self.still()
        yield from self._arrive(side)

    def line(self, side: Side, T_base_tcp: Array, speed: float = 0.16) -> Actions:
        """Move a hand along a straight line to a pose in the base frame, at `speed` [m/s].

        Raises:
            MotionFailure: "no_reach" if the arm cannot stay on the line.
        """
        start = self.hand(side)
        turn = float(np.linalg.norm(Rotation.from_matrix(start[:3, :3].T @ T_base_tcp[:3, :3]).as_rotvec()))
        n = max(
            2,
            round(max(float(np.linalg.norm(T_base_tcp[:3, 3] - start[:3, 3])) / speed, turn / 1.0) * 1.2 * CONTROL_HZ),
        )
        turning = Slerp([0, 1], Rotation.from_matrix(np.stack([start[:3, :3], T_base_tcp[:3, :3]])))
        for k in range(1, n + 1):
            u = smooth(k / n)
            self._reach(
                side, kin.transform(turning(u).as_matrix(), start[:3, 3] + (T_base_tcp[:3, 3] - start[:3, 3]) * u)
            )
            yield self.still()
        for _ in range(4):
            self._reach(side, T_base_tcp)
            yield self.still()

    def stand(self, torso: Array, arms: Mapping[Side, Sequence[Array]] | None = None) -> Actions:
        """Move the torso (4,) and meanwhile arms through evenly spaced postures (7,): what `arm_motion.sweep` plans."""
        start, arms = self.torso, arms or {}
        seconds = float(np.max(np.abs(torso - start) / _TORSO_SPEED))
        for path in arms.values():
            travel = sum(float(np.abs(b - a).max()) for a, b in pairwise(path))
            seconds = max(seconds, travel / _CARRY_SPEED)
        n = round(seconds * 1.4 * CONTROL_HZ)
        for k in range(1, n + 1):
            u = smooth(k / n)
            self.action[ActionLayout.TORSO] = start + (torso - start) * u
            for side, path in arms.items():
                at = u * (len(path) - 1)
                i = min(int(at), len(path) - 2)
                self.action[ActionLayout.ARM[side]] = path[i] + (path[i + 1] - path[i]) * (at - i)
            yield self.still()
        if n:
            yield from self.wait(0.15)

    def drive(self, goal: Array, speed: float = 0.4) -> Actions:
        """Drive the base straight to `goal` (3,) x, y [m], yaw [rad] in the world, at most `speed` [m/s] and 0.9 rad/s.

        Raises:
            MotionFailure: "base_blocked" if it does not arrive within 3 cm.
        """
        start = self.felt.base_pose.copy()
        change = np.append(goal[:2] - start[:2], kin.wrap(goal[2] - start[2]))
        total = 1.5 * max(float(np.linalg.norm(change[:2])) / speed, abs(float(change[2])) / 0.9)
        n = max(1, round(total * CONTROL_HZ))
        for k in range(1, n + 60):
            u = min(1.0, k / n)
            reference, forward = start + change * smooth(u), change * 6 * u * (1 - u) * CONTROL_HZ / n
            error = reference - self.felt.base_pose
            error[2] = kin.wrap(error[2])
            if k > n and np.linalg.norm(error[:2]) < 0.006 and abs(error[2]) < 0.01:
                break
            yield self._moving(forward + 3.0 * error)
        yield self.still()
        if np.linalg.norm(goal[:2] - self.felt.base_pose[:2]) > 0.03:
            raise MotionFailure("base_blocked")

    def _reach(self, side: Side, T_base_tcp: Array) -> None:
        torso = np.append(
            self.felt.torso[:3] if np.abs(self.felt.torso - self.torso).max() < 0.02 else self.torso[:3], 0
        )
        now = self.arm(side)
        q = kin.nearest_posture(kin.inverse(kin.chest(torso)) @ T_base_tcp, side, now)
        if q is None or np.abs(q - now).max() > _JUMP_RAD:
            raise MotionFailure("no_reach")
        self.action[ActionLayout.ARM[side]] = q

    def _arrive(self, side: Side) -> Actions:
        for _ in range(20):
            yield self.still()
            if np.abs(self.felt.arm[side] - self.arm(side)).max() < 0.02:
                return
        if np.abs(self.felt.arm[side] - self.arm(side)).max() > 0.08:
            raise MotionFailure("arm_blocked")

    def still(self) -> Array:
        """The present command, the base standing."""
        self.action[ActionLayout.BASE] = 0.0
        return self.action.copy()

    def _moving(self, velocity_world: Array) -> Array:
        yaw = self.felt.base_pose[2]
        c, s = np.cos(yaw), np.sin(yaw)
        vx, vy, w = np.clip(velocity_world, -r1.BASE_SPEED, r1.BASE_SPEED)
        self.action[ActionLayout.BASE] = [c * vx + s * vy, -s * vx + c * vy, w]
        return self.action.copy()
