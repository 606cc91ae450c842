"""The expert: a scripted policy on simulator truth.

It is the privileged upper bound and the source of demonstrations, and every report that uses it says so. Its grasps are
physical (friction); what it is spared is perception.
"""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from mpvi_bt.manipulation.pick import pick
from mpvi_bt.manipulation.place import place_in, place_on, present
from mpvi_bt.manipulation.truth import Truth
from mpvi_bt.manipulation.work import Work
from mpvi_bt.plan.skills import Skill, SkillCall, clauses, match
from mpvi_bt.robot.motion import Actions, Motion, MotionFailure
from mpvi_bt.robot.protocol import SIDES, Proprioception, Side
from mpvi_bt.robot.solids import Array

_PATIENCE_S = 2.0  # longer than a trigger takes to fire
_ATTEMPTS = 4  # of one skill
_ROUNDS = 3  # of a whole prompt
_ANYWHERE = ("unknown_object", "unknown_skill", "not_a_container", "not_held", "hands_full")  # backing off mends none


class ExpertPolicy:
    """`mpvi_bt.behaviors.protocols.Policy` that reads simulator truth and needs no pictures.

    Attributes:
        note: What it is doing or why it gave up, for a person.
        planning_s: Wall time spent on stances and paths, measured by `timer`.
    """

    name = "expert"
    cameras: tuple[str, ...] = ()

    def __init__(
        self, truth: Truth, skills: Mapping[str, Skill], seed: int = 0, timer: Callable[[], float] | None = None
    ) -> None:
        """Work in the world of `truth`; the same seed plans the same motions."""
        self._truth, self._skills, self._seed, self._timer = truth, skills, seed, timer
        self._calls = 0
        self.note = ""
        self.planning_s = 0.0
        self.reset()

    def reset(self) -> None:
        """Forget the prompt: the next observation starts its clauses from the first one."""
        self._prompt: str | None = None
        self._motion: Motion | None = None
        self._actions: Actions = iter(())

    def infer(self, observation: Mapping[str, Any]) -> Array:
        """The next action as a chunk of one, (1, 23)."""
        felt: Proprioception = observation["proprioception"]
        if observation["prompt"] != self._prompt or self._motion is None:
            self._prompt = str(observation["prompt"])
            self._motion = Motion(felt)
            self._calls += 1
            work = Work(self._truth, self._motion, np.random.default_rng([self._seed, self._calls]))
            self._actions = self._perform(work, self._prompt)
        self._motion.felt = felt
        started = self._timer() if self._timer else 0.0
        action = next(self._actions, None)
        if self._timer:
            self.planning_s += self._timer() - started
        if action is None:
            action = self._motion.action.copy()
            action[:3] = 0.0
        return action[None]

    def _perform(self, work: Work, prompt: str) -> Actions:
        calls: list[SkillCall] = []
        for clause in clauses(prompt):
            call = match(clause, self._skills)
            if call is None:
                self.note = f"no skill for {clause!r}"
                return
            calls.append(call)
        for _ in range(_ROUNDS):  # what was dropped on the way is picked up again
            for call in calls:
                if not (yield from self._attempt(work, call)):
                    break
            else:
                yield from work.tuck()
                for side in work.held():
                    if (name := work.truth.holding(side)) is not None and work.truth.volumes(name):
                        yield from work.look_at(name)
                self.note = "done"
                yield from self._show(work)

    def _show(self, work: Work) -> Actions:
        """Nobody has said that it is complete: hold what has been filled out to the head, and home again, for ever."""
        for turn in itertools.count():
            yield from work.motion.wait(_PATIENCE_S)
            for side, held in work.held().items():
                if work.truth.volumes(held.name):
                    with contextlib.suppress(MotionFailure):
                        yield from present(work, side, 3 * turn)
                        yield from work.look_at(held.name)
                        yield from work.motion.wait(_PATIENCE_S)
                        yield from work.tuck()

    def _attempt(self, work: Work, call: SkillCall) -> Any:
        """Try one skill several times from different places; yields actions, returns whether it succeeded."""
        tried: list[Array] = []
        for _ in range(_ATTEMPTS):
            try:
                yield from self._skill(work, call, tried)
                return True
            except MotionFailure as failure:
                self.note = f"{call.skill.name}: {failure.reason}"
                if failure.reason in _ANYWHERE:
                    return False
                yield from self._recover(work)
                if failure.reason == "missed":
                    return False
        return False

    def _skill(self, work: Work, call: SkillCall, tried: list[Array]) -> Actions:
        words = call.arguments
        if call.skill.name == "pick":
            alike = {e.name for e in self._truth.knowledge().find(words["object"])}
            if any(work.truth.holding(s) in alike for s in SIDES if words.get("hand") in (None, s)):
                return  # in hand already
            name = self._nearest(work, words["object"])
            for side in self._free_hands(work, words.get("hand"), name):
                try:
                    yield from pick(work, name, side, tried)
                    return
                except MotionFailure as failure:
                    if failure.reason != "no_stance" or "hand" in words:
                        raise
            raise MotionFailure("no_stance")
        side = self._hand_with(work, words["object"], words.get("hand"))
        if call.skill.name == "place_in":
            yield from place_in(work, side, self._nearest(work, words["container"]), tried)
        elif call.skill.name == "place_on":
            yield from place_on(work, side, self._nearest(work, words["surface"]), tried)
        else:
            raise MotionFailure("unknown_skill")

    def _recover(self, work: Work) -> Actions:
        """After a failure: open a hand that holds nothing, raise it, back off, fold."""
        held = work.held()
        for side in SIDES:
            if side not in held and work.motion.felt.gripper_command[side] < 0.9:
                yield from work.motion.grip(side, 1.0, 0.4)
            if side not in held:
                with contextlib.suppress(MotionFailure):  # where no hand can rise, folding is tried all the same
                    yield from work.rise(side)
        x, y, yaw = work.motion.felt.base_pose
        try:
            yield from work.settle()
            yield from work.motion.drive(np.array([x - 0.15 * np.cos(yaw), y - 0.15 * np.sin(yaw), yaw]))
        except MotionFailure as failure:
            self.note = f"recovery: {failure.reason}"

    def _nearest(self, work: Work, phrase: str) -> str:
        """The thing that a phrase names, what is still to be picked up first, then the nearest."""
        found = self._truth.knowledge().find(phrase)
        if not found:
            raise MotionFailure("unknown_object")
        here = work.motion.felt.base_pose[:2]
        best = (found[0].held, found[0].inside is not None)
        alike = [e for e in found if (e.held, e.inside is not None) == best]
        return min(alike, key=lambda e: float(np.linalg.norm(e.center[:2] - here))).name

    def _free_hands(self, work: Work, wanted: str | None, name: str) -> list[Side]:
        free = [s for s in SIDES if work.truth.holding(s) is None]
        if wanted is not None:
            free = [s for s in free if s == wanted]
        if not free:
            raise MotionFailure("hands_full")
        x, y, yaw = work.motion.felt.base_pose
        at = work.truth.pose(name)[:2, 3]
        leftward = -np.sin(yaw) * (at[0] - x) + np.cos(yaw) * (at[1] - y)
        return sorted(free, key=lambda s: (s == "left") != (leftward > 0))

    def _hand_with(self, work: Work, phrase: str, wanted: str | None) -> Side:
        names = {e.name for e in self._truth.knowledge().find(phrase)}
        for side in SIDES:
            if work.truth.holding(side) in names and wanted in (None, side):
                return side
        raise MotionFailure("not_held")
