"""The state of a node at a tick, as drawn, traced and compared."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

Status = Literal["SUCCESS", "FAILURE", "RUNNING", "INVALID"]
# How an episode ends. "stopped": the policy stopped of its own accord, and the goal is met. "backend_error": a policy's
# server or a language model failed, which is no fault of the tree's.
Ending = Literal["success", "failure", "stopped", "time_limit", "interrupted", "backend_error", "error"]


@dataclass(frozen=True)
class NodeState:
    """How a node stands.

    Attributes:
        status: "INVALID": it has not begun, or what it did was undone: see `interrupted` and `ended`.
        feedback: One line, or "".
        elapsed_s: Simulated time in this round, of nodes that count it.
        limit_s: What elapsed_s may reach.
        gave_up: A SUCCESS that passes over a failure.
        interrupted: It was RUNNING when it was cut off.
        ended: Of INVALID: how its last round ended, which a node above it has reset since; "": it has had none.
        reason, evidence: Of its failure, if it has one: a stable code, and one line for a person.
        origin: Path of the node whose failure that is, itself or one below; "" without a failure.
    """

    status: Status = "INVALID"
    feedback: str = ""
    elapsed_s: float | None = None
    limit_s: float | None = None
    gave_up: bool = False
    interrupted: bool = False
    ended: Literal["", "SUCCESS", "FAILURE"] = ""
    reason: str = ""
    evidence: str = ""
    origin: str = ""

    def told(self) -> dict[str, Any]:
        """It as JSON data, without what is at its default but for the status."""
        values = {name: value for name, value in vars(self).items() if value != getattr(NOT_BEGUN, name)}
        return {"status": self.status, **values}


NOT_BEGUN = NodeState()
