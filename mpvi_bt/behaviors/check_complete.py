"""CheckComplete: ask the checker whether the criterion holds, but only when proprioception says so."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from py_trees.common import Status

from mpvi_bt.behaviors.context import Query
from mpvi_bt.behaviors.node import Leaf
from mpvi_bt.behaviors.protocols import TriggerEvent
from mpvi_bt.behaviors.saved_state import count
from mpvi_bt.errors import UnknownName
from mpvi_bt.robot.protocol import CameraImage, Side

_OTHER: Mapping[Side, Side] = {"left": "right", "right": "left"}


class CheckComplete(Leaf):
    """SUCCESS once an event fired and the checker confirmed; a no lets things go on (Paper, Completion Checker).

    The skill's file says which events ask, and whose camera then sees the result. Without a skill grasps and releases
    ask, a grasp with the wrist camera, a release with the head's (Paper, Proprioceptive trigger: general heuristics for
    all subtasks).

    Args:
        name: In the tree.
        criterion: A state, such as "the trash can is held in a gripper".
        skill: Name of the primitive that ends the group, or None.
    """

    stops_robot = False

    def __init__(self, name: str, criterion: str, skill: str | None = None) -> None:
        super().__init__(name)
        self.criterion, self.skill = criterion, skill
        self._cameras: dict[str, str] = {"grasp": "hand"}
        self._kinds: tuple[str, ...] | None = None
        self._asked_about = criterion
        self._asked = 0

    def setup(self, **kwargs: object) -> None:
        """Look the skill up. Raises UnknownName if the run has no such skill."""
        super().setup(**kwargs)
        if self.skill is not None:
            skills = self.context.skills
            if self.skill not in skills:
                raise UnknownName("skill", self.skill, skills, self.path)
            triggers = skills[self.skill].triggers
            self._cameras = {t.event: t.camera for t in triggers}
            self._kinds = tuple(self._cameras)

    def initialise(self) -> None:
        """Watch anew."""
        super().initialise()
        self._asked_about = self.resolve(self.criterion)
        self.context.triggers.reset(self._kinds)

    def update(self) -> Status:
        """Watch proprioception; on an event, ask."""
        with self.context.stopwatch("triggers"):
            event = self.context.triggers.update()
        if event is None:
            return Status.RUNNING
        return Status.SUCCESS if self._ask(event) else Status.RUNNING

    def terminate(self, new_status: Status) -> None:
        """Forget how often it asked; not when it begins, so that a resumed run counts on."""
        super().terminate(new_status)
        self._asked = 0

    def state(self) -> dict[str, Any]:
        """How often it has asked."""
        return super().state() | ({"asked": self._asked} if self._asked else {})

    def restore(self, state: dict[str, Any]) -> None:
        """Count on from there."""
        super().restore(state)
        self._asked = count(state, "asked")

    def _camera(self, event: TriggerEvent) -> str:
        """Whose picture shows what came of the event."""
        wanted = self._cameras.get(event.kind)
        if event.side is None or wanted not in ("hand", "other_hand"):
            return "head"
        return event.side if wanted == "hand" else _OTHER[event.side]

    def _ask(self, event: TriggerEvent) -> bool:
        context = self.context
        camera: str | None = None
        image: CameraImage | None = None
        if context.checker.needs_image:
            camera = self._camera(event)
            with context.stopwatch("rendering"):
                image = context.robot.look(camera)
        with context.stopwatch("checker"):
            judgement = context.checker.check(self._asked_about, image)
        context.log.queries.append(
            Query(
                self._asked_about,
                event.kind,
                camera,
                judgement.complete,
                judgement.reason,
                self.path,
                context.clock.time_s,
            )
        )
        self._asked += 1
        answer = "yes" if judgement.complete else "no"
        self.feedback_message = f"asked {self._asked}: {answer}, {judgement.reason}"
        return judgement.complete
