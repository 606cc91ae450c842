"""One episode on a robot over ROS 2."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from mpvi_bt.executive.ticking.loop import Subscriber
from mpvi_bt.executive.ticking.stop import Stop
from mpvi_bt.ground.robot.robot_description import RobotDescription
from mpvi_bt.runs.ros2.bridge_file import Bridge
from mpvi_bt.runs.ros2.robot_session import robot_session
from mpvi_bt.runs.ros2.ros_packages import part
from mpvi_bt.runs.ros2.run_control import RunControl
from mpvi_bt.runs.ros2.run_topics import RunTopics

if TYPE_CHECKING:
    from mpvi_bt.runs.serving.served import ServedWork


def play_on_robot(
    work: ServedWork,
    bridge: Bridge,
    robot: RobotDescription,
    allow_motion: bool,
    say: Callable[[str], None],
    watchers: Sequence[Subscriber] = (),
) -> dict[str, Any]:
    """Play one episode; its result, in which "ros2" tells how the bridge went.

    Args:
        work: What is to be done.
        bridge: The robot's topics.
        robot: What robot it is.
        allow_motion: Whether commands go out.
        say: Told what a person should know.
        watchers: Who watches.

    Raises:
        UserError: It cannot be begun.
        RobotError: The robot is silent before the episode begins.
        ModelError: A language model makes no plan.
        NodeError: A behavior raised.
        KeyboardInterrupt: It was ended by a signal.
    """
    from mpvi_bt.runs.serving.served import check_work, play_episode

    check_work(work, say)
    stop = Stop()
    prefix = bridge.settings.names
    if shared := work.config.navigator == "nav2":
        part("nav2_msgs.action:NavigateToPose", "--navigator nav2")
    with robot_session(bridge, robot, allow_motion, stop, say, shared) as session:
        watchers = [RunControl(session, prefix, stop), RunTopics(session, prefix), *watchers]
        _, _, result = play_episode(
            work, session.first, session.world, "ros2", say, watchers, stop, lambda: {"ros2": session.told()}
        )
    return result
