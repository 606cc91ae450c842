"""Eyes: the segments of pictures under names, so that detectors and checkers can ask for things by phrase."""

from __future__ import annotations

import threading
from collections import Counter, deque
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mpvi_bt.finding.perception.color_patches import patches
from mpvi_bt.finding.perception.detector import ROBOT, SWITCH, switch_of
from mpvi_bt.finding.perception.parted_things import wholes
from mpvi_bt.finding.perception.segments import SWITCHES, Segmenter, Segments
from mpvi_bt.ground.robot.protocol import CameraImage
from mpvi_bt.ground.words.phrases import Vocabulary

# Our choice.
SURE = 0.5  # least score for hands and checkers: they believe every segment that they get
_KEPT = 4  # pictures whose segments are kept: a robot has three cameras
_RING_PX = 2  # a switch is of the thing that borders on it most within so many pixels


@dataclass(frozen=True, eq=False)
class NamedSegment:
    """A segment under a name.

    Attributes:
        name: In its picture only, such as "can__of__soda.n.01_2", and of pieces of one thing the same; the robot's
            parts are `ROBOT`, and a switch is called by its thing, "radio_receiver.n.01_1.switch".
        kind: As `Segments` has it; of a switch that of its thing, and ".switch".
        label: Its number in the picture's labels.
        score: 0 to 1.
    """

    name: str
    kind: str
    label: int
    score: float


class Eyes:
    """What a network takes pictures to show. All who look at one picture share one pass of the network.

    Words are the catalogue's, by kind: it is not told what things there are in an episode.

    Attributes:
        words: Kind to what people call such things.
    """

    def __init__(
        self, segmenter: Segmenter, words: Mapping[str, Iterable[str]], sizes: Mapping[str, float] | None = None
    ) -> None:
        """See by `segmenter`.

        Args:
            segmenter: Any.
            words: Of its kinds.
            sizes: How long things of a kind are at most [m], of those that can be carried: segments of one kind may be
                pieces of one thing, and patches on it other things.
        """
        self._sizes = dict(sizes or {})
        self.words = {kind: tuple(called) for kind, called in words.items()}
        switches = {kind + SWITCH: [switch_of(p) for p in called] for kind, called in self.words.items()}
        self._vocabulary = Vocabulary({**self.words, **switches})
        self._segmenter = segmenter
        self._seen: deque[tuple[NDArray[np.uint8], Segments]] = deque(maxlen=_KEPT)
        self._lock = threading.Lock()  # each client of a server has a thread of its own

    def see(
        self, image: CameraImage, expected: Collection[str] = (), held: NDArray[np.bool_] | None = None
    ) -> tuple[CameraImage, list[NamedSegment]]:
        """The picture with the network's labels in place of any that it had, and its segments.

        A picture is the same one as long as its colors are: who looks may have smoothed its depth.

        Args:
            image: Any camera's.
            expected: Kinds that are asked for, which makes them likelier to be there. What is not seen of them may be a
                patch of color on or in what is.
            held: (H, W) pixels of one thing.
        """
        with self._lock:
            segments = next((seen for rgb, seen in self._seen if rgb is image.rgb), None)
        if segments is None:
            segments = self._segmenter.segment(image)
            with self._lock:
                self._seen.append((image.rgb, segments))
        if held is not None:
            segments = segments.expecting(expected, held.astype(np.int32))
        elif expected:
            segments = self._closer(image, segments, {SWITCHES if k.endswith(SWITCH) else k for k in expected})
        things = _named(segments)
        sure = {thing.label: thing.kind for thing in things if thing.score >= SURE}
        called = {thing.label: thing.name for thing in things}
        parted = wholes(replace(image, labels=segments.labels), sure, self._sizes)
        whole_of = {called[piece]: called[whole] for piece, whole in parted.items()}
        things = [replace(thing, name=_renamed(thing.name, whole_of)) for thing in things]
        names = {thing.label: thing.name for thing in things}
        return replace(image, labels=segments.labels, names=names), things

    def _closer(self, image: CameraImage, segments: Segments, expected: Collection[str]) -> Segments:
        """With patches of color within what is surely seen of the expected kinds, if they are taken for the others."""
        seen = segments.expecting(expected)
        sure = {k: kind for k, kind in enumerate(seen.kinds, 1) if seen.scores[k - 1] >= SURE and kind in expected}
        missing = set(expected) - set(sure.values())
        holders = [k for k, kind in sure.items() if kind in self._sizes]
        if not missing or not holders:
            return seen
        found = patches(image.rgb, np.isin(seen.labels, holders))
        if not found.any():
            return seen
        closer = segments.expecting(expected, found)
        wanted = [k for k, kind in enumerate(closer.kinds, 1) if kind in missing and closer.scores[k - 1] >= SURE]
        kept = np.unique(found[np.isin(closer.labels, wanted) & (found > 0)])
        if not len(kept):
            return seen
        number = np.zeros(found.max() + 1, np.int32)
        number[kept] = np.arange(1, len(kept) + 1)
        return segments.expecting(expected, number[found])

    def meant(self, phrase: str) -> set[str]:
        """Kinds that a phrase means, of switches too; none of what no kind is called."""
        return {ROBOT} if phrase == ROBOT else set(self._vocabulary.named(phrase))


def _renamed(name: str, names: Mapping[str, str]) -> str:
    """The new name of a thing, or of its switch."""
    thing = name.removesuffix(SWITCH)
    return names.get(thing, thing) + name[len(thing) :]


def _named(segments: Segments) -> list[NamedSegment]:
    """The segments, numbered by kind in their order."""
    of_kind: Counter[str] = Counter()
    things, switches = [], []
    for label, (kind, score) in enumerate(zip(segments.kinds, segments.scores.tolist(), strict=True), start=1):
        if kind == SWITCHES:
            switches.append((label, score))
            continue
        of_kind[kind] += 1
        name = ROBOT if kind == ROBOT else f"{kind}_{of_kind[kind]}"
        things.append(NamedSegment(name, kind, label, score))
    known = {thing.label: thing for thing in things if thing.kind != ROBOT}
    boxes = ndimage.find_objects(segments.labels, len(segments.kinds)) if switches else []
    for label, score in switches:
        whose = known.get(_around(segments.labels, boxes[label - 1], label, known))
        if whose is not None:
            things.append(NamedSegment(whose.name + SWITCH, whose.kind + SWITCH, label, score))
    return things


def _around(labels: NDArray[np.int32], box: tuple[slice, ...] | None, label: int, known: Iterable[int]) -> int:
    """Which of the `known` labels borders most on a segment; 0 if none does."""
    if box is None:
        return 0
    near = labels[tuple(slice(max(s.start - _RING_PX, 0), s.stop + _RING_PX) for s in box)]
    own = near == label
    ring = near[ndimage.binary_dilation(own, np.ones((3, 3), bool), iterations=_RING_PX) & ~own]
    count = Counter({k: n for k, n in zip(*np.unique(ring, return_counts=True), strict=True) if k in set(known)})
    return int(count.most_common(1)[0][0]) if count else 0
