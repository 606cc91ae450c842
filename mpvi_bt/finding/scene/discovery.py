"""Things found in pictures, kept in the knowledge base for later segments (Paper, Navigation appendix).

Detection of all task-relevant objects runs throughout. Which of the known things a picture shows is told by place; what
is seen again is believed more, and less what should be in a picture and is not.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from mpvi_bt.executive.plan.knowledge import Entry, KnowledgeBase, calls
from mpvi_bt.finding.perception.detector import Detection, Detector
from mpvi_bt.finding.perception.located_detections import (
    LocatedDetection,
    Looks,
    covers,
    locate_detections,
    middle_in_sight,
    shows,
)
from mpvi_bt.finding.scene.assignment import NEVER, associated
from mpvi_bt.finding.scene.belief import BELIEF, Belief
from mpvi_bt.finding.scene.carrying import Carrying
from mpvi_bt.ground.errors import DetectorError
from mpvi_bt.ground.geometry.linear_algebra import norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.protocols import Clock
from mpvi_bt.ground.robot.protocol import CameraImage, Proprioception


@dataclass(frozen=True)
class Association:
    """Parameters for matching detections to known things, and for updating their boxes.

    Our choice: depth, joints and odometry of a good robot are off by a third of the gate.
    """

    gate_m: float = 0.10  # boxes with centers nearer than this may show one thing [m]
    gate_per_m: float = 0.05  # growth of the gate per meter of range [ratio]
    unseen_gate_m: float = 0.40  # gate for a thing let go and not seen since [m]; it may have rolled or fallen
    shared: float = 0.25  # boxes that share this part of the smaller one may show one thing [ratio]
    smaller: float = 0.7  # a box this much smaller, within half the gate, may show a part of the other [ratio]
    part_misfit: float = 0.9  # misfit of such a part, 0 to 1
    flat_m: float = 0.02  # least thickness of a box in this comparison [m]
    grows: float = 0.5  # step of a box outward to a new look's faces [ratio]; a look shows a part, hardly ever too much
    shrinks: float = 0.1  # step of a box inward [ratio]
    large_m: float = 0.9  # a thing longer than this, seen from above, is not for carrying [m]


_FIT = Association()


class Discoveries:
    """Fills a knowledge base from pictures of the head camera.

    It knows no names of things, only phrases: what it finds is called "can of soda #2" after the phrase that found it.

    Attributes:
        knowledge: What is known.
        phrases: What is looked for.
        errors: How many pictures the detector failed on.
        last_error: Its last failure, or None.
        detections: What it found in the last picture.
    """

    def __init__(
        self,
        knowledge: KnowledgeBase,
        phrases: Iterable[str],
        detector: Detector,
        clock: Clock,
        belief: Belief = BELIEF,
    ) -> None:
        """Bind the parts.

        Args:
            knowledge: To read and to fill; rooms in it tell in which room a thing is.
            phrases: What to look for.
            detector: Finds it in pictures.
            clock: Simulated time.
            belief: How far the detector is to be believed.
        """
        self.knowledge, self.phrases = knowledge, tuple(dict.fromkeys(phrases))
        self._detector, self._clock, self._belief = detector, clock, belief
        self._carrying = Carrying(knowledge)
        self._numbers: dict[str, int] = {}
        self._looks: defaultdict[str, Looks] = defaultdict(Looks)  # by name
        self.errors = 0
        self.last_error: DetectorError | None = None
        self.detections: Sequence[Detection] = ()

    def feel(self, body: Proprioception) -> list[Array]:
        """Take in one step of proprioception: what the hands hold moves with them. To be called each control step.

        Returns:
            (2, 3) lowest and highest corner of each thing that the hands have just taken, where it was.
        """
        let_go, taken = self._carrying.feel(body)
        for name in let_go:
            self._looks[name].near_m = None
        return taken

    def see(self, image: CameraImage, body: Proprioception) -> list[Entry]:
        """Take in one picture.

        Args:
            image: Taken now.
            body: Felt now.

        Returns:
            The entries of what it shows, new or confirmed. Where the detector fails nothing is learned: the failure is
            counted and remembered.
        """
        self._carrying.move(body)
        try:
            self.detections = self._detector.detect(image, self.phrases)
            seen, unplaced = locate_detections(image, self.detections)
        except DetectorError as error:
            self.detections = ()
            self.errors, self.last_error = self.errors + 1, error
            return []
        entries, new = [], []
        for detection, known in zip(seen, self._associate(seen), strict=True):
            if known is None:
                known = self._discover(detection)
                new.append(known)
            else:
                self._confirm(known, detection)
            looks = self._looks[known.name]
            looks.px_m3 = max(looks.px_m3, detection.px_m3)
            known.seen_s, known.view = self._clock.time_s, body.base_pose.copy()
            entries.append(known)
        self._absorb(entries)
        self._doubt(image, {entry.name for entry in entries}, unplaced)
        self._carrying.adopt(new)
        self._carrying.sort()
        return entries

    # ------------------------------------------------------------------------------------------ association

    def _associate(self, seen: Sequence[LocatedDetection]) -> list[Entry | None]:
        """The entry of each detection, None for a thing that is new."""
        known = [entry for entry in self.knowledge if entry.kind != "room"]
        misfits = np.full((len(seen), len(known)), NEVER)
        for i, detection in enumerate(seen):
            for k, entry in enumerate(known):
                if _alike(entry.phrases, detection.phrases):
                    misfits[i, k] = self._misfit(detection, entry)
        return [None if k is None else known[k] for k in associated(misfits)]

    def _misfit(self, detection: LocatedDetection, entry: Entry) -> float:
        """How badly a detection fits an entry: 0 to 1, or `NEVER`."""
        gate = _FIT.gate_m + _FIT.gate_per_m * detection.range_m
        way = (detection.lowest + detection.highest) / 2 - entry.center
        if entry.source != "prior" and self._looks[entry.name].near_m is None:
            gate, way[2] = max(gate, _FIT.unseen_gate_m), max(way[2], 0.0)
        apart = float(norm(way)) / gate
        a, b = np.stack([detection.lowest, detection.highest]), np.stack([entry.lowest, entry.highest])
        if apart < 1.0:
            return apart
        if (shared := _shared(a, b)) > _FIT.shared:
            return 1.0 - shared / 2
        gap = float(norm(np.maximum(np.maximum(a[0] - b[1], b[0] - a[1]), 0.0)))
        turned = entry.held and gap < gate  # in the hand, or hanging between two: a sheet swings
        return _FIT.part_misfit if turned or (gap < gate / 2 and (_smaller(a, b) or _smaller(b, a))) else NEVER

    # ------------------------------------------------------------------------------------------ learning

    def _discover(self, detection: LocatedDetection) -> Entry:
        """A new entry."""
        phrase = detection.phrases[0]
        name = ""
        while not name or name in self.knowledge.entries:
            self._numbers[phrase] = self._numbers.get(phrase, 0) + 1
            name = f"{phrase} #{self._numbers[phrase]}"
        entry = Entry(name, detection.phrases, "object", detection.lowest, detection.highest,
                      source=self._detector.name, confidence=self._belief.first(detection.score))  # fmt: skip
        self.knowledge.put(entry)
        self._place(entry, detection.lowest, detection.highest)
        self._looks[name] = Looks(detection.range_m)
        return entry

    def _confirm(self, entry: Entry, detection: LocatedDetection) -> None:
        """See a known thing again; what is known beforehand, or held, is known better than pictures tell."""
        if entry.source == "prior":
            return
        entry.phrases = tuple(dict.fromkeys((*entry.phrases, *detection.phrases)))
        entry.confidence = self._belief.seen(entry.confidence, detection.score)
        if entry.held:
            return
        looks = self._looks[entry.name]
        nearest = looks.near_m
        if nearest is None and not detection.cut:
            low, high = detection.lowest, detection.highest
        else:
            low, high = _merged(entry, detection, 1.0 if nearest is None else nearest / max(detection.range_m, 1e-3))
        if not detection.cut:
            looks.near_m = min(nearest or np.inf, detection.range_m)
        self._place(entry, low, high)

    def _place(self, entry: Entry, lowest: Array, highest: Array) -> None:
        entry.lowest, entry.highest = lowest, highest
        entry.kind = "fixture" if np.ptp([lowest, highest], axis=0)[:2].max() > _FIT.large_m else "object"
        at = entry.center[:2]
        rooms = (r for r in self.knowledge if r.kind == "room")
        entry.room = next((r.name for r in rooms if ((at >= r.lowest[:2]) & (at <= r.highest[:2])).all()), None)

    def _absorb(self, entries: Sequence[Entry]) -> None:
        """Forget an entry if it turns out to be a part of a thing, now seen more completely."""
        names = {entry.name for entry in entries}
        for whole in entries:
            for part in [e for e in self.knowledge if e.source != "prior" and e.name not in names and not e.held]:
                a, b = np.stack([part.lowest, part.highest]), np.stack([whole.lowest, whole.highest])
                if _smaller(a, b) and _shared(a, b) > 0.5 and _alike(whole.phrases, part.phrases):
                    self._forget(part)

    def _forget(self, entry: Entry) -> None:
        self.knowledge.drop(entry.name)
        self._looks.pop(entry.name, None)

    def _doubt(self, image: CameraImage, seen: set[str], unplaced: Sequence[Detection]) -> None:
        """Lower the belief in things missing from the picture, and forget things with too little belief.

        What is hidden is not doubted: neither what another thing is before, nor what is behind a closed door. Nor is
        what was detected where the depth image tells no place.
        """
        for entry in list(self.knowledge):
            low, high = entry.lowest, entry.highest
            if (
                entry.source == "prior" or entry.held or entry.name in seen
                or not shows(image, low, high, self._looks[entry.name])
                or not _alike(entry.phrases, self.phrases)
                or any(calls(entry.phrases, d.phrase) and covers(d, image, low, high) for d in unplaced)
            ):  # fmt: skip
                continue
            entry.confidence = self._belief.missed(entry.confidence)
            if entry.confidence < self._belief.given_up:
                self._forget(entry)

    def expect(self, name: str, image: CameraImage) -> None:
        """Doubt a thing that was gone to, if this picture of its place does not show it.

        Unlike other looks this one is meant for it: that its middle is in the picture with nothing before it is enough.
        """
        entry = self.knowledge.entries.get(name)
        if entry is None or entry.source == "prior" or entry.held or entry.seen_s == self._clock.time_s:
            return
        if not middle_in_sight(image, entry.lowest, entry.highest):
            return
        entry.confidence = self._belief.missed(entry.confidence)
        if entry.confidence < self._belief.given_up:
            self._forget(entry)

    # ------------------------------------------------------------------------------------------ saving

    def save(self) -> dict[str, Any]:
        """What was learned so far, as JSON values."""
        return {
            "entries": self.knowledge.save(),
            "numbers": dict(self._numbers),
            "looks": {name: asdict(looks) for name, looks in self._looks.items()},
            "hands": self._carrying.save(),
            "errors": self.errors,
            "detector": getattr(self._detector, "save", dict)(),
        }

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Bring this and its knowledge base to what was saved.

        Raises:
            KeyError, TypeError, ValueError: What was saved is not as `save` writes it.
        """
        self._carrying.restore(saved["hands"])
        self.knowledge.restore(saved["entries"])
        self._numbers = {str(phrase): int(number) for phrase, number in saved["numbers"].items()}
        self._looks = defaultdict(Looks, TypeAdapter(dict[str, Looks]).validate_python(saved["looks"]))
        self.errors = int(saved["errors"])
        getattr(self._detector, "restore", dict)(saved["detector"])


