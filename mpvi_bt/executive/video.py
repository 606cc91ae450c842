"""An mp4 of an episode: what the robot sees, how it looks from outside, and how the tree stands."""

from __future__ import annotations

from collections.abc import Callable, Generator
from pathlib import Path
from typing import Protocol, cast

import numpy as np

from mpvi_bt.drawing.text import LEGEND, ascii_tree
from mpvi_bt.errors import BackendError
from mpvi_bt.executive.frame_text import COLUMNS, DIM, INK, PAPER, SIZE, write, write_tree
from mpvi_bt.executive.labels import Picture
from mpvi_bt.executive.loop import Outcome, Watcher, World
from mpvi_bt.executive.search_frames import OUTSIDE, SearchFrames
from mpvi_bt.executive.search_view import SearchView
from mpvi_bt.robot.linear_algebra import norm
from mpvi_bt.robot.protocol import CONTROL_HZ, CameraImage
from mpvi_bt.robot.solids import Array
from mpvi_bt.tree.build import Tree
from mpvi_bt.writing import unwritable

_OUTSIDE = (800, 600)  # picture from outside, upper left,
_RENDERED = (640, 480)  # rendered smaller, as it is most of what a frame costs on a CPU (0.1 s)
_HEAD = (480, 360)  # picture of the head camera, upper right


class Outside(Protocol):
    """A world that can be seen from outside."""

    def look_from(self, T_world_camera: Array, size: tuple[int, int]) -> CameraImage:
        """A picture from anywhere: (4, 4) optical frame to world, width and height [px]."""
        ...


class Video(Watcher):
    """Subscriber that writes an mp4. Each frame costs two pictures, so it draws only every few steps.

    The file is closed properly however the episode ends, Ctrl-C included.

    Args:
        file: Where to write.
        title: Written in each frame.
        frames_per_s: Of simulated time; 30 at most.
        speed: How many times faster than simulated time the video plays. Our choice: twice, at ten frames a second.
        viewpoint: T_world_camera (4, 4), optical frame, for a base pose (3,); None: a camera that follows the robot.
        search: Where the robot searches: frames show its map, too, and what was detected in the head's picture.
    """

    def __init__(
        self,
        file: str | Path,
        title: str = "",
        frames_per_s: float = 5.0,
        speed: float = 2.0,
        viewpoint: Callable[[Array], Array] | None = None,
        search: SearchView | None = None,
    ) -> None:
        self._file, self._title, self._viewpoint = Path(file), title, viewpoint
        self._every = max(1, round(CONTROL_HZ / frames_per_s))
        self._fps = CONTROL_HZ / self._every * speed
        self._follow = Follower()
        self._search = None if search is None else SearchFrames(search)
        self._writer: Generator[None, Picture | None, None] | None = None
        self._last: tuple[Tree, World] | None = None

    def start(self, tree: Tree, world: World) -> None:
        """Open the file. Raises UserError if it cannot be written."""
        import imageio_ffmpeg

        try:
            self._file.parent.mkdir(parents=True, exist_ok=True)
            self._file.open("wb").close()
        except OSError as error:
            raise unwritable(self._file, error) from error
        self._writer = imageio_ffmpeg.write_frames(
            str(self._file),
            SIZE,
            fps=self._fps,
            codec="libx264",
            quality=None,
            output_params=["-preset", "ultrafast", "-crf", "26", "-movflags", "+faststart"],
            ffmpeg_log_level="error",
        )
        self._writer.send(None)
        self._last = tree, world

    def step(self, tree: Tree, world: World) -> None:
        """Draw a frame when one is due."""
        if world.steps % self._every == 0:
            self._send(tree, world, f"{world.time_s:6.1f} s")

    def end(self, outcome: Outcome) -> None:
        """Show the last state for a second, if it can be drawn, and close the file."""
        if self._writer is None or self._last is None:
            return
        try:
            if outcome.ending != "error":
                for _ in range(round(self._fps)):
                    self._send(*self._last, outcome.told(self._last[0].spec))
        finally:
            writer, self._writer = self._writer, None
            writer.close()  # waits for ffmpeg to write the index, without which the file does not play

    def _send(self, tree: Tree, world: World, status: str) -> None:
        if self._writer is None:
            return
        base_pose = world.robot.proprioception().base_pose
        outside: Picture | None = None
        if hasattr(world, "look_from"):
            T = self._viewpoint(base_pose) if self._viewpoint else self._follow(base_pose)
            size = _RENDERED if self._search is None else OUTSIDE
            outside = cast("Outside", world).look_from(T, size).rgb
        text = ascii_tree(tree.spec, tree.states(), COLUMNS, fold=True)
        if self._search is not None:
            frame = self._search.frame(outside, world, text, self._title, status.strip(), _doing(tree))
        else:
            frame = compose(outside, world.robot.look("head").rgb, text, f"{self._title}   {status}".strip())
        try:
            self._writer.send(frame)
        except OSError as error:
            raise BackendError(f"{self._file}: ffmpeg stopped writing the video: {error}") from error


