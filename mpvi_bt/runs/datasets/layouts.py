"""File layout of a dataset: paths, numbers of episodes and tasks, metadata.

LeRobot's v3.0 (lerobot 0.4 and newer) and its v2.1 (lerobot up to 0.3, openpi). Each episode has files of its own,
which both allow, so that no video is encoded twice.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.runs.datasets.demonstrations import Demonstrated
from mpvi_bt.runs.datasets.normalization import Statistics, written
from mpvi_bt.runs.datasets.parquet import write_index, write_json, write_lines, write_rows, write_table

FILES_A_CHUNK = 1000


@dataclass(frozen=True)
class DatasetEpisode:
    """An episode of a dataset.

    Attributes:
        episode: As it was recorded.
        number: Its own in the dataset.
        tasks: What its rows are told to do, each once.
        table: Its rows.
        statistics: Of its rows and pictures.
    """

    episode: Demonstrated
    number: int
    tasks: Sequence[str]
    table: Mapping[str, NDArray[Any]]
    statistics: Mapping[str, Statistics]


class Layout(ABC):
    """How a dataset is laid out.

    Args:
        out: Its folder.
        episodes: All of them, in their order.
        by_subtask: Whether a row's task is what the robot is at, and not what the whole episode is told.

    Attributes:
        info: What `info.json` says of the layout alone.
        counters: Keys of a row's whole numbers.
        empty: Keys of columns that hold nothing.
        tasks: What rows are told to do, by number.
        numbers: Those of the episodes.
    """

    info: Mapping[str, Any]
    counters: Sequence[str] = ("frame_index", "episode_index", "index", "task_index")
    empty: Sequence[str] = ()

    def __init__(self, out: Path, episodes: Sequence[Demonstrated], by_subtask: bool) -> None:
        self.out, self._by_subtask = out, by_subtask
        self.tasks = list(dict.fromkeys(task for episode in episodes for task in self.tasks_of(episode)))
        self.subtasks = list(dict.fromkeys(name for episode in episodes for name in episode.about.subtasks))
        self.numbers: Sequence[int] = range(len(episodes))

    def tasks_of(self, episode: Demonstrated) -> list[str]:
        """The task text of each subtask number."""
        return prompts(episode) if self._by_subtask else [episode.about.instruction] * len(episode.about.subtasks)

    def columns(self, episode: Demonstrated, number: int, begin: int) -> dict[str, NDArray[Any]]:
        """Whole numbers of an episode's rows, the first of which is the dataset's row `begin`."""
        steps, subtask = np.arange(episode.about.frames), episode.frames["subtask"]
        told = np.array([self.tasks.index(task) for task in self.tasks_of(episode)], np.int64)
        at = np.array([self.subtasks.index(name) for name in episode.about.subtasks], np.int64)
        every = {
            "frame_index": steps,
            "episode_index": np.full_like(steps, number),
            "index": begin + steps,
            "task_index": told[subtask],
            "subtask_index": at[subtask],
        }
        return {key: every[key] for key in self.counters}

    def add(self, entry: DatasetEpisode) -> None:
        """Write an episode's rows."""
        write_table(entry.table, self.place("data_path", entry.number))

    def totals(self, videos: Sequence[str]) -> dict[str, Any]:
        """What `info.json` counts besides episodes and frames."""
        return {"total_tasks": len(self.tasks)}

    @abstractmethod
    def place(self, template: str, number: int, **more: str) -> Path:
        """A file of an episode, by the key of its template in `info`."""

    @abstractmethod
    def finish(
        self, entries: Sequence[DatasetEpisode], statistics: Mapping[str, Statistics], videos: Sequence[str]
    ) -> None:
        """Write what is told of all episodes, but for `info.json`.

        Args:
            entries: All that were added.
            statistics: Of all of them together.
            videos: Keys of pictures.
        """


