"""The `learned` checker: the visual checker's rules, on what a network sees."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mpvi_bt.executive.completion.criteria import parse
from mpvi_bt.finding.perception.between_fingers import between_fingers
from mpvi_bt.finding.perception.detector import ROBOT, SWITCH, switch_of
from mpvi_bt.finding.perception.segments import FLOOR
from mpvi_bt.finding.perception.shared_eyes import SURE, Eyes, NamedSegment
from mpvi_bt.finding.perception.visual_checker import Eyesight, VisualChecker
from mpvi_bt.ground.protocols import Judgement
from mpvi_bt.ground.robot.default_robot import DEFAULT_ROBOT
from mpvi_bt.ground.robot.protocol import SIDES, CameraImage
from mpvi_bt.ground.robot.robot_description import RobotDescription
from mpvi_bt.ground.robot.robots import robot_named

# Our choice.
_RING_PX = 3  # how far around a thing in a hand one looks for what it is a part of
_MOST = 0.5  # share of that ring on the thing asked for, and of held pixels on one segment, that is enough [ratio]
_FLUSH = (0.03, 0.03)  # pieces of one thing: their depth differs by no more where they border [m, and part of it]


class LearnedChecker:
    """Judges a criterion from one picture's colors and depth (implements `Checker`). It reads no labels of a picture.

    What a criterion names is likelier to be in the picture than what it does not name: see `Segments.expecting`.

    Attributes:
        name: "learned".
        needs_image: Yes.
    """

    name = "learned"
    needs_image = True

    def __init__(
        self,
        eyes: Eyes,
        floors: Iterable[str] = (),
        eyesight: Eyesight | None = None,
        robot: RobotDescription | None = None,
    ) -> None:
        """See through `eyes`, which may be shared.

        Args:
            eyes: What they name is judged.
            floors: What floors are called besides, such as "kitchen floor": the network tells none from another.
            eyesight, robot: As of `VisualChecker`.
        """
        self._eyes, self._eyesight, self._robot = eyes, eyesight, robot or robot_named(DEFAULT_ROBOT)
        self._words = {**eyes.words, FLOOR: (*eyes.words.get(FLOOR, ()), *floors)}

    def check(self, criterion: str, image: CameraImage | None) -> Judgement:
        """Whether the picture shows that `criterion` is met."""
        if image is None:
            return Judgement(False, "no picture to look at")
        asked = parse(criterion)
        phrases = (asked.subject, asked.object) if asked else ()
        if asked and asked.relation in ("on", "off"):
            phrases = (*phrases, switch_of(asked.subject))
        kinds = {kind for phrase in phrases for kind in self._eyes.meant(phrase)}
        seen, things = self._eyes.see(image, kinds)
        sure = [t for t in things if t.score >= SURE and not t.kind.endswith(SWITCH)]
        if asked and asked.relation == "nextto":
            seen = _pieced(seen, sure)
        called = {thing.name: self._words.get(thing.kind, ()) for thing in sure}
        judged = VisualChecker(called, self._eyesight, self._robot).check(criterion, seen)
        if asked and asked.relation == "held" and asked.side in (None, image.camera) and image.camera in SIDES:
            return judged if judged.complete else self._held(image, asked.subject, judged)
        return judged

    def _held(self, image: CameraImage, subject: str, judged: Judgement) -> Judgement:
        """By what is between the fingers, looked at as one thing.

        A held part without a known kind counts as the thing that surrounds it in the picture: a trash can is held by
        its bail.

        Args:
            image: A wrist camera's.
            subject: What may be held.
            judged: The answer if there is nothing of it.
        """
        kinds = self._eyes.meant(subject)
        seen, things = self._eyes.see(image, kinds)
        robot = _of(seen, [t for t in things if t.kind == ROBOT])
        held = between_fingers(seen, robot, self._robot)
        if not held.any():
            return judged
        seen, things = self._eyes.see(image, kinds, held)
        sure = [t for t in things if t.score >= SURE]
        for thing in sure:
            if np.count_nonzero(held & _of(seen, [thing])) > _MOST * np.count_nonzero(held):
                is_so = thing.kind in kinds
                return Judgement(True, f"{thing.name} is seen between the fingers") if is_so else judged
        ring = ndimage.binary_dilation(held, iterations=_RING_PX) & ~held & ~robot
        behind = np.count_nonzero(ring & _of(seen, [t for t in sure if t.kind in kinds]))
        if behind < max(_MOST * np.count_nonzero(ring), 1):
            return judged
        return Judgement(True, f"a part of {subject} is seen between the fingers")


def _of(seen: CameraImage, things: Iterable[NamedSegment]) -> NDArray[np.bool_]:
    """(H, W) the pixels of some segments."""
    assert seen.labels is not None
    return np.isin(seen.labels, [thing.label for thing in things])


def _pieced(seen: CameraImage, things: Iterable[NamedSegment]) -> CameraImage:
    """The picture with segments of one kind that lie flush under one name: nothing is next to a piece of itself."""
    assert seen.labels is not None
    names, kinds = dict(seen.names), {thing.label: thing.kind for thing in things}
    for a, b in ((np.s_[1:], np.s_[:-1]), (np.s_[:, 1:], np.s_[:, :-1])):
        d, e = seen.depth[a], seen.depth[b]
        flush = (np.abs(d - e) <= _FLUSH[0] + _FLUSH[1] * np.minimum(d, e)) & (seen.labels[a] != seen.labels[b])
        for one, other in np.unique(np.stack([seen.labels[a][flush], seen.labels[b][flush]], 1), axis=0).tolist():
            if one in kinds and kinds[one] == kinds.get(other) and names[one] != names[other]:
                gone, kept = names[one], names[other]
                names = {label: kept if name == gone else name for label, name in names.items()}
    return replace(seen, names=names)
