"""The four metrics of an episode besides its goal: simulated time and three distances.

Directions: time and distances are lower-is-better as measured; normalized by the human mean (human / robot, as the
evaluator does, the inverse of the paper's wording) they are higher-is-better, 1.0 being as good as a human.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from mpvi_bt.executive.ticking.loop import Watcher, World
from mpvi_bt.executive.tree.build import Tree
from mpvi_bt.ground.geometry import kinematics
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.marked_yaml import Amount, Count
from mpvi_bt.ground.robot.default_robot import DEFAULT_ROBOT
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, SIDES, Side
from mpvi_bt.ground.robot.robots import robot_named
from mpvi_bt.runs.episode.way import Place, thinned

DIRECTIONS: Mapping[str, str] = {
    "q_score": "0..1, higher is better; what held at the start earns nothing",
    "goal_fraction": "0..1, higher is better; what held at the start counts",
    "conditions_met": "0..1, higher is better; of the conditions as listed",
    "time.simulator_time": "seconds, lower is better",
    "time.normalized_time": "human / robot, higher is better",
    "agent_distance": "meters in the world, lower is better",
    "agent_distance_base_relative": "meters of the hands in the base frame, lower is better",
    "normalized_agent_distance": "human / robot, higher is better",
}


@dataclass(frozen=True)
class Measurement:
    """What was measured over an episode.

    Attributes:
        steps: Control steps.
        base_m: Sum of the base's steps on the floor.
        hand_world_m: Sum of each hand's steps in the world: driving counts.
        hand_base_m: Sum of each hand's steps in the base frame: driving does not count.
        way: Corners of the base's way, x and y in the world [m].
    """

    steps: Count
    base_m: Amount
    hand_world_m: Mapping[Side, Amount]
    hand_base_m: Mapping[Side, Amount]
    way: list[Place] = field(default_factory=list)

    @property
    def time_s(self) -> float:
        """Simulated time."""
        return self.steps / CONTROL_HZ

    def after(self, earlier: Measurement) -> Measurement:
        """The sum of this measurement and an earlier one of the same episode."""
        return Measurement(
            steps=self.steps,  # the world's clock has gone on
            base_m=earlier.base_m + self.base_m,
            hand_world_m={side: earlier.hand_world_m[side] + self.hand_world_m[side] for side in SIDES},
            hand_base_m={side: earlier.hand_base_m[side] + self.hand_base_m[side] for side in SIDES},
            way=earlier.way + self.way,
        )


class Meter(Watcher):
    """Notes what the robot feels at every step, and adds distances up when asked.

    Hands come from the joint angles by forward kinematics, all steps at once: one by one it would cost more than the
    physics.

    Args:
        earlier: What was measured before the episode was stopped, if it is one that goes on.
    """

    def __init__(self, earlier: Measurement | None = None) -> None:
        self._earlier = earlier
        self._steps = 0
        self._felt: list[Array] = []
        self._robot = DEFAULT_ROBOT

    def start(self, tree: Tree, world: World) -> None:
        """Begin anew from where the robot is."""
        self._felt = []
        self.note(world)

    def step(self, tree: Tree, world: World) -> None:
        """Note where base and joints are."""
        self.note(world)

    def note(self, world: World) -> None:
        """Note where base and joints are, whoever drives."""
        felt = world.robot.proprioception()
        self._felt.append(np.concatenate([felt.base_pose, felt.torso, *(felt.arm[side] for side in felt.sides)]))
        self._robot = felt.robot
        self._steps = world.steps

    @property
    def measurement(self) -> Measurement:
        """What was measured so far."""
        robot = robot_named(self._robot)
        ends = np.cumsum([3, len(robot.torso_joints), *(len(robot.arm_joints[side]) for side in robot.sides)])
        base, torso, *joints = np.split(np.array(self._felt).reshape(-1, ends[-1]), ends[:-1], axis=1)
        arms = dict(zip(robot.sides, joints, strict=True))
        T_world_base = kinematics.transform(kinematics.rot_z(base[:, 2]), np.pad(base[:, :2], ((0, 0), (0, 1))))
        T_base_hand = {side: robot.tcp(torso, arms[side], side) for side in robot.sides}
        measured = Measurement(
            steps=self._steps,
            base_m=_way(base[:, :2]),
            hand_world_m=_of_both({side: _way(matmul(T_world_base, T)[:, :3, 3]) for side, T in T_base_hand.items()}),
            hand_base_m=_of_both({side: _way(T[:, :3, 3]) for side, T in T_base_hand.items()}),
            way=thinned(base[:, :2]),
        )
        return measured.after(self._earlier) if self._earlier else measured


def ratio(human: float, robot: float) -> float | None:
    """Human / robot; None if the robot's figure is 0 (the evaluator writes inf, not valid JSON)."""
    return human / robot if robot > 0.0 else None


def _of_both(ways: Mapping[Side, float]) -> dict[Side, float]:
    """A hand that the robot does not have has gone nowhere."""
    return {side: ways.get(side, 0.0) for side in SIDES}


def _way(positions: Array) -> float:
    """Length [m] of the way through positions (n, 2 or 3)."""
    return float(norm(np.diff(positions, axis=0), axis=1).sum())
