"""The eyes that detector and checker `learned` share: a network, and the catalogue's words for what it knows."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

from mpvi_bt.finding.perception.shared_eyes import Eyes
from mpvi_bt.house.things.catalogue import Catalogue, load_catalogue
from mpvi_bt.house.things.kind_words import kind_sizes, kind_words
from mpvi_bt.runs.choices.backends import choose


def eyes_by(weights: str = "") -> Eyes:
    """The eyes with a file of weights, by default those that ship: the same ones each time.

    Raises:
        UserError: There is no such file, or it has no weights of such a network.
    """
    return _made(weights, load_catalogue())


def weights_of(detector: str) -> str:
    """The file of weights that a choice of detector names; "" for any but `learned`, or without a file."""
    choice = choose("detector", detector)
    return choice.address if choice.name == "learned" else ""


@lru_cache(maxsize=2)
def _made(weights: str, catalogue: Catalogue) -> Eyes:
    from mpvi_bt.finding.eyes.segmenter import SHIPPED, LearnedSegmenter

    segmenter = LearnedSegmenter.load(Path(weights).expanduser() if weights else SHIPPED)
    return Eyes(segmenter, kind_words(catalogue), kind_sizes(catalogue))
