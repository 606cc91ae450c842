"""`mpvi ros2 house`: our house as a robot of ROS 2."""

from __future__ import annotations

import json
import signal
from typing import Any

import click

from mpvi_bt.apps.cli.argument_types import File, Name, check_writable, out_folder
from mpvi_bt.apps.cli.status import Status
from mpvi_bt.apps.cli.work_options import assisted, robot_option, seconds, tell_goal
from mpvi_bt.executive.drawing.terminal import tell
from mpvi_bt.executive.ticking.stop import Stop
from mpvi_bt.ground.robot.default_robot import DEFAULT_ROBOT


@click.command()
@click.argument("task", type=Name("tasks"))
@click.option("--instance", type=click.IntRange(min=0), default=0, show_default=True, help="Start state.")
@robot_option("Robot in the house, or its file.", DEFAULT_ROBOT)
@click.option("--bridge", type=File("bridges"), default="house", show_default=True, help="Bridge file to answer to.")
@assisted
@seconds("--wait", 60.0, "Longest wait for a bridge to start.")
@seconds("--patience", 120.0, "Longest wait for the answer to a state, with a bridge in lockstep.")
@click.option(
    "--stream",
    "stream_hz",
    type=click.FloatRange(0, 30),
    default=0.0,
    show_default=True,
    metavar="HZ",
    help="Send all pictures so often; 0: only those that are asked for.",
)
@out_folder("runs/ros2", "Folder of the result.")
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
def house(as_json: bool, out: Any, **given: Any) -> int:
    """Be the robot of TASK for a bridge: a house with a robot in it, on the topics of ROS 2, in simulated time.

    `mpvi ros2` in another terminal drives it. The house ends when the bridge has gone, when the task's time is over, or
    with Ctrl-C, and scores the episode by where things truly are. docs/ros2.md tells more.

    Exit code 0 where the goal is true at the end, 1 where it is not.
    """
    from mpvi_bt.runs.ros2.ros_packages import require_ros

    require_ros()
    import rclpy
    from rclpy.signals import SignalHandlerOptions

    from mpvi_bt.runs.episode.result import write_json
    from mpvi_bt.runs.ros2.ros_house import HouseSession, play, result_path

    check_writable(out)
    status, session = Status(), HouseSession(**given)
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    try:
        with Stop() as stop:
            signal.signal(signal.SIGTERM, lambda number, frame: stop.request())
            episode = play(session, status.say, stop)
    finally:
        rclpy.shutdown()
    if out is not None:
        write_json(result_path(session, out), episode.result)
    if as_json:
        tell(json.dumps(episode.result, indent=2))
    else:
        tell_goal(session.task, session.instance, episode.goal, episode.ended)
    return 0 if episode.goal.satisfied else 1
