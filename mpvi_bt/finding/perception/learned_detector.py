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

    def __init__(
        self, eyes: Eyes, least_px: int = LEAST_PX, least_score: float = LEAST_SCORE, expects: bool = False
    ) -> None:
        """See through `eyes`.

        Args:
            eyes: May be shared.
            least_px: A thing of fewer pixels is not seen.
            least_score: Nor is one of a lower score, but for the robot's own parts.
            expects: Whether what it is asked for is likely to be there. In a search it is not.
        """
        self._eyes, self._least_px, self._least_score, self._expects = eyes, least_px, least_score, expects

    @property
    def near(self) -> LearnedDetector:
        """One without a least size, through the same eyes, for hands: they are where the things are that they ask for.

        It is to be surer, as they believe all that is detected.
        """
        return LearnedDetector(self._eyes, 1, SURE, expects=True)

    def detect(self, image: CameraImage, phrases: Sequence[str]) -> list[Detection]:
        """As `Detector` says; scores are the network's, of several parts of the robot the best."""
        asked = {phrase: self._eyes.meant(phrase) for phrase in phrases}
        seen, things = self._eyes.see(image, set().union(*asked.values()) if self._expects else ())
        assert seen.labels is not None
        things = [thing for thing in things if thing.score >= self._least_score or thing.kind == ROBOT]
        scores: dict[str, float] = {}
        for thing in things:
            scores[thing.name] = max(thing.score, scores.get(thing.name, 0.0))
        found = []
        for phrase in phrases:
            meant = {thing.name for thing in things if thing.kind in asked[phrase]}
            for shown in visible(seen.labels, seen.names, meant, self._least_px):
                score = float(np.clip(scores[shown.label], 0.0, 1.0))
                found.append(Detection(phrase, score, shown.box, shown.spread(seen.labels.shape)))
        return found
