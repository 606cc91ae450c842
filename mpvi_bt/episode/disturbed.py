"""What the disturbances of a policy came to in an episode."""

from __future__ import annotations

from mpvi_bt.disturbances.faulty_policy import FaultyPolicy
from mpvi_bt.disturbances.late_policy import LatePolicy
from mpvi_bt.episode.result import Lateness
from mpvi_bt.manipulation.policies.chunks import WrappedPolicy
from mpvi_bt.protocols import Policy


def lateness_of(policy: Policy) -> Lateness | None:
    """What the latency of a policy came to; None if it has none."""
    if not isinstance(policy, LatePolicy):
        return None
    return Lateness(
        stale_action_ratio=round(policy.stale_action_ratio, 6),
        effective_control_hz=round(policy.effective_control_hz, 6),
    )


def faults_of(policy: Policy) -> dict[str, int] | None:
    """How often each fault of a policy came about; None if it was given none."""
    while not isinstance(policy, FaultyPolicy):
        if not isinstance(policy, WrappedPolicy):
            return None
        policy = policy.wrapped
    return dict(sorted(policy.happened.items()))
