"""Reads recorded demonstrations, and sees that they are whole: nothing of them is believed before it is checked."""

from __future__ import annotations

import subprocess
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, Field

from mpvi_bt.executive.remote.prompts import prompt_of
from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import FileProblems, Problem, UserError, shown
from mpvi_bt.ground.marked_yaml import Record, load_marked, validate_data
from mpvi_bt.ground.robot.default_robot import DEFAULT_ROBOT
from mpvi_bt.ground.robot.robots import robot_named
from mpvi_bt.runs.recording.demonstration_recorder import VERSION, velocity_sizes

READ = (1, 2, VERSION)
CODEC = "h264"
_TOLERANCE_S = 1e-4  # as LeRobot's loader has it, between a row's time and its picture's

Size = Annotated[int, Field(gt=0)]
Camera = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_\-]*$")]


class Chosen(Record):
    """What is read of how the episode was run.

    Attributes:
        robot: Its name.
    """

    model_config = ConfigDict(strict=True, extra="ignore")

    robot: str = DEFAULT_ROBOT


class EpisodeFile(Record):
    """What is read of `episode.json`; it may say more.

    Attributes:
        version: Of the layout.
        task: Its name.
        problem: BEHAVIOR's activity that the task is; recordings of version 1 do not tell.
        config: How it was run.
        instruction: What the robot was told.
        fps: Rows a second of simulated time.
        frames: How many rows there are, and pictures of each camera.
        cameras: Height and width [px] of each camera's pictures.
        subtasks: What the robot was at, which rows name by number.
        success: Whether its goal is true at the end.
    """

    model_config = ConfigDict(strict=True, extra="ignore")

    version: int
    task: str = ""
    problem: str | None = None
    config: Chosen = Chosen()
    instruction: Annotated[str, Field(min_length=1)]
    fps: Size
    frames: Size
    cameras: dict[Camera, Annotated[list[Size], Field(min_length=2, max_length=2)]]
    subtasks: Annotated[list[str], Field(min_length=1)]
    success: bool


@dataclass(frozen=True)
class Demonstrated:
    """One recorded episode: the folder that `recording.demonstration_recorder` wrote.

    Attributes:
        folder: Where it is.
        about: Its `episode.json`.
    """

    folder: Path
    about: EpisodeFile

    def told_as_in(self, prompts: Path) -> Demonstrated:
        """The same, with the instruction that a file has for its task.

        Raises:
            UnknownName: The file does not name the task.
            UserError, FileProblems: It cannot be read, or everything that is wrong with it.
        """
        told = prompt_of(self.about.problem or self.about.task, prompts)
        return Demonstrated(self.folder, self.about.model_copy(update={"instruction": told}))

    @cached_property
    def frames(self) -> dict[str, NDArray[Any]]:
        """Arrays by name.

        They are state (n, A), base_pose (n, 3), action (n, A), subtask (n,), of each camera histogram/CAMERA (3, 256)
        and, but for recordings of version 1, arm_velocity (n, V) and T_base_camera/CAMERA (n, 4, 4).

        Raises:
            FileProblems: Everything that is wrong with the file.
        """
        file = self.folder / "frames.npz"
        if not paths.is_file(file):
            raise FileProblems([_unreadable(file, "no such file")])
        try:
            with np.load(file, allow_pickle=False) as content:
                arrays = {key: content[key] for key in content.files}
        except Exception as error:  # whatever zipfile, zlib and numpy make of broken bytes
            raise FileProblems([_unreadable(file, f"cannot be read: {error}")]) from None
        if wrong := [_invalid(file, message) for message in self._wrong(arrays)]:
            raise FileProblems(wrong)
        return arrays

    def _wrong(self, arrays: dict[str, NDArray[Any]]) -> Iterator[str]:
        """What is wrong with the arrays, each in a sentence."""
        n, last = self.about.frames, len(self.about.subtasks) - 1
        robot = robot_named(self.about.config.robot)
        size, velocities = robot.layout.size, sum(velocity_sizes(robot).values())
        due: dict[str, tuple[int, ...]] = {"state": (n, size), "base_pose": (n, 3), "action": (n, size)}
        due |= {"subtask": (n,)} | {f"histogram/{camera}": (3, 256) for camera in self.about.cameras}
        if self.about.version > 1:
            due |= {"arm_velocity": (n, velocities)}
            due |= {f"T_base_camera/{camera}": (n, 4, 4) for camera in self.about.cameras}
        for name, shape in due.items():
            array = arrays.get(name)
            counts = name == "subtask" or name.startswith("histogram/")
            if array is None:
                yield f"no array {name!r}; it has {', '.join(map(shown, arrays)) or 'none'}"
            elif array.shape != shape:
                yield f"{name} is of shape {array.shape}, not {shape}: {n} rows, as episode.json says"
            elif array.dtype.kind not in ("iu" if counts else "f"):
                yield f"{name} has values of type {array.dtype}, not {'whole' if counts else 'floating-point'} numbers"
            elif not counts and not np.isfinite(_float32(array)).all():
                yield f"{name} has values that are not finite"
            elif name == "subtask" and not 0 <= array.min() <= array.max() <= last:
                yield f"subtask has the number {array.min() if array.min() < 0 else array.max()}; there are 0 to {last}"
            elif name.startswith("histogram/"):
                height, width = self.about.cameras[name.partition("/")[2]]
                if array.min() < 0 or (array.sum(1) != n * height * width).any():
                    yield f"{name} does not count {n} pictures of {height} x {width} pixels"


