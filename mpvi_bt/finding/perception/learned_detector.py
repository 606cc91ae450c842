"""The `learned` detector: things that a network sees in the colors and the depth of a picture."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mpvi_bt.finding.perception.detector import ROBOT, Detection
from mpvi_bt.finding.perception.labeled_pixels import visible
from mpvi_bt.finding.perception.segmentation import LEAST_PX
from mpvi_bt.finding.perception.shared_eyes import SURE, Eyes
from mpvi_bt.ground.robot.protocol import CameraImage

LEAST_SCORE = 0.2  # our choice: who searches believes little of what scores low, until it is seen again


class LearnedDetector:
    """Finds the segments whose kind a phrase means. It reads no labels of a picture.

    Attributes:
        name: "learned".
        prompt: It waits for nothing; see `GuardedDetector`.
    """

    name = "learned"
    prompt = True

    def __init__(self, eyes: Eyes, least_px: int = LEAST_PX, least_score: float = LEAST_SCORE) -> None:
        """See through `eyes`.

        Args:
            eyes: May be shared.
            least_px: A thing of fewer pixels is not seen.
            least_score: Nor is one of a lower score, but for the robot's own parts.
        """
        self._eyes, self._least_px, self._least_score = eyes, least_px, least_score

    @property
    def near(self) -> LearnedDetector:
        """One without a least size, through the same eyes; it is to be surer, as hands believe all that is detected."""
        return LearnedDetector(self._eyes, 1, SURE)

    def detect(self, image: CameraImage, phrases: Sequence[str]) -> list[Detection]:
        """As `Detector` says; scores are the network's, of several parts of the robot the best."""
        seen, things = self._eyes.see(image)
        assert seen.labels is not None
        things = [thing for thing in things if thing.score >= self._least_score or thing.kind == ROBOT]
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
