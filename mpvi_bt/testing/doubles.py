"""Backends without a simulator: a robot in an empty world that follows every command, and its drivers.

They are honest about what they are, and pass the contracts of `mpvi_bt.testing.contracts`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from mpvi_bt.executive.behaviors.context import Context
from mpvi_bt.executive.plan.clauses import clauses, match
from mpvi_bt.executive.plan.skills import Skill
from mpvi_bt.ground.errors import BackendError
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.protocols import Judgement, Progress, Report, StepClock, TriggerEvent
from mpvi_bt.ground.robot.default_robot import DEFAULT_ROBOT
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, CameraImage, Proprioception, Robot, Side
from mpvi_bt.ground.robot.robot_description import RobotDescription
from mpvi_bt.ground.robot.robots import layout_of, robot_named


class KinematicRobot:
    """A robot without dynamics: base and joints move as commanded, fingers stop at what is between them.

    Args:
        model: Whose joints it has; None: the default robot's.

    Attributes:
        model: What robot it is.
        between_m: Width of what is between the fingers of each hand.
    """

    def __init__(self, model: RobotDescription | None = None) -> None:
        self.model = model or robot_named(DEFAULT_ROBOT)
        self._layout, sides = self.model.layout, self.model.sides
        self.between_m: dict[Side, float] = {"left": 0.03, "right": 0.06}
        self._pose = np.zeros(3)
        self._velocity = np.zeros(3)
        self._targets = np.zeros(self._layout.size)
        self._targets[list(self._layout.gripper.values())] = 1.0
        self._width: dict[Side, float] = dict.fromkeys(sides, self.model.opening_m)
        self._arm_velocity = {side: np.zeros(len(self.model.arm_joints[side])) for side in sides}
        self._torso_velocity = np.zeros(len(self.model.torso_joints))
        self._gripper_velocity: dict[Side, float] = dict.fromkeys(sides, 0.0)
        self._action = self._targets.copy()

    @property
    def action(self) -> Array:
        """(A,) command of the next step."""
        return self._action.copy()

    def act(self, action: Array) -> None:
        """Set the command of the next step. Raises BackendError unless it is (A,) and finite."""
        action = np.array(action, float)
        if action.shape != self._action.shape or not np.isfinite(action).all():
            raise BackendError(f"an action must be {self._action.shape} and finite, not {action.shape}")
        self._action = action

    def hold(self) -> None:
        """Stand still and keep every joint's target."""
        self._action = self._targets.copy()

    def proprioception(self) -> Proprioception:
        """What it feels now."""
        layout, sides = self._layout, self.model.sides
        return Proprioception(
            base_pose=self._pose.copy(),
            base_velocity=self._velocity.copy(),
            torso=self._targets[layout.torso].copy(),
            arm={side: self._targets[layout.arm[side]].copy() for side in sides},
            arm_velocity={side: self._arm_velocity[side].copy() for side in sides},
            gripper_width=dict(self._width),
            gripper_command={side: float(self._targets[layout.gripper[side]]) for side in sides},
            arm_command={side: self._targets[layout.arm[side]].copy() for side in sides},
            torso_velocity=self._torso_velocity.copy(),
            gripper_velocity=dict(self._gripper_velocity),
            robot=self.model.name,
            open_m=self.model.opening_m,
            grasp_m=self.model.grasp_m,
        )

    def look(self, camera: str) -> CameraImage:
        """A small black picture."""
        if camera not in self.model.cameras:
            raise BackendError(f"no camera {camera!r}; known: {', '.join(self.model.cameras)}")
        K = np.array([[8.0, 0, 4], [0, 8, 4], [0, 0, 1]])
        return CameraImage(camera, np.zeros((8, 8, 3), np.uint8), np.zeros((8, 8), np.float32), None, {}, K, np.eye(4))

    def save(self) -> dict[str, Any]:
        """How it stands."""
        return {
            "pose": self._pose.tolist(),
            "targets": self._targets.tolist(),
            "action": self._action.tolist(),
            "width": dict(self._width),
        }

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Stand so."""
        self._pose, self._targets = np.array(saved["pose"]), np.array(saved["targets"])
        self._action, self._width = np.array(saved["action"]), dict(saved["width"])

    def advance(self, action: Array) -> None:
        """Move for one control step."""
        dt, layout = 1 / CONTROL_HZ, self._layout
        vx, vy, turn = self._velocity = layout.velocity(action)
        yaw = self._pose[2]
        self._pose += dt * np.array(
            [vx * math.cos(yaw) - vy * math.sin(yaw), vx * math.sin(yaw) + vy * math.cos(yaw), turn]
        )
        self._pose[2] = math.remainder(self._pose[2], math.tau)
        for side in self.model.sides:
            arm = layout.arm[side]
            self._arm_velocity[side] = (action[arm] - self._targets[arm]) / dt
            before = self._width[side]
            wanted = (float(np.clip(action[layout.gripper[side]], -1, 1)) + 1) / 2 * self.model.opening_m
            reach = 0.4 * dt
            width = self._width[side] + float(np.clip(wanted - self._width[side], -reach, reach))
            self._width[side] = max(width, self.between_m[side])
            self._gripper_velocity[side] = (self._width[side] - before) / dt
        self._torso_velocity = (action[layout.torso] - self._targets[layout.torso]) / dt
        self._targets = action.copy()
        layout.set_velocity(self._targets, 0.0)


class KinematicWorld(StepClock):
    """An empty world with a KinematicRobot in it."""

    def __init__(self, model: RobotDescription | None = None) -> None:
        """Of a robot; None: the default one."""
        self.robot = KinematicRobot(model)

    def step(self) -> None:
        """One control step."""
        self.robot.advance(self.robot.action)
        self.steps += 1

    def save(self) -> dict[str, Any]:
        """How everything stands."""
        return {"steps": self.steps, **self.robot.save()}

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Have everything stand so."""
        self.steps = int(saved["steps"])
        self.robot.restore(saved)


