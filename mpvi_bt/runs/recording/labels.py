"""Text on a picture, placed so that no two texts cover one another."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

Picture = NDArray[np.uint8]
Color = tuple[int, int, int]
Rectangle = tuple[int, int, int, int]  # left, top, right, bottom [px]


class Labels:
    """Writes names beside things; a name without free space is left out.

    Attributes:
        taken: Where nothing may be written any more.
    """

    def __init__(self, picture: Picture, size: float = 0.42) -> None:
        """Nothing is written yet.

        Args:
            picture: (H, W, 3) RGB, written on in place.
            size: Of the letters, as OpenCV counts it: 1 is 22 px for a capital.
        """
        import cv2

        self._cv, self._picture, self._size = cv2, picture, size
        self._thick = max(1, round(1.8 * size))
        self.taken: list[Rectangle] = []

    def beside(self, rectangle: Rectangle, text: str, ink: Color, paper: Color | None = None) -> bool:
        """Write beside a thing, or within it if there is no room beside it.

        Args:
            rectangle: Where the thing is.
            text: ASCII; OpenCV has no more letters.
            ink: Color of the letters.
            paper: Color of a box behind them; None: none.

        Returns:
            Whether there was room.
        """
        (width, height), below = self._cv.getTextSize(text, self._cv.FONT_HERSHEY_SIMPLEX, self._size, self._thick)
        pad = 1 + self._thick
        size = width + 2 * pad, height + below + 2 * pad
        for left, top in _places(rectangle, size):
            place = left, top, left + size[0], top + size[1]
            if self._is_free(place):
                self.taken.append(place)
                self._write(text, (left + pad, top + pad + height), place, ink, paper)
                return True
        return False

    def _is_free(self, place: Rectangle) -> bool:
        left, top, right, bottom = place
        height, width = self._picture.shape[:2]
        if left < 0 or top < 0 or right > width or bottom > height:
            return False
        return all(right <= a or c <= left or bottom <= b or d <= top for a, b, c, d in self.taken)

    def _write(self, text: str, at: tuple[int, int], place: Rectangle, ink: Color, paper: Color | None) -> None:
        font = self._cv.FONT_HERSHEY_SIMPLEX
        if paper is not None:
            self._cv.rectangle(self._picture, place[:2], (place[2] - 1, place[3] - 1), paper, -1)
        self._cv.putText(self._picture, text, at, font, self._size, ink, self._thick, self._cv.LINE_AA)


def _places(around: Rectangle, size: tuple[int, int]) -> Iterator[tuple[int, int]]:
    """Upper left corners for a text of that size, the best first: above, right, left, below, then within."""
    left, top, right, bottom = around
    width, height = size
    middle_u, middle_v = (left + right - width) // 2, (top + bottom - height) // 2
    yield left, top - height
    yield right, middle_v
    yield left - width, middle_v
    yield left, bottom
    yield right - width, top - height
    yield right - width, bottom
    yield left, top
    yield middle_u, middle_v