class V30(Layout):
    """LeRobot's v3.0."""

    info = {
        "codebase_version": "v3.0",
        "chunks_size": FILES_A_CHUNK,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "video_path": "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4",
    }
    counters = (*Layout.counters, "subtask_index")

    def place(self, template: str, number: int, **more: str) -> Path:
        """A file of an episode."""
        chunk, file = divmod(number, FILES_A_CHUNK)
        return self.out / self.info[template].format(chunk_index=chunk, file_index=file, **more)

    def finish(
        self, entries: Sequence[DatasetEpisode], statistics: Mapping[str, Statistics], videos: Sequence[str]
    ) -> None:
        """Tables of episodes, tasks and subtasks, and statistics."""
        meta = self.out / "meta"
        write_rows([self._row(entry, videos) for entry in entries], meta / "episodes/chunk-000/file-000.parquet")
        write_index(self.tasks, "task_index", meta / "tasks.parquet")
        write_index(self.subtasks, "subtask_index", meta / "subtasks.parquet")
        write_json(written(statistics), meta / "stats.json")

    def _row(self, entry: DatasetEpisode, videos: Sequence[str]) -> dict[str, Any]:
        begin, length = int(entry.table["index"][0]), entry.episode.about.frames
        chunk, file = divmod(entry.number, FILES_A_CHUNK)
        row: dict[str, Any] = {
            "episode_index": entry.number,
            "tasks": list(entry.tasks),
            "length": length,
            "data/chunk_index": chunk,
            "data/file_index": file,
            "dataset_from_index": begin,
            "dataset_to_index": begin + length,
            "meta/episodes/chunk_index": 0,
            "meta/episodes/file_index": 0,
        }
        for key in videos:
            row |= {f"videos/{key}/chunk_index": chunk, f"videos/{key}/file_index": file}
            row |= {f"videos/{key}/from_timestamp": 0.0, f"videos/{key}/to_timestamp": length / entry.episode.about.fps}
        for key, found in written(entry.statistics).items():
            row |= {f"stats/{key}/{name}": value for name, value in found.items()}
        return row


class V21(Layout):
    """LeRobot's v2.1, which knows no subtasks."""

    info = {
        "codebase_version": "v2.1",
        "chunks_size": FILES_A_CHUNK,
        "data_path": "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet",
        "video_path": "videos/chunk-{episode_chunk:03d}/{video_key}/episode_{episode_index:06d}.mp4",
    }

    def place(self, template: str, number: int, **more: str) -> Path:
        """A file of an episode."""
        chunk = number // self.info["chunks_size"]
        return self.out / self.info[template].format(episode_chunk=chunk, episode_index=number, **more)

    def finish(
        self, entries: Sequence[DatasetEpisode], statistics: Mapping[str, Statistics], videos: Sequence[str]
    ) -> None:
        """A line for each episode, with its own statistics, which loaders put together, and for each task."""
        meta = self.out / "meta"
        write_lines(map(self.told, entries), meta / "episodes.jsonl")
        each = ({"episode_index": entry.number, "stats": written(entry.statistics)} for entry in entries)
        write_lines(each, meta / "episodes_stats.jsonl")
        write_lines(self.tasks_told(), meta / "tasks.jsonl")

    def totals(self, videos: Sequence[str]) -> dict[str, Any]:
        """With those of files."""
        chunks = {number // self.info["chunks_size"] for number in self.numbers}
        more = {"total_videos": len(self.numbers) * len(videos), "total_chunks": len(chunks)}
        return super().totals(videos) | more

    def told(self, entry: DatasetEpisode) -> dict[str, Any]:
        """A line of `episodes.jsonl`."""
        return {"episode_index": entry.number, "tasks": list(entry.tasks), "length": entry.episode.about.frames}

    def tasks_told(self) -> list[dict[str, Any]]:
        """The lines of `tasks.jsonl`."""
        return [{"task_index": number, "task": task} for number, task in enumerate(self.tasks)]


def prompts(episode: Demonstrated) -> list[str]:
    """The prompt of each subtask; the instruction for rows without a subtask."""
    return [name or episode.about.instruction for name in episode.about.subtasks]
