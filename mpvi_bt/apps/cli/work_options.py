"""Options of work on a robot elsewhere, behind a socket or over ROS 2, and of the house in its place."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import click

from mpvi_bt.apps.cli.argument_types import Name, arguments, check_writable
from mpvi_bt.apps.cli.setting_options import method, parameters, settings
from mpvi_bt.executive.drawing.terminal import tell
from mpvi_bt.runs.choices.config import ASKING, METHOD, EpisodeConfig

if TYPE_CHECKING:
    from mpvi_bt.executive.ticking.goal_report import GoalReport
    from mpvi_bt.runs.serving.served import ServedWork

# What the executive is run with where nothing else is said: what needs neither a simulator nor a known house.
ELSEWHERE = {"default_map": {"map": "online", "policy": "reactive"}}
_HERE = [name for name in METHOD if name not in ("robot", "sim", "assisted")]  # no simulator is here


def work(task: str, instruction: str, *more: str) -> Callable[[Any], Any]:
    """The options of what is done, and how.

    Args:
        task, instruction: Help of these two.
        more: Names of settings beside tree and plan.
    """

    def add(command: Any) -> Any:
        command = settings("tree", "plan", *more)(method("robot", *_HERE)(settings(*_HERE, *ASKING)(command)))
        command = click.option("--instruction", default="", metavar="TEXT", help=instruction)(parameters(command))
        return click.option("--task", type=Name("tasks/plans"), help=task)(command)

    return add


def work_of(instruction: str, params: tuple[str, ...], out: Any, task: str | None, **given: Any) -> ServedWork:
    """The work that is given. Raises UsageError and UserError."""
    from mpvi_bt.runs.serving.served import ServedWork

    if task and instruction:
        raise click.UsageError("--task and --instruction both set the work: give only one of them.")
    check_writable(out)
    return ServedWork(EpisodeConfig(task or "", arguments=tuple(arguments(params).items()), **given), instruction, out)


def robot_option(help: str, default: str | None = None) -> Callable[[Any], Any]:
    """The option of a robot, by name or file."""
    kind = Name("robots", file=True)
    return click.option("--robot", type=kind, default=default, show_default=True, metavar="NAME", help=help)


def seconds(option: str, default: float, help: str) -> Callable[[Any], Any]:
    """The option of the longest wait for something."""
    kind = click.FloatRange(min=0)
    name = f"{option.strip('-')}_s"
    return click.option(option, name, type=kind, default=default, show_default=True, metavar="SECONDS", help=help)


def assisted(command: Any) -> Any:
    """The option of a house that holds what is grasped."""
    return click.option("--assisted", is_flag=True, help="Fix a grasped object to the hand, as BEHAVIOR does.")(command)


def tell_goal(task: str, instance: int, goal: GoalReport, ended: str) -> None:
    """Tell which conditions hold at the end of an episode, and its q."""
    for condition in goal.conditions:
        tell(f"  {'x' if condition.satisfied else ' '} {condition.text}")
    tell(f"{task}, instance {instance}: q = {goal.q:.3f}, {ended}")
