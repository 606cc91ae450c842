"""How a remote policy is spoken to, from YAML: names and sizes on the wire, the order and units of numbers, timeouts.

The files are `policies/*.yaml`; docs/policy_servers.md explains every key.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextvars import ContextVar
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Discriminator, Field, PrivateAttr, Tag, model_validator
from pydantic_core import PydanticKnownError

from mpvi_bt.executive.remote.dataset_rate import dataset_rate
from mpvi_bt.executive.remote.joint_dialects import BaseVelocity, Dialect, joint_dialect
from mpvi_bt.executive.remote.prompts import check_prompts
from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import FileProblems, UserError, shown
from mpvi_bt.ground.file_kinds import expect
from mpvi_bt.ground.marked_yaml import Record, SourceMarks, load_marked, validate_data
from mpvi_bt.ground.robot.action_layout import ActionKind
from mpvi_bt.ground.robot.action_rows import LEAST_HZ, MOST_HZ
from mpvi_bt.ground.robot.default_robot import DEFAULT_ROBOT
from mpvi_bt.ground.robot.robots import robot_named

Felt = Literal[
    "base_pose", "base_velocity", "torso", "arm_left", "arm_right", "arm_velocity_left", "arm_velocity_right",
    "gripper_width_left", "gripper_width_right", "gripper_command_left", "gripper_command_right",
    "hand_position_left", "hand_position_right", "hand_quaternion_left", "hand_quaternion_right",
]  # fmt: skip
Commanded = Literal[
    "base_velocity", "torso", "arm_left", "gripper_command_left", "arm_right", "gripper_command_right"
]  # fmt: skip
_SIZES = {"base": 3, "gripper": 1, "hand_position": 3, "hand_quaternion": 4}
_ROBOT: ContextVar[str] = ContextVar("robot", default=DEFAULT_ROBOT)  # of the settings that are being checked
MOST_NUMBERS = 4096  # of a vector

Index = Annotated[int, Field(strict=True, ge=0, lt=MOST_NUMBERS)]
Number = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-1e6, le=1e6)]
Whole = Annotated[int, Field(strict=True, ge=-(2**63), lt=2**63)]
Truth = Annotated[bool, Field(strict=True)]
Pixels = Annotated[int, Field(strict=True, ge=1, le=2048)]
Rate = Annotated[float, Field(strict=True, ge=LEAST_HZ, le=MOST_HZ, allow_inf_nan=False)]
Seconds = Annotated[float, Field(strict=True, gt=0, le=3600, allow_inf_nan=False)]


def _key(given: str) -> str:
    if not 1 <= len(given) <= 200 or "" in given.split("."):
        raise ValueError(f"{shown(given)} is no key: 1 to 200 characters, with names before, after and between dots")
    return given


def _camera(given: str) -> str:
    known = robot_named(_ROBOT.get()).cameras
    if given not in known:
        raise PydanticKnownError("literal_error", {"expected": " or ".join(map(repr, known))})
    return given


# Which member of a union is meant, so that only what is wrong with that one is told.
def _one_or_all(given: Any) -> str:
    return "all" if isinstance(given, list | tuple) else "one"


def _kind(given: Any) -> str:
    if isinstance(given, list | tuple):
        return "wholes" if all(type(item) is int for item in given) else "numbers"
    return {bool: "truth", int: "whole", str: "text"}.get(type(given), "number")


Key = Annotated[str, AfterValidator(_key)]
CameraName = Annotated[str, AfterValidator(_camera)]
Indices = Annotated[Annotated[Index, Tag("one")] | Annotated[tuple[Index, ...], Tag("all")], Discriminator(_one_or_all)]
Numbers = Annotated[
    Annotated[Number, Tag("one")] | Annotated[tuple[Number, ...], Tag("all")], Discriminator(_one_or_all)
]
Constant = Annotated[
    Annotated[Truth, Tag("truth")]
    | Annotated[Whole, Tag("whole")]
    | Annotated[Number, Tag("number")]
    | Annotated[str, Tag("text")]
    | Annotated[tuple[Whole, ...], Tag("wholes")]
    | Annotated[tuple[Number, ...], Tag("numbers")],
    Discriminator(_kind),
]


def size_of(part: str) -> int:
    """How many numbers a part of the state or of the action has, of the robot whose settings are being checked."""
    robot = robot_named(_ROBOT.get())
    if part == "torso":
        return len(robot.torso_joints)
    if part.startswith("arm"):
        arms = robot.arm_joints
        return len(arms.get("left" if part.endswith("left") else "right", next(iter(arms.values()), ())))
    return next(n for name, n in _SIZES.items() if part.startswith(name))


class PartPlace(Record):
    """A part of ours and its place among their numbers: ours = scale * theirs + offset.

    Attributes:
        part: Its name.
        at: Index of its first number among theirs, or the index of each.
        scale: One for all its numbers, or one for each; -1 turns a sign about.
        offset: Likewise.
    """

    _size: int = PrivateAttr(0)
    part: str
    at: Indices
    scale: Numbers = 1.0
    offset: Numbers = 0.0

    @model_validator(mode="after")
    def _fits(self) -> PartPlace:
        size = self._size = size_of(self.part)
        for name in ("at", "scale", "offset"):
            value = getattr(self, name)
            if isinstance(value, tuple) and len(value) != size:
                raise ValueError(f"{self.part} has {size} numbers, {name!r} has {len(value)}")
        if 0 in (self.scale if isinstance(self.scale, tuple) else (self.scale,)):
            raise ValueError("a scale of 0 would lose the number")
        return self

    @property
    def indices(self) -> tuple[int, ...]:
        """Where each of its numbers stands among theirs."""
        return self.at if isinstance(self.at, tuple) else tuple(range(self.at, self.at + self._size))


class FeltPiece(PartPlace):
    """A part of what the robot feels.

    Attributes:
        part: As in docs/observations.md; `hand_position` (3) and `hand_quaternion` (4, wxyz) are those of the point
            between the fingers, in the base frame.
        function: Sent instead of the angle.
    """

    part: Felt
    function: Literal["sin", "cos"] | None = None


class CommandedPiece(PartPlace):
    """A part of the action."""

    part: Commanded


def _check_places(pieces: tuple[PartPlace, ...], size: int | None) -> None:
    taken: set[int] = set()
    for i, name in _places(pieces):
        if size is not None and i >= size:
            raise ValueError(f"{name} would stand at {i}, but there are {size} numbers, 0 to {size - 1}")
        if i in taken:
            raise ValueError(f"{name} would stand at {i}, where another number stands")
        taken.add(i)


def _places(pieces: tuple[PartPlace, ...]) -> Iterator[tuple[int, str]]:
    for piece in pieces:
        for i in piece.indices:
            yield i, piece.part


class Vector(Record):
    """Numbers that go under one key: parts of ours, or those of a dialect's robot.

    Attributes:
        parts: What is in it; the rest is 0.
        dialect: Whose numbers it has in place of parts.
        base_velocity: Of a dialect: the frame of the base's velocity; None: as the evaluator of that year.
        size: How many numbers; by default as many as the parts need, or the dialect has.
        dtype: Of the array.
    """

    parts: Annotated[tuple[FeltPiece, ...], Field(min_length=1)] | None = None
    dialect: Dialect | None = None
    base_velocity: BaseVelocity | None = None
    size: Annotated[int, Field(strict=True, ge=1, le=MOST_NUMBERS)] | None = None
    dtype: Literal["float32", "float64"] = "float32"

    @model_validator(mode="after")
    def _fits(self) -> Vector:
        if (self.parts is None) == (self.dialect is None):
            raise ValueError(
                "say what is in it: either by 'parts', which are ours, or by 'dialect', which is BEHAVIOR's"
            )
        if self.dialect is None and self.base_velocity is not None:
            raise ValueError("'base_velocity' is of a dialect; a part has the name base_velocity, too")
        if self.dialect is not None and self.size not in (None, size := joint_dialect(self.dialect).state_size):
            raise ValueError(f"{self.dialect} has {size} numbers, not {self.size}")
        _check_places(self.parts or (), self.size)
        return self

    @property
    def length(self) -> int:
        """How many numbers."""
        if self.dialect is not None:
            return joint_dialect(self.dialect).state_size
        return self.size or 1 + max(i for piece in self.parts or () for i in piece.indices)


class Image(Record):
    """A picture.

    Attributes:
        camera: Whose.
        show: "rgb" or "rgba" (uint8), or "depth" (float32 [m], 0 where nothing is seen), or "depth_linear", which is
            BEHAVIOR's: inf there.
        size: Height and width [px] that it is scaled to; by default it is sent as rendered.
        fit: Where those have another shape: "pad" with zeros, as openpi does, or "crop" what is too much at the sides.
        layout: Order of its axes.
    """

    camera: CameraName
    show: Literal["rgb", "rgba", "depth", "depth_linear"] = "rgb"
    size: Annotated[tuple[Pixels, ...], Field(min_length=2, max_length=2)] | None = None
    fit: Literal["pad", "crop"] = "pad"
    layout: Literal["hwc", "chw"] = "hwc"


class Observation(Record):
    """The server's observation, by its own keys; a "." in a key goes one mapping deeper.

    Attributes:
        prompt: Key of the prompt; None: the server has one of its own.
        prompts: File of whole tasks' prompts, of which the task's is sent in place of every subtask's (`prompts`).
        images: Pictures.
        state: What the robot feels.
        camera_poses: Key of BEHAVIOR's `cam_rel_poses`.
        task_id: Key of BEHAVIOR's number of the task.
        constants: Sent as they are, a list as an array.
        batched: Whether every array has a leading dimension of 1, as BEHAVIOR has it from 3.9.3 on.
    """

    prompt: Key | None = "prompt"
    prompts: Annotated[str, Field(min_length=1, max_length=4096)] | None = None
    images: dict[Key, Image] = {}
    state: dict[Key, Vector] = {}
    camera_poses: Key | None = None
    task_id: Key | None = None
    constants: dict[Key, Constant] = {}
    batched: Truth = False

    @model_validator(mode="after")
    def _keys_differ(self) -> Observation:
        if self.prompts is not None and self.prompt is None:
            raise ValueError("'prompts' are given, and 'prompt' has no key to send one by")
        keys = [key for key in (self.prompt, self.camera_poses, self.task_id) if key is not None]
        keys += [*self.images, *self.state, *self.constants]
        for key in keys:
            if keys.count(key) > 1:
                raise ValueError(f"the key {key!r} is used twice")
            for inner in keys:
                if inner.startswith(f"{key}."):
                    raise ValueError(f"{key!r} cannot hold {inner!r} too")
        return self

    @property
    def cameras(self) -> tuple[str, ...]:
        """Cameras whose pictures are sent."""
        return tuple(sorted({image.camera for image in self.images.values()}))


class Action(Record):
    """What the server answers.

    Attributes:
        key: Of the array, (H, size) or (size,).
        size: Numbers of one action; None: as many as the robot's own has.
        parts: Where ours are among them; by default they are ours. A part that is left out is held as it was when
            the policy was reset; the base stands still.
        dialect: Whose numbers they are in place of parts.
    """

    key: Key = "actions"
    size: Annotated[int, Field(strict=True, ge=1, le=MOST_NUMBERS)] | None = None
    parts: tuple[CommandedPiece, ...] = ()
    dialect: Dialect | None = None

    @model_validator(mode="after")
    def _fits(self) -> Action:
        if self.dialect is not None and (
            self.parts or self.size not in (None, joint_dialect(self.dialect).action_size)
        ):
            size = joint_dialect(self.dialect).action_size
            raise ValueError(f"{self.dialect} says what all of its {size} numbers are: no 'parts' beside it")
        ours = robot_named(_ROBOT.get()).layout.size if self.parts or self.size else None
        if not self.parts and self.size not in (None, ours):
            raise ValueError(f"{self.size} numbers are not ours, which are {ours}: say in 'parts' what they are")
        names = [piece.part for piece in self.parts]
        if again := next((name for name in names if names.count(name) > 1), None):
            raise ValueError(f"{again} is commanded twice")
        _check_places(self.parts, self.size or ours)
        return self

    @property
    def told_size(self) -> int | None:
        """How many numbers the server answers; None: as many as the robot's own action has."""
        return self.size if self.dialect is None else joint_dialect(self.dialect).action_size


