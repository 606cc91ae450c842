"""The privileged judge: answers from simulator truth. Every report that used it says so."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Protocol

from mpvi_bt.behaviors.protocols import Judgement
from mpvi_bt.completion.criteria import named, parse
from mpvi_bt.robot.protocol import CameraImage, Side


class Truth(Protocol):
    """What is so, by names of things."""

    def held(self, name: str, side: Side | None) -> bool:
        """Whether the robot holds the thing, in that hand if one is named."""
        ...

    def inside(self, name: str, container: str) -> bool:
        """Whether the thing is inside the container."""
        ...

    def ontop(self, name: str, surface: str) -> bool:
        """Whether the thing is on top of the surface."""
        ...


class OracleChecker:
    """Judges a criterion by `Truth` (implements `Checker`).

    Attributes:
        name: "oracle".
        needs_image: No.
    """

    name = "oracle"
    needs_image = False

    def __init__(self, truth: Truth, phrases: Mapping[str, Iterable[str]]) -> None:
        """Take the truth.

        Args:
            truth: What is so now, each time it is asked.
            phrases: Name of each thing to what people call it.
        """
        self._truth, self._phrases = truth, {name: tuple(called) for name, called in phrases.items()}

    def check(self, criterion: str, image: CameraImage | None) -> Judgement:
        """Whether `criterion` is so; the picture is not looked at. What it cannot parse is a no."""
        asked = parse(criterion)
        if asked is None:
            return Judgement(False, f"not a criterion that it understands: {criterion[:80]!r}")
        subjects, objects = named(asked.subject, self._phrases), named(asked.object, self._phrases)
        if not subjects:
            return Judgement(False, f"nothing is called {asked.subject!r}")
        if asked.relation != "held" and not objects:
            return Judgement(False, f"nothing is called {asked.object!r}")
        truth = self._truth
        if asked.relation == "held":
            so = [s for s in subjects if truth.held(s, asked.side)]
        elif asked.relation == "inside":
            so = [s for s in subjects if any(truth.inside(s, o) for o in objects if o != s)]
        else:
            so = [s for s in subjects if any(truth.ontop(s, o) for o in objects if o != s)]
        return Judgement(len(so) >= asked.count, f"{len(so)} of {asked.count} {asked.relation}")
