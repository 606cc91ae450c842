"""Fills the task's prompt and number into the settings of a remote policy, and checks that they fit the robot."""

from __future__ import annotations

from mpvi_bt.executive.remote.dialect_settings import Constant, DialectSettings
from mpvi_bt.executive.remote.joint_dialects import joint_dialect
from mpvi_bt.executive.remote.prompts import prompt_of
from mpvi_bt.ground.errors import UserError, shown
from mpvi_bt.ground.robot.robot_description import RobotDescription
from mpvi_bt.ground.robot.robots import ROBOTS


def with_task(settings: DialectSettings, task: str | None, number: int | None) -> DialectSettings:
    """The settings with all that they need of a task filled in, as constants.

    Args:
        settings: As loaded.
        task: Name that BEHAVIOR has for it; None: there is none.
        number: What BEHAVIOR's evaluators send as `task_id`; None: it has none.

    Raises:
        UserError: The settings need to know a task, or its number, and it is not known; or the prompt's file has none.
        FileProblems: Everything that is wrong with that file.
    """
    observation = settings.observation
    if observation is None or (observation.prompts is None and observation.task_id is None):
        return settings
    constants: dict[str, Constant] = dict(observation.constants)
    filled: dict[str, object] = {"constants": constants, "prompts": None, "task_id": None}
    if observation.prompts is not None and observation.prompt is not None:
        if task is None:
            raise UserError(f"{observation.prompts}: it has a prompt for each task, and none is chosen: name a task.")
        constants[observation.prompt] = prompt_of(task, observation.prompts)
        filled["prompt"] = None
    if observation.task_id is not None:
        if number is None:
            what = "no task is named" if task is None else f"BEHAVIOR has no number for the task {shown(task)}"
            raise UserError(
                f"the policy's settings send {observation.task_id!r}, and {what}: take settings without 'task_id', or "
                f"write a number under 'constants', such as {observation.task_id}: [0]."
            )
        constants[observation.task_id] = (number,)
    return settings.model_copy(update={"observation": observation.model_copy(update=filled)})


def check_robot(settings: DialectSettings, robot: RobotDescription, called: str = "of the policy") -> None:
    """Raise UserError if the robot lacks a joint or hand of the settings; the message names robots that fit.

    Args:
        settings: As loaded.
        robot: That is to be driven.
        called: Their name or file.
    """
    if why := unfit(settings, robot):
        fitting = [f"--robot {name}" for name, other in ROBOTS.items() if not unfit(settings, other)]
        instead = f"choose {' or '.join(fitting)}" if fitting else "no robot here has all that they name"
        raise UserError(f"the settings {called} {why}: {instead}, or other settings.")


def unfit(settings: DialectSettings, robot: RobotDescription) -> str:
    """The first part of the settings that the robot lacks, or ""."""
    observation, action = settings.observation, settings.action
    vectors = list(observation.state.values()) if observation is not None else []
    for name in [action.dialect, *(vector.dialect for vector in vectors)]:
        if name is not None and robot.name != (due := joint_dialect(name)).robot:
            return f"have the numbers of {due.title}, and the robot is the {robot.name}"
    if settings.robot not in (None, robot.name):
        return f"are of the robot {settings.robot}, not of the {robot.name}"
    pieces = [piece.part for vector in vectors for piece in vector.parts or ()]
    pieces += [piece.part for piece in action.parts]
    for part in pieces:
        side = part.rpartition("_")[2]
        if side in ("left", "right") and side not in robot.sides:
            return f"have {part!r}, and the {robot.name} has no {side} arm"
    for camera in settings.cameras if observation is not None else ():
        if camera not in robot.cameras:
            return f"want pictures of {camera!r}, and the {robot.name} has no such camera"
    return ""
