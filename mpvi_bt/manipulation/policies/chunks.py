"""Ways to carry out action chunks, each a policy that wraps another: receding horizon and temporal ensembling."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from mpvi_bt.action_chunk import ask
from mpvi_bt.errors import UserError, shown
from mpvi_bt.protocols import Policy
from mpvi_bt.robot.linear_algebra import matmul
from mpvi_bt.robot.solids import Array

DECAY = 0.01  # per step of age; the value that ACT was published with
_OLDEST = 1024  # chunks that are kept


class _Wrapped:
    """Is, but for its actions, the policy that it wraps."""

    def __init__(self, policy: Policy) -> None:
        self._policy = policy

    @property
    def name(self) -> str:
        """Of the policy."""
        return self._policy.name

    @property
    def cameras(self) -> tuple[str, ...]:
        """That the policy wants next."""
        return self._policy.cameras

    @property
    def note(self) -> str:
        """Of the policy; "" if it has none."""
        return getattr(self._policy, "note", "")

    @property
    def gave_up(self) -> bool:
        """As the policy says; no if it never does."""
        return getattr(self._policy, "gave_up", False)

    def reset(self) -> None:
        """Forget everything."""
        self._policy.reset()


class RecedingHorizon(_Wrapped):
    """Carries out the beginning of each chunk, then asks again: what the policy sees is never older than that.

    Args:
        policy: Whose chunks.
        horizon: How many actions of each, at least 1; a chunk that is shorter is carried out whole.

    Raises:
        UserError: The horizon is none.
    """

    def __init__(self, policy: Policy, horizon: int) -> None:
        super().__init__(policy)
        if not isinstance(horizon, int) or isinstance(horizon, bool) or horizon < 1:
            raise UserError(f"a horizon is a whole number of actions, at least 1, not {shown(horizon)}")
        self._horizon = horizon

    def infer(self, observation: Mapping[str, Any]) -> Array:
        """(h, 23), h at most the horizon. Raises PolicyError if the policy gives no chunk."""
        return ask(self._policy, observation)[: self._horizon]


class TemporalEnsemble(_Wrapped):
    """Asks at every step, and acts by the mean of all that chunks so far have foreseen for this step.

    The weights are exp(-decay * i), i = 0 for the oldest chunk (Zhao et al., "Learning Fine-Grained Bimanual
    Manipulation with Low-Cost Hardware", RSS 2023): jumps between chunks are smoothed out, at the price of following
    new pictures later, the more so the larger the decay.

    Args:
        policy: Whose chunks.
        decay: Per step, at least 0: every chunk counts the same.

    Raises:
        UserError: The decay is none.
    """

    def __init__(self, policy: Policy, decay: float = DECAY) -> None:
        super().__init__(policy)
        if isinstance(decay, bool) or not isinstance(decay, int | float) or not 0 <= decay < math.inf:
            raise UserError(f"a decay is a finite number, at least 0, not {shown(decay)}")
        self._decay = decay
        self._prompt: str | None = None
        self._chunks: list[Array] = []  # the oldest first; each begins at the present step

    def reset(self) -> None:
        """Forget everything, what was foreseen too."""
        super().reset()
        self._chunks.clear()

    def infer(self, observation: Mapping[str, Any]) -> Array:
        """(1, 23). Raises PolicyError if the policy gives no chunk."""
        if observation["prompt"] != self._prompt:
            self._prompt = str(observation["prompt"])
            self._chunks.clear()
        newest = ask(self._policy, observation)
        self._chunks = [chunk[1:] for chunk in self._chunks if len(chunk) > 1][-_OLDEST:] + [newest]
        weights = np.exp(-self._decay * np.arange(len(self._chunks)))
        now = np.stack([chunk[0] for chunk in self._chunks])
        return np.asarray(matmul(weights, now) / weights.sum())[None]
