"""An mp4 of an episode: what the robot sees, how it looks from outside, and how the tree stands."""

from __future__ import annotations

import contextlib
import struct
import sys
from collections.abc import Callable, Generator, Sequence
from pathlib import Path
from typing import Protocol, cast

import numpy as np

from mpvi_bt.executive.drawing.text import tree_lines
from mpvi_bt.executive.ticking.loop import Outcome, Watcher, World
from mpvi_bt.executive.tree.build import Tree
from mpvi_bt.ground.geometry.linear_algebra import norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, CameraImage
from mpvi_bt.ground.robot.robots import robot_named
from mpvi_bt.ground.writing import unwritable
from mpvi_bt.runs.recording import cards
from mpvi_bt.runs.recording.frame_text import (
    COLUMNS,
    DIM,
    INK,
    PAPER,
    SIZE,
    WRIST,
    Caption,
    plain,
    show_wrists,
    wrapped,
    write,
    write_tree,
)
from mpvi_bt.runs.recording.labels import Picture
from mpvi_bt.runs.recording.news import answer
from mpvi_bt.runs.recording.search_frames import OUTSIDE, SearchFrames
from mpvi_bt.runs.recording.search_view import SearchView

_OUTSIDE = (800, 600)  # picture from outside, upper left,
_RENDERED = (640, 480)  # rendered smaller, as it is most of what a frame costs on a CPU (0.1 s)
_HEAD = (480, 360)  # picture of the head camera, upper right
_POSTER_QUALITY = 88
_DRIVING = 2  # times faster than else, our choice: less happens
_LAST_S, _CARD_S = 1.0, 6.0  # of the film: so long the last state, and each card, are shown
_ANSWERS = 3  # the checker's last that a frame tells


class Outside(Protocol):
    """A world that can be seen from outside."""

    def look_from(self, T_world_camera: Array, size: tuple[int, int]) -> CameraImage:
        """A picture from anywhere: (4, 4) optical frame to world, width and height [px]."""
        ...


class Video(Watcher):
    """Subscriber that writes an mp4. Each frame costs several pictures, so it draws only every few steps.

    It begins with a card of instruction and plan, and of what signs and colors mean, and ends with one of the goal's
    conditions, where there are such. The file is closed properly however the episode ends, Ctrl-C included. The last
    state, with q, also goes beside it, as `NAME.poster.jpg`, for pages that show the film. Where the film cannot be
    written any more, such as on a full disk, a line says so, and the episode goes on without it.

    Args:
        file: Where to write.
        title: Written in each frame.
        about: Who does what in the episode; written on the first card.
        frames_per_s: Of simulated time; 30 at most.
        speed: How many times faster than simulated time the video plays. Our choice: twice, at ten frames a second;
            while the robot only drives, twice as fast again. Each frame tells it.
        viewpoint: T_world_camera (4, 4), optical frame, for a base pose (3,); None: a camera that follows the robot.
        search: Where the robot searches: frames show its map, too, and what was detected in the head's picture.
        only_failures: Whether the film is deleted where the goal is met.
        tell: Is given that line.
    """

    def __init__(
        self,
        file: str | Path,
        title: str = "",
        about: str = "",
        frames_per_s: float = 5.0,
        speed: float = 2.0,
        viewpoint: Callable[[Array], Array] | None = None,
        search: SearchView | None = None,
        only_failures: bool = False,
        tell: Callable[[str], None] = lambda line: print(f"mpvi: {line}", file=sys.stderr),
    ) -> None:
        self._only_failures, self._tell = only_failures, tell
        self._file, self._title, self._about, self._viewpoint = Path(file), title, about, viewpoint
        self._every = max(1, round(CONTROL_HZ / frames_per_s))
        self._fps, self._speed = CONTROL_HZ / self._every * speed, speed
        self._follow = Follower()
        self._search = None if search is None else SearchFrames(search)
        self._writer: Generator[None, Picture | None, None] | None = None
        self._last: tuple[Tree, World] | None = None
        self._frame: Picture | None = None

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
            output_params=["-preset", "veryfast", "-crf", "28", "-movflags", "+faststart"],
            ffmpeg_log_level="quiet",
        )
        self._writer.send(None)
        self._last = tree, world
        self._show(cards.opening(self._title, self._about, tree.spec, self._search is not None), _CARD_S)

    def step(self, tree: Tree, world: World) -> None:
        """Draw a frame when one is due."""
        if world.steps % self._every or self._writer is None:
            return
        states = tree.states()
        busy = max(
            (n for n in tree.spec.nodes if states[n.path].status == "RUNNING"), key=lambda n: n.depth, default=None
        )
        faster = _DRIVING if busy and busy.spec.kind == "navigate" else 1
        if world.steps % (self._every * faster) == 0:
            status = [f"{world.time_s:.1f} s, shown at {self._speed * faster:g}x", _doing(tree)]
            self._send(tree, world, status, busy.path if busy else "")

    def end(self, outcome: Outcome) -> None:
        """Show the last state for a second, if it can be drawn, then how the goal stands, and close the file."""
        if self._last is None:
            return
        last, self._last = self._last, None
        deleted = self._only_failures and outcome.goal is not None and outcome.goal.satisfied
        try:
            if outcome.ending != "error" and not deleted:
                spec = last[0].spec
                told = outcome.told(spec)
                for _ in range(round(self._fps * _LAST_S)):
                    self._send(*last, told.split(", ", 1) if outcome.goal else ["", told])
                self._show(cards.closing(outcome, spec), _CARD_S)
        finally:
            if self._writer is not None:
                self._writer.close()  # waits for ffmpeg to write the index, without which the file does not play
                self._writer = None
                if not deleted and not has_index(self._file):
                    self._tell(f"{self._file}: cannot be played: ffmpeg could not finish it; is the disk full?")
            if deleted:
                for file in (self._file, self._poster):
                    file.unlink(missing_ok=True)
            else:
                self._write_poster()

    @property
    def _poster(self) -> Path:
        return self._file.with_suffix(".poster.jpg")

    def _write_poster(self) -> None:
        if self._frame is None:
            return
        import cv2

        ok, data = cv2.imencode(".jpg", self._frame[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, _POSTER_QUALITY])
        with contextlib.suppress(OSError):  # the film is there
            if ok:
                self._poster.write_bytes(data.tobytes())

    def _send(self, tree: Tree, world: World, status: Sequence[str], at: str = "") -> None:
        if self._writer is None:
            return
        body = world.robot.proprioception()
        base_pose = body.base_pose
        outside: Picture | None = None
        if hasattr(world, "look_from"):
            T = self._viewpoint(base_pose) if self._viewpoint else self._follow(base_pose)
            size = _RENDERED if self._search is None else OUTSIDE
            outside = cast("Outside", world).look_from(T, size).rgb
        sides = [camera for camera in robot_named(body.robot).cameras if camera != "head"]
        caption = Caption(
            title=self._title,
            status=status,
            tree=tree_lines(tree.spec, tree.states(), COLUMNS, fold=True, unicode=True),
            instruction=tree.spec.instruction,
            wrists={side: world.robot.look(side).rgb for side in sides},
            answers=_answers(tree),
            at=at,
        )
        if self._search is not None:
            frame = self._search.frame(outside, world, caption)
        else:
            frame = compose(outside, world.robot.look("head").rgb, caption)
        self._frame = frame
        self._write(frame)

    def _show(self, card: Picture | None, for_s: float) -> None:
        """A card, if there is one, for so long."""
        for _ in range(round(self._fps * for_s) if card is not None else 0):
            self._write(card)

    def _write(self, frame: Picture | None) -> None:
        if self._writer is None:
            return
        try:
            self._writer.send(frame)
        except OSError:
            self._writer = None
            self._tell(f"{self._file}: the film breaks off here, as ffmpeg cannot write it; is the disk full?")


