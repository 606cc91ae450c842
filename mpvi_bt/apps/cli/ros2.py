"""`mpvi ros2`: the executive on a robot over ROS 2, and our house as such a robot."""

from __future__ import annotations

import importlib
import json
import sys
from typing import Any

import click

from mpvi_bt.apps.cli import INTERRUPTED
from mpvi_bt.apps.cli.argument_types import Name, check_writable, out_folder
from mpvi_bt.apps.cli.examples import with_examples
from mpvi_bt.apps.cli.score import brief_score
from mpvi_bt.apps.cli.work_options import ELSEWHERE, robot_option, work, work_of
from mpvi_bt.executive.drawing.terminal import results, tell
from mpvi_bt.ground.errors import BackendError


class _WithHouse(click.Group):
    """The command, beside its one subcommand, which is loaded when it is called."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """None: loading the house only to list it would take long; the help names it."""
        return []

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The house, or None."""
        if cmd_name != "house":
            return None
        command: click.Command = importlib.import_module("mpvi_bt.apps.cli.ros2_house").house
        return with_examples(command, "ros2 house")


@click.group(
    cls=_WithHouse,
    invoke_without_command=True,
    subcommand_metavar="[house [ARGS]...]",
    context_settings=ELSEWHERE,
)
@robot_option("The robot, by name or file.")
@click.option(
    "--bridge", type=Name("bridges", file=True), metavar="NAME", help="Its topics: a bridge, by name or file."
)
@click.option("--allow-motion", is_flag=True, help="Send commands; without it nothing moves.")
@work("Task to do.", "Instruction to carry out, in place of a task.", "seed", "mcap")
@out_folder("runs", "Folder of result and trace.")
@click.option("--watch/--no-watch", default=True, show_default=True, help="Show the tree while it runs.")
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
@click.pass_context
def ros2(ctx: click.Context, /, **given: Any) -> int | None:
    """Run a task, an instruction or a tree on a robot over ROS 2. Nothing moves without --allow-motion.

    `mpvi ros2 house` is such a robot: our simulated house, in a process of its own.

    The bridge says which topics the robot has: docs/ros2.md. Ctrl-C and SIGTERM stop the robot. Exit code 0 where the
    tree succeeds, 1 where it fails, 3 where the robot, a policy's server or a language model failed.
    """
    if ctx.invoked_subcommand is not None:
        return None
    return _run(**given)


def _run(
    robot: str | None,
    bridge: str | None,
    allow_motion: bool,
    watch: bool,
    as_json: bool,
    **executive: Any,
) -> int:
    for option, value in (("--robot", robot), ("--bridge", bridge)):
        if not value:
            raise click.UsageError(f"Missing option '{option}'.")
    assert robot is not None
    assert bridge is not None
    if not any(executive[name] for name in ("task", "instruction", "tree", "plan")):
        raise click.UsageError("Nothing to do: give --task, --instruction or --tree.")
    from mpvi_bt.ground.robot.robots import robot_named
    from mpvi_bt.runs.ros2.bridge_file import load_bridge
    from mpvi_bt.runs.ros2.ros_packages import require_ros

    model = robot_named(robot)
    topics = load_bridge(bridge, model)
    require_ros()
    from mpvi_bt.executive.ticking.live import LiveTree
    from mpvi_bt.executive.ticking.loop import Subscriber
    from mpvi_bt.runs.recording.mcap_log import require_mcap
    from mpvi_bt.runs.ros2.ros_episode import play_on_robot

    done = work_of(robot=robot, **executive)
    if executive["mcap"]:
        require_mcap()
        check_writable(executive["mcap"].parent)
    watchers: list[Subscriber] = []
    if watch:
        watchers.append(LiveTree(sys.stderr if as_json else results(), f"{robot} over ROS 2"))
    result = play_on_robot(done, topics, model, allow_motion, _note, watchers)
    tell(json.dumps(result, indent=2) if as_json else brief_score(result, False, None, None))
    if result["ended"] == "interrupted":
        return INTERRUPTED
    if result["ended"] == "backend_error":
        return BackendError.exit_code
    return 0 if result["success"] else 1


def _note(line: str) -> None:
    click.echo(f"mpvi: {line}", err=True)