class DialectSettings(Record):
    """All of a file.

    Attributes:
        about: One line for a person.
        robot: Name or file of the robot whose parts and cameras they name; None: the default robot's.
        observation: None: the whole observation, as `mpvi serve` takes it.
        action: How the answer is read.
        rate_hz: Rows a second; None: the server says, or nobody does.
        dataset: Folder of a dataset of LeRobot's that says it, where `rate_hz` does not.
        actions: What the joints in a row are; None: the server says, or they are absolute.
        reset_message: Whether {"reset": True}, which gets no answer, is sent at a handoff (BEHAVIOR's servers want it;
            openpi's break on it).
        request_chunk: How many actions to ask for with BEHAVIOR's `__action_chunk_size__`; None: it is not sent.
        connect_s: How long a server that is not there yet is waited for [wall clock].
        answer_s: How long one answer is waited for, lost connections and all.
        tries: How often a lost connection is made anew for one answer.
        max_mb: The largest message that is taken from the server [MiB].
        checkpoint: Folder with a copy of a checkpoint's JSON files, where LeRobot's server has another one.
        device: Where a checkpoint of LeRobot's runs, such as "cpu"; None: where it was trained, if that is there.
    """

    about: Annotated[str, Field(min_length=1, max_length=200)] = "a remote policy"
    robot: Annotated[str, Field(min_length=1, max_length=4096)] | None = None
    observation: Observation | None = None
    action: Action = Action()
    rate_hz: Rate | None = None
    dataset: Annotated[str, Field(min_length=1, max_length=4096)] | None = None
    actions: ActionKind | None = None
    reset_message: Truth = False
    request_chunk: Annotated[int, Field(strict=True, ge=2, le=1000)] | None = None
    connect_s: Seconds = 30.0
    answer_s: Seconds = 120.0
    tries: Annotated[int, Field(strict=True, ge=0, le=100)] = 3
    max_mb: Annotated[int, Field(strict=True, ge=1, le=64)] = 16
    checkpoint: Annotated[str, Field(min_length=1, max_length=4096)] | None = None
    device: Annotated[str, Field(min_length=1, max_length=40)] | None = None

    @property
    def rate_from(self) -> str:
        """Who says the rate, for a person."""
        return "the settings" if self.dataset is None else f"the dataset {self.dataset}"

    @property
    def known_cameras(self) -> tuple[str, ...]:
        """Every camera of the robot."""
        return tuple(robot_named(self.robot or DEFAULT_ROBOT).cameras)

    @property
    def cameras(self) -> tuple[str, ...]:
        """Cameras that the server may be sent pictures of."""
        return self.known_cameras if self.observation is None else self.observation.cameras


