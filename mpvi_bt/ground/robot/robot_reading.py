"""A robot's file beside its URDF: what does not fit, each with its place, and the robot that both describe."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from mpvi_bt.ground.errors import FileProblems, Problem
from mpvi_bt.ground.file_kinds import expect
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.marked_yaml import SourceMarks, load_marked, validate_data
from mpvi_bt.ground.near_file import near_file
from mpvi_bt.ground.robot.base_reading import base_of, read_base_frame
from mpvi_bt.ground.robot.camera_part import camera_of, check_cameras
from mpvi_bt.ground.robot.described import DescribedRobot
from mpvi_bt.ground.robot.gripper_reading import read_grippers
from mpvi_bt.ground.robot.joint_group import JointGroup, read_group, spread_group
from mpvi_bt.ground.robot.kinematic_chain import BaseFrame, KinematicChain, placed
from mpvi_bt.ground.robot.layout_reading import read_layout
from mpvi_bt.ground.robot.mobile_base import MobileBase
from mpvi_bt.ground.robot.protocol import SIDES, Side
from mpvi_bt.ground.robot.robot_file import FramePart, RobotFile
from mpvi_bt.ground.robot.robot_findings import RobotFindings
from mpvi_bt.ground.robot.robot_shapes import drawn_links
from mpvi_bt.ground.robot.trunk_reading import read_trunk
from mpvi_bt.ground.robot.urdf_tree import read_urdf_tree

_BELOW_M = 0.03  # our choice: wheels and pads of rubber are drawn as deep


def read_robot(file: str | Path, name: str = "") -> DescribedRobot:
    """The robot of a file, by that file and its URDF alone.

    Args:
        file: Of the robot.
        name: What it is called; the file's stem by default.

    Raises:
        UserError: There is no such file.
        FileProblems: Everything that is wrong with it, or with its URDF.
    """
    data, marks = load_marked(file)
    return _made(data, marks, name or Path(file).stem)


def check_robot_file(data: Any, marks: SourceMarks) -> DescribedRobot:
    """The robot of a loaded file. Raises FileProblems."""
    return _made(data, marks, Path(marks.file).stem)


def lint_robot_file(data: Any, marks: SourceMarks) -> list[Problem]:
    """What may be worth knowing of a file without errors: meshes that are not there, and links below the floor."""
    robot = check_robot_file(data, marks)
    problems = list(robot.tree.missing_meshes())
    low, link = min(((link.lowest_m, link.name) for link in drawn_links(robot)), default=(0.0, ""))
    if low < -_BELOW_M:
        message = (
            f"link {link!r} reaches {-low:.2f} m below the floor as it drives; if the base frame is above the floor, "
            f"say so: `above_floor_m: {robot.above_floor_m - low:.2f}`"
        )
        problems.append(replace(marks.problem(("base",), "below-floor", message, key=True), severity="warning"))
    return problems


def _made(data: Any, marks: SourceMarks, name: str) -> DescribedRobot:
    if isinstance(data, dict) and isinstance(data.get("base"), dict) and data["base"].get("kind") == "ackermann":
        message = (
            "a base that steers like a car is not driven: ways here turn on the spot. Known: holonomic, differential"
        )
        raise FileProblems([marks.problem(("base", "kind"), "unknown-value", message)])
    expect("robot", data, marks)
    told = validate_data(data, marks, RobotFile)
    urdf = Path(marks.file).parent / told.urdf
    if not urdf.is_file():
        message = f"there is no file {str(urdf)!r}{near_file(urdf, '. ')}"
        raise FileProblems([marks.problem(("urdf",), "unreadable", message)])
    return _described(told, RobotFindings(marks, read_urdf_tree(urdf)), name)


def _described(told: RobotFile, findings: RobotFindings, name: str) -> DescribedRobot:
    """The robot. Raises FileProblems."""
    tree = findings.tree
    frame = read_base_frame(findings, told.base)
    torso = read_group(findings, told.torso, ("torso",), "the torso")
    sides = list(_sides(findings, told))
    arms = {side: read_group(findings, told.arms[side], ("arms", side), f"the {side} arm") for side in sides}
    fingers = read_grippers(findings, told.grippers, frame.link)
    check_cameras(findings, told.cameras, frame.link)
    findings.stop_if_wrong()
    order, layout = read_layout(findings, told, torso, arms)
    findings.stop_if_wrong()
    spread = spread_group(torso, order)
    first = [tree.joints[arm.joints[0]].parent for arm in arms.values() if arm.joints]
    chest, head = first[0] if first else frame.link, told.cameras["head"].link
    trunk = read_trunk(findings, told.torso, frame, order, torso.limits, chest, head)
    chains, carried = _cameras(findings, told, frame, order, arms)
    hands = {side: _chain(frame, told.grippers[side].tcp, (*order, *arms[side].joints)) for side in arms}
    findings.stop_if_wrong()
    speed = told.base.speed
    linear = [i for i, n in enumerate(layout.names) if n in tree.joints and tree.joints[n].kind == "prismatic"]
    made = DescribedRobot(
        name=name,
        layout=layout,
        base=MobileBase(1.0, 1.0, 1.0, 1.0),  # until where the arms are is known
        base_speed=np.array([speed.ahead, speed.sideways or 0.0, speed.turn]),
        drive_acceleration=np.array([told.base.acceleration.ahead, told.base.acceleration.turn]),
        torso_joints=order,
        arm_joints={side: arm.joints for side, arm in arms.items()},
        finger_joints={side: tuple(told.grippers[side].joints) for side in arms},
        torso_limits=spread.limits,
        arm_limits={side: arm.limits for side, arm in arms.items()},
        torso_top_speed=spread.speed,
        arm_top_speed={side: arm.speed for side, arm in arms.items()},
        linear_joints=frozenset(linear),
        opening_m=next((hand.opening_m for hand in fingers.values()), 0.0),
        grasp_m=max((told.grippers[side].grasp_m for side in arms), default=0.0),
        travel_torso=spread.travel,
        travel_arm={side: arm.travel for side, arm in arms.items()},
        trunk=trunk,
        cameras={name: camera_of(part) for name, part in told.cameras.items()},
        arm_m=told.arm_radius_m,
        tree=tree,
        link=frame.link,
        camera_chains=chains,
        carried=carried,
        hands=hands,
        above_floor_m=told.base.above_floor_m,
        finger_range={side: fingers[side].ends for side in arms},
    )
    object.__setattr__(made, "base", base_of(told.base, made))
    return made


def _sides(findings: RobotFindings, told: RobotFile) -> Iterator[Side]:
    """Sides that have an arm and a gripper; tells of others."""
    if list(told.arms) == ["left"]:
        findings.tell(("arms", "left"), "unknown-value", "a robot's only arm is its 'right' one", key=True)
    for side in SIDES:
        if side in told.arms and side in told.grippers:
            yield side
        elif side in told.arms:
            findings.tell(("arms", side), "missing-key", f"the {side} arm has no gripper: grippers.{side}", key=True)
        elif side in told.grippers:
            findings.tell(("grippers", side), "missing-key", f"there is no {side} arm for it: arms.{side}", key=True)


def _chain(
    frame: BaseFrame, part: FramePart, order: tuple[str | None, ...], turn: Array | None = None
) -> KinematicChain:
    return frame.chain(part.link, placed(part.xyz, part.rpy), order, turn)


def _cameras(
    findings: RobotFindings,
    told: RobotFile,
    frame: BaseFrame,
    order: tuple[str | None, ...],
    arms: dict[Side, JointGroup],
) -> tuple[dict[str, KinematicChain], dict[str, Side | None]]:
    """Chains to the cameras, and the arm that each is on."""
    chains, carried = {}, dict[str, Side | None]()
    for name, part in told.cameras.items():
        above = {joint.name for joint in findings.tree.path(part.link, frame.link) or ()}
        on = next((side for side, arm in arms.items() if above & set(arm.joints)), None)
        if name == "head" and on is not None:
            message = f"it is on the {on} arm: the camera to search with is on base, torso or head"
            findings.tell(("cameras", name, "link"), "out-of-range", message)
        optical = "optical" in part.link if part.optical is None else part.optical
        full = order if on is None else (*order, *arms[on].joints)
        chains[name] = _chain(frame, part, full, None if optical else kin.LINK_TO_OPTICAL)
        carried[name] = on
    return chains, carried
