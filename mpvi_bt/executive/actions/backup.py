"""A policy with a second one behind it for prompts without a skill in the first."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping
from typing import Any

from mpvi_bt.executive.actions.felt_end import MISSED_S, FeltEnd
from mpvi_bt.executive.plan.clauses import clauses, match
from mpvi_bt.executive.plan.skills import Skill
from mpvi_bt.ground.action_chunk import ask
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.protocols import NO_SKILL, Policy
from mpvi_bt.ground.robot.action_layout import ActionKind
from mpvi_bt.ground.robot.action_rows import standing
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, Proprioception
from mpvi_bt.ground.robot.robots import layout_of

CLOSED_EMPTY = f"closed_empty: a hand that was to hold something has been closed on nothing for {MISSED_S:g} s"


class WithBackup:
    """`mpvi_bt.ground.protocols.Policy` of two.

    The first one is told the whole prompt. Where it says `NO_SKILL`, it is told one clause after the other, and the
    second one those that it has no skill for; the next clause comes once the one at work has `ended`. One that cannot
    say so has ended when a hand has held what it was to hold, or let go of it, for a second; and has given up, with
    the reason "closed_empty", when a hand that was to hold something stays closed on nothing. Where the first one is to
    use some of its skills only, it is not asked about the others.

    Attributes:
        name: Both names, joined by "+".
        prompts: How many prompts or clauses each of them was given and did not refuse, by name; those that are begun
            anew after a handoff count again.
        steps: How many actions each of them gave.
    """

    def __init__(
        self, first: Policy, second: Policy, skills: Mapping[str, Skill], only: Collection[str] | None = None
    ) -> None:
        """Take the two, which do not have the same name.

        Args:
            first, second: The policies.
            skills: By name; they tell clauses apart.
            only: Names of those that the first one is to use; None: all that it has.
        """
        self._first, self._second, self._skills, self._only = first, second, skills, only
        self.name = f"{first.name}+{second.name}"
        self.prompts: Counter[str] = Counter()
        self.steps: Counter[str] = Counter()
        self.reset()

    @property
    def cameras(self) -> tuple[str, ...]:
        """Of the one at work."""
        return self._at.cameras

    @property
    def rate_hz(self) -> float | None:
        """Of the one at work; None if it does not say."""
        return getattr(self._at, "rate_hz", None)

    @property
    def rate_from(self) -> str:
        """Of the one at work."""
        return getattr(self._at, "rate_from", "")

    @property
    def actions(self) -> ActionKind:
        """Of the one at work; who has missed stands still where the joints are."""
        return "absolute" if self._missed else getattr(self._at, "actions", "absolute")

    @property
    def note(self) -> str:
        """Of the one at work, after its name."""
        said = CLOSED_EMPTY if self._missed else getattr(self._at, "note", "")
        return f"{self._at.name}: {said}"

    @property
    def gave_up(self) -> bool:
        """Whether the one at work has: what comes after it is not begun."""
        return self._missed or getattr(self._at, "gave_up", False)

    @property
    def ended(self) -> bool:
        """Whether the last one has come to the end of its prompt, if it can say so."""
        return self.gave_up or (not self._left and self._done)

    @property
    def progress(self) -> float | None:
        """The active policy's progress, if it got the whole prompt and reports any; else None."""
        return getattr(self._at, "progress", None) if self._told == self._prompt else None

    @property
    def planning_s(self) -> float:
        """Wall time that both spent on planning, as far as they tell."""
        return sum(getattr(policy, "planning_s", 0.0) for policy in (self._first, self._second))

    @property
    def _done(self) -> bool:
        """Whether the active policy reports success."""
        return getattr(self._at, "ended", False) and not getattr(self._at, "gave_up", False)

    def reset(self) -> None:
        """Have both forget everything; the first one is asked next."""
        self._first.reset()
        self._second.reset()
        self._at: Policy = self._first
        self._prompt, self._told, self._left = "", "", list[str]()
        self._felt_end, self._rows, self._missed = FeltEnd(None), 0, False

    def close(self) -> None:
        """Close both."""
        for policy in (self._first, self._second):
            getattr(policy, "close", lambda: None)()

    def infer(self, observation: Mapping[str, Any]) -> Array:
        """(H, A). Raises PolicyError if the one at work gives no chunk."""
        body = observation["proprioception"]
        if observation["prompt"] != self._prompt:
            self.reset()
            self._prompt = str(observation["prompt"])
            self._tell(self._first, self._prompt, body)
        else:
            self._feel(body)
        if self._missed:
            return standing(body)[None]
        if barred := self._barred():
            chunk = standing(body)[None]
        else:
            chunk = ask(self._at, {**observation, "prompt": self._told})
            self._felt_end.acts(chunk, layout_of(body))
        if barred or self._refused():
            self._pass_on(body)
            chunk = chunk[:1]  # the cameras of the next one at work come with the next observation
        self.steps[self._at.name] += len(chunk)
        self._rows = len(chunk)
        return chunk

    def _tell(self, policy: Policy, prompt: str, body: Proprioception) -> None:
        policy.reset()
        self._at, self._told = policy, prompt
        self.prompts[policy.name] += 1
        call = match(prompt, self._skills)
        self._felt_end, self._rows = FeltEnd(None if call is None else call.skill, body), 0

    def _feel(self, body: Proprioception) -> None:
        """Begin the next clause if the one at work is done; where the policy cannot say so, by what the hands feel."""
        since_s = self._rows / (self.rate_hz or CONTROL_HZ)
        silent = not hasattr(self._at, "ended")
        if silent and self._felt_end.missed(body, since_s):
            self._missed = True
        elif self._left and (self._done or (silent and self._felt_end.felt(body, since_s))):
            self._tell(self._first, self._left.pop(0), body)

    def _barred(self) -> bool:
        """Whether the first one is at work and not to use a skill that it was told to."""
        if self._only is None or self._at is not self._first:
            return False
        calls = [match(clause, self._skills) for clause in clauses(self._told, self._skills)]
        return any(call is None or call.skill.name not in self._only for call in calls)

    def _refused(self) -> bool:
        """Whether the first policy is active and reports no skill for its prompt."""
        note = str(getattr(self._first, "note", ""))
        return self._at is self._first and getattr(self._first, "gave_up", False) and note.startswith(NO_SKILL)

    def _pass_on(self, body: Proprioception) -> None:
        """Give the refused prompt to the second policy; of several clauses, the first policy gets one at a time."""
        self.prompts[self._first.name] -= 1
        parts = clauses(self._told, self._skills)
        if len(parts) > 1:
            self._left = parts[1:]
            self._tell(self._first, parts[0], body)
        else:
            self._tell(self._second, self._told, body)
