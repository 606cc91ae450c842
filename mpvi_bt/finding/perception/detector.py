"""Open-vocabulary detection: finding things in a picture by phrases, and a guard around any detector."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.ground.errors import DetectorError, shown
from mpvi_bt.ground.robot.protocol import CameraImage
from mpvi_bt.ground.words.phrases import normalize

ROBOT = "robot"  # the phrase that finds the robot's own parts
SWITCH = ".switch"  # ends the label of a thing's switch
MOST_DETECTIONS = 10_000  # in one picture: more is a fault
_MOST_HANGS = 3  # a run may wait so often; one that is late with each picture would cost the limit for each


@dataclass(frozen=True, eq=False)
class Detection:
    """A thing in one picture, found by a phrase. It has no identity across pictures.

    Attributes:
        phrase: As asked for.
        score: Confidence, 0 to 1.
        box: (4,) left, top, right, bottom [px], the last ones exclusive.
        mask: (H, W) bool, its pixels, or None from a detector that only draws boxes.
    """

    phrase: str
    score: float
    box: NDArray[np.intp]
    mask: NDArray[np.bool_] | None = None


class Detector(Protocol):
    """Finds things by phrases.

    A detector that remembers earlier pictures may have `save()`, its memory as JSON values, and `restore(saved)`: then
    a stopped run can go on. From afar the places of small things are uncertain. A detector that leaves them out may
    have `near`: the same detector with small things, for hands. Without `knows_robot = True` hands tell the robot's own
    parts by its joints, too.

    Attributes:
        name: As given on the command line.
    """

    name: str

    def detect(self, image: CameraImage, phrases: Sequence[str]) -> list[Detection]:
        """What of `phrases` the picture shows; `ROBOT` finds the robot's own parts, all in one.

        A phrase that names nothing finds nothing. The picture is not changed, and what is returned is the caller's.
        """
        ...


_Answer = tuple[Any, BaseException | None]


class GuardedDetector:
    """A detector around another one, of which nothing is taken on trust.

    Whatever goes wrong in it is a `DetectorError` with a reason that docs/detectors.md lists. It works in a thread of
    its own: one that hangs is left alone, and refused until it has come back; after three times, for good. One that
    says of itself that it is `prompt`, as it waits for nothing, is called right away: on a busy machine a thread is
    waited for long.

    Attributes:
        name: The other one's.
        knows_robot: Whether the other one tells every pixel of the robot.
        note: What it wants to be printed, in one line, such as the mistakes it is told to make; "" if nothing.
    """

    def __init__(self, detector: Detector, limit_s: float = 60.0) -> None:
        """Guard `detector`.

        Args:
            detector: Any.
            limit_s: Wall time that it may take for a picture. Our choice: far more than any needs, since how fast a
                machine is must not change what an episode does.
        """
        self._detector, self._limit_s = detector, limit_s
        self._work: queue.SimpleQueue[tuple[CameraImage, Sequence[str]]] = queue.SimpleQueue()
        self._done: queue.SimpleQueue[_Answer] = queue.SimpleQueue()
        self._thread: threading.Thread | None = None
        self._hangs, self._hung = False, 0
        self._prompt = getattr(detector, "prompt", False) is True
        self.name = str(getattr(detector, "name", type(detector).__name__))
        self.note = str(getattr(detector, "note", ""))
        self.knows_robot = getattr(detector, "knows_robot", False) is True

    def detect(self, image: CameraImage, phrases: Sequence[str]) -> list[Detection]:
        """As `Detector` says.

        Raises:
            DetectorError: It raised, hangs, or answered what is no detection in this picture.
        """
        found, error = self._ask(image, tuple(phrases)) if self._prompt else self._wait(image, tuple(phrases))
        if isinstance(error, DetectorError):
            raise error
        if error is not None:
            raise DetectorError("raised", f"detector {self.name}: {type(error).__name__}: {error}") from error
        if not isinstance(found, list | tuple):
            raise DetectorError("bad_answer", f"detector {self.name} answered no list: {shown(found)}")
        if len(found) > MOST_DETECTIONS:
            raise DetectorError("bad_answer", f"detector {self.name} found {len(found)} things in one picture")
        for detection in found:
            check_detection(detection, image, phrases, f"detector {self.name}")
        return list(found)

    @property
    def near(self) -> GuardedDetector:
        """One like it for hands, where the other one has one; else itself."""
        near = getattr(self._detector, "near", self._detector)
        return self if near is self._detector else GuardedDetector(near, self._limit_s)

    def save(self) -> dict[str, Any]:
        """State of the inner detector from picture to picture, as JSON values."""
        return dict(getattr(self._detector, "save", dict)())

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Have it go on from there. Raises KeyError, TypeError or ValueError if that is not as it writes it."""
        getattr(self._detector, "restore", dict)(saved)

    def _ask(self, image: CameraImage, phrases: Sequence[str]) -> _Answer:
        try:
            return self._detector.detect(image, phrases), None
        except Exception as error:
            return None, error

    def _wait(self, image: CameraImage, phrases: Sequence[str]) -> _Answer:
        """What it answers from its thread, within the limit."""
        if self._hung >= _MOST_HANGS:
            raise DetectorError("hangs", f"detector {self.name} was late {self._hung} times: it is asked no more")
        if self._hangs and self._done.empty():
            raise DetectorError("hangs", f"detector {self.name} has not come back from an earlier picture")
        if self._hangs:
            self._done.get()  # what it found is of a picture long past
            self._hangs = False
        if self._thread is None:
            # a daemon: one that never comes back must not keep the process from ending
            self._thread = threading.Thread(target=self._serve, daemon=True, name=f"detector {self.name}")
            self._thread.start()
        self._work.put((image, phrases))
        try:
            return self._done.get(timeout=self._limit_s)
        except queue.Empty:
            self._hangs, self._hung = True, self._hung + 1
            message = f"detector {self.name} has found nothing and said nothing for {self._limit_s:g} s"
            raise DetectorError("hangs", message) from None

    def _serve(self) -> None:
        while True:
            image, phrases = self._work.get()
            try:
                answer = self._ask(image, phrases)
            except BaseException as error:
                answer = (None, error)
            self._done.put(answer)


