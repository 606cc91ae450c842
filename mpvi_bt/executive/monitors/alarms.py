"""When signals that are past their thresholds make an alarm."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from mpvi_bt.executive.monitors.signals import SAMPLE_S

OUTCOMES = frozenset({"stall", "grip"})  # signals of what the robot gets done, not of what it is told


class Alarms:
    """Tells, sample by sample of one handoff, whether there is an alarm.

    Two symptoms at one time are seldom chance. One alone is a failure only if it lasts, and if it is of what the robot
    gets done: arms that are told to shake may get there all the same (docs/failing_measured.md).

    Args:
        agree: So many signals past their thresholds at one sample make an alarm.
        alone_s: So does one of `OUTCOMES` that has been past its threshold for so long [s]; None: one alone never does.
    """

    def __init__(self, agree: int = 2, alone_s: float | None = None) -> None:
        self._agree, self._alone_s = agree, alone_s
        self._lasting: dict[str, int] = {}  # samples since one of them has been past its threshold

    def update(self, past: Collection[str]) -> bool:
        """Take in the names of the signals that are past their thresholds at the next sample."""
        self._lasting = {name: self._lasting.get(name, -1) + 1 for name in OUTCOMES.intersection(past)}
        alone_s = self._alone_s
        return len(past) >= self._agree or (alone_s is not None and any(s >= alone_s for s in self.lasting_s.values()))

    @property
    def lasting_s(self) -> Mapping[str, float]:
        """How long the exceeded signals of `OUTCOMES` have been past their thresholds [s]; 0 at the first sample."""
        return {name: samples * SAMPLE_S for name, samples in self._lasting.items()}