def _doing(tree: Tree) -> str:
    """What the deepest running node says of its work, which its line has no room for."""
    states = tree.states()
    running = [node for node in tree.spec.nodes if states[node.path].status == "RUNNING" and states[node.path].feedback]
    return states[max(running, key=lambda node: node.depth).path].feedback if running else ""


class Follower:
    """A camera that hangs behind and above the base and swings after it, without shaking (first-order lag)."""

    def __init__(self, behind_m: float = 1.4, up_m: float = 3.6, lag: float = 0.12) -> None:
        self._behind_m, self._up_m, self._lag = behind_m, up_m, lag
        self._pose: Array | None = None

    def __call__(self, base_pose: Array) -> Array:
        """T_world_camera (4, 4), optical frame, for the next base pose (3,)."""
        if self._pose is None:
            self._pose = base_pose.copy()
        step = base_pose - self._pose
        step[2] = 0.4 * np.arctan2(np.sin(step[2]), np.cos(step[2]))  # turns dizzy more than moves do
        self._pose = self._pose + self._lag * step
        x, y, yaw = self._pose
        forward = np.array([np.cos(yaw), np.sin(yaw), 0.0])
        eye = np.array([x, y, self._up_m]) - self._behind_m * forward
        ahead = np.array([x, y, 0.7]) + 0.5 * forward - eye
        z = ahead / norm(ahead)
        across = np.cross(z, (0.0, 0.0, 1.0))
        across /= norm(across)
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = np.stack([across, np.cross(z, across), z], 1), eye
        return T


def compose(outside: Picture | None, head: Picture, text: str, status: str) -> Picture:
    """One frame: the outside view large on the left, the head's view and the tree's text beside it.

    Args:
        outside: (H, W, 3) RGB, or None where there is no such view: the head's takes its place.
        head: (H, W, 3) RGB.
        text: ASCII, a line a row; lines that do not fit are left out.
        status: Written under the outside view.

    Returns:
        (720, 1280, 3) uint8 RGB.
    """
    import cv2

    frame = np.full((SIZE[1], SIZE[0], 3), PAPER, np.uint8)
    main, beside = (head, None) if outside is None else (outside, head)
    frame[: _OUTSIDE[1], : _OUTSIDE[0]] = cv2.resize(main, _OUTSIDE, interpolation=cv2.INTER_LINEAR)
    top = 0
    if beside is not None:
        frame[: _HEAD[1], _OUTSIDE[0] :] = cv2.resize(beside, _HEAD, interpolation=cv2.INTER_LINEAR)
        top = _HEAD[1]
    write_tree(frame, text, _OUTSIDE[0] + 8, top)
    cv2.putText(frame, status, (16, _OUTSIDE[1] + 40), cv2.FONT_HERSHEY_SIMPLEX, 0.8, INK, 2, cv2.LINE_AA)
    write(frame, LEGEND, (16, _OUTSIDE[1] + 80), DIM)
    return frame
