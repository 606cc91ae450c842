"""Makes a LeRobot dataset (format v3.0) of demonstrations. The only module that knows pandas and that format.

LeRobot's own writer is not used: it pins a torch that our other extras cannot have. Format as documented by LeRobot
(lerobot 0.4, "LeRobotDataset v3.0"): tables in Parquet, pictures in MP4, and what they are in meta/. Each episode has
files of its own, which the format allows, so that no video is encoded twice.
"""

from __future__ import annotations

import importlib.util
import json
import os
import shutil
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.errors import UserError
from mpvi_bt.extras import install
from mpvi_bt.robot.linear_algebra import matmul
from mpvi_bt.suite.demonstrations import CODEC, Demonstrated, check_demonstrations
from mpvi_bt.writing import unwritable, write_whole

CODEBASE_VERSION = "v3.0"
FILES_A_CHUNK = 1000
QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}
_ARM = [f"arm_{joint}" for joint in range(1, 8)]
MOTORS = [
    *("base_vx", "base_vy", "base_yaw_rate", "lift", "waist_yaw", "waist_pitch", "head_tilt"),
    *(f"left_{name}" for name in (*_ARM, "gripper")),
    *(f"right_{name}" for name in (*_ARM, "gripper")),
]
VECTORS = {"observation.state": ("state", MOTORS), "observation.base_pose": ("base_pose", ["x", "y", "yaw"]),
           "action": ("action", MOTORS)}  # fmt: skip
COUNTERS = ("frame_index", "episode_index", "index", "task_index", "subtask_index")

Statistics = dict[str, NDArray[Any]]


def require_pandas() -> None:
    """Raise UserError unless what writes tables is installed."""
    if importlib.util.find_spec("pandas") is None or importlib.util.find_spec("pyarrow") is None:
        raise UserError(f"datasets need pandas and pyarrow, which are not installed: {install('dataset')}")


def write_dataset(
    episodes: Sequence[Demonstrated], out: Path, tell: Callable[[str, int, Demonstrated], None] = lambda *told: None
) -> None:
    """Write a dataset once all its episodes were found whole; a killed run leaves nothing at `out`.

    Args:
        episodes: In their order. All have the same rate and cameras.
        out: Its folder, which must not exist yet.
        tell: Is told what was done ("checked" or "wrote"), and the number and the episode that it was done to.

    Raises:
        UserError: There are no episodes, they do not go together, or `out` exists or cannot be written.
        FileProblems: Everything that is wrong with the episodes' files.
        BackendError: The disk is full or broken.
    """
    require_pandas()
    if not episodes:
        raise UserError("no demonstrations to make a dataset of: none reached its goal (--all takes the others, too)")
    first = episodes[0].about
    for episode in episodes:
        for key in ("fps", "cameras"):
            if (its := getattr(episode.about, key)) != getattr(first, key):
                raise UserError(f"{episode.folder}: {key} {its}, but {episodes[0].folder}: {getattr(first, key)}")
    if out.exists():
        raise UserError(f"{out}: exists; choose another folder")
    check_demonstrations(episodes, lambda number, episode: tell("checked", number, episode))
    partial = out.with_name(f".{out.name}.{os.getpid()}.tmp")
    try:
        partial.mkdir(parents=True)
        _write(episodes, partial, tell)
        partial.replace(out)
    except OSError as error:
        raise unwritable(out, error) from None
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def _write(episodes: Sequence[Demonstrated], out: Path, tell: Callable[[str, int, Demonstrated], None]) -> None:
    import pandas as pd

    first = episodes[0].about
    tasks = list(dict.fromkeys(e.about.instruction for e in episodes))
    subtasks = list(dict.fromkeys(name for e in episodes for name in e.about.subtasks))
    rows, begin = [], 0
    for number, episode in enumerate(episodes):
        table = _table(episode, number, begin, tasks, subtasks)
        chunk, file = divmod(number, FILES_A_CHUNK)
        _parquet(_frame(table), out / f"data/chunk-{chunk:03d}/file-{file:03d}.parquet")
        length = len(table["index"])
        row: dict[str, Any] = {
            "episode_index": number,
            "tasks": [episode.about.instruction],
            "length": length,
            "data/chunk_index": chunk,
            "data/file_index": file,
            "dataset_from_index": begin,
            "dataset_to_index": begin + length,
            "meta/episodes/chunk_index": 0,
            "meta/episodes/file_index": 0,
        }
        for camera in first.cameras:
            key = f"observation.images.{camera}"
            target = out / f"videos/{key}/chunk-{chunk:03d}/file-{file:03d}.mp4"
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(_content(episode.folder / f"{camera}.mp4"))
            row |= {f"videos/{key}/chunk_index": chunk, f"videos/{key}/file_index": file}
            row |= {f"videos/{key}/from_timestamp": 0.0, f"videos/{key}/to_timestamp": length / first.fps}
        for key, found in (_statistics(table) | _seen([episode])).items():
            row |= {f"stats/{key}/{name}": value.tolist() for name, value in found.items()}
        rows.append(row)
        begin += length
        tell("wrote", number, episode)
    _parquet(pd.DataFrame(rows), out / "meta/episodes/chunk-000/file-000.parquet")
    _parquet(pd.DataFrame({"task_index": range(len(tasks))}, index=tasks), out / "meta/tasks.parquet")
    _parquet(pd.DataFrame({"subtask_index": range(len(subtasks))}, index=subtasks), out / "meta/subtasks.parquet")
    everything = _joined([_table(e, n, 0, tasks, subtasks) for n, e in enumerate(episodes)])
    everything["index"] = np.arange(begin)
    statistics = _statistics(everything) | _seen(episodes)
    _json({key: {name: v.tolist() for name, v in stats.items()} for key, stats in statistics.items()}, out, "stats")
    _json(
        {
            "codebase_version": CODEBASE_VERSION,
            "robot_type": "r1",
            "total_episodes": len(episodes),
            "total_frames": begin,
            "total_tasks": len(tasks),
            "chunks_size": FILES_A_CHUNK,
            "data_files_size_in_mb": 100,
            "video_files_size_in_mb": 200,
            "fps": first.fps,
            "splits": {"train": f"0:{len(episodes)}"},
            "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
            "video_path": "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
            if first.cameras
            else None,
            "features": features(first.cameras, first.fps),
        },
        out,
        "info",
    )


