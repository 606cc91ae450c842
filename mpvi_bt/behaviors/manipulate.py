"""Manipulate: let the policy move the arms until something else ends it, or the policy gives up."""

from __future__ import annotations

from collections import deque

import numpy as np
from py_trees.common import Status

from mpvi_bt.action_chunk import ask
from mpvi_bt.behaviors.context import Notice
from mpvi_bt.behaviors.node import Leaf
from mpvi_bt.robot.grip import GripWatch
from mpvi_bt.robot.limits import within_reach_of
from mpvi_bt.robot.protocol import Proprioception
from mpvi_bt.robot.robots import robot_named
from mpvi_bt.robot.solids import Array

_CLIPPED = 1e-3  # [m, rad, m/s]: what is brought within the limits by less is no more than noise
_NOTE = 300  # characters of a policy's note
GRIP = "grip"  # the blackboard's key for the last notice, of trees that declare it


class Manipulate(Leaf):
    """Never succeeds: the policy has no notion of being done; CheckComplete or a timeout ends it (Paper, Manipulation).

    FAILURE with reason "gave_up" once the policy says so, its chunk is used up and no answer of the checker is awaited
    (Our choice: learned policies can't say it; of one that can, the time until its timeout would be lost to the rest).
    Its evidence is the policy's note, and what the checker last said no to.

    A chunk of actions is carried out whole, one a step, before the policy is asked again (Our choice: as openpi's
    clients do; `mpvi_bt.manipulation.policies.chunks` has other ways). At a handoff, that is whenever it starts, and
    when the prompt changes under way, the rest of an old chunk is dropped and the policy reset. Actions are brought
    within what the robot may be commanded; the run's log counts those that were not. Empty and lost grasps are logged,
    too.

    Where the run says so, the robot holds still while the checker is being asked; the chunk then waits where it is.

    Args:
        name: In the tree.
        prompt: What to do; clauses joined by ", then ".
    """

    def __init__(self, name: str, prompt: str) -> None:
        super().__init__(name)
        self.prompt = prompt
        self._said = prompt
        self._chunk: deque[Array] = deque()
        self._since_s = 0.0

    def initialise(self) -> None:
        """Hand over to the policy."""
        super().initialise()
        self._since_s = self.context.clock.time_s
        self._begin(self.resolve(self.prompt))
        felt = self.context.robot.proprioception()
        self._grip, self._model = GripWatch(felt), robot_named(felt.robot)

    def update(self) -> Status:
        """Carry out the next action of the chunk, asking for a new chunk when it is used up."""
        if (said := self.resolve(self.prompt)) != self._said:
            self._begin(said)
        context = self.context
        body = context.robot.proprioception()
        self._notice(body)
        if context.asking and context.while_asked == "hold":
            context.robot.hold()
            return Status.RUNNING
        if not self._chunk:
            self._chunk.extend(self._infer(body))
        wanted = self._chunk.popleft()
        action = within_reach_of(self._model, context.robot.action, wanted)
        if np.abs(action - wanted).max() > _CLIPPED:
            context.log.clipped += 1
        context.robot.act(action)
        note = str(getattr(context.policy, "note", ""))
        self.feedback_message = " ".join(note.split())[:_NOTE]
        if getattr(context.policy, "gave_up", False) and not (self._chunk or context.asking):
            return self.fail("gave_up", "; ".join(filter(None, (self.feedback_message, self._refused()))))
        return Status.RUNNING

    def terminate(self, new_status: Status) -> None:
        """Drop the rest of the chunk and hold still."""
        self._chunk.clear()
        super().terminate(new_status)

    def _begin(self, said: str) -> None:
        self._chunk.clear()
        self._said = said
        with self.context.stopwatch("policy"):
            self.context.policy.reset()

    def _notice(self, body: Proprioception) -> None:
        context = self.context
        for kind, side in self._grip.update(body):
            context.log.notices.append(Notice(kind, side, self.path, context.clock.time_s))
            if GRIP in context.blackboard:
                context.blackboard[GRIP] = f"{kind} {side}"

    def _refused(self) -> str:
        """What the checker beside this node last did not confirm since the handoff, and why; "" if nothing."""
        beside = self.path.rpartition("/")[0] + "/"
        for query in reversed(self.context.log.queries):
            if query.time_s < self._since_s:
                break
            if query.path.startswith(beside) and not query.complete:
                return f'"{query.criterion}": {query.said}, {query.reason}'
        return ""

    def _infer(self, body: Proprioception) -> Array:
        """(H, 23) actions from the policy. Raises PolicyError unless they are that, and finite."""
        context = self.context
        with context.stopwatch("rendering"):
            images = {camera: context.robot.look(camera) for camera in context.policy.cameras}
        with context.stopwatch("policy"):
            seen = {"prompt": self._said, "proprioception": body, "images": images, "command": context.robot.action}
            return ask(context.policy, seen)
