"""Brings a robot that only a file describes into its travel posture: each joint straight, as nobody plans its arms."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.action_rows import standing
from mpvi_bt.ground.robot.limits import travel_action
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, Robot
from mpvi_bt.ground.robot.robots import robot_named

# All our choice.
_SHARE = 0.3  # of the top speed of the joint that has the longest way
_NEAR = 0.02  # a joint that is so near to its goal is there [m or rad]
_SETTLES_S = 1.0  # that joints may take longer than their commands


class StraightFold:
    """Moves torso and empty arms to their travel posture, all joints together; an arm that holds something stays.

    It knows nothing of what is around, of the robot itself neither: the file's travel posture has to be one that can be
    reached so.

    Args:
        robot: What to move.
    """

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._actions: Iterator[Array] = iter(())

    def start(self) -> None:
        """Begin from the present posture."""
        self._actions = self._folding()

    def step(self) -> bool:
        """Write one step's command; True once the posture is reached, or cannot be."""
        action = next(self._actions, None)
        if action is not None:
            self._robot.act(action)
        return action is None

    def _folding(self) -> Iterator[Array]:
        felt = self._robot.proprioception()
        model, start = robot_named(felt.robot), standing(felt)
        layout, home = model.layout, travel_action(model)
        parts = [(layout.torso, model.torso_top_speed)]
        parts += [(layout.arm[side], model.arm_top_speed[side]) for side in felt.sides if not felt.holds(side)]
        goal, seconds = start.copy(), 0.0
        for part, speed in parts:
            goal[part] = home[part]
            way = np.abs(goal[part] - start[part])
            moving = way > _NEAR
            seconds = max(seconds, float((way[moving] / (_SHARE * speed[moving])).max(initial=0.0)))
        steps = math.ceil(seconds * CONTROL_HZ)
        for k in range(1, steps + 1):
            yield start + (goal - start) * k / steps
        for _ in range(round(_SETTLES_S * CONTROL_HZ)):
            body = self._robot.proprioception()
            joints = np.concatenate([body.torso, *(body.arm[side] for side in layout.arm)])
            if steps == 0 or np.abs(joints - goal[layout.joints]).max(initial=0.0) < _NEAR:
                return
            yield goal.copy()
