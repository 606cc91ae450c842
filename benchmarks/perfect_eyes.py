"""Eyes that see each kind without fail: how well the detector and the checker `learned` could do at best.

    mpvi run picking_up_trash --method mpvi_pixels --detector benchmarks.perfect_eyes:PerfectDetector \
        --checker benchmarks.perfect_eyes:PerfectChecker

They read the renderer's labels, and take identities off: what is left to lose is what a network mistakes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import lru_cache

from mpvi_bt.finding.perception.detector import ROBOT
from mpvi_bt.finding.perception.learned_checker import LearnedChecker
from mpvi_bt.finding.perception.learned_detector import LearnedDetector
from mpvi_bt.finding.perception.segments import FLOOR, SWITCHES, kind_of
from mpvi_bt.finding.perception.shared_eyes import Eyes
from mpvi_bt.house.things.catalogue import load_catalogue
from mpvi_bt.house.things.kind_words import kind_words
from mpvi_bt.testing.label_segmenter import LabelSegmenter


@lru_cache(maxsize=1)
def _eyes() -> Eyes:
    words = kind_words(load_catalogue())
    return Eyes(LabelSegmenter([*words, SWITCHES, ROBOT]), words)


class PerfectDetector(LearnedDetector):
    """The detector `learned` with such eyes."""

    name = "perfect"
    eyes = "labels"

    def __init__(self) -> None:
        super().__init__(_eyes())


class PerfectChecker(LearnedChecker):
    """The checker `learned` with such eyes."""

    name = "perfect"
    eyes = "labels"

    def __init__(self, vocabulary: Mapping[str, Iterable[str]]) -> None:
        floors = [phrase for label, called in vocabulary.items() if kind_of(label) == FLOOR for phrase in called]
        super().__init__(_eyes(), floors)
