"""Manipulate: let the policy move the arms until something else ends it."""

from __future__ import annotations

from collections import deque

import numpy as np
from py_trees.common import Status

from mpvi_bt.behaviors.node import Leaf
from mpvi_bt.errors import BackendError
from mpvi_bt.robot.protocol import ACTION_SIZE
from mpvi_bt.robot.solids import Array


class Manipulate(Leaf):
    """Always RUNNING: the policy has no notion of being done; CheckComplete or a timeout ends it (Paper, Manipulation).

    A chunk of actions is carried out whole, one a step, before the policy is asked again (Our choice: as openpi's
    clients do). At a handoff, that is whenever it starts, the rest of an old chunk is dropped and the policy reset.

    Args:
        name: In the tree.
        prompt: What to do; clauses joined by ", then ".
    """

    def __init__(self, name: str, prompt: str) -> None:
        super().__init__(name)
        self.prompt = prompt
        self._said = prompt
        self._chunk: deque[Array] = deque()

    def initialise(self) -> None:
        """Hand over to the policy."""
        super().initialise()
        self._chunk.clear()
        self._said = self.resolve(self.prompt)
        with self.context.stopwatch("policy"):
            self.context.policy.reset()

    def update(self) -> Status:
        """Carry out the next action of the chunk, asking for a new chunk when it is used up."""
        if not self._chunk:
            self._chunk.extend(self._infer())
        self.context.robot.act(self._chunk.popleft())
        return Status.RUNNING

    def terminate(self, new_status: Status) -> None:
        """Drop the rest of the chunk and hold still."""
        self._chunk.clear()
        super().terminate(new_status)

    def _infer(self) -> Array:
        """(H, 23) actions from the policy. Raises BackendError unless they are that, and finite."""
        context = self.context
        with context.stopwatch("rendering"):
            images = {camera: context.robot.look(camera) for camera in context.policy.cameras}
        with context.stopwatch("policy"):
            observation = {
                "prompt": self._said,
                "proprioception": context.robot.proprioception(),
                "images": images,
            }
            chunk = np.asarray(context.policy.infer(observation), dtype=float)
        if chunk.ndim != 2 or len(chunk) == 0 or chunk.shape[1] != ACTION_SIZE:
            raise BackendError(
                f"policy {context.policy.name}: a chunk of shape {chunk.shape}, not (H, {ACTION_SIZE}), H >= 1"
            )
        if not np.isfinite(chunk).all():
            raise BackendError(f"policy {context.policy.name}: a chunk with numbers that are not finite")
        return chunk
