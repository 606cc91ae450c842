"""BackOff: take the arms back along the way that they came."""

from __future__ import annotations

from py_trees.common import Status

from mpvi_bt.executive.behaviors.node import Leaf
from mpvi_bt.executive.behaviors.timer import Timer
from mpvi_bt.ground.robot.robots import layout_of


class BackOff(Leaf):
    """Gives the targets of arms and torso of the last handoff again, the last one first, a step each; then SUCCESS.

    What was free of contact on the way in is so on the way out. Fingers keep their target and the base stands. Without
    a trail, as where no `monitor` was, it succeeds at once.

    Args:
        name: In the tree.
        duration: How far back: simulated seconds or control steps; None: to the handoff.
    """

    def __init__(self, name: str, duration: float | str | None = None) -> None:
        super().__init__(name)
        self._timer = None if duration is None else Timer(duration)

    def initialise(self) -> None:
        """Begin at the end of the trail."""
        super().initialise()
        if self._timer is not None:
            self._timer.start(self.context.clock)

    def update(self) -> Status:
        """Go back one step."""
        context = self.context
        trail, robot = context.trail, context.robot
        if not trail or (self._timer is not None and self._timer.is_up(context.clock)):
            return Status.SUCCESS
        was, action = trail.pop(), robot.action.copy()
        layout = layout_of(robot.proprioception())
        layout.set_velocity(action, 0.0)
        action[layout.joints] = was[layout.joints]
        robot.act(action)
        self.feedback_message = "arms back along their way"
        return Status.RUNNING
