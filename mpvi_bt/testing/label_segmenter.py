"""A stand-in for a network that cuts pictures into segments: the renderer's labels, kinds in place of identities."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from mpvi_bt.finding.perception.segments import Segments, kind_of
from mpvi_bt.ground.robot.protocol import CameraImage


class LabelSegmenter:
    """Sees each thing that it knows without fail, and does not tell which one it is (implements `Segmenter`).

    A network of pixels can do no better. It is the one segmenter that reads labels: without them it sees nothing.

    Attributes:
        kinds: All that it knows.
        passes: How many pictures it has cut.
    """

    def __init__(self, kinds: Iterable[str]) -> None:
        """Know `kinds`."""
        self.kinds = tuple(kinds)
        self.passes = 0

    def segment(self, image: CameraImage) -> Segments:
        """One segment for each thing of a known kind, with a score of 1; one for all the robot's own parts."""
        self.passes += 1
        if image.labels is None:
            return Segments(np.zeros(image.depth.shape, np.int32), (), np.zeros(0))
        ids, places = np.unique(image.labels, return_inverse=True)
        named = [image.names.get(int(id_), "") for id_ in ids]
        shown = [name for name in dict.fromkeys(named) if kind_of(name) in self.kinds]
        number = {name: k for k, name in enumerate(shown, start=1)}
        table = np.array([number.get(name, 0) for name in named], np.int32)
        labels = table[places].reshape(image.labels.shape)
        return Segments(labels, tuple(map(kind_of, shown)), np.ones(len(shown)))