class StraightNavigator:
    """Drives in a straight line to places that it is told at the start.

    Args:
        robot: What to drive.
        places: Phrase to world x, y [m].
        speed_m_s: How fast.
    """

    def __init__(self, robot: Robot, places: Mapping[str, tuple[float, float]], speed_m_s: float = 0.8) -> None:
        self._robot, self._places, self._speed = robot, dict(places), speed_m_s
        self._target: str | None = None

    def start(self, target: str, room: str | None) -> None:
        """Begin."""
        self._target = target

    def step(self) -> Report:
        """Drive one step."""
        if self._target is None:
            return Report(Progress.FAILED, "not_started", "no target was set")
        if self._target not in self._places:
            return Report(Progress.FAILED, "unknown_target", f"nothing known as {self._target!r}")
        body = self._robot.proprioception()
        x, y, yaw = body.base_pose
        dx, dy = self._places[self._target][0] - x, self._places[self._target][1] - y
        distance = math.hypot(dx, dy)
        self._robot.hold()
        if distance < 0.02:
            return Report(Progress.SUCCEEDED, "", f"at {self._target}")
        speed = min(self._speed, distance * CONTROL_HZ)
        heading = math.atan2(dy, dx) - yaw
        action = self._robot.action
        layout_of(body).set_velocity(action, speed * np.array([math.cos(heading), math.sin(heading), 0.0]))
        self._robot.act(action)
        return Report(Progress.RUNNING, "", f"driving to {self._target}")

    def stop(self) -> None:
        """Stand still."""
        self._target = None
        self._robot.hold()


class GripPolicy:
    """Closes a hand for a pick and opens it for a place, a second and a half a clause; moves nothing else.

    Args:
        skills: To read prompts with.
        hand: Where a clause names none.
    """

    name = "grip"
    cameras: tuple[str, ...] = ()
    horizon = 15

    def __init__(self, skills: Mapping[str, Skill], hand: Side = "right") -> None:
        self._skills, self._hand = skills, hand
        self._chunks = 0

    def reset(self) -> None:
        """Begin with the first clause."""
        self._chunks = 0

    def infer(self, observation: Mapping[str, Any]) -> Array:
        """(15, A) actions."""
        parts = clauses(observation["prompt"], self._skills)
        call = match(parts[min(self._chunks // 3, len(parts) - 1)], self._skills) if parts else None
        self._chunks += 1
        body: Proprioception = observation["proprioception"]
        layout = layout_of(body)
        action = np.zeros(layout.size)
        action[layout.torso] = body.torso
        for side in body.sides:
            action[layout.arm[side]] = body.arm[side]
            action[layout.gripper[side]] = body.gripper_command[side]
        if call is not None:
            hand: Side = "left" if call.arguments.get("hand", self._hand) == "left" else "right"
            action[layout.gripper[hand]] = -1.0 if call.motion == "pick" else 1.0
        return np.tile(action, (self.horizon, 1))


class FingerTriggers:
    """Fires when the fingers of a hand have come to rest after closing on something, or after opening."""

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self.reset()

    def reset(self, kinds: Mapping[str, float | None] | None = None) -> None:
        """Begin anew; how long events must be apart is not minded."""
        body = self._robot.proprioception()
        self._kinds = kinds
        self._before = dict(body.gripper_width)
        self._moved: set[Side] = set()

    def update(self) -> TriggerEvent | None:
        """The event that fires now, if any."""
        body = self._robot.proprioception()
        fired = None
        for side in body.sides:
            width = body.gripper_width[side]
            if abs(width - self._before[side]) > 1e-4:
                self._moved.add(side)
            elif side in self._moved:
                self._moved.discard(side)
                kind = "grasp" if body.gripper_command[side] < 0 else "release"
                if fired is None and (self._kinds is None or kind in self._kinds):
                    fired = TriggerEvent(kind, side)
            self._before[side] = width
        return fired


class ScriptedChecker:
    """Answers as it is told.

    Args:
        answers: Criterion to its answers in turn, the last one for good; a criterion that is not there is a no.
        needs_image: Whether to ask for a picture.
    """

    name = "scripted"

    def __init__(self, answers: Mapping[str, tuple[bool, ...]], needs_image: bool = True) -> None:
        self.needs_image = needs_image
        self._answers = {criterion: list(turn) for criterion, turn in answers.items()}

    def check(self, criterion: str, image: CameraImage | None) -> Judgement:
        """The next answer."""
        turn = self._answers.get(criterion)
        if not turn:
            return Judgement(False, "no answer was scripted")
        return Judgement(turn.pop(0) if len(turn) > 1 else turn[0], "as scripted")


def scripted_context(
    world: KinematicWorld,
    skills: Mapping[str, Skill],
    places: Mapping[str, tuple[float, float]],
    answers: Mapping[str, tuple[bool, ...]],
) -> Context:
    """A run's context of the doubles above."""
    return Context(
        clock=world,
        robot=world.robot,
        navigator=StraightNavigator(world.robot, places),
        policy=GripPolicy(skills),
        checker=ScriptedChecker(answers),
        triggers=FingerTriggers(world.robot),
        skills=skills,
    )
