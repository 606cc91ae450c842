"""Frames of a film of a search: the head's picture with what was detected in it, and the map."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

import numpy as np

from mpvi_bt.executive.ticking.loop import World
from mpvi_bt.finding.perception.detector import Detection
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import CameraImage
from mpvi_bt.ground.robot.robots import robot_named
from mpvi_bt.runs.recording import search_colors as colors
from mpvi_bt.runs.recording.frame_text import (
    INK,
    LINE_PX,
    PAPER,
    SIZE,
    WRIST,
    Caption,
    show_wrists,
    wrapped,
    write,
    write_answers,
    write_tree,
)
from mpvi_bt.runs.recording.labels import Color, Labels, Picture
from mpvi_bt.runs.recording.map_picture import MapPicture
from mpvi_bt.runs.recording.search_view import Head, SearchView, called, found, seen_m2

_VIEW = (400, 300)  # from outside, upper left; of the head, beside it
OUTSIDE = _VIEW  # the size that is rendered
_MAP = (800, 364)  # lower left; below it the checker's answers
_NEWS_PX = 18  # from line to line of what is told in the right column, over the tree


class SearchFrames:
    """Composes the frames; it keeps the way so far."""

    def __init__(self, view: SearchView) -> None:
        """Draw what `view` says when a frame is asked for."""
        self._view, self._map = view, MapPicture(_MAP)
        self._paper = np.full((SIZE[1], SIZE[0], 3), PAPER, np.uint8)
        self._way: list[Array] = []
        self._eye = Head(view)
        self._inks: dict[str, Color] = {}  # of each phrase, the same in every frame

    def frame(self, outside: Picture | None, world: World, caption: Caption) -> Picture:
        """One frame.

        Args:
            outside: (H, W, 3) RGB, or None where there is no such view.
            world: Where the robot is now.
            caption: Title and status stand over the tree, the instruction over the pictures' lower edge, the checker's
                answers below the map.

        Returns:
            (720, 1280, 3) uint8 RGB.
        """
        import cv2

        frame = self._paper.copy()
        width, height = _VIEW
        if outside is not None:
            frame[:height, :width] = cv2.resize(outside, _VIEW, interpolation=cv2.INTER_AREA)
        image, detections = self._eye.look(world)
        frame[:height, width : 2 * width] = self._head(image, detections)
        felt = world.robot.proprioception()
        self._way.append(felt.base_pose)
        outline = robot_named(felt.robot).base.outline
        frame[height : height + _MAP[1], : _MAP[0]] = self._map.draw(
            self._view, felt.base_pose, outline, self._way, image
        )
        left, top = _MAP[0] + 8, 4
        for text in (*caption.status[:1], caption.title, *caption.status[1:], *self._news()):
            for line in wrapped(text, SIZE[0] - left - 8, 1):
                top += _NEWS_PX
                write(frame, line, (left, top), INK)
        told = wrapped(caption.instruction, 2 * width - 16, 2)
        if told:
            frame[height - 8 - LINE_PX * len(told) : height, : 2 * width] //= 4
        for k, line in enumerate(reversed(told)):
            write(frame, line, (8, height - 6 - LINE_PX * k), INK)
        bottom = SIZE[1] - WRIST[1] * bool(caption.wrists)
        write_tree(frame, caption, left, top + 8, bottom)
        write_answers(frame, caption.answers, 8, SIZE[1] - 8, _MAP[0] - 16)
        show_wrists(frame, caption.wrists, SIZE[0], SIZE[1])
        return frame

    def _head(self, image: CameraImage, detections: Iterable[Detection]) -> Picture:
        """The head's picture with its detections."""
        import cv2

        picture = cv2.resize(image.rgb, _VIEW, interpolation=cv2.INTER_LINEAR).astype(np.uint8)
        self._detections(picture, detections, _VIEW[0] / image.rgb.shape[1])
        return picture

    def _detections(self, picture: Picture, detections: Iterable[Detection], scale: float) -> None:
        """Boxes with phrase and score."""
        import cv2

        labels, boxes = Labels(picture), []
        for detection in detections:
            ink = self._inks.setdefault(detection.phrase, colors.THINGS[len(self._inks) % len(colors.THINGS)])
            left, top, right, bottom = np.round(np.asarray(detection.box) * scale).astype(int).tolist()
            cv2.rectangle(picture, (left - 1, top - 1), (right, bottom), colors.INK, 4)
            boxes.append(((left - 2, top - 2, right + 2, bottom + 2), ink, detection))
        for (left, top, right, bottom), ink, _ in boxes:
            cv2.rectangle(picture, (left + 1, top + 1), (right - 2, bottom - 2), ink, 2)
        for box, ink, detection in boxes:
            labels.beside(box, f"{detection.phrase} {detection.score:.2f}".encode("ascii", "replace").decode(),
                          colors.INK, ink)  # fmt: skip

    def _news(self) -> list[str]:
        """How much floor was seen, and what was found."""
        seen, total = seen_m2(self._view)
        kinds = Counter(called(entry) for entry in found(self._view.entries))
        text = ", ".join(f"{name} x{count}" if count > 1 else name for name, count in kinds.items())
        floor = f"floor seen: {seen:.0f} m2" + (f" of {total:.0f}" if total else "")
        return [floor, f"found: {text or 'nothing yet'}"]
