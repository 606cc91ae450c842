"""The `segmentation` detector: reads the label channel of a rendered picture, and errs where it is asked to."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mpvi_bt.finding.perception.detector import ROBOT, SWITCH, Detection, switch_of
from mpvi_bt.finding.perception.labeled_pixels import LabeledPixels, visible
from mpvi_bt.ground.robot.protocol import CameraImage
from mpvi_bt.ground.words.phrases import Vocabulary, read
from mpvi_bt.ground.words.sizes import Mistakes

NAME = "segmentation"
LEAST_PX = 20
LOWEST_SCORE = 0.35  # of a detector that confuses: the usual threshold of Grounding DINO


@dataclass(frozen=True)
class DetectionErrors(Mistakes):
    """How often and how far the detector errs; 0 switches a mistake off.

    The robot's own parts are never mistaken. Our choice: draws of one picture say nothing of the next one.

    Attributes:
        miss: Probability that a thing that a picture shows is not seen.
        confuse: Probability that a phrase is seen in something that it does not name: false detections a picture and
            phrase, if there is anything else in view. Scores, else 1, then tell a little: they are drawn from
            `LOWEST_SCORE` to 1, where the density of right ones rises linearly and that of false ones falls.
        jitter: Standard deviation of each edge of a box [px]; its mask is stretched along.
    """

    MOST = {"miss": 1.0, "confuse": 1.0, "jitter": 50.0}
    EXAMPLE = "miss=0.1,confuse=0.05,jitter=2"

    miss: float = 0.0
    confuse: float = 0.0
    jitter: float = 0.0

    def __str__(self) -> str:
        """One line for a person."""
        return f"misses {self.miss:.1%}, confuses {self.confuse:.1%}, edges off by {self.jitter:g} px"


NO_ERRORS = DetectionErrors()


class SegmentationDetector:
    """Reads the picture's label channel: the stand-in for an open-vocabulary detector, blind to what the label says.

    It hands out masks by phrase, not names: two cans are two detections of "can", and nothing tells which is which.
    Only visible pixels count. A switch has a label of its own; it is called by its thing, as "switch of the radio".

    The mistakes follow from the seed and from how many pictures came before: the same pictures in the same order have
    the same ones. What is missed and where things are drawn does not depend on what is asked for.

    Attributes:
        name: "segmentation", with its errors' address if they are on.
        note: One line on the errors to be printed; "" if they are off.
        prompt: It waits for nothing; see `Guarded`.
        knows_robot: Labels tell every pixel of the robot.
    """

    prompt = True
    knows_robot = True

    def __init__(
        self,
        vocabulary: Mapping[str, Iterable[str]],
        least_px: int = LEAST_PX,
        errors: DetectionErrors = NO_ERRORS,
        seed: int = 0,
    ) -> None:
        """Take the vocabulary.

        Args:
            vocabulary: Label of each thing to what people call it.
            least_px: A thing of fewer visible pixels is not seen. Its default is measured, see docs/detectors.md.
            errors: Mistakes to make.
            seed: Of the mistakes.
        """
        self._given = vocabulary
        called = {label: list(phrases) for label, phrases in vocabulary.items()}
        switches = {label + SWITCH: [switch_of(p) for p in phrases] for label, phrases in called.items()}
        self._vocabulary = Vocabulary({**called, **switches})
        self._least_px, self._errors, self._seed = least_px, errors, seed
        self._pictures = 0
        self.name = f"{NAME}:{errors.address}" if errors.address else NAME
        self.note = f"detector {NAME} errs on purpose: {errors}, seed {seed}" if errors.address else ""

    def detect(self, image: CameraImage, phrases: Sequence[str]) -> list[Detection]:
        """As `Detector` says; a picture without labels shows nothing."""
        rng = np.random.default_rng([self._seed, self._pictures]) if self.note else None
        self._pictures += 1
        if image.labels is None:
            return []
        size = image.labels.shape
        meant = {phrase: {ROBOT} if phrase == ROBOT else set(self._vocabulary.named(phrase)) for phrase in phrases}
        # Whoever errs may take for a phrase whatever is in view.
        names = set(image.names.values()) if rng is not None else set().union(*meant.values())
        things = visible(image.labels, image.names, names, self._least_px)
        if rng is not None:
            things = [t for thing in things if (t := self._mistaken(thing, size, rng)) is not None]
        found = []
        for phrase, labels in meant.items():
            own = [thing for thing in things if thing.label in labels]
            if rng is not None and phrase != ROBOT and read(phrase) is not None:
                others = [thing for thing in things if thing.label not in (*labels, ROBOT)]
                own += self._confused(others, rng)
            found += [Detection(phrase, thing.score, thing.box.copy(), thing.spread(size)) for thing in own]
        return found

    @property
    def near(self) -> SegmentationDetector:
        """One without a least size; the same one if it errs, since mistakes follow from the pictures before."""
        return self if self.note else SegmentationDetector(self._given, least_px=1)

    def save(self) -> dict[str, int]:
        """How many pictures there were: the mistakes in the next one depend on that."""
        return {"pictures": self._pictures}

    def restore(self, saved: Mapping[str, int]) -> None:
        """Go on after as many. Raises KeyError, TypeError or ValueError if that is not as `save` writes it."""
        self._pictures = int(saved["pictures"])

    def _mistaken(self, thing: LabeledPixels, size: tuple[int, ...], rng: np.random.Generator) -> LabeledPixels | None:
        """A thing as it seems to be, or None if it is missed. Each takes as many draws as any other."""
        missed, rank = rng.random(2)
        edges = rng.normal(0.0, self._errors.jitter, 4)
        if thing.label == ROBOT:
            return thing
        if missed < self._errors.miss:
            return None
        score = LOWEST_SCORE + (1.0 - LOWEST_SCORE) * float(np.sqrt(rank)) if self._errors.confuse else 1.0
        moved = thing.stretched(edges, size) if self._errors.jitter else thing
        return None if moved is None else replace(moved, score=score)

    def _confused(self, others: Sequence[LabeledPixels], rng: np.random.Generator) -> list[LabeledPixels]:
        """A false detection of a phrase on one of the `others`, or none."""
        confused, which, rank = rng.random(3)
        if confused >= self._errors.confuse or not others:
            return []
        score = 1.0 - (1.0 - LOWEST_SCORE) * float(np.sqrt(rank))
        return [replace(others[int(which * len(others))], score=score)]
