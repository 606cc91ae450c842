"""The wording of a run's end, the same everywhere: q first if a goal was scored, then the end of the plan.

The end of a plan is no success: failed units are given up, and the plan advances.
"""

from __future__ import annotations

from collections.abc import Mapping

from mpvi_bt.executive.tree.spec import TreeSpec

ENDED: Mapping[str, str] = {
    "success": "finished",
    "failure": "failed",
    "stopped": "the policy stopped",
    "time_limit": "out of time",
    "interrupted": "interrupted",
    "backend_error": "backend error",
    "error": "error",
    "cut": "the trace breaks off",
}
_OWN = ("success", "failure")  # ends that the tree itself comes to
WELL = ("success", "stopped")  # ends that are no failure, whatever the goal says


def is_plan(tree: TreeSpec) -> bool:
    """Whether the tree may give up units; then its SUCCESS does not mean that all of them succeeded."""
    return any(node.spec.kind == "attempt" for node in tree.nodes)


def gave_up(ending: str, failures: int) -> int:
    """Number of given-up units of a run: all its failures but the one that ended it, if one did."""
    return failures - (failures > 0 and ending in ("failure", "backend_error"))


def ended(ending: str, gave_up: int = 0, plan: bool = True, time_s: float | None = None, q: float | None = None) -> str:
    """Such as "q = 0.333, plan finished after 15.6 s, 2 units given up".

    Args:
        ending: As of `Outcome`, or "cut".
        gave_up: Units that were given up.
        plan: Whether it is a plan's tree, as `is_plan` says.
        time_s: Simulated time; None: it is not told.
        q: Score of the goal; None: there is none.
    """
    word = ENDED.get(ending, ending.replace("_", " "))
    what = f"plan {word}" if plan else "tree succeeded" if ending == "success" else f"tree {word}"
    told = what if ending in _OWN else word
    told += f" after {time_s:.1f} s" if time_s is not None else ""
    told += f", {gave_up} unit{'s' * (gave_up > 1)} given up" if gave_up else ""
    return told if q is None else f"q = {q:.3f}, {told}"
