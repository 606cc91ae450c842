"""Monitor: fails a policy's handoff as soon as its signals differ from those of good handoffs."""

from __future__ import annotations

from collections.abc import Sequence

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from mpvi_bt.executive.behaviors.context import WatchedHandoff
from mpvi_bt.executive.behaviors.node import Decorator
from mpvi_bt.executive.behaviors.parameters import duration_text
from mpvi_bt.executive.behaviors.timer import Timer
from mpvi_bt.executive.monitors.alarms import Alarms
from mpvi_bt.executive.monitors.signals import SAMPLE_STEPS, Signals
from mpvi_bt.ground.errors import NotInDryRun

_UNITS = {"reversals": "/s", "disagreement": " rad", "stall": " s", "grip": ""}


class Monitor(Decorator):
    """FAILURE with reason "alarm" at a sample at which enough signals are past their thresholds (`monitors.alarms`).

    The thresholds are those of the run's calibration for the skill. Without a calibration, or without that skill in it,
    it never alarms, and says so. Either way the run's log gets the handoff with its samples, and arm and torso targets
    go to the context's trail, which `back_off` goes back along.

    At the tick of an alarm the child has been ticked, and if that ends it, its own status stands. A resumed run
    begins the signals anew. In a dry run, where there is no robot, it lets its child work and does nothing else.

    Args:
        name: In the tree.
        child: Where the policy is at work.
        skill: Whose thresholds.
        agree: Signals that must agree, 1 to 4.
        alone: How long "stall" or "grip" alone must be past its threshold: simulated seconds or control steps; None: no
            such alarm.
    """

    def __init__(
        self, name: str, child: Behaviour, skill: str | None = None, agree: int = 2, alone: float | str | None = None
    ) -> None:
        super().__init__(name, child)
        self.skill, self.agree = skill, agree
        self._alone = "" if alone is None else f", or stall or grip for {duration_text(alone)}"
        self._alone_s = None if alone is None else Timer(alone).limit_s
        self._handoff: WatchedHandoff | None = None
        self._signals: Signals | None = None

    def initialise(self) -> None:
        """Begin with the first sample."""
        super().initialise()
        context = self.context
        context.trail.clear()
        try:
            self._signals = Signals(context.robot.proprioception())
        except NotInDryRun:
            self._signals, self.feedback_message = None, "no robot to measure"
            return
        self._steps, self._notices = 0, len(context.log.notices)
        self._alarms = Alarms(self.agree, self._alone_s)
        self._handoff = WatchedHandoff(self.skill or "", self.path, context.clock.time_s)
        context.log.handoffs.append(self._handoff)
        known = context.calibration.skills.get(self.skill or "") if context.calibration else None
        if known is not None:
            self.feedback_message = f"{self.agree} of 4 signals{self._alone}, by {known.runs} runs of {self.skill}"
        else:
            self.feedback_message = "no alarms: not calibrated" + (f" for {self.skill}" if self.skill else "")

    def update(self) -> Status:
        """The child's status, unless there is an alarm."""
        context, handoff = self.context, self._handoff
        if self._signals is None or handoff is None:
            return self.decorated.status
        action = context.robot.action
        context.trail.append(action.copy())
        notices = len(context.log.notices)
        with context.stopwatch("monitor"):
            differs = float(getattr(context.policy, "disagreement", 0.0))
            self._signals.update(context.robot.proprioception(), action, differs, notices - self._notices)
        self._notices = notices
        status = self.decorated.status
        if self._steps % SAMPLE_STEPS == 0:
            values = self._signals.values
            handoff.samples.append([round(value, 4) for value in values])
            if status is Status.RUNNING and (said := self._alarm(len(handoff.samples) - 1, values)):
                return self.fail("alarm", said)
        self._steps += 1
        return status

    def terminate(self, new_status: Status) -> None:
        """Note how the handoff ended."""
        if self._handoff is not None:
            if new_status is not Status.INVALID:
                self._handoff.ended = "success" if new_status is Status.SUCCESS else "failure"
            self._handoff.ended_s = self.context.clock.time_s
            self._handoff.reason = self.failure.reason if self.failure else ""
        self._handoff = None
        super().terminate(new_status)

    def _alarm(self, sample: int, values: Sequence[float]) -> str:
        """The signals that speak against going on; "" if there is no alarm."""
        calibration = self.context.calibration
        if calibration is None or not self.skill:
            return ""
        past = calibration.alarms(self.skill, sample, values)
        told = [f"{name} {value:.3g}{_UNITS[name]} > {limit:.3g}" for name, value, limit in past]
        return ", ".join(told) if self._alarms.update([name for name, _, _ in past]) else ""