def check_detection(given: Any, image: CameraImage, phrases: Sequence[str], where: str) -> None:
    """Refuse what is no detection of one of `phrases` in a picture.

    Raises:
        DetectorError: What is wrong with it, after `where`.
    """

    def refuse(unless: bool, reason: str, what: Callable[[], str]) -> None:
        if not unless:
            raise DetectorError(reason, f"{where}: {what()}")

    refuse(isinstance(given, Detection), "bad_answer", lambda: f"{shown(given)} is no Detection")
    refuse(given.phrase in phrases, "bad_phrase", lambda: f"{shown(given.phrase)} was not asked for")
    score = given.score
    good = isinstance(score, int | float | np.number) and bool(0 <= score <= 1)
    refuse(good, "bad_score", lambda: f"the score of {shown(given.phrase)} is {score!r:.40}, not 0 to 1")
    height, width = image.depth.shape
    box = given.box
    refuse(
        isinstance(box, np.ndarray) and box.shape == (4,) and box.dtype.kind in "iu",
        "bad_box",
        lambda: f"the box of {shown(given.phrase)} is {box!r:.60}, not an array of four whole numbers",
    )
    left, top, right, bottom = box.tolist()
    refuse(
        0 <= left < right <= width and 0 <= top < bottom <= height,
        "bad_box",
        lambda: f"the box of {shown(given.phrase)}, {box.tolist()}, is empty or not within {width}x{height} pixels",
    )
    mask = given.mask
    if mask is None:
        return
    refuse(
        isinstance(mask, np.ndarray) and mask.dtype == bool and mask.shape == (height, width),
        "bad_mask",
        lambda: f"the mask of {shown(given.phrase)} is not ({height}, {width}) bool",
    )
    refuse(bool(mask.any()), "bad_mask", lambda: f"the mask of {shown(given.phrase)} is empty")


def switch_of(phrase: str) -> str:
    """Name of a thing's switch."""
    return f"switch of the {normalize(phrase)}"
