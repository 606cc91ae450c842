"""A policy that is told whole instructions and knows, as from demonstrations, which subtasks they take, in what order.

Our choice: the stand-in for a VLA that was trained on demonstrations of these instructions (Paper, Experiments: the
baseline). docs/methods.md tells what it stands for and what not.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from mpvi_bt.executive.actions.backup import WithBackup
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.action_layout import ActionKind
from mpvi_bt.hands.policies.scripted_policy import ScriptedPolicy


class DemonstratedPolicy:
    """A `mpvi_bt.ground.protocols.Policy` for whole instructions, by one that knows prompts.

    It gives the other policy one prompt after the other. When that thinks that it is done, or has given up, the next
    one comes: by its own senses alone, as nobody judges. What it has no demonstration of it takes for a prompt: who
    serves a policy is not told which of the two its clients will say.

    Attributes:
        name: The other policy's.
        note: What it is at; of a prompt the other policy's.
    """

    def __init__(self, inner: ScriptedPolicy | WithBackup, demonstrations: Mapping[str, Sequence[str]]) -> None:
        """Take the policy.

        Args:
            inner: Carries out each prompt.
            demonstrations: Instruction to the prompts that it takes, in order, one or more.
        """
        self.name = inner.name
        self._inner = inner
        self._demonstrations = {_plain(told): tuple(prompts) for told, prompts in demonstrations.items()}
        self._told = ""
        self._at = 0

    @property
    def cameras(self) -> tuple[str, ...]:
        """The other policy's."""
        return self._inner.cameras

    @property
    def planning_s(self) -> float:
        """The other policy's."""
        return self._inner.planning_s

    @property
    def rate_hz(self) -> float | None:
        """The other policy's; None if it does not say."""
        return getattr(self._inner, "rate_hz", None)

    @property
    def rate_from(self) -> str:
        """The other policy's."""
        return getattr(self._inner, "rate_from", "")

    @property
    def actions(self) -> ActionKind:
        """The other policy's."""
        return getattr(self._inner, "actions", "absolute")

    @property
    def note(self) -> str:
        """What it is at, for a person."""
        prompts = self._demonstrations.get(_plain(self._told))
        if prompts is None:
            return self._inner.note
        return f"{self._at + 1} of {len(prompts)}, {prompts[self._at]}: {self._inner.note}"

    @property
    def gave_up(self) -> bool:
        """Whether the other policy gave up the last of the prompts."""
        return self._inner.gave_up and self._at + 1 >= self._count

    @property
    def ended(self) -> bool:
        """Whether the other policy thinks that the last of the prompts is done, or has given it up."""
        return self._inner.ended and self._at + 1 >= self._count

    @property
    def progress(self) -> float | None:
        """How far along all of the prompts it is, 0 to 1; None if the other policy does not say."""
        progress: float | None = getattr(self._inner, "progress", None)
        return None if progress is None else (self._at + progress) / self._count

    @property
    def _count(self) -> int:
        """How many prompts the instruction takes."""
        return len(self._demonstrations.get(_plain(self._told), (self._told,)))

    def reset(self) -> None:
        """Begin the instruction anew."""
        self._at = 0
        self._inner.reset()

    def infer(self, observation: Mapping[str, Any]) -> Array:
        """The next actions, (H, 23)."""
        if observation["prompt"] != self._told:
            self._told = str(observation["prompt"])
            self.reset()
        prompts = self._demonstrations.get(_plain(self._told), (self._told,))
        if self._inner.ended and self._at + 1 < len(prompts):
            self._at += 1
            self._inner.reset()
        return self._inner.infer({**observation, "prompt": prompts[self._at]})


def _plain(instruction: str) -> str:
    """An instruction without what does not change it: case, and how it is spaced."""
    return " ".join(instruction.lower().split())
