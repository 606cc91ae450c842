"""The controllers of the house over ROS 2: stamped commands become the action of the next step."""

from __future__ import annotations

import numpy as np
import pytest

from mpvi_bt.ground.robot.limits import travel_action
from mpvi_bt.hands.robots.r1 import R1
from mpvi_bt.runs.ros2.bridge_file import load_bridge
from mpvi_bt.runs.ros2.house_commands import HouseCommands, stamp_ns

BRIDGE = load_bridge("house", R1)
BASE, JOINTS = BRIDGE.settings.base.topic, BRIDGE.joints[0].topic
HAND = BRIDGE.grippers["right"].topic
FINGERS = R1.finger_joints["right"]


def commands():
    return HouseCommands(R1, travel_action(R1), BRIDGE)


def answer(house, step: int, velocity=(0.0, 0.0, 0.0), without=()):
    """Commands that answer a state: the base's velocity, and where the arms are already."""
    stamp = stamp_ns(step)
    if BASE not in without:
        house.drive(BASE, stamp, velocity)
    for entry in (*BRIDGE.joints, *BRIDGE.grippers.values()):
        if entry.topic not in without:
            house.follow(entry.topic, stamp, (entry.joints or ())[:1], [1 / 30], [[0.0]])


def test_a_state_is_answered_by_every_topic() -> None:
    """In lockstep the house waits for the base, the joints and both grippers, whatever order they come in."""
    house = commands()
    answer(house, 0, without=(HAND,))
    assert house.missing() == {HAND}
    house.follow(HAND, stamp_ns(0), FINGERS, [1 / 30], [[0.05, 0.05]])
    assert not house.missing()
    house.next_action()
    assert house.missing() == {*house.heard}


def test_the_one_point_of_a_trajectory_is_the_target_of_the_next_step() -> None:
    """Targets come through to the bit, so that an episode is the one that is played without ROS."""
    house, joints = commands(), R1.arm_joints["left"]
    targets = R1.travel_arm["left"] + np.pi / 100
    house.follow(JOINTS, stamp_ns(0), joints, [33_333_333e-9], [targets])
    action = house.next_action()
    assert (action[R1.layout.arm["left"]] == targets).all()
    assert (action[R1.layout.arm["right"]] == R1.travel_arm["right"]).all()


@pytest.mark.parametrize(("position", "told"), [(0.0, -1.0), (0.025, 0.0), (0.05, 1.0)])
def test_fingers_tell_how_far_a_gripper_is_open(position: float, told: float) -> None:
    """Each finger has half of the opening; the action has -1 closed to 1 open."""
    house = commands()
    house.follow(HAND, stamp_ns(0), FINGERS, [1 / 30], [[position, position]])
    assert house.next_action()[R1.layout.gripper["right"]] == pytest.approx(told)


def test_a_slow_trajectory_takes_its_time() -> None:
    """Between its points a joint goes evenly, from where it was told to be."""
    house, joint = commands(), R1.torso_joints[0]
    house.follow(JOINTS, stamp_ns(0), [joint], [0.2, 0.4], [[0.5], [0.4]])
    lifts = [house.next_action()[R1.layout.torso][0] for _ in range(15)]
    assert lifts[2] == pytest.approx((R1.travel_torso[0] + 0.5) / 2)
    assert lifts[5] == pytest.approx(0.5)
    assert lifts[8] == pytest.approx(0.45)
    assert lifts[11:] == [0.4] * 4


def test_the_base_stops_by_itself_when_commands_stay_away() -> None:
    """A quarter of a second of its own time after the last velocity the base is told to stand."""
    house = commands()
    answer(house, 0, (0.3, 0.0, 0.1))
    speeds = [house.next_action()[0] for _ in range(12)]
    assert speeds == [0.3] * 8 + [0.0] * 4


def test_a_command_for_a_state_that_has_passed_is_not_carried_out() -> None:
    """It is late, and its state counts as lost for that topic; a second copy of a command changes nothing."""
    house = commands()
    answer(house, 0, (0.1, 0.0, 0.0))
    answer(house, 0, (0.2, 0.0, 0.0))
    assert house.next_action()[0] == 0.1
    answer(house, 1, without=(BASE,))
    house.next_action()
    house.drive(BASE, stamp_ns(1), (0.5, 0.0, 0.0))
    assert house.next_action()[0] == 0.1
    heard = house.heard[BASE]
    assert (heard.taken, heard.again, heard.late, heard.lost) == (1, 1, 1, 2)


@pytest.mark.parametrize(
    ("joints", "positions"),
    [(["no_such_joint"], [[0.0]]), (FINGERS, [[0.01]]), (FINGERS, []), (FINGERS, [[float("nan"), 0.0]])],
)
def test_a_command_that_no_controller_can_follow_is_refused(joints: list[str], positions: list[list[float]]) -> None:
    """Of unknown joints, of a wrong size or not finite: nothing moves, and the reason is counted."""
    house = commands()
    before = house.next_action()
    house.follow(HAND, stamp_ns(1), joints, [0.1], positions)
    house.drive(BASE, stamp_ns(1), (float("inf"), 0.0, 0.0))
    assert (house.next_action() == before).all()
    assert sum(house.heard[HAND].refused.values()) == sum(house.heard[BASE].refused.values()) == 1
