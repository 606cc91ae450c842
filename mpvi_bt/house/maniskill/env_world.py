"""The world of a ManiSkill environment, as trees drive it and goals are judged by it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import sapien
from numpy.typing import NDArray

from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.robot_description import RobotDescription
from mpvi_bt.house.instances.sampling import Start
from mpvi_bt.house.layout.house import House
from mpvi_bt.house.sim.cameras import Cameras
from mpvi_bt.house.sim.sim_robot import SimRobot
from mpvi_bt.house.sim.world import SimWorld


class ManiSkillWorld(SimWorld):
    """A `SimWorld` in the scene of a ManiSkill environment, which steps it."""

    def __init__(
        self,
        scene: sapien.Scene,
        step: Callable[[NDArray[np.float32]], object],
        house: House,
        start: Start,
        render: bool,
        put_robot: Callable[[Array, Cameras | None], SimRobot],
        assisted: bool = False,
    ) -> None:
        """Build a start of a task in `scene`.

        Args:
            scene: A sub scene of the environment's.
            step: The environment's step with one action (23,) float32; it calls `stepped` in turn.
            house: Rooms, walls and fixtures.
            start: Where things and the robot begin; nothing has moved yet.
            render: Whether pictures can be asked for.
            put_robot: Puts the robot at a pose (3,) x, y [m], yaw [rad], with the world's cameras.
            assisted: As of `SimWorld`.
        """
        self._put = put_robot
        super().__init__(house, start.objects, start.base_pose, render=render, assisted=assisted, scene=scene)
        self._step = step
        self._wrapped = False

    def _put_robot(self, base_pose: Array, model: RobotDescription) -> SimRobot:
        return self._put(base_pose, self.cameras)

    def stepped(self) -> None:
        """See to all that is due after the physics of a control step."""
        self.robot.forget()  # whoever sends the drives their commands
        super().stepped()

    def step_through(self, step: Callable[[NDArray[np.float32]], object]) -> None:
        """Have steps go through a wrapper of the environment, such as one that records them, until the next reset.

        What is carried out is then what is recorded, float32.

        Args:
            step: The wrapper's step with one action (23,) float32.
        """
        self._step, self._wrapped = step, True

    def step(self) -> None:
        """Have the environment take one step."""
        short = self.robot.action.astype(np.float32)
        if self._wrapped:
            self.robot.act(short.astype(float))
        self._step(short)
