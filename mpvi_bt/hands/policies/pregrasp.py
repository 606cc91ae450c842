"""Planned pre-grasps: a classical motion brings the hand before a thing, then the policy is handed what is left."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

from mpvi_bt.executive.actions.chunks import WrappedPolicy
from mpvi_bt.executive.plan.clauses import clauses, match
from mpvi_bt.executive.plan.skills import Skill, SkillCall
from mpvi_bt.finding.perception.detector import Detector
from mpvi_bt.finding.scene.free_space import Standing
from mpvi_bt.ground.action_chunk import ask
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.protocols import Policy
from mpvi_bt.ground.robot.motion import MotionFailure
from mpvi_bt.ground.robot.protocol import Side
from mpvi_bt.hands.motion.carry import come_out
from mpvi_bt.hands.motion.work import Words, Work
from mpvi_bt.hands.policies.reactive import ReactivePolicy
from mpvi_bt.hands.policies.scripted_policy import Performance
from mpvi_bt.hands.skills.pick import come_before, pick

_SKILL = "pick"  # the motion of skills that have a pre-grasp


class PregraspPolicy(ReactivePolicy):
    """The reactive policy up to the pre-grasp: it looks, takes up a stance, and ends with its hand before the thing.

    Only of a prompt that begins with picking up. It tries once; where that fails it folds the arms, and ends too.
    """

    name = "pregrasp"
    tries = 1

    def __init__(
        self, skills: Mapping[str, Skill], seed: int = 0, timer: Callable[[], float] | None = None,
        detector: Detector | None = None, vocabulary: Mapping[str, Iterable[str]] | None = None,
        standing: Standing | None = None, hand: Side | None = None,
    ) -> None:  # fmt: skip
        """See as `ReactivePolicy` does; `hand` comes before the thing if the prompt names none."""
        self._hand = hand
        super().__init__(skills, seed, timer, detector, vocabulary, standing)

    def first(self, prompt: str) -> str | None:
        """The clause that a prompt begins with, if that is to pick something up."""
        said = clauses(prompt, self._skills)
        call = match(said[0], self._skills) if said else None
        return said[0] if call is not None and call.motion == _SKILL else None

    def perform(self, work: Work, prompt: str) -> Performance:
        """Bring the hand there, once; there is nothing to show to anybody afterward."""
        if (clause := self.first(prompt)) is not None:
            yield from super().perform(work, clause)
        return None

    def words(self, call: SkillCall) -> Words:
        """Of a skill call, with the hand."""
        return call.arguments if self._hand is None else {"hand": self._hand, **call.arguments}

    def attempt(self, work: Work, call: SkillCall) -> Any:
        """Try it; yields actions, returns whether the hand is there."""
        yield from come_out(work)
        try:
            yield from pick(work, self.words(call), [], come_before)
        except MotionFailure as failure:
            self.note = f"{call.skill.name}: {work.explained(failure)}"
            yield from self._recover(work)
            return False
        return True


class WithPregrasp(WrappedPolicy):
    """A policy that is handed over to with the hand before what it is to pick up.

    At each handoff whose prompt begins with picking up, `pregrasp` is at work first, whether it succeeds or not. The
    policy is told the same prompt then. Faults and latency are of the policy alone, if it is wrapped in these before.
    """

    def __init__(self, policy: Policy, pregrasp: PregraspPolicy) -> None:
        super().__init__(policy)
        self._pregrasp = pregrasp
        self._prompt: str | None = None
        self._before = False

    @property
    def cameras(self) -> tuple[str, ...]:
        """Of the one at work."""
        return self._pregrasp.cameras if self._before else super().cameras

    @property
    def note(self) -> str:
        """Of the one at work."""
        return f"{self._pregrasp.name}: {self._pregrasp.note}" if self._before else super().note

    @property
    def gave_up(self) -> bool:
        """Whether the policy has."""
        return not self._before and super().gave_up

    @property
    def ended(self) -> bool:
        """Whether the policy thinks that it is done, or has given up: not before it is at work."""
        return not self._before and super().ended

    @property
    def progress(self) -> float | None:
        """Of the policy; None before it is at work."""
        return None if self._before else super().progress

    def reset(self) -> None:
        """Forget everything: the next observation begins another handoff."""
        super().reset()
        self._pregrasp.reset()
        self._prompt, self._before = None, False

    def infer(self, observation: Mapping[str, Any]) -> Array:
        """(H, 23). Raises PolicyError if the policy gives no chunk."""
        if observation["prompt"] != self._prompt:
            self._prompt = str(observation["prompt"])
            self._before = self._pregrasp.first(self._prompt) is not None
            if not self._before:
                self._pregrasp.reset()
        if not self._before:
            return ask(self._policy, observation)
        action = self._pregrasp.infer(observation)
        self._before = not self._pregrasp.ended  # what the policy wants to see comes with the next observation
        return action
