"""How long policy, checker and planner took in a run, as `--latency PART=@FILE` reads it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from mpvi_bt.executive.actions.chunks import WrappedPolicy
from mpvi_bt.executive.behaviors.context import Log
from mpvi_bt.ground.compiled import compiling
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.protocols import Policy


class TimedPolicy(WrappedPolicy):
    """Another policy, each of its answers timed.

    Attributes:
        took_s: Wall time of each answer [s], in order.
    """

    def __init__(self, policy: Policy) -> None:
        super().__init__(policy)
        self.took_s: list[float] = []

    def infer(self, observation: Mapping[str, Any]) -> Array:
        """(H, A) as the policy answers. Raises what it raises."""
        began = compiling.clock()
        chunk = self._policy.infer(observation)
        self.took_s.append(compiling.clock() - began)
        return chunk


def measured_times(took_s: list[float], log: Log, planner_s: float | None) -> dict[str, list[float]]:
    """Part to the times of its answers [s], without parts that gave none.

    Args:
        took_s: Of the policy.
        log: Of the run: it has the answers of the checker, and of the planner on the way.
        planner_s: How long the first plan took; None: no planner was asked.
    """
    first = [] if planner_s is None else [planner_s]
    times = {
        "policy": took_s,
        "checker": [query.latency_s for query in log.queries],
        "planner": first + [replan.latency_s for replan in log.replans],
    }
    return {part: [round(seconds, 4) for seconds in taken] for part, taken in times.items() if taken}
