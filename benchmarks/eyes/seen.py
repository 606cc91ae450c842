"""What eyes see in labeled pictures, counted: things found and missed, segments right and false, pixels by kind."""

from __future__ import annotations

import time
from collections import Counter, defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from mpvi_bt.finding.eyes.picture_file import LabeledPicture
from mpvi_bt.finding.eyes.segment_overlaps import OVERLAP, overlaps, without_labels
from mpvi_bt.finding.eyes.tiles import cover_of
from mpvi_bt.finding.perception.segments import Segmenter, Segments

LEAST_PX = 10  # things of fewer pixels do not count
SIZES = (10, 50, 200, 800)  # bins of area begin there [px]


@dataclass(frozen=True)
class SeenThing:
    """A thing in a picture, and whether it was found.

    Attributes:
        kind, drawn: As of `LabeledPicture`.
        area: [px].
        outlined: Whether a segment of any kind shares half of the union with it,
        found: and whether one of its own kind does.
    """

    kind: str
    drawn: str
    area: int
    outlined: bool
    found: bool


@dataclass(frozen=True)
class SeenSegment:
    """A segment, and whether it is right.

    Attributes:
        kind, score, area: As of `Segments`; [px].
        right: Whether it shares half of the union with a thing of its kind.
        outlines: Whether with a thing of any kind.
    """

    kind: str
    score: float
    area: int
    right: bool
    outlines: bool


@dataclass
class Seen:
    """Counts over pictures.

    Attributes:
        things, segments: All of them.
        both, either: Pixels by kind that are both seen and true, and that are either.
        ms: Processor time of each picture.
        shares: Of each picture, the part of its things and segments that are right.
    """

    things: list[SeenThing] = field(default_factory=list)
    segments: list[SeenSegment] = field(default_factory=list)
    both: Counter[str] = field(default_factory=Counter)
    either: Counter[str] = field(default_factory=Counter)
    ms: list[float] = field(default_factory=list)
    shares: list[float] = field(default_factory=list)

    @property
    def mean_overlap(self) -> float:
        """Mean over kinds of the part of their union that seen and true pixels share (mIoU)."""
        return float(np.mean([self.both[kind] / count for kind, count in self.either.items() if self.true[kind]]))

    @property
    def true(self) -> Counter[str]:
        """How many things there are of each kind."""
        return Counter(thing.kind for thing in self.things)

    def by_kind(self) -> dict[str, tuple[int, int, int, int]]:
        """Of each kind: things, those found, segments, those right; the most frequent first."""
        out: dict[str, list[int]] = defaultdict(lambda: [0, 0, 0, 0])
        for thing in self.things:
            out[thing.kind][0] += 1
            out[thing.kind][1] += thing.found
        for segment in self.segments:
            out[segment.kind][2] += 1
            out[segment.kind][3] += segment.right
        order = sorted(out, key=lambda kind: (-out[kind][0], kind))
        return {kind: (out[kind][0], out[kind][1], out[kind][2], out[kind][3]) for kind in order}


def is_movable(kind: str) -> bool:
    """Whether a kind is of things that are moved."""
    return cover_of(kind) == 2


def look_at_all(eyes: Segmenter, pictures: Iterable[LabeledPicture]) -> Seen:
    """What eyes see in pictures."""
    seen = Seen()
    for picture in pictures:
        image = without_labels(picture)
        began = time.process_time()
        segments = eyes.segment(image)
        seen.ms.append(1000 * (time.process_time() - began))
        _count(seen, segments, picture)
    return seen


def _count(seen: Seen, segments: Segments, picture: LabeledPicture) -> None:
    shared = overlaps(segments.labels, len(segments.kinds), picture.labels, len(picture.kinds))
    good = shared >= OVERLAP
    alike = np.array([[a == b for b in picture.kinds] for a in segments.kinds], bool).reshape(good.shape)
    areas = np.bincount(picture.labels.ravel(), minlength=len(picture.kinds) + 1)[1:]
    right = []
    for k, (kind, drawn) in enumerate(zip(picture.kinds, picture.drawn, strict=True)):
        if areas[k] >= LEAST_PX:
            found = bool((good[:, k] & alike[:, k]).any())
            seen.things.append(SeenThing(kind, drawn, int(areas[k]), bool(good[:, k].any()), found))
            right.append(found)
    own = np.bincount(segments.labels.ravel(), minlength=len(segments.kinds) + 1)[1:]
    for k, kind in enumerate(segments.kinds):
        true = bool((good[k] & alike[k]).any())
        score = float(segments.scores[k])
        seen.segments.append(SeenSegment(kind, score, int(own[k]), true, bool(good[k].any())))
        right.append(true)
    names = ["", *sorted({*segments.kinds, *picture.kinds})]
    told, due = (
        np.array([0, *(names.index(kind) for kind in kinds)])[labels]
        for kinds, labels in ((segments.kinds, segments.labels), (picture.kinds, picture.labels))
    )
    for k, name in enumerate(names[1:], 1):
        seen.both[name] += int(np.count_nonzero((told == k) & (due == k)))
        seen.either[name] += int(np.count_nonzero((told == k) | (due == k)))
    seen.shares.append(float(np.mean(right)) if right else 1.0)
