"""Manipulate: let the policy move the arms until something else ends it, or the policy gives up."""

from __future__ import annotations

import time
from collections import deque
from dataclasses import replace

from py_trees import composites
from py_trees.behaviour import Behaviour
from py_trees.common import Status

from mpvi_bt.executive.behaviors.check_complete import CheckComplete
from mpvi_bt.executive.behaviors.context import Failure, Notice
from mpvi_bt.executive.behaviors.node import Leaf, failure_of
from mpvi_bt.executive.monitors.handoff import (
    COMPLETE,
    CUT_OFF,
    INTERRUPTED,
    NEW_PROMPT,
    POLICY_DONE,
    POLICY_GAVE_UP,
    Handoff,
    says_done,
)
from mpvi_bt.executive.monitors.handoff_watch import HandoffWatch
from mpvi_bt.ground.action_chunk import ask
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.grip import GripWatch
from mpvi_bt.ground.robot.limits import within_reach_of
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, Proprioception
from mpvi_bt.ground.robot.robots import robot_named

_NOTE = 300  # characters of a policy's note
GAVE_UP = "gave_up"  # the reason of a failure by which the policy stops of its own accord
GRIP = "grip"  # the blackboard's key for the last notice, of trees that declare it


class Manipulate(Leaf):
    """Never succeeds: the policy has no notion of being done; CheckComplete or a timeout ends it (Paper, Manipulation).

    FAILURE with reason "gave_up" once the policy says so, its chunk is used up and no answer of the checker is awaited
    (Our choice: learned policies can't say it; of one that can, the time until its timeout would be lost to the rest).
    Its evidence is the policy's note, and what the checker last said no to.

    A chunk of actions is carried out whole, one a step, before the policy is asked again (Our choice: as openpi's
    clients do; `mpvi_bt.executive.actions.chunks` has other ways). At a handoff, that is whenever it starts, and
    when the prompt changes under way, the rest of an old chunk is dropped and the policy reset. Actions are brought
    within what the robot may be commanded; the run's log counts those that were not. Empty and lost grasps are logged,
    too, and so are the figures of each handoff, with the reason why it ended.

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
        self._watch: HandoffWatch | None = None

    def initialise(self) -> None:
        """Hand over to the policy."""
        super().initialise()
        self._since_s = self.context.clock.time_s
        felt = self.context.robot.proprioception()
        self._grip, self._model = GripWatch(felt), robot_named(felt.robot)
        self._begin(self.resolve(self.prompt), felt)

    def update(self) -> Status:
        """Carry out the next action of the chunk, asking for a new chunk when it is used up."""
        context = self.context
        body = context.robot.proprioception()
        if (said := self.resolve(self.prompt)) != self._said:
            self._end(NEW_PROMPT)
            self._begin(said, body)
        watch = self._watch
        assert watch is not None
        self._notice(body, watch)
        if context.asking and context.while_asked == "hold":
            context.robot.hold()
            return Status.RUNNING
        if not self._chunk:
            self._chunk.extend(self._infer(body, watch))
        wanted = self._chunk.popleft()
        action = within_reach_of(self._model, context.robot.action, wanted)
        context.log.clipped += watch.acted(body, wanted, action)
        context.robot.act(action)
        note = str(getattr(context.policy, "note", ""))
        self.feedback_message = " ".join(note.split())[:_NOTE]
        if getattr(context.policy, "gave_up", False) and not (self._chunk or context.asking):
            self._end(POLICY_DONE if says_done(self.feedback_message) else POLICY_GAVE_UP)
            return self.fail(GAVE_UP, "; ".join(filter(None, (self.feedback_message, self._refused()))))
        return Status.RUNNING

    def terminate(self, new_status: Status) -> None:
        """Drop the rest of the chunk and hold still."""
        if self._watch is not None:
            self._end(self._cut_off_by())
        self._chunk.clear()
        super().terminate(new_status)

    def _begin(self, said: str, felt: Proprioception) -> None:
        self._chunk.clear()
        self._said = said
        self._waited, self._first_query = self._waited_steps(), len(self.context.log.queries)
        self._watch = HandoffWatch(self.path, said, felt, self._grip, self._model, self.context.clock.time_s)
        self.context.log.under_way.append(self._watch)
        with self.context.stopwatch("policy"):
            self.context.policy.reset()

    def _end(self, stopped_reason: str) -> None:
        """Log the handoff, if it has not ended yet."""
        watch, self._watch = self._watch, None
        if watch is None:
            return
        log = self.context.log
        log.under_way.remove(watch)
        figures = watch.figures(self.context.clock.time_s, stopped_reason, self.feedback_message)
        log.diagnosis.append(self._with_questions(figures))

    def _with_questions(self, figures: Handoff) -> Handoff:
        """With what the checker beside this node was asked meanwhile, and how long the robot waited for the policy."""
        queries = [q for q in self.context.log.queries[self._first_query :] if q.path.startswith(self._beside)]
        noes = [query for query in queries if not (query.complete or query.fault)]
        return replace(
            figures,
            waited_s=round((self._waited_steps() - self._waited) / CONTROL_HZ, 3),
            judged=any(isinstance(node, CheckComplete) for node in getattr(self.parent, "children", ())),
            asked=sum(not query.fault for query in queries),
            noes=len(noes),
            unanswered=sum(bool(query.fault) for query in queries),
            last_no=f'"{noes[-1].criterion}": {noes[-1].reason}' if noes else "",
        )

    def _waited_steps(self) -> int:
        """Steps so far in which the robot waited for a late action of the policy."""
        policy: object = self.context.policy
        while policy is not None:
            if isinstance(stale := getattr(policy, "stale", None), int):
                return stale
            policy = getattr(policy, "wrapped", None)
        return 0

    def _cut_off_by(self) -> str:
        """Why it is cut off: by what has ended beside it or above it."""
        node: Behaviour = self
        while (above := node.parent) is not None:
            beside = [child for child in above.children if child is not node]
            if above is self.parent and any(
                isinstance(child, CheckComplete) and child.status is Status.SUCCESS for child in beside
            ):
                return COMPLETE
            # A selector goes on after a failure; anything else fails by it.
            if isinstance(above, composites.Selector):
                if any(child.status in (Status.RUNNING, Status.SUCCESS) for child in beside):
                    return CUT_OFF
            elif failure := next(filter(None, map(failure_of, beside)), None):
                return failure.reason
            if isinstance(own := getattr(above, "failure", None), Failure):
                return own.reason
            node = above
        return INTERRUPTED

    @property
    def _beside(self) -> str:
        """How the paths of the nodes beside this one, and of those below them, begin."""
        return self.path.rpartition("/")[0] + "/"

    def _notice(self, body: Proprioception, watch: HandoffWatch) -> None:
        context = self.context
        for kind, side in self._grip.update(body):
            watch.noticed(kind, side)
            context.log.notices.append(Notice(kind, side, self.path, context.clock.time_s))
            if GRIP in context.blackboard:
                context.blackboard[GRIP] = f"{kind} {side}"

    def _refused(self) -> str:
        """What the checker beside this node last did not confirm since the handoff, and why; "" if nothing."""
        for query in reversed(self.context.log.queries):
            if query.time_s < self._since_s:
                break
            if query.path.startswith(self._beside) and not query.complete:
                return f'"{query.criterion}": {query.said}, {query.reason}'
        return ""

    def _infer(self, body: Proprioception, watch: HandoffWatch) -> Array:
        """(H, A) actions from the policy. Raises PolicyError unless they are that, and finite."""
        context = self.context
        with context.stopwatch("rendering"):
            images = {camera: context.robot.look(camera) for camera in context.policy.cameras}
        began = time.perf_counter()
        with context.stopwatch("policy"):
            seen = {"prompt": self._said, "proprioception": body, "images": images, "command": context.robot.action}
            chunk = ask(context.policy, seen)
        watch.answered(len(chunk), time.perf_counter() - began)
        return chunk
