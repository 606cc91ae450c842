"""The reactive policy: the expert's skills, in the scene that cameras show. docs/reactive.md describes what it does."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np

from mpvi_bt.manipulation.in_hand import show
from mpvi_bt.manipulation.scripted import ScriptedPolicy
from mpvi_bt.manipulation.seen import Seen
from mpvi_bt.manipulation.work import Work
from mpvi_bt.perception.detector import Detector, LabelDetector
from mpvi_bt.plan.skills import Skill, SkillCall, clauses, match
from mpvi_bt.robot.motion import Actions
from mpvi_bt.robot.protocol import SIDES
from mpvi_bt.robot.solids import Array
from mpvi_bt.robot.squeeze import squeezes

# Lift [m] and head tilt [rad] to look around: down, near, ahead, and from low down into compartments.
_LOOKS = ((0.42, 0.55), (0.42, 0.95), (0.42, 0.10), (0.05, 0.40), (0.05, -0.10), (0.55, -0.30))
_TURNS = (0.0, 0.6, -0.6)  # of the base, from where it came [rad]
_NAMES = ("object", "container", "surface", "target", "source", "tool")  # slots that hold the name of a thing


class ReactivePolicy(ScriptedPolicy):
    """`mpvi_bt.behaviors.protocols.Policy` that sees, and knows no simulator."""

    name = "reactive"

    def __init__(
        self, skills: Mapping[str, Skill], seed: int = 0, timer: Callable[[], float] | None = None,
        detector: Detector | None = None, vocabulary: Mapping[str, Iterable[str]] | None = None,
    ) -> None:  # fmt: skip
        """See through `detector`, by default the picture's labels and a vocabulary: label to phrases."""
        self._seen = Seen(detector or LabelDetector(vocabulary or {}))
        super().__init__(self._seen, skills, seed, timer, sight=self._seen)

    def infer(self, observation: Mapping[str, Any]) -> Array:
        """The next action as a chunk of one, (1, 23)."""
        self._seen.feel(observation["proprioception"])
        return super().infer(observation)

    def perform(self, work: Work, prompt: str) -> Actions:
        """Do the first clause that can be grounded in view, then the next such one; look around if there is none."""
        calls = [c for clause in clauses(prompt) if (c := match(clause, self._skills)) is not None]
        if not calls:
            self.note = f"no skill for {prompt[:60]!r}"
            return
        self._seen.forget(self._phrases(calls))
        yield from self._look_at_hands(work)
        left = list(calls)
        while left:
            call = next((c for c in left if self._grounded(work, c)), None)
            if call is None:
                call = yield from self._search(work, left)
            if call is None:
                self.note = f"nothing in view for {left[0].skill.name}"
                return
            self.note = call.skill.name
            if (yield from self.attempt(work, call)):
                left.remove(call)
            else:
                return
        yield from self.finish(work)

    def _phrases(self, calls: Iterable[SkillCall]) -> list[str]:
        return [c.arguments[slot] for c in calls for slot in _NAMES if slot in c.arguments]

    def _grounded(self, work: Work, call: SkillCall) -> bool:
        """Whether all things that a call names are known: seen, or held."""
        known = self._seen.knowledge()
        return all(known.find(phrase) for phrase in self._phrases([call]))

    def _look_at_hands(self, work: Work) -> Actions:
        """See what the hands hold already."""
        sides = [side for side in SIDES if work.motion.felt.holds(side)]
        if sides or squeezes(work.motion.felt):
            torso = work.motion.torso
            torso[3] = 0.9
            yield from work.motion.stand(torso)
            yield from work.see("head", *sides)
            for side in sides:
                yield from show(work, side)

    def _search(self, work: Work, calls: list[SkillCall]) -> Any:
        """Look around, from one heading after the other; returns the first call that is grounded, or None."""
        x, y, yaw = work.motion.felt.base_pose
        for turn in _TURNS:
            if turn:
                yield from work.motion.drive(np.array([x, y, yaw + turn]))
            for lift, tilt in _LOOKS:
                torso = np.array([lift, 0.0, 0.0, tilt])
                if work.held():
                    torso[:3] = work.motion.torso[:3]
                yield from work.motion.stand(torso)
                yield from work.see("head")
                for call in calls:
                    if self._grounded(work, call):
                        return call
        return None
