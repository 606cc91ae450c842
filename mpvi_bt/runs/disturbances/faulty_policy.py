"""A policy with faults, for tests and studies of failure detection."""

from __future__ import annotations

import re
import zlib
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from mpvi_bt.executive.actions.chunks import WrappedPolicy
from mpvi_bt.executive.plan.clauses import clauses, match
from mpvi_bt.executive.plan.skills import Skill
from mpvi_bt.ground.action_chunk import ask
from mpvi_bt.ground.errors import UnknownName
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.protocols import Policy
from mpvi_bt.ground.robot.action_layout import ActionLayout
from mpvi_bt.ground.robot.action_rows import command_of
from mpvi_bt.ground.robot.protocol import CONTROL_HZ
from mpvi_bt.ground.robot.robots import layout_of
from mpvi_bt.runs.disturbances.faults import KINDS


class FaultyPolicy(WrappedPolicy):
    """Another policy's chunks, with the faults of `faults.KINDS` but lateness, which `LatePolicy` adds.

    All draws follow from the seed, the number of the handoff and the step since: the same run has the same faults.

    Args:
        policy: Whose chunks.
        faults: Kind to number, as `read_faults` gives them.
        seed: Of the draws.
        skills: By name; they tell which words of a prompt are its object.
        things: Phrases of the task's things, one of which is taken for the object.

    Attributes:
        happened: How often each fault came about: steps with jitter or drift, handoffs frozen or with a wrong object.

    Raises:
        UnknownName: There is no such fault.
    """

    def __init__(
        self,
        policy: Policy,
        faults: Mapping[str, float],
        seed: int = 0,
        skills: Mapping[str, Skill] | None = None,
        things: Sequence[str] = (),
    ) -> None:
        super().__init__(policy)
        for name in faults:
            if name not in KINDS:
                raise UnknownName("fault", name, KINDS)
        self._faults, self._seed = dict(faults), seed
        self._skills, self._things = skills or {}, tuple(things)
        self._handoff, self._step = 0, 0
        self._frozen: Array | None = None  # the command that it froze in
        self._before: Array | None = None
        self._said = ("", "")  # the last prompt, and what is made of it
        self.happened: Counter[str] = Counter()

    def reset(self) -> None:
        """Begin another handoff."""
        super().reset()
        self._handoff += 1
        self._step = 0
        self._frozen = self._before = None
        self._said = ("", "")

    def save(self) -> dict[str, Any]:
        """Handoffs and faults so far."""
        return {"handoffs": self._handoff, "happened": dict(self.happened), "wrapped": super().save()}

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Go on from what `save` gave: an interrupted handoff begins anew, as the next one."""
        self._handoff = int(saved["handoffs"])
        self.happened = Counter({str(name): int(count) for name, count in saved["happened"].items()})
        super().restore(saved["wrapped"])

    def infer(self, observation: Mapping[str, Any]) -> Array:
        """(H, A). Raises PolicyError if the policy gives no chunk."""
        if self._before is None:
            self._before = command_of(observation["proprioception"])
        prompt = observation["prompt"]
        if "wrong_object" in self._faults:
            if self._said[0] != prompt:
                self._said = prompt, self._mistaken(prompt)
            prompt = self._said[1]
        chunk = ask(self._policy, {**observation, "prompt": prompt})
        layout = layout_of(observation["proprioception"])
        for action in chunk:
            self._disturb(action, layout)
        return chunk

    def _disturb(self, action: Array, layout: ActionLayout) -> None:
        """Change one action, in place."""
        arms = layout.arm_joints
        self._step += 1
        draws = self._draws("step", self._step)
        if self._frozen is None and draws.random() < self._faults.get("freeze", 0.0):
            assert self._before is not None
            self._frozen = self._before.copy()
            layout.set_velocity(self._frozen, 0.0)
            self.happened["freeze"] += 1
        if jitter := self._faults.get("jitter"):
            action[arms] += draws.normal(0.0, jitter, len(arms))
            self.happened["jitter"] += 1
        if drift := self._faults.get("drift"):
            way = self._draws("drift", 0).normal(size=len(arms))
            way /= np.sqrt(np.mean(way**2))
            action[arms] += way * drift * self._step / CONTROL_HZ
            self.happened["drift"] += 1
        if self._frozen is not None:
            action[:] = self._frozen
        self._before = action.copy()

    def _mistaken(self, prompt: str) -> str:
        """The prompt with another of the task's things in the place of its first object, if the draw says so."""
        draws = self._draws("object", zlib.crc32(prompt.encode()))
        if draws.random() >= self._faults["wrong_object"]:
            return prompt
        calls = (match(clause, self._skills) for clause in clauses(prompt, self._skills))
        meant = next((call.arguments["object"] for call in calls if call and "object" in call.arguments), None)
        others = [thing for thing in self._things if thing.lower() not in prompt.lower()]
        if meant is None or not others:
            return prompt
        self.happened["wrong_object"] += 1
        other = str(draws.choice(others))
        return re.sub(rf"\b{re.escape(meant)}\b", lambda _: other, prompt)

    def _draws(self, what: str, number: int) -> np.random.Generator:
        return np.random.default_rng([self._seed, zlib.crc32(what.encode()), self._handoff, number])