def read_demonstration(folder: Path) -> Demonstrated:
    """A recorded episode, of which no more than its description is looked at.

    Raises:
        UserError: There is none in the folder, or one of another version of this package.
        FileProblems: Everything that is wrong with its description.
    """
    file = folder / "episode.json"
    if not paths.is_file(file):
        raise UserError(f"{folder}: no demonstration there (no episode.json)")
    data, marks = load_marked(file)
    if isinstance(data, dict) and (version := data.get("version", VERSION)) not in READ:
        known = " and ".join(map(str, READ))
        raise UserError(f"{file}: a demonstration of version {shown(version)}; this mpvi_bt reads {known}")
    return Demonstrated(folder, validate_data(data, marks, EpisodeFile))


def find_demonstrations(folders: Iterable[Path]) -> list[Demonstrated]:
    """Those in the folders and right below them, sorted by name; each once.

    Raises:
        UserError: A folder has none.
        FileProblems: Everything that is wrong with their descriptions.
    """
    found, problems = {}, []
    for folder in folders:
        files = sorted([*folder.glob("episode.json"), *folder.glob("*/episode.json")])
        if not files:
            how = "`mpvi run TASK --demonstration DIR` or `mpvi suite run SUITE --demonstrations`"
            raise UserError(f"{folder}: no demonstrations there; {how} records some")
        for file in files:
            try:
                found[file.parent.resolve()] = read_demonstration(file.parent)
            except FileProblems as error:
                problems += error.problems
    if problems:
        raise FileProblems(problems)
    return list(found.values())


def check_demonstrations(
    episodes: Sequence[Demonstrated], tell: Callable[[int, Demonstrated], None] = lambda n, e: None
) -> None:
    """Read every row and decode every picture of episodes, as many at once as there are cores.

    Args:
        episodes: To check.
        tell: Is told the number and the episode that was checked.

    Raises:
        FileProblems: Everything that is wrong with any of them.
    """
    problems = []
    with ThreadPoolExecutor() as pool:
        for number, (episode, found) in enumerate(zip(episodes, pool.map(_problems, episodes), strict=True)):
            problems += found
            tell(number, episode)
    if problems:
        raise FileProblems(problems)


def _problems(episode: Demonstrated) -> list[Problem]:
    problems: list[Problem] = []
    try:
        _ = episode.frames
    except FileProblems as error:
        problems += error.problems
    return problems + list(chain.from_iterable(_video_problems(episode, camera) for camera in episode.about.cameras))


def _video_problems(episode: Demonstrated, camera: str) -> Iterator[Problem]:
    """What is wrong with a camera's video."""
    import imageio_ffmpeg

    file, about = episode.folder / f"{camera}.mp4", episode.about
    if not paths.is_file(file):
        yield _unreadable(file, "no such file")
        return
    # Packets are listed as they are (ffmpeg's "framecrc": what they are, then one line each) and decoded aside.
    listed = ["-map", "0:v:0", "-c", "copy", "-f", "framecrc", "pipe:1"]
    decoded = ["-map", "0:v:0", "-f", "null", "-"]
    begin = [imageio_ffmpeg.get_ffmpeg_exe(), "-nostdin", "-v", "error", "-xerror", "-threads", "1", "-f", "mp4"]
    done = subprocess.run(
        [*begin, "-i", f"file:{file}", *listed, *decoded], capture_output=True, text=True, check=False
    )
    if done.returncode:
        why = done.stderr.splitlines()[:1] or [f"ffmpeg ends with {done.returncode}"]
        yield _unreadable(file, f"cannot be played to its end: {why[0].rpartition('] ')[2]}")
        return
    lines = done.stdout.splitlines()
    head = {line[1:].split(" 0: ")[0]: line.split(" 0: ")[-1] for line in lines if line.startswith("#")}
    height, width = about.cameras[camera]
    if (size := head.get("dimensions")) != f"{width}x{height}":
        yield _invalid(file, f"pictures of {size} pixels; episode.json says {width}x{height}")
    if (codec := head.get("codec_id")) != CODEC:
        yield _invalid(file, f"encoded as {codec}, not as {CODEC}")
    over, under = map(int, head["tb"].split("/"))
    times_s = sorted(int(line.split(",")[2]) * over / under for line in lines if line[:1].isdigit())
    if len(times_s) != about.frames:
        yield _invalid(file, f"{len(times_s)} pictures; episode.json says {about.frames} frames")
    elif np.abs(np.array(times_s) - np.arange(about.frames) / about.fps).max() > _TOLERANCE_S:
        yield _invalid(file, f"its pictures are not {about.fps} a second from 0 s on; episode.json says so")


def _float32(array: NDArray[Any]) -> NDArray[np.float32]:
    with np.errstate(over="ignore"):
        return array.astype(np.float32)


def _unreadable(file: Path, message: str) -> Problem:
    return Problem(str(file), 0, 0, "unreadable", message)


def _invalid(file: Path, message: str) -> Problem:
    return Problem(str(file), 0, 0, "invalid-value", message)
