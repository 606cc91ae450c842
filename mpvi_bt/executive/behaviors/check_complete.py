"""CheckComplete: after a trigger event, ask the checker whether the criterion holds."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

from py_trees.common import Status

from mpvi_bt.executive.behaviors.context import Query
from mpvi_bt.executive.behaviors.node import Leaf
from mpvi_bt.executive.behaviors.question import Question
from mpvi_bt.executive.behaviors.saved_state import count
from mpvi_bt.executive.completion.criteria import parse
from mpvi_bt.ground.errors import UnknownName
from mpvi_bt.ground.protocols import Judgement, TriggerEvent
from mpvi_bt.ground.robot.protocol import CameraImage, Side, other
from mpvi_bt.ground.robot.robots import robot_named


class CheckComplete(Leaf):
    """SUCCESS once an event fired and the checker confirmed; else things go on (Paper, Completion Checker).

    The skill's file says which events ask, and whose camera then sees the result. Without a skill any event asks, a
    grasp with the wrist camera, the others with the head's (Paper, Proprioceptive trigger: general heuristics for all
    subtasks).

    One question is open at a time. Of the events that fire meanwhile the last one is kept: after a no it asks at once,
    with a picture of that moment, as things have changed since the one that was judged; after a yes it is of no more
    interest (Our choice). Whoever interrupts the check drops the question; a resumed run asks it anew.

    Where the skill names a witness, the wrist's picture of the moment of a release is kept, and the checker is asked
    about it once, after a no to the other picture. A run that is resumed between the two has lost it.

    Args:
        name: In the tree.
        criterion: A state, such as "the trash can is held in a gripper".
        skill: Name of the primitive that ends the group, or None.
        at_once: Ask once, at the first tick, by the head's picture; FAILURE with reason "not_complete" on a no,
            and with the fault's code where there was no answer.
    """

    stops_robot = False

    def __init__(self, name: str, criterion: str, skill: str | None = None, at_once: bool = False) -> None:
        super().__init__(name)
        self.criterion, self.skill, self.at_once = criterion, skill, at_once
        self._cameras: dict[str, str] = {"grasp": "hand"}
        self._witness = False
        self._kept: CameraImage | None = None  # of the moment in which a hand let go
        self._kinds: Mapping[str, float | None] | None = None
        self._asked_about = criterion
        self._asked = 0
        self._due: TriggerEvent | None = None  # what asks next
        self._open: tuple[TriggerEvent, str | None, Question[Judgement]] | None = None  # with the camera

    def setup(self, **kwargs: object) -> None:
        """Look the skill up. Raises UnknownName if the run has no such skill."""
        super().setup(**kwargs)
        if self.skill is not None:
            skills = self.context.skills
            if self.skill not in skills:
                raise UnknownName("skill", self.skill, skills, self.path)
            triggers = skills[self.skill].triggers
            self._cameras = {t.event: t.camera for t in triggers}
            self._witness = any(t.witness for t in triggers)
            self._kinds = {t.event: t.refractory_s for t in triggers}

    def initialise(self) -> None:
        """Watch anew."""
        super().initialise()
        self._asked_about = self.resolve(self.criterion)
        self.context.triggers.reset(self._kinds)
        self._kept = None
        if self.at_once:
            self._due = TriggerEvent("asked", None)

    def update(self) -> Status:
        """Watch for events; on one, ask; on a yes, end."""
        if not self.at_once:
            with self.context.stopwatch("triggers"):
                event = self.context.triggers.update()
            self._keep()
            if event is not None and self._tells(event):
                self._due = event
        if self._open is None and self._due is not None:
            self._ask(self._due, self._look(self._camera(self._due)))
            self._due = None
        said = self._said()
        if said is not None and said.complete:
            return Status.SUCCESS
        if self.at_once and said is not None:
            return self.fail(said.fault or "not_complete", self.feedback_message)
        return Status.RUNNING

    def terminate(self, new_status: Status) -> None:
        """Forget the open question, and how often it asked; not when it begins, so that a resumed run counts on."""
        super().terminate(new_status)
        self._asked = 0
        self._due = None
        self._close()

    def state(self) -> dict[str, Any]:
        """How often it has asked and was answered, and what it must ask about again."""
        event = self._due or (self._open[0] if self._open else None)
        answered = self._asked - (self._open is not None)
        return {
            **super().state(),
            **({"asked": answered} if answered else {}),
            **({"event": [event.kind, event.side]} if event else {}),
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Count on from there. Raises ValueError if the event is none."""
        super().restore(state)
        self._asked = count(state, "asked")
        match state.get("event"):
            case None:
                self._due = None
            case [str(kind), None | "left" | "right" as side]:
                self._due = TriggerEvent(kind, side)
            case wrong:
                raise ValueError(f"'event' should be the kind of an event and its hand, not {wrong!r:.40}")

    def _camera(self, event: TriggerEvent) -> str:
        """The camera that shows the result of an event."""
        wanted = self._cameras.get(event.kind)
        if event.side is None or wanted not in ("hand", "other_hand"):
            return "head"
        camera = event.side if wanted == "hand" else other(event.side)
        return camera if camera in robot_named(self.context.robot.proprioception().robot).cameras else "head"

    def _tells(self, event: TriggerEvent) -> bool:
        """Whether a picture of an event can show the result: a hand's own camera sees nothing of the other hand.

        Our choice: nor is the other camera asked, whose hand may be about to close on the thing.
        """
        camera, asked = self._camera(event), parse(self._asked_about)
        return camera == "head" or asked is None or asked.side in (None, camera)

    def _look(self, camera: str) -> CameraImage | None:
        """That camera's picture, for a checker that looks at one."""
        if not self.context.checker.needs_image:
            return None
        with self.context.stopwatch("rendering"):
            return self.context.robot.look(camera)

    def _keep(self) -> None:
        """Keep the picture of a hand that has let go in this step, where the skill says so."""
        side: Side | None = getattr(self.context.triggers, "released", None)
        if side is None:
            return
        if self._witness and side in robot_named(self.context.robot.proprioception().robot).cameras:
            self._kept = self._look(side)

    def _ask(self, event: TriggerEvent, image: CameraImage | None) -> None:
        context, checker = self.context, self.context.checker
        with context.stopwatch("checker"):
            question = Question(
                partial(checker.check, self._asked_about, image),
                context.clock,
                lambda judgement: judgement.latency_s,
                at_once=not getattr(checker, "remote", False),
            )
        self._open = event, None if image is None else image.camera, question
        self._asked += 1
        self.feedback_message = f"asked {self._asked}: no answer yet"
        context.asking.add(question)

    def _said(self) -> Query | None:
        """The answer to the open question, once it is there; after a no, that of the picture of this very release."""
        if self._open is None:
            return None
        event, *_ = self._open
        said, kept = self._answer(*self._open), self._kept
        if said is None or said.said != "no" or event.kind != "release" or kept is None or kept.camera != event.side:
            return said
        self._kept = None
        self._ask(event, kept)
        return self._answer(*self._open)

    def _answer(self, event: TriggerEvent, camera: str | None, question: Question[Judgement]) -> Query | None:
        """The question with its answer, once that is there."""
        context = self.context
        with context.stopwatch("checker"):
            judged = question.answer()
        if judged is None:
            return None
        self._close()
        query = Query(
            self._asked_about,
            event.kind,
            camera,
            judged.complete,
            judged.reason,
            self.path,
            question.asked_s,
            judged.latency_s,
            judged.fault,
            judged.cost,
        )
        context.log.queries.append(query)
        self.feedback_message = f"asked {self._asked}: {query.said}, {query.reason}"
        return query

    def _close(self) -> None:
        if self._open is not None:
            self.context.asking.discard(self._open[2])
        self._open = None