def features(cameras: Mapping[str, Sequence[int]], fps: int) -> dict[str, Any]:
    """What a frame has, as `info.json` tells it.

    Args:
        cameras: Height and width [px] of each camera's pictures.
        fps: Frames a second.
    """
    vectors = {
        key: {"dtype": "float32", "shape": [len(names)], "names": {"motors": list(names)}}
        for key, (_, names) in VECTORS.items()
    }
    videos = {
        f"observation.images.{camera}": {
            "dtype": "video",
            "shape": [height, width, 3],
            "names": ["height", "width", "channels"],
            "info": {
                "video.height": height,
                "video.width": width,
                "video.codec": CODEC,
                "video.pix_fmt": "yuv420p",
                "video.is_depth_map": False,
                "video.fps": fps,
                "video.channels": 3,
                "has_audio": False,
            },
        }
        for camera, (height, width) in cameras.items()
    }
    counters = {key: {"dtype": "int64", "shape": [1], "names": None} for key in COUNTERS}
    return {**vectors, **videos, "timestamp": {"dtype": "float32", "shape": [1], "names": None}, **counters}


def _table(
    episode: Demonstrated, number: int, begin: int, tasks: Sequence[str], subtasks: Sequence[str]
) -> dict[str, NDArray[Any]]:
    """Columns of an episode's rows, (n,) or (n, size)."""
    frames, n = episode.frames, episode.about.frames
    steps = np.arange(n)
    renumbered = np.array([subtasks.index(name) for name in episode.about.subtasks], np.int64)
    return {
        **{key: frames[name].astype(np.float32) for key, (name, _) in VECTORS.items()},
        "timestamp": (steps / episode.about.fps).astype(np.float32),
        "frame_index": steps,
        "episode_index": np.full(n, number),
        "index": begin + steps,
        "task_index": np.full(n, tasks.index(episode.about.instruction)),
        "subtask_index": renumbered[frames["subtask"]],
    }


def _joined(tables: Sequence[Mapping[str, NDArray[Any]]]) -> dict[str, NDArray[Any]]:
    return {key: np.concatenate([table[key] for table in tables]) for key in tables[0]}


def _statistics(table: Mapping[str, NDArray[Any]]) -> dict[str, Statistics]:
    """Of each column, over its rows: min, max, mean, std, count and quantiles, each (size,)."""
    found = {}
    for key, column in table.items():
        values = column.reshape(len(column), -1).astype(np.float64)
        found[key] = {
            "min": values.min(0),
            "max": values.max(0),
            "mean": values.mean(0),
            "std": values.std(0),
            "count": np.array([len(values)]),
            **{name: np.quantile(values, q, axis=0) for name, q in QUANTILES.items()},
        }
    return found


def _seen(episodes: Sequence[Demonstrated]) -> dict[str, Statistics]:
    """The same of pictures: over all their pixels, by channel (3, 1, 1), black 0 to white 1."""
    found = {}
    shade = np.arange(256) / 255
    for camera in episodes[0].about.cameras:
        histogram = np.stack([e.frames[f"histogram/{camera}"] for e in episodes]).astype(np.float64).sum(0)
        share = histogram / histogram.sum(1, keepdims=True)
        up_to = share.cumsum(1)
        mean = matmul(share, shade)
        each = {
            "min": shade[(histogram > 0).argmax(1)],
            "max": shade[255 - (histogram[:, ::-1] > 0).argmax(1)],
            "mean": mean,
            "std": np.sqrt(np.maximum(matmul(share, shade**2) - mean**2, 0.0)),
            **{name: shade[(up_to >= q - 1e-12).argmax(1)] for name, q in QUANTILES.items()},
        }
        key = f"observation.images.{camera}"
        found[key] = {name: value.reshape(3, 1, 1) for name, value in each.items()}
        found[key]["count"] = np.array([sum(e.about.frames for e in episodes)])
    return found


def _frame(table: Mapping[str, NDArray[Any]]) -> Any:
    import pandas as pd

    return pd.DataFrame({key: list(column) if column.ndim > 1 else column for key, column in table.items()})


def _content(file: Path) -> bytes:
    """A file of an episode. Raises UserError: it was there when it was checked."""
    try:
        return file.read_bytes()
    except OSError as error:
        raise UserError(f"{file}: cannot be read: {(error.strerror or str(error)).lower()}") from None


def _parquet(frame: Any, file: Path) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    frame.to_parquet(file)


def _json(content: Any, out: Path, name: str) -> None:
    write_whole(out / "meta" / f"{name}.json", json.dumps(content, indent=4, ensure_ascii=False, allow_nan=False))
