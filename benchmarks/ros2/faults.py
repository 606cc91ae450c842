"""Robots over ROS 2 that fail while a bridge drives them, and bridges that are killed: how soon the robot stands.

Robot, bridge and an observer of the commands are three processes. A trial drives the robot straight on, lets a fault
happen at a drawn moment, and waits until the bridge has ended.
"""

from __future__ import annotations

import math
import multiprocessing
import os
import random
import signal
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.origin import grid
from mpvi_bt.executive.ticking.stop import Stop
from mpvi_bt.ground.errors import RobotError, UserError
from mpvi_bt.runs.ros2.bridge_file import load_bridge
from mpvi_bt.runs.ros2.robot_session import robot_session
from tests.ros_robot import FETCH, TestRobot, write_bridge

FAULTS = (
    *("node killed", "topic silent", "clock jump", "NaN in joints", "wrong sizes", "late pictures"),
    *("two bridges on one robot", "bridge killed (-9)"),
)
HEADS = (
    "fault",
    "trials",
    "robot told to stand after, median [s]",
    "most [s]",
    "bridge ended by",
    "not ended after 15 s",
)
HUNG_S, BEGIN_S = 15.0, 40.0
BASE_TIMEOUT_S = 0.25  # of the robot's own base
_SPEED, _LOOK_EVERY = 0.4, 10
_FORK = multiprocessing.get_context("fork")  # children have all modules loaded; nothing of ROS runs in the parent


@dataclass(frozen=True)
class Trial:
    """What became of one.

    Attributes:
        fault: Which.
        after_s: From the fault to the last command that moves the base; where the bridge was killed to its last move.
        ended: Reason that the bridge ended by; "": it was killed; None: it hung.
        why: The same in a sentence.
    """

    fault: str
    after_s: float
    ended: str | None
    why: str = ""


def be_robot(pipe: Connection, clock: str) -> None:
    """A robot, in a process: the pipe says how it fails, and asks when it last moved."""
    with TestRobot(clock) as robot:
        robot.timeout_s = BASE_TIMEOUT_S
        pipe.send("ready")
        while (word := pipe.recv()) != "end":
            if word == "moved":
                pipe.send(robot.moved)
            else:
                _break(robot, *word)


def _break(robot: TestRobot, fault: str, number: int) -> None:
    odd = number % 2 == 1
    if fault == "topic silent":
        robot.silent.add("/odom" if odd else "/joint_states")
    elif fault == "clock jump":
        robot.shift_s = -5.0 if odd else 5.0
    elif fault == "NaN in joints":
        robot.spoil = lambda state: state.position.__setitem__(number % len(state.position), math.nan)
    elif fault == "wrong sizes" and odd:
        robot.size = (24, 32)
    elif fault == "wrong sizes":
        robot.spoil = lambda state: state.name.append("one_more")
    elif fault == "late pictures":
        robot.old_s = 4.0


def observe(pipe: Connection) -> None:
    """Note, in a process, when a command moved the base; the pipe asks for the moments."""
    import rclpy
    from geometry_msgs.msg import TwistStamped
    from rclpy.executors import SingleThreadedExecutor

    rclpy.init()
    node, moving = rclpy.create_node("observer"), list[float]()

    def hear(message: Any) -> None:
        twist = message.twist
        if twist.linear.x or twist.linear.y or twist.angular.z:
            moving.append(time.monotonic())

    node.create_subscription(TwistStamped, "/cmd_vel", hear, 100)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    pipe.send("ready")
    while not pipe.poll():
        executor.spin_once(0.02)
    pipe.send(moving)


def be_bridge(pipe: Connection, file: str) -> None:
    """Drive the robot straight on, in a process, and look now and then; the pipe gets the reason of the end."""
    try:
        with robot_session(load_bridge(file, FETCH), FETCH, True, Stop(), lambda line: None) as made:
            pipe.send("ready")
            robot = made.world.robot
            while True:
                action = robot.action
                FETCH.layout.set_velocity(action, np.array([_SPEED, 0.0, 0.0]))
                robot.act(action)
                made.world.step()
                if made.world.steps % _LOOK_EVERY == 0:
                    robot.look("head")
    except RobotError as error:
        pipe.send((error.reason, str(error)))
    except UserError as error:
        pipe.send(("refused", str(error)))


