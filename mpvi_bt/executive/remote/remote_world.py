"""The world of a remote robot. Each observation is a step, and its action is the reply.

To the loop it is a `World` like any other. What drives the robot, such as an evaluator, has the clock: `step` hands the
command over and waits for the next observation.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from mpvi_bt.executive.remote.odometry import moved
from mpvi_bt.executive.remote.reading import Reading
from mpvi_bt.ground.errors import BackendError, BadMessage, UserError
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.protocols import StepClock
from mpvi_bt.ground.robot.limits import commanded, travel_action
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, CameraImage, Proprioception
from mpvi_bt.ground.robot.robot_description import RobotDescription

# Our choice: twice as far as any robot here goes in a step at its top speed, and no rounding or noise comes near.
_JUMP_M, _JUMP_RAD = 0.3, 0.9
_START_RAD = 0.05  # a joint that is so near to where robots start was told to be there: gravity bends what it holds


class RobotConnection(Protocol):
    """The connection to whoever has the robot."""

    def exchange(self, actions: Array) -> Reading:
        """Answer the last observation with actions (K, A), and wait for the next one."""
        ...

    def look(self, camera: str) -> Reading:
        """Ask for the same observation again, with a camera's picture."""
        ...


class RemoteRobot:
    """`mpvi_bt.ground.robot.protocol.Robot` by what was last heard of it.

    Attributes:
        model: What robot it is.
        line: The connection to whoever has it.
    """

    def __init__(self, model: RobotDescription, first: Reading, line: RobotConnection) -> None:
        """Take the first observation."""
        self.model, self.line = model, line
        self._action = _first_command(model, first)
        self.take(first, np.zeros(3))

    @property
    def action(self) -> Array:
        """(A,) a copy of the command of the next step."""
        return self._action.copy()

    def act(self, action: Array) -> None:
        """Set the command of the next step, within the robot's limits. Raises BackendError unless (A,) and finite."""
        self._action = commanded(self.model, action)

    def hold(self) -> None:
        """Stand still; every joint keeps its target."""
        self.model.layout.set_velocity(self._action, 0.0)

    def proprioception(self) -> Proprioception:
        """What was felt last."""
        return self._body

    def look(self, camera: str) -> CameraImage:
        """The last picture of a camera; asked for if the last observation has none.

        Raises:
            BackendError: The robot has no such camera, or nobody sends its picture.
        """
        if camera not in self._images:
            if camera not in self.model.cameras:
                raise BackendError(f"no camera {camera!r}; known: {', '.join(self.model.cameras)}")
            seen = self._seen
            if camera not in seen.images:
                seen = self.line.look(camera)
                if camera not in seen.images:
                    raise BadMessage(f"the requested picture of the camera {camera!r} is missing")
            image = seen.images[camera]
            if not seen.placed:
                image = replace(image, T_world_camera=matmul(kin.base(self._seen_from), image.T_world_camera))
            self._images[camera] = image
        return self._images[camera]

    def take(self, reading: Reading, odometry: Array) -> None:
        """Take in an observation; `odometry`: (3,) the base's place if the observation has none."""
        told, action, layout = reading.body, self._action, self.model.layout
        pose = told.base_pose if reading.placed else odometry
        self._body = replace(
            told,
            base_pose=pose,
            gripper_command=told.gripper_command or {side: float(action[layout.gripper[side]]) for side in told.sides},
            arm_command=told.arm_command or {side: action[layout.arm[side]].copy() for side in told.sides},
            robot=self.model.name,
            open_m=self.model.opening_m,
            grasp_m=self.model.grasp_m,
        )
        self._seen, self._seen_from = reading, pose
        self._images: dict[str, CameraImage] = {}

    def foresee(self) -> None:
        """Assume a commanded step without an observation; pictures stay as they are."""
        body, action, layout = self._body, self._action, self.model.layout
        velocity = layout.velocity(action)
        arms = {side: action[layout.arm[side]].copy() for side in body.sides}
        self._body = replace(
            body,
            base_pose=moved(body.base_pose, velocity, 1 / CONTROL_HZ),
            base_velocity=velocity,
            torso=action[layout.torso].copy(),
            arm=arms,
            arm_velocity={side: (arms[side] - body.arm[side]) * CONTROL_HZ for side in body.sides},
            gripper_command={side: float(action[layout.gripper[side]]) for side in body.sides},
            arm_command=arms,
        )


class RemoteWorld(StepClock):
    """`mpvi_bt.executive.ticking.loop.World` of such a robot.

    Where an observation wants several actions, the robot is taken to do as it is told until the next one: the tree is
    ticked once for each action all the same, on what the robot would feel then and on the pictures that there are.

    Attributes:
        robot: The robot.
    """

    def __init__(self, model: RobotDescription, first: Reading, line: RobotConnection) -> None:
        """Begin with an observation. If it has no base pose, the base's place now is the origin."""
        self.robot = RemoteRobot(model, first, line)
        self._line, self._reading = line, first
        self._told: list[Array] = []

    def step(self) -> None:
        """Hand the robot's command over; once there are as many as are wanted, wait for the next observation.

        Raises:
            BadMessage: That is none, or does not follow the last one.
        """
        self.steps += 1
        self._told.append(self.robot.action)
        if len(self._told) < self._reading.steps:
            self.robot.foresee()
            return
        before = self.robot.proprioception()
        reading = self._line.exchange(np.array(self._told))
        _check_follows(before, reading, len(self._told) + reading.skipped)
        self.steps += reading.skipped
        self._told, self._reading = [], reading
        self.robot.take(reading, moved(before.base_pose, reading.body.base_velocity, 1 / CONTROL_HZ))

    def save(self) -> dict[str, Any]:
        """Its clock; the rest is elsewhere."""
        return {"steps": self.steps}

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Raises UserError: who has the robot has its past."""
        raise UserError("an episode of a robot elsewhere cannot be gone on with.")


def _first_command(model: RobotDescription, first: Reading) -> Array:
    """(A,) the assumed command of a robot before its first observation.

    What is felt, but for joints that are about where robots start: those were told to be there.
    """
    if first.command is not None:
        command = commanded(model, first.command)
        model.layout.set_velocity(command, 0.0)
        return command
    start, body, layout = travel_action(model), first.body, model.layout
    command = start.copy()
    parts: list[tuple[slice, Array]] = [(layout.torso, body.torso)]
    parts += [(layout.arm[side], body.arm[side]) for side in body.sides]
    for part, felt in parts:
        command[part] = np.where(np.abs(felt - start[part]) < _START_RAD, start[part], felt)
    for side in body.sides:
        # In tenths: fingers are never quite where they were told to be.
        opening = round(body.gripper_width[side] / model.opening_m, 1)
        command[layout.gripper[side]] = np.clip(2 * opening - 1, -1.0, 1.0)
    return command


def _check_follows(before: Proprioception, reading: Reading, steps: int) -> None:
    """Raise BadMessage if the robot cannot have moved that far in these steps."""
    body = reading.body
    far = float(norm(body.base_pose[:2] - before.base_pose[:2])) if reading.placed else 0.0
    joints = [body.torso - before.torso, *(body.arm[side] - before.arm[side] for side in body.sides)]
    turned = max((float(np.abs(by).max()) for by in joints if len(by)), default=0.0)
    for what, by, most, unit in (("the base", far, _JUMP_M, "m"), ("a joint", turned, _JUMP_RAD, "rad")):
        if by > most * steps:
            raise BadMessage(
                f"an observation that does not follow the one before: {what} is {by:.2f} {unit} from where it was; "
                "one came out of order, or a reset was not told"
            )
