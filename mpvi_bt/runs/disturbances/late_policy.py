"""A policy whose chunks come late: while it computes, the robot waits or goes on with the chunk before."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Literal

import numpy as np

from mpvi_bt.executive.actions.chunks import WrappedPolicy
from mpvi_bt.ground.action_chunk import ask
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.protocols import Policy
from mpvi_bt.ground.robot.action_rows import command_of
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, Proprioception
from mpvi_bt.ground.robot.robots import layout_of
from mpvi_bt.runs.disturbances.latency import in_steps

Meanwhile = Literal["hold", "go_on"]


class LatePolicy(WrappedPolicy):
    """Another policy's chunks, each d control steps after its observation, d = ceil(latency x 30 Hz).

    "hold": the robot holds its targets for d steps, then carries out the whole chunk. "go_on": the last d actions of
    each chunk are kept back; when the rest is carried out the policy is asked, and they are carried out while it
    computes. Of the new chunk the first d actions, whose time has passed, are dropped. A chunk shorter than 2 d cannot
    cover the wait; the robot then holds for what is missing. (Delay d, horizon H, d <= H - d: Real-Time Chunking,
    arXiv 2506.07339.)

    With "go_on" the observation has "committed", (d, A): the actions that will be carried out before the answer takes
    effect. A policy that is trained for it freezes its chunk's first d actions to them.

    Args:
        policy: Whose chunks.
        latency_s: Time of each answer [s], by its number in the episode.
        meanwhile: What the robot does until then.

    Attributes:
        fresh: Actions so far that a chunk gave.
        stale: Steps so far in which there was none, and the robot held.
    """

    def __init__(self, policy: Policy, latency_s: Callable[[int], float], meanwhile: Meanwhile = "hold") -> None:
        super().__init__(policy)
        self._latency_s, self._meanwhile = latency_s, meanwhile
        self._answers = 0
        self._kept: Array | None = None  # the end of the last chunk, not carried out yet
        self._last: Array | None = None  # of the last chunk: the command in force once it is used up
        self.fresh, self.stale = 0, 0

    @property
    def stale_action_ratio(self) -> float:
        """Share of the steps in which the robot held for want of an action (as vla-eval names it)."""
        total = self.fresh + self.stale
        return self.stale / total if total else 0.0

    @property
    def effective_control_hz(self) -> float:
        """Actions from chunks a simulated second, of at most 30 (as vla-eval names it)."""
        return CONTROL_HZ * (1.0 - self.stale_action_ratio)

    def reset(self) -> None:
        """Forget everything, what was kept back too."""
        super().reset()
        self._kept = self._last = None

    def save(self) -> dict[str, Any]:
        """Answers and steps so far."""
        return {"answers": self._answers, "fresh": self.fresh, "stale": self.stale, "wrapped": super().save()}

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Go on from what `save` gave, with the next answer."""
        self._answers, self.fresh, self.stale = (int(saved[key]) for key in ("answers", "fresh", "stale"))
        super().restore(saved["wrapped"])

    def infer(self, observation: Mapping[str, Any]) -> Array:
        """(H, A). Raises PolicyError if the policy gives no chunk."""
        body = observation["proprioception"]
        delay = in_steps(self._latency_s(self._answers))
        self._answers += 1
        covered = np.empty((0, layout_of(body).size)) if self._kept is None else self._kept[:delay]
        held = np.repeat(self._still(body, covered)[None], delay - len(covered), 0)
        waiting = np.concatenate([covered, held])
        if self._meanwhile == "go_on":
            observation = {**observation, "committed": waiting.copy()}
        chunk = ask(self._policy, observation)
        # What was foreseen for steps that the old chunk covered has passed; while the robot held still, nothing has.
        timely = chunk[min(len(covered), len(chunk) - 1) :]
        back = min(delay, len(timely)) if self._meanwhile == "go_on" else 0  # delay > 0: `waiting` is some
        carried, self._kept = timely[: len(timely) - back], timely[len(timely) - back :]
        self.stale += len(held)
        self.fresh += len(covered) + len(carried)
        self._last = timely[-1]
        return np.concatenate([waiting, carried])

    def _still(self, body: Proprioception, before: Array) -> Array:
        """(A,) the command that keeps every joint's target and the base at rest, once `before` is carried out."""
        last = before[-1] if len(before) else self._last
        held = last.copy() if last is not None else command_of(body)
        layout_of(body).set_velocity(held, 0.0)
        return held
