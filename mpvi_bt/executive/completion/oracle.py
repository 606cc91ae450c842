"""The privileged checker: it reads the simulator's state. Every report names it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Protocol

from mpvi_bt.executive.completion.criteria import UNARY, Criterion, Relation, named, parse
from mpvi_bt.ground.protocols import Judgement
from mpvi_bt.ground.robot.protocol import CameraImage, Side

_SET_DOWN = ("inside", "ontop", "nextto", "under")  # relations of what rests: in a hand it is not done yet


class CheckedTruth(Protocol):
    """What is so, by names of things."""

    def held(self, name: str, side: Side | None) -> bool:
        """Whether the robot holds the thing between its fingers, in that hand if one is named."""
        ...

    def lifted(self, name: str) -> bool:
        """Whether the robot alone carries the thing, with one hand or both."""
        ...

    def at(self, phrase: str) -> bool | None:
        """Whether the robot is at something that `phrase` names, other than its payload; None: there is none."""
        ...

    def so(self, relation: Relation, name: str, other: str) -> bool | None:
        """Whether a relation holds of the thing, and of the other one if it takes two; None: that is not simulated."""
        ...


class OracleChecker:
    """Judges a criterion by `CheckedTruth` (implements `Checker`).

    Attributes:
        name: "oracle".
        needs_image: No.
    """

    name = "oracle"
    needs_image = False

    def __init__(self, truth: CheckedTruth, phrases: Mapping[str, Iterable[str]]) -> None:
        """Take the truth.

        Args:
            truth: What is so now, each time it is asked.
            phrases: Name of each thing to what people call it.
        """
        self._truth, self._phrases = truth, {name: tuple(called) for name, called in phrases.items()}

    def check(self, criterion: str, image: CameraImage | None) -> Judgement:
        """Whether `criterion` is so; the picture is not looked at. What it cannot decide is a no."""
        so, reason = self.decide(criterion)
        return Judgement(so is True, reason)

    def decide(self, criterion: str) -> tuple[bool | None, str]:
        """Whether `criterion` is so, None where it does not parse or is not simulated; and why."""
        asked = parse(criterion)
        if asked is None:
            return None, f"not a criterion that it understands: {criterion[:80]!r}"
        if asked.relation == "at":
            there = self._truth.at(asked.subject)
            if there is None:
                return None, f"nothing is called {asked.subject!r}"
            return there, f"the robot is {'' if there else 'not '}at the {asked.subject}"
        subjects, objects = named(asked.subject, self._phrases), named(asked.object, self._phrases)
        if not subjects:
            return None, f"nothing is called {asked.subject!r}"
        if asked.relation not in UNARY and not objects:
            return None, f"nothing is called {asked.object!r}"
        answers = [self._holds(asked, subject, objects) for subject in subjects]
        if None in answers:
            return None, f"{asked.relation!r} is not simulated"
        count = sum(map(bool, answers))
        if asked.relation == "closed" and not all(answers):  # "the cabinet is closed" is not so while another is open
            return False, f"{len(answers) - count} of {len(answers)} open"
        if asked.relation == "cut" and not all(answers):
            return False, f"{len(answers) - count} of {len(answers)} whole"
        return count >= asked.count, f"{count} of {asked.count} {asked.relation}"

    def _holds(self, asked: Criterion, subject: str, objects: list[str]) -> bool | None:
        truth = self._truth
        if asked.relation == "held":
            return truth.held(subject, asked.side)
        if asked.relation == "lifted":
            return truth.lifted(subject)
        if asked.relation in _SET_DOWN and truth.held(subject, None):
            return False
        others = [""] if asked.relation in UNARY else [o for o in objects if o != subject]
        if asked.relation == "nextto":
            others = [o for o in others if not truth.held(o, None)]
        answers = [truth.so(asked.relation, subject, other) for other in others]
        return None if None in answers else any(answers)
