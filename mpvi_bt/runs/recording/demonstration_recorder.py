"""Records an episode as a demonstration: pictures, proprioception and actions, ready for a LeRobot dataset.

Written with numpy and ffmpeg alone; `mpvi dataset` makes a dataset of many (runs/datasets/lerobot.py).
"""

from __future__ import annotations

import io
import json
import shutil
from collections.abc import Callable, Generator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.executive.behaviors.parameters import NavigateTo, Prompt
from mpvi_bt.executive.ticking.loop import Outcome, Watcher, World
from mpvi_bt.executive.tree.build import Tree
from mpvi_bt.ground.errors import BackendError
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.action_rows import Resampler, state_of
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, SIDES, Proprioception, Robot, Side
from mpvi_bt.ground.robot.robot_description import RobotDescription
from mpvi_bt.ground.robot.robots import layout_of, robot_named
from mpvi_bt.ground.words.phrases import OTHER
from mpvi_bt.ground.writing import unwritable, write_whole

# 1 had neither `arm_velocity` nor `T_base_camera`; in 1 and 2 the action of a row was that of its first control step.
VERSION = 3
NUMBERS = ("state", "base_pose", "arm_velocity", "action")  # arrays of a row's numbers
FPS = 10  # Our choice: pictures are most of what recording costs on a CPU, and openpi's own datasets have 10 to 50


def velocity_sizes(robot: RobotDescription) -> dict[Side, int]:
    """How many numbers a row has of each arm's velocity: of an arm that is missing as many as of the other one."""
    joints = {side: len(robot.arm_joints[side]) for side in robot.sides}
    return {side: joints.get(side, max(joints.values(), default=0)) for side in SIDES}


def arm_velocities(felt: Proprioception) -> Array:
    """(V,) [rad/s], the left arm's first; 0 of an arm that the robot lacks."""
    sizes = velocity_sizes(robot_named(felt.robot))
    return np.concatenate([felt.arm_velocity.get(side, np.zeros(size)) for side, size in sizes.items()])


def felt_again(state: Array, base_pose: Array, arm_velocity: Array, robot: str) -> Proprioception:
    """What was felt, of a recorded row: the inverse of `state_of`.

    Args:
        state: (A,).
        base_pose: (3,) x, y [m], yaw [rad] in the world.
        arm_velocity: (V,) [rad/s], as of `arm_velocities`.
        robot: Its name.
    """
    model = robot_named(robot)
    layout, ends = model.layout, np.cumsum(list(velocity_sizes(model).values()))
    velocities = dict(zip(SIDES, np.split(arm_velocity, ends[:-1]), strict=True))
    return Proprioception(
        base_pose=base_pose,
        base_velocity=layout.velocity(state),
        torso=state[layout.torso],
        arm={side: state[layout.arm[side]] for side in model.sides},
        arm_velocity={side: velocities[side] for side in model.sides},
        gripper_width={side: float(state[layout.gripper[side]]) for side in model.sides},
        gripper_command={},
        robot=robot,
    )


