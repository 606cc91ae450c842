"""What the disturbances of a policy came to in an episode."""

from __future__ import annotations

from typing import TypeVar

from mpvi_bt.executive.actions.chunks import WrappedPolicy
from mpvi_bt.executive.actions.paced import PacedPolicy
from mpvi_bt.ground.protocols import Policy
from mpvi_bt.ground.robot.protocol import CONTROL_HZ
from mpvi_bt.runs.disturbances.faulty_policy import FaultyPolicy
from mpvi_bt.runs.disturbances.late_policy import LatePolicy
from mpvi_bt.runs.episode.result import ActionPace, Lateness

Kind = TypeVar("Kind", bound=WrappedPolicy)


def lateness_of(policy: Policy) -> Lateness | None:
    """What the latency of a policy came to; None if it has none."""
    late = _layer(policy, LatePolicy)
    if late is None:
        return None
    return Lateness(
        stale_action_ratio=round(late.stale_action_ratio, 6),
        effective_control_hz=round(late.effective_control_hz, 6),
    )


def actions_of(policy: Policy) -> ActionPace | None:
    """How a policy's rows were carried out; None for absolute rows at the control rate, if all agree on that rate."""
    paced = _layer(policy, PacedPolicy)
    pace = None if paced is None else paced.pace
    agreed = pace is not None and pace.said_by and not pace.contradicted
    if pace is None or (agreed and pace.rate_hz == CONTROL_HZ and pace.kind == "absolute"):
        return None
    return ActionPace(rate_hz=pace.rate_hz, kind=pace.kind, said_by=pace.said_by or "nobody")


def faults_of(policy: Policy) -> dict[str, int] | None:
    """How often each fault of a policy came about; None if it was given none."""
    faulty = _layer(policy, FaultyPolicy)
    return None if faulty is None else dict(sorted(faulty.happened.items()))


def _layer(policy: Policy, kind: type[Kind]) -> Kind | None:
    """The outermost layer of a kind in which a policy is wrapped."""
    while not isinstance(policy, kind):
        if not isinstance(policy, WrappedPolicy):
            return None
        policy = policy.wrapped
    return policy
