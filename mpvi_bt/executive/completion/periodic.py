"""Polling: a trigger at fixed intervals, as in the paper's ablation."""

from __future__ import annotations

from collections.abc import Mapping

from mpvi_bt.ground.protocols import TriggerEvent


class PeriodicTriggers:
    """Fires every so many steps, whatever the robot does (implements `Triggers`; Paper, ablation: every 300 steps).

    The event is no hand's, so that the head camera's picture is judged, as the paper's checker is handed it.
    """

    def __init__(self, steps: int) -> None:
        """Fire every `steps` control steps from a reset on, at least 1."""
        self._steps = steps
        self.reset()

    def reset(self, kinds: Mapping[str, float | None] | None = None) -> None:
        """Begin anew. A skill's events are ignored: this is the ablation without them."""
        self._passed = 0

    def update(self) -> TriggerEvent | None:
        """An event, if it is time for one."""
        self._passed += 1
        if self._passed < self._steps:
            return None
        self._passed = 0
        return TriggerEvent("periodic", None)