def has_index(file: Path) -> bool:
    """Whether an mp4 has the index (`moov`) that players need, and is as long as its parts say."""
    with contextlib.suppress(OSError, struct.error), file.open("rb") as stream:
        length, at, found = file.stat().st_size, 0, False
        while at < length:
            stream.seek(at)
            size, kind = struct.unpack(">I4s", stream.read(8))
            if size == 1:
                (size,) = struct.unpack(">Q", stream.read(8))
            found = found or kind == b"moov"
            at += size or length - at
        return found and at == length
    return False


def _answers(tree: Tree) -> list[str]:
    """The checker's last answers: trigger, question and reply."""
    context = getattr(tree, "context", None)  # none where setup failed
    queries = context.log.queries[-_ANSWERS:] if context else []
    return [f"{query.time_s:.1f} s, {answer(query)}" for query in queries]


def _doing(tree: Tree) -> str:
    """Feedback of the deepest running node, too long for its own line."""
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


def compose(outside: Picture | None, head: Picture, caption: Caption) -> Picture:
    """One frame: the outside view large on the left, the head's view and the tree's text beside it.

    Below the outside view stand q or the time, what the robot was told, and what its wrist cameras see.

    Args:
        outside: (H, W, 3) RGB, or None where there is no such view: the head's takes its place.
        head: (H, W, 3) RGB.
        caption: All else.

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
    write_tree(frame, caption, _OUTSIDE[0] + 8, top, SIZE[1])
    show_wrists(frame, caption.wrists, _OUTSIDE[0], SIZE[1])
    head_line = "   ".join(filter(None, (*caption.status[:1], caption.title)))
    cv2.putText(frame, plain(head_line), (12, _OUTSIDE[1] + 28), cv2.FONT_HERSHEY_SIMPLEX, 0.65, INK, 2, cv2.LINE_AA)
    room = _OUTSIDE[0] - WRIST[0] * len(caption.wrists) - 24
    said = [(line, INK) for text in caption.status[1:] for line in wrapped(text, room, 1)]
    said += [(line, INK) for text in caption.answers[-1:] for line in wrapped(text, room, 1)]
    said += [(line, DIM) for line in wrapped(caption.instruction, room, 4 - len(said))]
    for k, (line, ink) in enumerate(said):
        write(frame, line, (12, _OUTSIDE[1] + 50 + 18 * k), ink)
    return frame
