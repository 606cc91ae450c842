"""Open-vocabulary detection: where a picture shows what a phrase names."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.perception.knowledge import normalize, whole
from mpvi_bt.robot.protocol import CameraImage

ROBOT = "robot"  # the phrase that finds the robot's own parts
SWITCH = ".switch"  # ends the label of a thing's switch


@dataclass(frozen=True, eq=False)
class Detection:
    """One thing that a phrase names, in one picture. It says nothing of which thing that is in another picture.

    Attributes:
        phrase: As asked for.
        score: Confidence, 0 to 1.
        box: (4,) left, top, right, bottom [px], the last ones exclusive.
        mask: (H, W) bool, its pixels.
    """

    phrase: str
    score: float
    box: NDArray[np.intp]
    mask: NDArray[np.bool_]


class Detector(Protocol):
    """Finds things by phrases.

    Attributes:
        name: As given on the command line.
    """

    name: str

    def detect(self, image: CameraImage, phrases: Sequence[str]) -> list[Detection]:
        """What of `phrases` the picture shows; `ROBOT` finds the robot's own parts, all in one."""
        ...


class LabelDetector:
    """Reads the picture's label channel: the stand-in for an open-vocabulary detector, blind to what the label says.

    It hands out masks by phrase, not names: two cans are two detections of "can", and nothing tells which is which.
    A switch has a label of its own; it is called by its thing, as "switch of the radio".

    Attributes:
        name: "labels".
    """

    name = "labels"

    def __init__(self, vocabulary: Mapping[str, Iterable[str]]) -> None:
        """Take the vocabulary: label of each thing to what people call it."""
        self._called = {label: {normalize(p) for p in phrases} for label, phrases in vocabulary.items()}

    def detect(self, image: CameraImage, phrases: Sequence[str]) -> list[Detection]:
        """As `Detector` says; a picture without labels shows nothing."""
        if image.labels is None:
            return []
        ids: dict[str, list[int]] = {}
        for label in np.unique(image.labels).tolist():
            if label in image.names:
                ids.setdefault(image.names[label], []).append(label)
        found = []
        for phrase in phrases:
            wanted = normalize(phrase)
            if (thing := whole(wanted)) is not None and not any(wanted in names for names in self._called.values()):
                wanted = thing
            for label, own in ids.items():
                if label == ROBOT if phrase == ROBOT else wanted in self._names(label):
                    mask = np.isin(image.labels, own)
                    rows, columns = np.nonzero(mask.any(1))[0], np.nonzero(mask.any(0))[0]
                    box = np.array([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1])
                    found.append(Detection(phrase, 1.0, box, mask))
        return found

    def _names(self, label: str) -> set[str]:
        """What people call what has a label."""
        thing = label.removesuffix(SWITCH)
        called = self._called.get(thing, set())
        return called if thing == label else {switch_of(p) for p in called}


def switch_of(phrase: str) -> str:
    """What the switch of a thing is called."""
    return f"switch of the {normalize(phrase)}"
