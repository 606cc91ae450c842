"""Ways to carry out action chunks, each a policy that wraps another: receding horizon and temporal ensembling."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from mpvi_bt.ground.action_chunk import ask
from mpvi_bt.ground.errors import UserError, shown
from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.protocols import Policy
from mpvi_bt.ground.robot.action_layout import ActionKind, ActionLayout
from mpvi_bt.ground.robot.robots import layout_of

DECAY = 0.01  # per step of age; the value that ACT was published with
_OLDEST = 1024  # our choice: chunks that are kept: more are never averaged


class WrappedPolicy:
    """Forwards to a wrapped policy, except for its actions: the base of classes that change actions."""

    def __init__(self, policy: Policy) -> None:
        self._policy = policy

    @property
    def wrapped(self) -> Policy:
        """The policy that this one wraps."""
        return self._policy

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

    @property
    def ended(self) -> bool:
        """Whether the policy reports success or has given up; False if it never reports."""
        return getattr(self._policy, "ended", False)

    @property
    def progress(self) -> float | None:
        """How far along the policy takes itself to be, 0 to 1; None if it does not say."""
        return getattr(self._policy, "progress", None)

    @property
    def rate_hz(self) -> float | None:
        """Rows a second, as the policy says; None if it does not."""
        return getattr(self._policy, "rate_hz", None)

    @property
    def rate_from(self) -> str:
        """Who says so; "" for the policy itself."""
        return getattr(self._policy, "rate_from", "")

    @property
    def actions(self) -> ActionKind:
        """What the joints in its rows are."""
        return getattr(self._policy, "actions", "absolute")

    @property
    def disagreement(self) -> float:
        """Of the newest chunk with what was foreseen for its steps before [rad]; 0 if chunks do not overlap."""
        return getattr(self._policy, "disagreement", 0.0)

    def reset(self) -> None:
        """Forget everything."""
        self._policy.reset()

    def close(self) -> None:
        """Close the policy, if it can be."""
        getattr(self._policy, "close", lambda: None)()

    def save(self) -> dict[str, Any]:
        """What it has counted in the episode so far, as JSON values: a resumed run goes on from there."""
        save: Callable[[], dict[str, Any]] = getattr(self._policy, "save", dict)
        return save()

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Restore the state from `save`. Raises KeyError, TypeError or ValueError if it is not one."""
        if hasattr(self._policy, "restore"):
            self._policy.restore(saved)


def difference(foreseen: Array | None, chunk: Array, layout: ActionLayout) -> float:
    """How far two chunks for the same steps are apart [rad]: the arm joint that differs most, averaged over the steps.

    Args:
        foreseen: (k, A) what was foreseen, from this step on; None: nothing.
        chunk: (H, A) what is now.
        layout: Of both.
    """
    steps = 0 if foreseen is None else min(len(foreseen), len(chunk))
    if foreseen is None or not steps or not layout.arm:
        return 0.0
    arms = layout.arm_joints
    apart = np.abs(chunk[:steps, arms] - foreseen[:steps, arms])
    return float(apart.max(1).mean())


class RecedingHorizon(WrappedPolicy):
    """Carries out the beginning of each chunk, then asks again, so that the policy's observation is never older.

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
        self._rest: Array | None = None
        self._disagreement = 0.0

    @property
    def disagreement(self) -> float:
        """Of the newest chunk with the end of the one before, which was dropped [rad]."""
        return self._disagreement

    def reset(self) -> None:
        """Forget everything."""
        super().reset()
        self._rest, self._disagreement = None, 0.0

    def infer(self, observation: Mapping[str, Any]) -> Array:
        """(h, A), h at most the horizon. Raises PolicyError if the policy gives no chunk."""
        chunk = ask(self._policy, observation)
        self._disagreement = difference(self._rest, chunk, layout_of(observation["proprioception"]))
        self._rest = chunk[self._horizon :]
        return chunk[: self._horizon]


class TemporalEnsemble(WrappedPolicy):
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
        self._disagreement = 0.0
        self._chunks: list[Array] = []  # the oldest first; each begins at the present step

    @property
    def disagreement(self) -> float:
        """Of the newest chunk with the one before [rad]."""
        return self._disagreement

    def reset(self) -> None:
        """Forget everything, what was foreseen too."""
        super().reset()
        self._chunks.clear()
        self._disagreement = 0.0

    def infer(self, observation: Mapping[str, Any]) -> Array:
        """(1, A). Raises PolicyError if the policy gives no chunk."""
        if observation["prompt"] != self._prompt:
            self._prompt = str(observation["prompt"])
            self._chunks.clear()
        newest = ask(self._policy, observation)
        self._chunks = [chunk[1:] for chunk in self._chunks if len(chunk) > 1][-_OLDEST:]
        last = self._chunks[-1] if self._chunks else None
        self._disagreement = difference(last, newest, layout_of(observation["proprioception"]))
        self._chunks.append(newest)
        weights = np.exp(-self._decay * np.arange(len(self._chunks)))
        now = np.stack([chunk[0] for chunk in self._chunks])
        return np.asarray(matmul(weights, now) / weights.sum())[None]
