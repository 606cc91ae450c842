"""The `learned` checker: the visual checker's rules, on what a network sees."""

from __future__ import annotations

from collections.abc import Iterable

from mpvi_bt.finding.perception.detector import SWITCH
from mpvi_bt.finding.perception.segments import FLOOR
from mpvi_bt.finding.perception.shared_eyes import SURE, Eyes
from mpvi_bt.finding.perception.visual_checker import Eyesight, VisualChecker
from mpvi_bt.ground.protocols import Judgement
from mpvi_bt.ground.robot.protocol import CameraImage
from mpvi_bt.ground.robot.robot_description import RobotDescription


class LearnedChecker:
    """Judges a criterion from one picture's colors and depth (implements `Checker`). It reads no labels of a picture.

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
        self._eyes, self._eyesight, self._robot = eyes, eyesight, robot
        self._words = {**eyes.words, FLOOR: (*eyes.words.get(FLOOR, ()), *floors)}

    def check(self, criterion: str, image: CameraImage | None) -> Judgement:
        """Whether the picture shows that `criterion` is met."""
        if image is None:
            return Judgement(False, "no picture to look at")
        seen, things = self._eyes.see(image)
        sure = [t for t in things if t.score >= SURE and not t.kind.endswith(SWITCH)]
        called = {thing.name: self._words.get(thing.kind, ()) for thing in sure}
        return VisualChecker(called, self._eyesight, self._robot).check(criterion, seen)
