"""Common parts of film frames: size, lines of text, fonts."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from mpvi_bt.executive.drawing.symbols import MARKS, Standing, legend
from mpvi_bt.executive.drawing.text import Line, left_out, window
from mpvi_bt.runs.recording.frame_icons import ICONS, draw_icon
from mpvi_bt.runs.recording.labels import Color, Picture

SIZE = (1280, 720)  # of a frame: width, height
PAPER: Color = (24, 26, 32)
INK: Color = (226, 228, 232)
DIM: Color = (140, 146, 158)
COLUMNS, LINE_PX = 59, 15  # of the tree's text
WRIST = (160, 120)  # picture of a wrist camera
INKS: Mapping[Standing, Color] = {  # what is idle is dim
    name: (int(mark.dark[1:3], 16), int(mark.dark[3:5], 16), int(mark.dark[5:7], 16))
    for name, mark in MARKS.items()
    if name != "idle"
}
LEGEND = (legend(unicode=True), "→ sequence  ? selector  * remembers which child ran  ⇉ parallel  ◇ decorator")
BAR: Color = (32, 84, 128)  # behind the node in force
PITCH_PX = 7.8  # of a letter


@dataclass(frozen=True)
class Caption:
    """What a frame tells besides its large pictures.

    Attributes:
        title: Of the episode.
        status: A line each, the first large: the time, or at the end q.
        tree: How it stands, a line a node.
        instruction: What the robot was told.
        wrists: What the wrist cameras see, by side.
        answers: The checker's last, a line each, the newest last.
        at: Path of the node that is drawn as the one in force, or "".
    """

    title: str = ""
    status: Sequence[str] = ()
    tree: Sequence[Line] = ()
    instruction: str = ""
    wrists: Mapping[str, Picture] = field(default_factory=dict)
    answers: Sequence[str] = ()
    at: str = ""


def plain(text: str) -> str:
    """The text in letters that OpenCV has, and icons."""
    return "".join(character if character.isascii() or character in ICONS else "?" for character in text)


def wrapped(text: str, width_px: float, lines: int) -> list[str]:
    """The text in so many lines at most."""
    columns = int(width_px / PITCH_PX)
    return textwrap.wrap(plain(text), columns, max_lines=lines, placeholder=" ...") if text else []


def write_tree(frame: Picture, caption: Caption, left: int, top: int, bottom: int) -> None:
    """Write the tree's lines from `top` down to `bottom`, the node in force on a bar of its color.

    Of a tree that is too long its root and the lines about what runs are shown; the others are counted.
    """
    room = (bottom - top) // LINE_PX - 1
    shown = list(caption.tree)
    if len(shown) > room:
        root, rest = shown[0], shown[1:]
        first, last = window(rest, room - 2)
        shown = [root, *rest[first:last], Line("", None, left_out(first, last, len(rest)), "", "")]
    for i, line in enumerate(shown):
        ink = INK if i == 0 else DIM
        ink = INKS.get(line.standing, ink) if line.standing else ink
        y = top + (i + 1) * LINE_PX
        if line.path and line.path == caption.at:
            frame[y - LINE_PX + 4 : y + 4, left - 4 : left + round(COLUMNS * PITCH_PX)] = BAR
            ink = INK
        write(frame, plain(line.text), (left, y), ink)


def write_answers(frame: Picture, answers: Sequence[str], left: int, bottom: int, width: int) -> None:
    """Write each on a line, up from `bottom`; the newest, which is the lowest, stands out."""
    for k, answer in enumerate(reversed(answers)):
        for line in wrapped(answer, width, 1):
            write(frame, line, (left, bottom - k * LINE_PX), DIM if k else INK)


def show_wrists(frame: Picture, wrists: Mapping[str, Picture], right: int, bottom: int) -> None:
    """The wrist cameras' pictures side by side, their lower right corner there, each with its side."""
    import cv2

    width, height = WRIST
    left = right - width * len(wrists)
    for side, picture in wrists.items():
        part = frame[bottom - height : bottom, left : left + width]
        part[:] = cv2.resize(picture, WRIST, interpolation=cv2.INTER_AREA)
        cv2.rectangle(part, (0, 0), (8 + round(PITCH_PX * len(side)), 16), PAPER, -1)
        write(part, side, (4, 12), INK)
        left += width


def write(frame: Picture, text: str, at: tuple[int, int], color: Color, scale: float = 1.0) -> None:
    """Write `text` at column and row `at` in cells of one width, as a tree needs; OpenCV has no such font."""
    import cv2

    font, size, pitch_px, thick = cv2.FONT_HERSHEY_SIMPLEX, 0.45 * scale, PITCH_PX * scale, max(1, round(0.8 * scale))
    for k, character in enumerate(text):
        if character in ICONS:
            draw_icon(frame, character, (at[0] + k * pitch_px, at[1]), (pitch_px, LINE_PX * scale), color, scale)
        elif character != " ":
            width = cv2.getTextSize(character, font, size, thick)[0][0]
            place = round(at[0] + k * pitch_px + (pitch_px - width) / 2), at[1]
            cv2.putText(frame, character, place, font, size, color, thick, cv2.LINE_AA)
