"""A dataset as BEHAVIOR's demonstrations of 2025 are: their keys, their numbers and their folders.

Sources: the card of `behavior-1k/2025-challenge-demos`, `PROPRIOCEPTION_INDICES` of OmniGibson's `eval_utils.py`, and
what the loader of openpi-comet (`behavior/learning/datas/dataset.py`) asks of a dataset.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.ground.errors import UnknownName, UserError
from mpvi_bt.ground.geometry.linear_algebra import norm
from mpvi_bt.ground.human import human_stats
from mpvi_bt.ground.robot.protocol import CONTROL_HZ
from mpvi_bt.hands.behavior_robot.behavior_layout import (
    ACTION_SIZE,
    BODY,
    FIELDS,
    SIZE,
    TYPE,
    action_for,
    camera_poses,
    encoded,
)
from mpvi_bt.runs.datasets.columns import Feature, vector
from mpvi_bt.runs.datasets.demonstrations import Demonstrated
from mpvi_bt.runs.datasets.layouts import V21, DatasetEpisode, prompts
from mpvi_bt.runs.datasets.parquet import Table, write_json
from mpvi_bt.runs.recording.demonstration_recorder import felt_again

BaseVelocity = Literal["zero", "world"]


class BehaviorContent:
    """256 numbers of proprioception, 21 of where cameras are, base actions in -1..1, at 30 Hz.

    Args:
        base_velocity: What its base velocity is told to be: "zero", as in its demonstrations, whose frames are restored
            states, or "world", as its evaluator tells it.
    """

    robot_type: str = TYPE
    channels: str = "rgb"
    time: Literal["float32", "float64"] = "float64"
    _CAMERAS: Mapping[str, str] = {"head": "head", "left": "left_wrist", "right": "right_wrist"}

    def __init__(self, base_velocity: BaseVelocity) -> None:
        self._base_velocity = base_velocity

    def picture(self, camera: str) -> str:
        """By what is seen, and by whom."""
        return f"observation.images.rgb.{self._CAMERAS[camera]}"

    def vectors(self) -> dict[str, Feature]:
        """Numbers without names, as there."""
        sizes = {
            "observation.state": SIZE["behavior-2025"],
            "observation.cam_rel_poses": 7 * len(self._CAMERAS),
            "action": ACTION_SIZE,
        }
        return {key: vector(size, None) for key, size in sizes.items()}

    def check(self, episode: Demonstrated) -> None:
        """Raise UserError if robot, rate or recorded data do not fit BEHAVIOR's layout."""
        where, about = episode.folder, episode.about
        if (robot := about.config.robot) != BODY:
            raise UserError(
                f"{where}: robot {robot}; BEHAVIOR's numbers are an {TYPE}'s joints: record with --robot {BODY}"
            )
        if about.version < 2:
            raise UserError(
                f"{where}: recorded by an older mpvi_bt, without joint velocities and camera poses, which BEHAVIOR's "
                "numbers tell: record it again"
            )
        if about.fps != CONTROL_HZ:
            raise UserError(f"{where}: {about.fps} rows a second; BEHAVIOR has 30: record with --demonstration-fps 30")
        if missing := self._CAMERAS.keys() - about.cameras.keys():
            raise UserError(f"{where}: no pictures of {', '.join(sorted(missing))}; BEHAVIOR has head, left and right")

    def columns(self, episode: Demonstrated) -> dict[str, NDArray[Any]]:
        """The episode's data as BEHAVIOR's robot reports it; the first base pose is the origin."""
        frames = {key: array.astype(float) for key, array in episode.frames.items() if array.dtype.kind == "f"}
        state, pose, velocity = (frames[key] for key in ("state", "base_pose", "arm_velocity"))
        robot, steps = episode.about.config.robot, range(episode.about.frames)
        felt = (felt_again(state[n], pose[n], velocity[n], robot) for n in steps)
        numbers = [encoded(body, "behavior-2025", self._base_velocity, pose[0]) for body in felt]
        cameras = [
            camera_poses({camera: frames[f"T_base_camera/{camera}"][n] for camera in self._CAMERAS}) for n in steps
        ]
        return {
            "observation.state": np.array(numbers, np.float32),
            "observation.cam_rel_poses": np.array(cameras, np.float32),
            "action": action_for(frames["action"]).astype(np.float32),
        }