class DemonstrationRecorder(Watcher):
    """Subscriber that writes a folder: `frames.npz`, a video of each camera, and `episode.json` once all is there.

    A row holds what is felt and seen at its beginning, and as its action all that the robot is told until the next row,
    as `mpvi_bt.ground.robot.action_rows` has it: carried out at the same rate, it gets the robot to where it was. Each
    picture is rendered for it, which steers nothing.

    Args:
        folder: Where to write; what was there of the same names is replaced.
        about: What `episode.json` says besides, such as task and instruction.
        fps: Rows a second of simulated time; divides 30.
        cameras: Whose pictures; none: no pictures; None: of all that the robot has.
    """

    def __init__(
        self, folder: Path, about: dict[str, Any], fps: int = FPS, cameras: Sequence[str] | None = None
    ) -> None:
        self._folder, self._about, self._fps, self._cameras = folder, about, fps, cameras
        self._every = CONTROL_HZ // fps
        self._actions: Resampler | None = None
        self._told = np.empty(0)
        self._rows: dict[str, list[Any]] = {key: [] for key in (*NUMBERS, "subtask")}
        self._videos: dict[str, CameraVideo] = {}
        self._finished = False

    def start(self, tree: Tree, world: World) -> None:
        """As `begin`."""
        self.begin()

    def begin(self) -> None:
        """Make the folder. Raises UserError if it cannot be written."""
        try:
            shutil.rmtree(self._folder, ignore_errors=True)
            self._folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise unwritable(self._folder, error) from None

    def step(self, tree: Tree, world: World) -> None:
        """Note a row when one is due."""
        self.note(world.steps, world.robot, world.robot.action, lambda: subtask(tree))

    def note(self, steps: int, robot: Robot, action: Array, at: Callable[[], str]) -> None:
        """Note a control step, and begin a row if one is due.

        Args:
            steps: Control steps that are over.
            robot: What it feels and sees.
            action: (A,) that the next step carries out.
            at: Says what the robot is at.
        """
        if steps % self._every == 0:
            self._begin_row(robot, action, at)
        if self._rows["state"]:
            self._tell(action[None])

    def _begin_row(self, robot: Robot, action: Array, at: Callable[[], str]) -> None:
        if not self._rows["state"]:
            self._told = action
        felt = robot.proprioception()
        if self._actions is None:
            self._actions = Resampler(layout_of(felt))
            self._cameras = tuple(robot_named(felt.robot).cameras if self._cameras is None else self._cameras)
            self._rows |= {f"T_base_camera/{camera}": [] for camera in self._cameras}
        self._rows["state"].append(state_of(felt))
        self._rows["base_pose"].append(felt.base_pose)
        self._rows["arm_velocity"].append(arm_velocities(felt))
        self._rows["subtask"].append(at())
        T_base_world = kin.inverse(kin.base(felt.base_pose))
        for camera in self._cameras or ():
            image = robot.look(camera)
            self._rows[f"T_base_camera/{camera}"].append(matmul(T_base_world, image.T_world_camera))
            if camera not in self._videos:
                self._videos[camera] = CameraVideo(self._folder / f"{camera}.mp4", image.rgb.shape, self._fps)
            self._videos[camera].add(image.rgb)

    def _tell(self, actions: Array, whole: bool = True) -> None:
        """Add the actions of control steps; write the rows that are complete."""
        assert self._actions is not None
        for row in self._actions.resampled(actions, CONTROL_HZ, self._fps, self._told, whole):
            self._rows["action"].append(row)
            self._told = row

    def end(self, outcome: Outcome) -> None:
        """Close the last row and the videos, however the episode ended."""
        if self._actions is not None:
            self._tell(np.empty((0, len(self._told))), whole=False)
        for video in self._videos.values():
            video.close()
        self._finished = outcome.ending not in ("error", "backend_error", "interrupted")

    def conclude(self, q: float, success: bool) -> None:
        """Write the rows and, last of all, what the episode was and how it was scored, if it came to an end.

        Args:
            q: Its exact q, 0 to 1.
            success: Whether its goal is true at the end.
        """
        if not self._finished:
            return
        names = list(dict.fromkeys(self._rows["subtask"]))
        arrays: dict[str, NDArray[Any]] = {
            key: np.array(rows, np.float32) for key, rows in self._rows.items() if key != "subtask"
        }
        arrays["subtask"] = np.array([names.index(name) for name in self._rows["subtask"]], np.int64)
        for camera, video in self._videos.items():
            arrays[f"histogram/{camera}"] = video.histogram
        file = io.BytesIO()
        np.savez_compressed(file, allow_pickle=False, **arrays)
        write_whole(self._folder / "frames.npz", file.getvalue())
        about = {
            "version": VERSION,
            **self._about,
            "fps": self._fps,
            "frames": len(self._rows["state"]),
            "cameras": {camera: list(video.size) for camera, video in self._videos.items()},
            "subtasks": names,
            "q": q,
            "success": success,
        }
        write_whole(self._folder / "episode.json", json.dumps(about, indent=1, ensure_ascii=False))


def subtask(tree: Tree) -> str:
    """The running policy's prompt, or the destination of the drive; "" if neither runs."""
    states = tree.states()
    for node in tree.spec.nodes:
        if states[node.path].status == "RUNNING":
            if isinstance(node.spec.parameters, Prompt):
                return node.spec.parameters.prompt
            if isinstance(node.spec.parameters, NavigateTo):
                target = node.spec.parameters.target
                return f"go to {target}" if OTHER.match(target) else f"go to the {target}"
    return ""


class CameraVideo:
    """One camera's h264 file, every frame at its exact time, and how often each value was in each channel.

    Attributes:
        size: Height and width [px].
        histogram: (3, 256) of all pictures.
    """

    def __init__(self, file: Path, shape: tuple[int, ...], fps: int) -> None:
        import imageio_ffmpeg

        self.size = (shape[0], shape[1])
        self.histogram: NDArray[np.int64] = np.zeros((3, 256), np.int64)
        self._file = file
        self._writer: Generator[None, bytes | NDArray[np.uint8] | None, None] = imageio_ffmpeg.write_frames(
            str(file),
            (shape[1], shape[0]),
            fps=fps,
            codec="libx264",
            quality=None,
            # Every second frame stands alone, so that a loader gets at any of them soon; none is out of order.
            output_params=["-preset", "veryfast", "-crf", "20", "-g", "2", "-bf", "0"],
            ffmpeg_log_level="error",
            macro_block_size=2,
        )
        self._writer.send(None)

    def add(self, picture: NDArray[np.uint8]) -> None:
        """Append a frame (H, W, 3)."""
        try:
            self._writer.send(np.ascontiguousarray(picture))
        except OSError as error:
            raise BackendError(f"{self._file}: ffmpeg stopped writing the video: {error}") from error
        for channel in range(3):
            self.histogram[channel] += np.bincount(picture[..., channel].ravel(), minlength=256)

    def close(self) -> None:
        """Wait for ffmpeg to write the index, without which the file does not play."""
        self._writer.close()
