"""Bridge files: which topics of ROS 2 a robot has. They are `bridges/*.yaml`; docs/ros2.md explains every key."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
from pydantic import Field, StringConstraints, model_validator

from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import FileProblems, Problem
from mpvi_bt.ground.file_kinds import expect
from mpvi_bt.ground.marked_yaml import Record, SourceMarks, load_marked, validate_data
from mpvi_bt.ground.robot.finger_joints import FingerJoints, fingers_of
from mpvi_bt.ground.robot.protocol import Side
from mpvi_bt.ground.robot.robot_description import RobotDescription

EACH = "*"  # as a name: every camera, or gripper, that has no entry of its own; {name} in its topics is its name

Topic = Annotated[
    str, StringConstraints(pattern=r"^/?[A-Za-z{][A-Za-z0-9_{}]*(/[A-Za-z{][A-Za-z0-9_{}]*)*$", max_length=200)
]
FrameName = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9_/.\-]+$", max_length=200)]
Names = Annotated[tuple[str, ...], Field(min_length=1)]
Seconds = Annotated[float, Field(gt=0.0, le=60.0, allow_inf_nan=False)]
Finite = Annotated[float, Field(ge=-100.0, le=100.0, allow_inf_nan=False)]


class TfOdometry(Record):
    """The base's place by transforms.

    Attributes:
        fixed: Frame of the map.
        base: Frame of the base.
    """

    fixed: FrameName
    base: FrameName


class OdometrySource(Record):
    """Where the base's place comes from: one of the two.

    Attributes:
        topic: Of nav_msgs/Odometry.
        tf: Frames to look up; the speed then is that of the place.
    """

    topic: Topic | None = None
    tf: TfOdometry | None = None

    @model_validator(mode="after")
    def _one(self) -> OdometrySource:
        if (self.topic is None) == (self.tf is None):
            raise ValueError("give either 'topic' or 'tf'")
        return self


class CameraTopics(Record):
    """Topics of a camera. Depth is aligned with color, pixel by pixel.

    Attributes:
        color: sensor_msgs/Image (rgb8, bgr8), or CompressedImage with `compressed`.
        depth: sensor_msgs/Image, 32FC1 [m] or 16UC1 [mm].
        info: sensor_msgs/CameraInfo of color.
        compressed: Whether color comes as CompressedImage.
        frame: Optical frame to look up by tf; None: where the robot's file has the camera.
        labels: sensor_msgs/Image, 32SC1: what each pixel shows. Only a simulator has them.
        names: std_msgs/String, latched: JSON of what labels stand for.
        request: std_msgs/Header that asks for a picture of a moment; None: pictures come by themselves.
    """

    color: Topic
    depth: Topic
    info: Topic
    compressed: bool = False
    frame: FrameName | None = None
    labels: Topic | None = None
    names: Topic | None = None
    request: Topic | None = None

    @model_validator(mode="after")
    def _labels_have_names(self) -> CameraTopics:
        if (self.labels is None) != (self.names is None):
            raise ValueError("'labels' and 'names' come together")
        return self


class BaseCommands(Record):
    """How the base is driven.

    Attributes:
        topic: Of the velocity in the frame of the base.
        type: Its message of geometry_msgs.
        frame: Written into a TwistStamped.
    """

    topic: Topic
    type: Literal["Twist", "TwistStamped"] = "Twist"
    frame: FrameName = "base_link"


class JointCommands(Record):
    """A controller of joints: by a topic or by an action.

    Attributes:
        topic: Of trajectory_msgs/JointTrajectory.
        action: Of control_msgs/FollowJointTrajectory.
        joints: Names; None: every joint of torso and arms that no other entry has.
    """

    topic: Topic | None = None
    action: Topic | None = None
    joints: Names | None = None

    @model_validator(mode="after")
    def _one_way(self) -> JointCommands:
        if (self.topic is None) == (self.action is None):
            raise ValueError("give either 'topic' or 'action'")
        return self


class GripperCommands(JointCommands):
    """A controller of a gripper. Its position goes from `closed` to `open` as it opens.

    Attributes:
        joints: Names; None: the finger joints of the robot's file.
        open, closed: Position of each joint then; None: as the robot's file has it. A joint that it does not have
            slides by an even share of the opening.
    """

    open: Finite | None = None
    closed: Finite | None = None


class Quality(Record):
    """Quality of service of a kind of topic, where its default does not meet its publisher or subscriber.

    Attributes:
        reliability: Best effort loses messages and never waits.
        depth: How many messages are kept.
    """

    reliability: Literal["reliable", "best_effort"] | None = None
    depth: Annotated[int, Field(ge=1, le=1000)] | None = None


class Qualities(Record):
    """By kind: states by default are reliable or not as they are offered, pictures best effort, commands reliable."""

    states: Quality = Quality()
    pictures: Quality = Quality()
    commands: Quality = Quality()


class BridgeFile(Record):
    """All of a file.

    Attributes:
        about: One line for a person.
        clock: "sim": time comes from /clock; "system": it is this computer's.
        lockstep: Whether the robot waits for the answer to each state: our house does; a real robot cannot.
        joint_states: Topics of sensor_msgs/JointState.
        odometry: Where the base is.
        cameras: By the names of the robot's file; "*" stands for each that is not named.
        base: How the base is driven.
        joints: Controllers of torso and arms.
        grippers: By side; "*" stands for each that is not named.
        qos: Qualities of service that differ.
        watchdog_s: States that are older stop the robot.
        picture_s: Pictures that are older are refused.
        wait_s: How long a topic is waited for at the start.
        names: Prefix of the topics that the bridge publishes itself.
    """

    about: Annotated[str, Field(min_length=1, max_length=200)] = "a robot"
    clock: Literal["sim", "system"] = "system"
    lockstep: bool = False
    joint_states: Topic | Annotated[tuple[Topic, ...], Field(min_length=1)]
    odometry: OdometrySource
    cameras: dict[str, CameraTopics] = {}
    base: BaseCommands
    joints: tuple[JointCommands, ...] = ()
    grippers: dict[str, GripperCommands] = {}
    qos: Qualities = Qualities()
    watchdog_s: Seconds = 0.3
    picture_s: Seconds = 1.0
    wait_s: Seconds = 10.0
    names: Topic = "/mpvi"

    @model_validator(mode="after")
    def _lockstep_needs_its_clock(self) -> BridgeFile:
        if self.lockstep and self.clock != "sim":
            raise ValueError("'lockstep' is for a simulator, whose clock is 'sim'")
        return self

    @property
    def state_topics(self) -> tuple[str, ...]:
        """Topics of joint states."""
        return (self.joint_states,) if isinstance(self.joint_states, str) else self.joint_states


@dataclass(frozen=True, eq=False)
class Bridge:
    """A bridge file read for one robot: every name is filled in and is the robot's.

    Attributes:
        file: Path of the file, for messages.
        settings: What it says of the whole.
        cameras: By name, those that have topics.
        joints: Controllers with the names of their joints.
        grippers: By side.
        fingers: The joints of each.
    """

    file: str
    settings: BridgeFile
    cameras: Mapping[str, CameraTopics]
    joints: tuple[JointCommands, ...]
    grippers: Mapping[Side, GripperCommands]
    fingers: Mapping[Side, FingerJoints]


def check_bridge(data: Any, marks: SourceMarks) -> BridgeFile:
    """A loaded file as a `BridgeFile`. Raises FileProblems."""
    expect("bridge", data, marks)
    return validate_data(data, marks, BridgeFile)


def load_bridge(given: str, robot: RobotDescription) -> Bridge:
    """A bridge by the name of a file in `bridges/` or by path, for a robot.

    Raises:
        UserError: There is none, with the nearest name.
        FileProblems: Everything that is wrong with it, or that does not fit the robot.
    """
    data, marks = load_marked(paths.find_or_file("bridges", given))
    settings = check_bridge(data, marks)
    problems = list(_misfits(settings, marks, robot))
    if problems:
        raise FileProblems(problems)
    rest = _rest(settings, robot)
    grippers = _each(settings.grippers, robot.sides)
    fingers = {side: _fingers(grippers[side], robot, side) for side in robot.sides}
    for side in robot.sides:
        if (fingers[side].ends[:, 0] == fingers[side].ends[:, 1]).any():
            place = ("grippers", side if side in settings.grippers else EACH)
            raise FileProblems([marks.problem(place, "out-of-range", "open and closed are the same", key=True)])
    return Bridge(
        file=marks.file,
        settings=settings,
        cameras=_each(settings.cameras, robot.cameras),
        joints=tuple(entry if entry.joints else entry.model_copy(update={"joints": rest}) for entry in settings.joints),
        grippers={side: grippers[side].model_copy(update={"joints": fingers[side].names}) for side in robot.sides},
        fingers=fingers,
    )


def _fingers(entry: GripperCommands, robot: RobotDescription, side: Side) -> FingerJoints:
    """The joints of a gripper, with the ends that the file gives them."""
    own = fingers_of(robot, side)
    names = entry.joints or own.names
    known = dict(zip(own.names, own.ends, strict=True))
    ends = np.array([known.get(name, (0.0, own.opening_m / len(names))) for name in names], float)
    for column, given in enumerate((entry.closed, entry.open)):
        ends[:, column] = ends[:, column] if given is None else given
    return FingerJoints(names, ends, own.opening_m)


def joint_names(robot: RobotDescription) -> tuple[str, ...]:
    """The joints of torso and arms that can be commanded."""
    arms = (name for side in robot.sides for name in robot.arm_joints[side])
    return (*filter(None, robot.torso_joints), *arms)


def _rest(settings: BridgeFile, robot: RobotDescription) -> tuple[str, ...]:
    """The joints that no entry names."""
    taken = {name for entry in settings.joints for name in entry.joints or ()}
    return tuple(name for name in joint_names(robot) if name not in taken)


T = TypeVar("T", bound=Record)


def _each(entries: Mapping[str, T], names: Iterable[str]) -> dict[str, T]:
    """The entry of each name, its own or that of "*", with {name} filled in."""
    found: dict[str, T] = {}
    for name in names:
        if name in entries:
            found[name] = entries[name]
        elif EACH in entries:
            every = entries[EACH]
            texts = {key: value.replace("{name}", name) for key, value in every if isinstance(value, str)}
            found[name] = every.model_copy(update=texts)
    return found


def _misfits(settings: BridgeFile, marks: SourceMarks, robot: RobotDescription) -> Iterator[Problem]:
    """What the file names and the robot does not have, and what would be commanded twice."""
    whose = f" of the robot {robot.name}"
    for key, entries, known in (
        ("cameras", settings.cameras, tuple(robot.cameras)),
        ("grippers", settings.grippers, robot.sides),
    ):
        for name in entries:
            if name not in (*known, EACH):
                yield marks.unknown((key, name), key.removesuffix("s"), name, known, key=True, whose=whose)
    taken: dict[str, int] = {}
    for i, entry in enumerate(settings.joints):
        for k, name in enumerate(entry.joints or ()):
            if name not in joint_names(robot):
                yield marks.unknown(("joints", i, "joints", k), "joint", name, joint_names(robot), whose=whose)
            elif name in taken:
                yield marks.problem(
                    ("joints", i, "joints", k), "invalid-value", f"{name} is commanded by entry {taken[name]} already"
                )
            taken.setdefault(name, i)
    if open_ends := [i for i, entry in enumerate(settings.joints) if entry.joints is None][1:]:
        yield marks.problem(
            ("joints", open_ends[0]), "missing-key", "only one entry can be without 'joints': it has the rest"
        )
    if (rest := _rest(settings, robot)) and all(entry.joints for entry in settings.joints):
        yield marks.problem(
            ("joints",),
            "missing-key",
            f"no controller has {', '.join(rest)}: name them, or leave 'joints' out of one entry",
        )
    for side in robot.sides:
        controller = settings.grippers.get(side) or settings.grippers.get(EACH)
        if controller is None:
            yield marks.problem(
                ("grippers",), "missing-key", f"the gripper {side!r} of the {robot.name} has no controller"
            )
        elif not controller.joints and not robot.finger_joints[side]:
            place = ("grippers", side if side in settings.grippers else EACH)
            message = f"the file of the {robot.name} names no joints of its {side} gripper: give 'joints'"
            yield marks.problem(place, "missing-key", message, key=True)
    if "head" in robot.cameras and "head" not in settings.cameras and EACH not in settings.cameras:
        yield marks.problem(
            ("cameras",), "missing-key", "the camera 'head' has no topics: it is what things are found with"
        )