def _alike(phrases: tuple[str, ...], others: Iterable[str]) -> bool:
    """Whether any of the others may mean what is called so."""
    return any(calls(phrases, other) for other in others)


def _smaller(a: Array, b: Array) -> bool:
    """Whether box `a` (2, 3) is so much smaller than box `b` that it may be the box of a part."""
    return bool(norm(a[1] - a[0]) < _FIT.smaller * norm(b[1] - b[0]))


def _shared(a: Array, b: Array) -> float:
    """Part of the smaller of two boxes (2, 3) that is in the other one, too."""
    a, b = (box + np.outer([-0.5, 0.5], np.maximum(_FIT.flat_m - (box[1] - box[0]), 0.0)) for box in (a, b))
    both = np.maximum(np.minimum(a[1], b[1]) - np.maximum(a[0], b[0]), 0.0)
    return float(np.prod(both) / min(np.prod(a[1] - a[0]), np.prod(b[1] - b[0])))


def _merged(entry: Entry, detection: LocatedDetection, nearer: float) -> tuple[Array, Array]:
    """Lowest and highest corner of a thing that is seen again, from a range `nearer` times as short as the best before.

    Its faces go part of the way to where they are seen now, outward fast and inward slowly: a look shows the side that
    is turned to it, and an edge of the picture may cut it. The noise of depth, which stretches boxes, grows with the
    square of the range: looks from farther count that much less, looks from nearer bring the faces inward faster. A box
    apart from the old one is that of a thing that was moved, unless it is so small that something hides the rest.
    """
    weight = min(1.0, nearer**2)
    low, high = entry.lowest, entry.highest
    part = _smaller(np.stack([detection.lowest, detection.highest]), np.stack([low, high]))
    if ((detection.lowest > high) | (detection.highest < low)).any() and not part:
        shift = weight * ((detection.lowest + detection.highest) / 2 - entry.center)
        low, high = low + shift, high + shift
    inward = 0.0 if detection.cut else float(np.clip(1.0 - 1.0 / nearer, 0.0 if part else _FIT.shrinks, _FIT.grows))
    below, above = detection.lowest - low, detection.highest - high
    return (
        low + weight * np.where(below < 0, _FIT.grows, inward) * below,
        high + weight * np.where(above > 0, _FIT.grows, inward) * above,
    )