def load_settings(given: str) -> DialectSettings:
    """Settings by the name of a file in `policies/`, such as "openpi_comet", or by path.

    Raises:
        UserError: There is none, with the nearest name.
        FileProblems: Everything that is wrong with it.
    """
    return check_settings(*load_marked(paths.find_or_file("policies", given)))


def _with_rate(settings: DialectSettings, marks: SourceMarks) -> DialectSettings:
    """The settings with their dataset's rate. A relative folder is looked for from theirs on. Raises FileProblems."""
    if settings.dataset is None:
        return settings
    try:
        rate_hz = dataset_rate(Path(marks.file).parent / settings.dataset)
    except UserError as error:
        raise FileProblems([marks.problem(("dataset",), "invalid-value", str(error))]) from None
    if settings.rate_hz not in (None, rate_hz):
        said = f"{rate_hz:g} rows a second, and 'rate_hz' says {settings.rate_hz:g}: leave one of the two out"
        raise FileProblems([marks.problem(("dataset",), "invalid-value", f"{settings.dataset}: {said}")])
    return settings.model_copy(update={"rate_hz": rate_hz})


def _validated(data: Any, marks: SourceMarks) -> DialectSettings:
    """The settings, of the robot that they name. Raises FileProblems."""
    robot = data.get("robot") if isinstance(data, dict) else None
    if not isinstance(robot, str) or not robot:
        return validate_data(data, marks, DialectSettings)
    try:
        robot_named(robot)
    except UserError as error:
        raise FileProblems([marks.problem(("robot",), "unknown-value", str(error))]) from None
    token = _ROBOT.set(robot)
    try:
        return validate_data(data, marks, DialectSettings)
    finally:
        _ROBOT.reset(token)


def check_settings(data: Any, marks: SourceMarks) -> DialectSettings:
    """As `load_settings`, of data that is already loaded. A file of prompts is looked for from their folder on."""
    expect("policy", data, marks)
    settings = _with_rate(_validated(data, marks), marks)
    if settings.observation is None or settings.observation.prompts is None:
        return settings
    file = check_prompts(settings.observation.prompts, marks, ("observation", "prompts"))
    observation = settings.observation.model_copy(update={"prompts": str(file)})
    return settings.model_copy(update={"observation": observation})
