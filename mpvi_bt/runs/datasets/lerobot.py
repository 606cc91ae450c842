"""Makes a LeRobot dataset of demonstrations.

LeRobot's own writer is not used: it pins a torch that our other extras cannot have. Formats as documented by LeRobot:
tables in Parquet, pictures in MP4, and what they are in meta/.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.robot.action_layout import ActionKind
from mpvi_bt.ground.writing import unwritable
from mpvi_bt.runs.datasets import normalization as statistics
from mpvi_bt.runs.datasets.behavior_dataset import BaseVelocity, BehaviorContent, BehaviorV21
from mpvi_bt.runs.datasets.columns import Content, OwnContent, features
from mpvi_bt.runs.datasets.demonstrations import Demonstrated, check_demonstrations
from mpvi_bt.runs.datasets.episode_videos import place_video
from mpvi_bt.runs.datasets.layouts import V21, V30, DatasetEpisode, Layout
from mpvi_bt.runs.datasets.parquet import require_pandas, write_json

Format = Literal["v3.0", "v2.1"]
Tell = Callable[[str, int, Demonstrated], None]


@dataclass(frozen=True)
class DatasetForm:
    """What a dataset is to be.

    Attributes:
        format: LeRobot's version of it.
        like: Whose keys and numbers it has; None: our own.
        prompt: What a row's task is: what the whole episode is told, or what the robot is at.
        size: Height and width [px] that all pictures are scaled to; None: as recorded.
        base_velocity: What BEHAVIOR's numbers say of it, see `BehaviorContent`.
        actions: What joints in our own actions are.
    """

    format: Format = "v3.0"
    like: Literal["behavior"] | None = None
    prompt: Literal["instruction", "subtask"] = "instruction"
    size: int | None = None
    base_velocity: BaseVelocity = "zero"
    actions: ActionKind = "absolute"


def write_dataset(
    episodes: Sequence[Demonstrated], out: Path, form: DatasetForm = DatasetForm(), tell: Tell = lambda *told: None
) -> None:
    """Write a dataset once all its episodes were found whole; a killed run leaves nothing at `out`.

    Args:
        episodes: In their order. All are of one robot, with the same rate and, unless they are scaled, cameras.
        out: Its folder, which must not exist yet.
        form: What it is to be.
        tell: Is told what was done ("checked" or "wrote"), and the number and the episode that it was done to.

    Raises:
        UserError: There are no episodes, they do not go together or cannot be told so, or `out` exists or cannot be
            written.
        FileProblems: Everything that is wrong with the episodes' files.
        BackendError: The disk is full or broken.
    """
    require_pandas()
    _check_alike(episodes, form)
    own = form.like is None
    if not own and form.actions != "absolute":
        raise UserError(f"--actions {form.actions} is of our own keys; BEHAVIOR's joints are absolute")
    robot = episodes[0].about.config.robot
    content = OwnContent(robot, form.actions) if own else BehaviorContent(form.base_velocity)
    for episode in episodes:
        content.check(episode)
    if out.exists():
        raise UserError(f"{out}: exists; choose another folder")
    layout = V30 if form.format == "v3.0" else V21 if own else BehaviorV21
    partial = out.with_name(f".{out.name}.{os.getpid()}.tmp")
    placed = layout(partial, episodes, form.prompt == "subtask")
    check_demonstrations(episodes, lambda number, episode: tell("checked", number, episode))
    try:
        partial.mkdir(parents=True)
        _write(episodes, content, placed, form, tell)
        partial.replace(out)
    except OSError as error:
        raise unwritable(out, error) from None
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def _check_alike(episodes: Sequence[Demonstrated], form: DatasetForm) -> None:
    if not episodes:
        raise UserError("no demonstrations to make a dataset of: none reached its goal (--all takes the others, too)")
    first = episodes[0]
    for episode in episodes:
        about, other = episode.about, first.about
        for what, its, others in (
            ("robot", about.config.robot, other.config.robot),
            ("fps", about.fps, other.fps),
            ("cameras", sorted(about.cameras), sorted(other.cameras)),
        ):
            if its != others:
                raise UserError(f"{episode.folder}: {what} {its}, but {first.folder}: {others}")
        if form.size is None and about.cameras != other.cameras:
            raise UserError(
                f"{episode.folder}: pictures of {about.cameras}, but {first.folder}: {other.cameras}; "
                "--size scales all alike"
            )


def _write(episodes: Sequence[Demonstrated], content: Content, layout: Layout, form: DatasetForm, tell: Tell) -> None:
    first = episodes[0].about
    size = None if form.size is None else (form.size, form.size)
    entries: list[DatasetEpisode] = []
    histograms: dict[str, list[Any]] = {content.picture(camera): [] for camera in first.cameras}
    begin = 0
    for n, (number, episode) in enumerate(zip(layout.numbers, episodes, strict=True)):
        length = episode.about.frames
        table = content.columns(episode)
        table["timestamp"] = (np.arange(length) / first.fps).astype(content.time)
        table |= layout.columns(episode, number, begin)
        table |= {key: np.zeros((length, 0), np.float32) for key in layout.empty}
        for camera in first.cameras:
            key = content.picture(camera)
            target = layout.place("video_path", number, video_key=key)
            histograms[key].append(place_video(episode, camera, size, target))
        found = statistics.of_rows([table])
        found |= {key: statistics.of_pictures(each[-1:], length) for key, each in histograms.items()}
        entry = DatasetEpisode(episode, number, list(dict.fromkeys(layout.tasks_of(episode))), table, found)
        layout.add(entry)
        entries.append(entry)
        begin += length
        tell("wrote", n, episode)
    together = statistics.of_rows([entry.table for entry in entries])
    together |= {key: statistics.of_pictures(each, begin) for key, each in histograms.items()}
    layout.finish(entries, together, list(histograms))
    sizes = {camera: recorded if size is None else size for camera, recorded in first.cameras.items()}
    write_json(
        {
            **layout.info,
            "robot_type": content.robot_type,
            "total_episodes": len(episodes),
            "total_frames": begin,
            **layout.totals(list(histograms)),
            "fps": first.fps,
            "splits": {"train": f"0:{len(episodes)}"},
            "video_path": layout.info["video_path"] if first.cameras else None,
            "features": features(content, sizes, first.fps, layout.counters, layout.empty),
        },
        layout.out / "meta/info.json",
    )
