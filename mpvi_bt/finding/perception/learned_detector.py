"""The `learned` detector: things that a network sees in the colors and the depth of a picture."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mpvi_bt.finding.perception.detector import Detection
from mpvi_bt.finding.perception.labeled_pixels import visible
from mpvi_bt.finding.perception.segmentation import LEAST_PX
from mpvi_bt.finding.perception.shared_eyes import Eyes
from mpvi_bt.ground.robot.protocol import CameraImage


class LearnedDetector:
    """Finds the segments whose kind a phrase means. It reads no labels of a picture.

    Attributes:
        name: "learned".
        prompt: It waits for nothing; see `GuardedDetector`.
    """

    name = "learned"
    prompt = True

    def __init__(self, eyes: Eyes, least_px: int = LEAST_PX) -> None:
        """See through `eyes`, which may be shared; a thing of fewer pixels than `least_px` is not seen."""
        self._eyes, self._least_px = eyes, least_px

    @property
    def near(self) -> LearnedDetector:
        """One without a least size, through the same eyes."""
        return LearnedDetector(self._eyes, least_px=1)

    def detect(self, image: CameraImage, phrases: Sequence[str]) -> list[Detection]:
        """As `Detector` says; scores are the network's, of several parts of the robot the best."""
        seen, things = self._eyes.see(image)
        assert seen.labels is not None
        scores: dict[str, float] = {}
        for thing in things:
            scores[thing.name] = max(thing.score, scores.get(thing.name, 0.0))
        found = []
        for phrase in phrases:
            kinds = self._eyes.meant(phrase)
            meant = {thing.name for thing in things if thing.kind in kinds}
            for shown in visible(seen.labels, seen.names, meant, self._least_px):
                score = float(np.clip(scores[shown.label], 0.0, 1.0))
                found.append(Detection(phrase, score, shown.box, shown.spread(seen.labels.shape)))
        return found
