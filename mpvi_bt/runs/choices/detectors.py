"""Makes the detector that a run chooses, by name or by name and address. Each is imported only when it is made."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from mpvi_bt.finding.perception.detector import Detector, GuardedDetector
from mpvi_bt.runs.choices.backends import choose

Vocabulary = Mapping[str, Iterable[str]]  # label of a picture to what people call it


def make_detector(given: str, vocabulary: Vocabulary, seed: int = 0) -> GuardedDetector:
    """The detector of a name, guarded: what goes wrong in it is a DetectorError.

    Args:
        given: Such as "segmentation", "segmentation:miss=0.1" or "grounding_dino".
        vocabulary: What the labels of pictures stand for.
        seed: Of the mistakes that it is to make.

    Raises:
        UnknownName: There is none of that name.
        UserError: Its address is wrong, or what it needs is not installed.
    """
    return GuardedDetector(choose("detector", given).make(vocabulary=vocabulary, seed=seed))


def segmentation(address: str, vocabulary: Vocabulary, seed: int) -> Detector:
    """Detects things by the labels of rendered pictures.

    With the detector "oracle", places come from the simulator; policies then use this one for their own pictures.
    """
    from mpvi_bt.finding.perception.segmentation import DetectionErrors, SegmentationDetector

    return SegmentationDetector(vocabulary, errors=DetectionErrors.read(address, "detector segmentation"), seed=seed)


def learned(address: str) -> Detector:
    """By a network on colors and depth; the address is the file of its weights."""
    from mpvi_bt.finding.perception.learned_detector import LearnedDetector
    from mpvi_bt.runs.choices.learned_eyes import eyes_by

    return LearnedDetector(eyes_by(address))


def grounding_dino(address: str) -> Detector:
    """By Grounding DINO; the address is its model."""
    from mpvi_bt.finding.perception.grounding_dino import GroundingDinoDetector

    return GroundingDinoDetector(address) if address else GroundingDinoDetector()