class BehaviorV21(V21):
    """v2.1 as BEHAVIOR has it: a folder a task, by its number there, and episode n of task k is number 10000 k + n.

    Subtasks are told in its annotations and, where they are to be the prompts, in the files that openpi-comet reads
    those from ("orchestrators").
    """

    info = {
        **V21.info,
        "chunks_size": 10_000,
        "data_path": "data/task-{episode_chunk:04d}/episode_{episode_index:08d}.parquet",
        "video_path": "videos/task-{episode_chunk:04d}/{video_key}/episode_{episode_index:08d}.mp4",
        "metainfo_path": "meta/episodes/task-{episode_chunk:04d}/episode_{episode_index:08d}.json",
        "annotation_path": "annotations/task-{episode_chunk:04d}/episode_{episode_index:08d}.json",
    }

    empty = ("observation.task_info",)  # BEHAVIOR's loader wants it there, to take it away

    def __init__(self, out: Path, episodes: Sequence[Demonstrated], by_subtask: bool) -> None:
        super().__init__(out, episodes, False)
        self._orchestrated = by_subtask
        self._tasks: dict[int, tuple[str, str]] = {}
        before: Counter[int] = Counter()
        numbers = []
        for episode in episodes:
            name, told = episode.about.problem or episode.about.task, episode.about.instruction
            task = task_id(name, episode.folder)
            if (other := self._tasks.setdefault(task, (name, told))[1]) != told:
                raise UserError(f"{episode.folder}: told {told!r}; BEHAVIOR has one text a task, here {other!r}")
            numbers.append(self.info["chunks_size"] * task + before[task])
            before[task] += 1
        self.numbers = numbers

    def columns(self, episode: Demonstrated, number: int, begin: int) -> dict[str, NDArray[Any]]:
        """As ever, but that a task's number is BEHAVIOR's."""
        columns = super().columns(episode, number, begin)
        return columns | {"task_index": columns["episode_index"] // self.info["chunks_size"]}

    def add(self, entry: DatasetEpisode) -> None:
        """Write an episode's rows, what was recorded of it, and its subtasks."""
        super().add(entry)
        about, runs = entry.episode.about, list(runs_of(entry.episode))
        name = self._tasks[entry.number // self.info["chunks_size"]][0]
        write_json({"num_samples": about.frames, "task": about.task}, self.place("metainfo_path", entry.number))
        annotation = self.place("annotation_path", entry.number)
        write_json(_annotation(name, about.frames, runs), annotation)
        if not self._orchestrated:
            return
        folder = self.out / "orchestrators" / annotation.parent.name / annotation.stem
        told = {"cot_task_description": about.instruction, "cot_subtask_description_list": [run[0] for run in runs]}
        write_json(told, folder / "task_annotated.json")
        for number, (prompt, begin, end) in enumerate(runs):
            texts = {"cot_subtask_description": prompt, "skill_description": prompt}
            write_json({**texts, "start_frame": begin, "end_frame": end}, folder / f"subtask_{number}_annotated.json")

    def told(self, entry: DatasetEpisode) -> dict[str, Any]:
        """A line of `episodes.jsonl`, with how far base and hands went."""
        return {**super().told(entry), **distances(entry.table)}

    def tasks_told(self) -> list[dict[str, Any]]:
        """The lines of `tasks.jsonl`, by BEHAVIOR's numbers and names."""
        told = sorted(self._tasks.items())
        return [{"task_index": number, "task_name": name, "task": text} for number, (name, text) in told]


def distances(table: Table) -> dict[str, float]:
    """How far base and hands went [m], as BEHAVIOR's `episodes.jsonl` tells: the hands in the base frame."""
    names = {"robot_pos": "distance_traveled", "eef_left_pos": "left_eef_displacement"}
    names |= {"eef_right_pos": "right_eef_displacement"}
    paths = {told: table["observation.state"][:, FIELDS["behavior-2025"][name]] for name, told in names.items()}
    return {told: round(float(norm(np.diff(path, axis=0)).sum()), 4) for told, path in paths.items()}


def runs_of(episode: Demonstrated) -> Iterator[tuple[str, int, int]]:
    """Subtasks in order, each with its first row and its end. Between subtasks, the instruction stands in."""
    at = episode.frames["subtask"]
    bounds = [0, *(np.flatnonzero(np.diff(at)) + 1).tolist(), len(at)]
    names = prompts(episode)
    for begin, end in pairwise(bounds):
        yield names[at[begin]], begin, end


def task_id(name: str, where: Path) -> int:
    """BEHAVIOR's number of a task. Raises UserError: it is none of its 50."""
    if name not in human_stats():
        raise UserError(f"{where}: {UnknownName('task', name, human_stats(), 'BEHAVIOR')}")
    return human_stats()[name].task_id


def _annotation(task: str, frames: int, runs: Sequence[tuple[str, int, int]]) -> dict[str, Any]:
    """What BEHAVIOR's annotators would have noted of an episode; our prompts are sentences, its skills 31 words."""
    skills = [
        {
            "skill_idx": number,
            "skill_id": [],
            "skill_description": [prompt],
            "object_id": [[]],
            "manipulating_object_id": [],
            "memory_prefix": [],
            "spatial_prefix": [],
            "frame_duration": [begin, end],
        }
        for number, (prompt, begin, end) in enumerate(runs)
    ]
    return {
        "task_name": task,
        "data_folder": "",
        "meta_data": {"task_duration": frames, "valid_duration": [0, frames]},
        "skill_annotation": skills,
        "primitive_annotation": [],
    }
