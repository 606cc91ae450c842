"""What frames of films have in common: their size, and how text is written on them."""

from __future__ import annotations

from mpvi_bt.executive.labels import Color, Picture

SIZE = (1280, 720)  # of a frame: width, height
PAPER: Color = (24, 26, 32)
INK: Color = (226, 228, 232)
DIM: Color = (140, 146, 158)
COLUMNS, LINE_PX = 59, 15  # of the tree's text
_STATUS_INK: dict[str, Color] = {
    "[*]": (120, 200, 255),
    "[o]": (130, 210, 140),
    "[x]": (255, 120, 110),
    "[!]": (255, 190, 90),
}


def write_tree(frame: Picture, text: str, left: int, top: int) -> None:
    """Write a tree's lines from there on down to the frame's end; those that do not fit are left out, and counted."""
    lines = text.splitlines()
    room = (frame.shape[0] - top) // LINE_PX - 1
    if len(lines) > room:
        lines = [*lines[: room - 1], f"... {len(lines) - room + 1} more lines"]
    for i, line in enumerate(lines):
        color = next((ink for mark, ink in _STATUS_INK.items() if mark in line), INK if i == 0 else DIM)
        write(frame, line, (left, top + (i + 1) * LINE_PX), color)


def write(frame: Picture, text: str, at: tuple[int, int], color: Color, pitch_px: float = 7.8) -> None:
    """Write `text` at column and row `at` in cells of one width, as a tree needs; OpenCV has no such font."""
    import cv2

    font, size = cv2.FONT_HERSHEY_SIMPLEX, 0.45
    for k, character in enumerate(text):
        if character != " ":
            width = cv2.getTextSize(character, font, size, 1)[0][0]
            place = round(at[0] + k * pitch_px + (pitch_px - width) / 2), at[1]
            cv2.putText(frame, character, place, font, size, color, 1, cv2.LINE_AA)
