"""What a checkpoint of LeRobot's says of itself: its JSON files are read, neither lerobot nor torch is loaded."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mpvi_bt.executive.remote.dataset_rate import dataset_rate
from mpvi_bt.executive.remote.dialect_settings import DialectSettings
from mpvi_bt.executive.remote.task_settings import check_robot
from mpvi_bt.executive.remote.wire_mapping import MOST_ACTIONS
from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import UserError, shown
from mpvi_bt.ground.robot.action_layout import KINDS, ActionKind
from mpvi_bt.ground.robot.default_robot import DEFAULT_ROBOT
from mpvi_bt.ground.robot.robot_description import RobotDescription
from mpvi_bt.ground.robot.robots import ROBOTS, robot_named

CONFIG, PROCESSOR, TRAINING = "config.json", "policy_preprocessor.json", "train_config.json"
STATE, POSE, PICTURES = "observation.state", "observation.base_pose", "observation.images."  # of `mpvi dataset`
INFO = "meta/info.json"  # of a dataset
_MOST = 1 << 16  # numbers of a feature
_INSIDE = (".", "pretrained_model", "checkpoints/last/pretrained_model")  # where a folder of lerobot-train has them


@dataclass(frozen=True)
class LerobotCheckpoint:
    """A policy that LeRobot has saved.

    Attributes:
        folder: Where its files are.
        kind: LeRobot's name of its type, such as "act".
        pictures: Height and width [px] of each picture, by key.
        numbers: How many numbers it is given, by key.
        action_size: How many numbers one of its actions has.
        whole_chunks: Whether it answers a chunk at once. One that remembers observations, or averages its chunks, is
            asked for each row.
        rows: How many rows of a chunk are carried out.
        device: Where it was trained, such as "cuda".
        dataset: Folder of the dataset that it was trained on, if that is still there.
        fps: Rows a second of that dataset; None: not known.
        robot: Whose dataset it is; None: not known.
        actions: What the joints in that dataset's actions are; None: not said.
    """

    folder: Path
    kind: str
    pictures: Mapping[str, tuple[int, int]]
    numbers: Mapping[str, int]
    action_size: int
    whole_chunks: bool
    rows: int
    device: str
    dataset: Path | None = None
    fps: float | None = None
    robot: str | None = None
    actions: ActionKind | None = None


def read_checkpoint(given: Path, weights: bool = True) -> LerobotCheckpoint:
    """The checkpoint in a folder, or in what `lerobot-train` has written there.

    Args:
        given: The folder.
        weights: Whether its weights have to be there, too.

    Raises:
        UserError: There is none, or it cannot be run here.
    """
    folder = next((given / name for name in _INSIDE if (given / name / CONFIG).is_file()), None)
    if folder is None:
        raise UserError(f"{given}: no checkpoint of LeRobot's is there: a folder with {CONFIG} and model.safetensors")
    config = _json(folder / CONFIG)
    kind, inputs, outputs = config.get("type"), config.get("input_features"), config.get("output_features")
    if not isinstance(kind, str) or not isinstance(inputs, dict) or not isinstance(outputs, dict):
        said = "no policy of LeRobot's: 'type', 'input_features' and 'output_features' are wanted"
        raise UserError(f"{folder / CONFIG}: {said}")
    if weights and not (folder / "model.safetensors").is_file():
        raise UserError(f"{folder}: its weights, model.safetensors, are missing")
    if not (folder / PROCESSOR).is_file():
        said = "it was saved by a LeRobot before 0.4; LeRobot's migrate_policy_normalization makes a new one of it"
        raise UserError(f"{folder}: {PROCESSOR} is missing: {said}")
    sizes = {key: _shape(feature, key, folder) for key, feature in inputs.items()}
    pictures = {key: size[1:] for key, size in sizes.items() if inputs[key].get("type") == "VISUAL"}
    remembers = config.get("n_obs_steps", 1) != 1 or config.get("temporal_ensemble_coeff") is not None
    rows = config.get("n_action_steps", config.get("chunk_size", 1))
    if type(rows) is not int or not 1 <= rows <= MOST_ACTIONS:
        raise UserError(f"{folder / CONFIG}: n_action_steps: {shown(rows)} is given, 1 to {MOST_ACTIONS} are wanted")
    dataset, about = _dataset(folder)
    robot = about.get("robot_type")
    return LerobotCheckpoint(
        folder=folder,
        kind=kind,
        pictures={key: (height, width) for key, (height, width) in pictures.items()},
        numbers={key: size[0] for key, size in sizes.items() if key not in pictures},
        action_size=_shape(outputs.get("action"), "action", folder)[0],
        whole_chunks=not remembers,
        rows=rows,
        device=str(config.get("device") or "cpu"),
        dataset=dataset,
        fps=None if dataset is None else dataset_rate(dataset),
        robot=robot if isinstance(robot, str) else None,
        actions=None if dataset is None else _kind(about, dataset),
    )


def fitting_checkpoint(
    folder: Path, settings: DialectSettings, robot: str | None, weights: bool = True
) -> LerobotCheckpoint:
    """As `read_checkpoint`, checked by `check_fit`.

    Args:
        folder, weights: As `read_checkpoint` takes them.
        settings: What its features are.
        robot: Name or file of the robot; None: that of the settings, of its dataset, or the default one.
    """
    checkpoint = read_checkpoint(folder, weights)
    own = checkpoint.robot if checkpoint.robot in ROBOTS else None
    check_fit(checkpoint, settings, robot_named(robot or settings.robot or own or DEFAULT_ROBOT))
    return checkpoint


def rate_of(checkpoint: LerobotCheckpoint, settings: DialectSettings) -> tuple[float | None, str]:
    """Rows a second, of the settings or of the dataset that it was trained on (None: nobody says), and who says it."""
    own, fps = settings.rate_hz, checkpoint.fps
    if own is None:
        return fps, f"the dataset {checkpoint.dataset}"
    other = f"; the dataset {checkpoint.dataset} says {fps:g}" if fps not in (None, own) else ""
    return own, settings.rate_from + other


def _json(file: Path) -> dict[str, Any]:
    try:
        told = json.loads(file.read_bytes())
    except (OSError, ValueError, RecursionError) as error:
        raise UserError(f"{file}: cannot be read: {error}") from None
    if not isinstance(told, dict):
        raise UserError(f"{file}: {shown(told)} is no mapping")
    return told


def _shape(feature: Any, key: str, folder: Path) -> tuple[int, ...]:
    """(3, height, width) of a picture, (n,) of numbers."""
    kind, shape = (feature.get("type"), feature.get("shape")) if isinstance(feature, dict) else (None, None)
    if isinstance(shape, list) and shape and all(type(n) is int and 0 < n <= _MOST for n in shape):
        if kind == "VISUAL" and len(shape) == 3 and shape[0] == 3:
            return tuple(shape)
        if kind != "VISUAL" and len(shape) == 1:
            return tuple(shape)
    said = "(3, height, width)" if kind == "VISUAL" else "(n,)"
    raise UserError(f"{folder / CONFIG}: the feature {key!r} has the shape {shown(shape)}; {said} is wanted")


def _dataset(folder: Path) -> tuple[Path | None, dict[str, Any]]:
    """The dataset that it was trained on and its `info.json`, if both are still where the training found them."""
    if not (folder / TRAINING).is_file():
        return None, {}
    told = _json(folder / TRAINING).get("dataset")
    root = told.get("root") if isinstance(told, dict) else None
    if isinstance(root, str):
        for base in (Path(), *folder.absolute().parents):  # a relative one is from where it was trained
            if paths.is_file(info := base / root / INFO):
                return base / root, _json(info)
    return None, {}


def _kind(about: Mapping[str, Any], dataset: Path) -> ActionKind | None:
    """What joints in actions are, where `mpvi dataset --actions` has written it."""
    told: Any = about
    for key in ("features", "action", "info", "joints"):
        told = told.get(key) if isinstance(told, Mapping) else None
    if told is None or told in KINDS:
        return told
    raise UserError(f"{dataset / INFO}: features.action.info.joints is {shown(told)}, not one of {', '.join(KINDS)}")


def check_fit(checkpoint: LerobotCheckpoint, settings: DialectSettings, robot: RobotDescription) -> None:
    """Raise UserError if a checkpoint is of another robot, or wants or answers what this one does not have.

    Args:
        checkpoint: As read.
        settings: What is sent under its features' names; without `observation`, those of `mpvi dataset` are meant.
        robot: That is to be driven.
    """
    called, layout = f"the checkpoint {checkpoint.folder}", settings.observation
    theirs = settings.robot or checkpoint.robot
    info = checkpoint.dataset / INFO if checkpoint.dataset else None
    if theirs is None:
        training = checkpoint.folder / TRAINING
        lost = f"its dataset is not where {training} says" if training.is_file() else f"it has no {TRAINING}"
        why = f"{info} has no robot_type" if info else lost
        raise UserError(
            f"nobody says of which robot {called} is: {why}. If it is of the "
            f"{robot.name}, write `robot: {robot.name}` in a file of settings (--policy-settings)."
        )
    if _named(theirs) != robot.name:
        by = f" (robot_type of {info})" if info and not settings.robot else ""
        raise UserError(f"{called} is of the robot {theirs}, not of the {robot.name}: choose it with --robot{by}.")
    check_robot(settings.model_copy(update={"robot": robot.name}), robot)
    if layout is not None and layout.prompts is not None:
        raise UserError(f"{called} is told each subtask: its settings have no 'prompts', which are of servers.")
    wanting = f"{checkpoint.folder / CONFIG}: the checkpoint"
    instead = "say in a file of settings what goes there (--policy-settings, docs/lerobot.md)"
    sent = _sent(settings, robot)
    for key, wanted in checkpoint.numbers.items():
        if key not in sent:
            known = ", ".join(sent) or "none"
            raise UserError(
                f"{wanting} wants numbers as {key!r}, and of the {robot.name} are sent: {known}; {instead}."
            )
        if sent[key] != wanted:
            raise UserError(f"{wanting} wants {wanted} numbers as {key!r}; of the {robot.name} they are {sent[key]}.")
    pictures: Mapping[str, tuple[int, ...] | None]
    if layout is None:
        pictures = {PICTURES + camera: None for camera in robot.cameras}
    else:
        pictures = {key: image.size for key, image in layout.images.items() if image.show == "rgb"}
    for key, size in checkpoint.pictures.items():
        if key not in pictures:
            known = ", ".join(pictures) or "none"
            raise UserError(f"{wanting} wants pictures as {key!r}, and the {robot.name} has: {known}; {instead}.")
        if (given := pictures[key]) is not None and tuple(given) != size:
            raise UserError(f"{wanting} wants {key!r} of {size}, and the settings scale it to {tuple(given)}.")
    answered = settings.action.told_size or robot.layout.size
    if answered != checkpoint.action_size:
        raise UserError(
            f"{wanting} answers actions of {checkpoint.action_size} numbers; of the {robot.name} they are {answered}."
        )


def _sent(settings: DialectSettings, robot: RobotDescription) -> dict[str, int]:
    """How many numbers are sent by each key."""
    if (layout := settings.observation) is None:
        return {STATE: robot.layout.size, POSE: 3}
    cameras = {layout.camera_poses: 21} if layout.camera_poses else {}
    return {key: vector.length for key, vector in layout.state.items()} | cameras


def _named(robot: str) -> str:
    """The name of a robot that may be a file; as it is where there is none."""
    try:
        return robot_named(robot).name
    except UserError:
        return robot