class _Child:
    """A process, with a pipe to it."""

    def __init__(self, work: Callable[..., None], *args: Any) -> None:
        self.pipe, theirs = _FORK.Pipe()
        self.process: BaseProcess = _FORK.Process(target=work, args=(theirs, *args), daemon=True)
        self.process.start()
        theirs.close()

    def hear(self, seconds: float) -> Any:
        """The next word; None: there is none in time, or the process is gone."""
        with suppress(EOFError, OSError):
            return self.pipe.recv() if self.pipe.poll(seconds) else None
        return None

    def kill(self) -> None:
        """By SIGKILL."""
        with suppress(ProcessLookupError):
            os.kill(self.process.pid or 0, signal.SIGKILL)
        self.process.join()


def trial(fault: str, number: int, seed: int) -> Trial:
    """One fault, in a domain of its own."""
    draw = random.Random(f"{seed} {fault} {number}")
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    os.environ["ROS_DOMAIN_ID"] = str(160 + number % 40)
    clock = "sim" if fault == "clock jump" else "system"
    with tempfile.TemporaryDirectory() as folder:
        file = write_bridge(Path(folder), clock, watchdog_s="watchdog_s: 0.3", wait_s="wait_s: 20")
        children = [robot := _Child(be_robot, clock), observer := _Child(observe)]
        try:
            if not (robot.hear(BEGIN_S) and observer.hear(BEGIN_S)):
                return Trial(fault, math.nan, "not begun")
            children.append(bridge := _Child(be_bridge, file))
            if (word := bridge.hear(BEGIN_S)) != "ready":
                return Trial(fault, math.nan, "not begun", str(word))
            time.sleep(draw.uniform(0.7, 1.7))
            if (word := bridge.hear(0.0)) is not None:  # a busy machine kept states from it
                return Trial(fault, math.nan, "ended before", str(word))
            at = time.monotonic()
            ended = _happen(fault, number, file, robot, bridge, children)
            if fault == "two bridges on one robot":  # the second one looks around before it commands
                at = time.monotonic() if ended and "goes on" not in ended[0] else math.inf
            if fault == "bridge killed (-9)":
                time.sleep(3 * BASE_TIMEOUT_S)
                robot.pipe.send("moved")
                return Trial(fault, (robot.hear(5.0) or math.inf) - at, "")
            time.sleep(0.2)
            observer.pipe.send("end")
            after = max((t for t in observer.hear(5.0) or () if t > at), default=at) - at if at < math.inf else math.nan
            return Trial(fault, after, ended and ended[0], ended[1] if ended else "")
        finally:
            for child in children:
                child.kill()


def _happen(
    fault: str, number: int, file: str, robot: _Child, bridge: _Child, children: list[_Child]
) -> tuple[str, str] | None:
    """Let a fault happen; how the bridge ended: of two the one that came second."""
    if fault == "node killed":
        robot.kill()
    elif fault == "bridge killed (-9)":
        bridge.kill()
        return "", ""
    elif fault == "two bridges on one robot":
        children.append(second := _Child(be_bridge, file))
        if (word := second.hear(BEGIN_S)) == "ready":
            word = second.hear(HUNG_S)
        first = bridge.hear(1.0)
        told = [end[0] if end else "goes on" for end in (word, first)]
        if told == ["goes on", "goes on"]:
            return None
        return f"{told[0]}; the first: {told[1]}", (word or first)[1]
    else:
        robot.pipe.send((fault, number))
    ended: tuple[str, str] | None = bridge.hear(HUNG_S)
    if ended is not None:
        bridge.process.join(5.0)
        return ended if not bridge.process.is_alive() else None
    return None


def rows(trials: list[Trial]) -> list[list[str | int | float | None]]:
    """A row of the table for each fault."""
    out: list[list[str | int | float | None]] = []
    for fault in dict.fromkeys(trial.fault for trial in trials):
        own = [trial for trial in trials if trial.fault == fault]
        after = [trial.after_s for trial in own if math.isfinite(trial.after_s)]
        reasons = Counter(trial.ended for trial in own if trial.ended is not None)
        told = ", ".join(f"{reason or 'SIGKILL'} {count}" for reason, count in reasons.most_common())
        median, most = (float(np.median(after)), max(after)) if after else (None, None)
        out.append([fault, len(own), median, most, told, sum(trial.ended is None for trial in own)])
    return out


def table(lines: list[list[str | int | float | None]]) -> str:
    """As Markdown."""
    shown = [[f"{cell:.2f}" if isinstance(cell, float) else str(cell) for cell in line] for line in lines]
    return grid(HEADS, shown)
