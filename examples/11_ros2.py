"""Drive a robot over ROS 2: 1 s straight on, a quarter turn, and a look. The robot is our house's, in another process.

With a robot of yours: its file and its bridge file in place of "r1" and "house", and no process is started. Whatever
happens within the `with` block, an error or Ctrl-C too, the robot is told to stop at its end.
"""

import os
import subprocess
import sys

import numpy as np

from mpvi_bt.executive.ticking.stop import Stop
from mpvi_bt.ground.robot.robots import robot_named
from mpvi_bt.runs.ros2.bridge_file import load_bridge
from mpvi_bt.runs.ros2.robot_session import RobotSession, robot_session

os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")  # nobody else on the net is driven
robot = robot_named("r1")


def drive(session: RobotSession, velocity: tuple[float, float, float], seconds: float) -> None:
    """Command vx, vy [m/s] and yaw rate [rad/s]; the robot ramps up and down."""
    world = session.world
    until_s = world.time_s + seconds
    while world.time_s < until_s:
        action = world.robot.action
        robot.layout.set_velocity(action, np.array(velocity))
        world.robot.act(action)
        world.step()


house = subprocess.Popen(
    [sys.executable, "-m", "mpvi_bt.apps.cli", "ros2", "house", "picking_up_trash", "--out", "runs/ros2"],
    stdout=subprocess.DEVNULL,
)
try:
    with robot_session(load_bridge("house", robot), robot, allow_motion=True, stop=Stop(), say=print) as session:
        drive(session, (0.4, 0.0, 0.0), 1.0)
        drive(session, (0.0, 0.0, 0.8), np.pi / 2 / 0.8)
        drive(session, (0.0, 0.0, 0.0), 0.5)
        body, image = session.world.robot.proprioception(), session.world.robot.look("head")
        x, y, yaw = body.base_pose
        print(f"the base is at {x:.2f}, {y:.2f} m and looks {np.degrees(yaw):.0f} degrees from x")
        print(f"the head sees {image.rgb.shape[1]} x {image.rgb.shape[0]} pixels, {np.median(image.depth):.1f} m away")
        print(
            f"{session.told()['commands']} commands, {session.told()['state_to_command_ms']} ms from state to command"
        )
finally:
    house.terminate()
    house.wait()
