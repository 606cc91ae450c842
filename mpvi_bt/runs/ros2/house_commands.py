"""Stamped commands of a bridge, as the action of the next step: what the controllers of a real robot do."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import CONTROL_HZ
from mpvi_bt.ground.robot.robot_description import RobotDescription
from mpvi_bt.runs.ros2.bridge_file import Bridge

FIRST_NS = 1_000_000_000  # the stamp of the first state: in ROS 0 means no time
BASE_TIMEOUT_S = 0.25  # of simulated time; our choice: what bases on the market have
_ROUNDING_S = 1e-6


def stamp_ns(step: int) -> int:
    """The time of the state of a step, in nanoseconds."""
    return FIRST_NS + round(step * 1_000_000_000 / CONTROL_HZ)


@dataclass
class Heard:
    """The messages of one topic.

    Attributes:
        taken: Commands that were carried out.
        again: Commands that came a second time.
        late: Commands for a state that had passed.
        lost: States that no command of this topic answered, in lockstep.
        refused: Commands that could not be carried out, by the reason.
    """

    taken: int = 0
    again: int = 0
    late: int = 0
    lost: int = 0
    refused: Counter[str] = field(default_factory=Counter)


@dataclass(frozen=True)
class _Target:
    """Where the target of a joint stands in an action, and what a position is there: `rate * (position - zero) - 1`.

    A joint of torso or arm has no rate: its position stands there as it is.
    """

    number: int
    rate: float | None = None
    zero: float = 0.0

    def value(self, position: Array) -> Array:
        return position if self.rate is None else self.rate * (position - self.zero) - 1.0


@dataclass(frozen=True, eq=False)
class _Trajectory:
    """Targets over time: `numbers` of the action go from `begin` (k,) through `rows` (n, k) at `times_s` (n,)."""

    numbers: list[int]
    begin: Array
    start_ns: int
    times_s: Array
    rows: Array

    def at(self, now_ns: int) -> Array:
        """(k,) the targets at a time."""
        t = (now_ns - self.start_ns) * 1e-9
        if t >= self.times_s[-1] - _ROUNDING_S:
            return self.rows[-1]
        times = np.concatenate([[0.0], self.times_s])
        rows = np.vstack([self.begin, self.rows])
        return np.array([np.interp(t, times, column) for column in rows.T])


class HouseCommands:
    """The commands that the robot was given.

    Args:
        model: The robot.
        action: (A,) its targets at the start.
        bridge: By which topics commands come. In lockstep they answer the state that has their stamp; otherwise they
            count from when they arrive.

    Attributes:
        heard: The messages so far, by topic.

    Raises:
        UserError: The bridge has actions: the house has topics only.
    """

    def __init__(self, model: RobotDescription, action: Array, bridge: Bridge) -> None:
        self._layout, self._action = model.layout, action.copy()
        self._lockstep = bridge.settings.lockstep
        numbers = {name: i for i, name in enumerate(model.layout.names)}
        self._targets = {name: _Target(numbers[name]) for entry in bridge.joints for name in entry.joints or ()}
        for side, fingers in bridge.fingers.items():
            number = model.layout.gripper[side]
            for name, (closed, opened) in zip(fingers.names, fingers.ends, strict=True):
                self._targets[name] = _Target(number, 2.0 / (opened - closed), closed)
        self.heard: Mapping[str, Heard] = {
            topic: Heard() for topic in (bridge.settings.base.topic, *trajectory_topics(bridge))
        }
        self._last_ns = dict.fromkeys(self.heard, -1)
        self._step = 0
        self._velocity, self._told_ns = np.zeros(3), -1
        self._trajectories: dict[str, _Trajectory] = {}

    def missing(self) -> set[str]:
        """Topics that have not answered the present state."""
        now = stamp_ns(self._step)
        return {topic for topic, last in self._last_ns.items() if last < now}

    def drive(self, topic: str, stamp: int, velocity: Sequence[float]) -> None:
        """Take the base's velocity (3,) [m/s, m/s, rad/s]; a stamp of 0 ns means now."""
        told = np.array(velocity, float)
        if not np.isfinite(told).all():
            self._refuse(topic, "not finite")
        elif self._takes(topic, stamp):
            self._velocity, self._told_ns = told, stamp_ns(self._step)

    def follow(
        self, topic: str, stamp: int, joints: Sequence[str], times_s: Sequence[float], positions: Sequence[Array]
    ) -> None:
        """Take a trajectory: positions (n, k) of k joints [rad or m], at times after its stamp."""
        unknown = [name for name in joints if name not in self._targets]
        if unknown or not joints or not positions or any(len(row) != len(joints) for row in positions):
            self._refuse(topic, f"no joint {unknown[0]}" if unknown else "wrong size")
            return
        rows, times = np.array(positions, float), np.array(times_s, float)
        if not (np.isfinite(rows).all() and (np.diff(times) > 0).all()):
            self._refuse(topic, "not finite, or times that do not rise")
        elif self._takes(topic, stamp):
            targets = [self._targets[name] for name in joints]
            numbers = [target.number for target in targets]
            rows = np.column_stack([target.value(column) for target, column in zip(targets, rows.T, strict=True)])
            start = stamp or stamp_ns(self._step)
            self._trajectories[topic] = _Trajectory(numbers, self._action[numbers], start, times, rows)

    def next_action(self) -> Array:
        """(A,) the action of the present step; then the next one is the present one."""
        if self._lockstep:
            for topic in self.missing():
                self.heard[topic].lost += 1
        due = stamp_ns(self._step + 1)
        for course in self._trajectories.values():
            self._action[course.numbers] = course.at(due)
        silent_s = (stamp_ns(self._step) - self._told_ns) * 1e-9
        self._layout.set_velocity(self._action, self._velocity if silent_s < BASE_TIMEOUT_S else 0.0)
        self._step += 1
        return self._action.copy()

    def _refuse(self, topic: str, reason: str) -> None:
        self.heard[topic].refused[reason] += 1

    def _takes(self, topic: str, stamp: int) -> bool:
        """Whether a command comes in time: after the last of its topic and, in lockstep, for the present state."""
        now, heard = stamp_ns(self._step), self.heard[topic]
        if stamp and stamp == self._last_ns[topic]:
            heard.again += 1
            return False
        if stamp and (stamp < self._last_ns[topic] or (self._lockstep and stamp < now)):
            heard.late += 1
            return False
        self._last_ns[topic] = stamp or now
        heard.taken += 1
        return True


def trajectory_topics(bridge: Bridge) -> list[str]:
    """Topics of trajectories. Raises UserError where there are actions in their place."""
    entries = (*bridge.joints, *bridge.grippers.values())
    if odd := next((entry.action for entry in entries if entry.topic is None), None):
        raise UserError(f"{bridge.file}: our house has no action {odd}: give a 'topic' in its place.")
    return [entry.topic for entry in entries if entry.topic is not None]
