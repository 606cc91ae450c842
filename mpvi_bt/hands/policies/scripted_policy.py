"""A policy that performs the skills of a prompt, one after the other, whatever it knows the world by."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Generator, Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mpvi_bt.executive.plan.clauses import clauses, match
from mpvi_bt.executive.plan.skills import Skill, SkillCall
from mpvi_bt.finding.scene.scene import Scene
from mpvi_bt.ground.errors import shown
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.protocols import NO_SKILL
from mpvi_bt.ground.robot.action_rows import standing
from mpvi_bt.ground.robot.model import RobotModel
from mpvi_bt.ground.robot.motion import GRIP, Actions, Motion, MotionFailure
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, Proprioception, Side
from mpvi_bt.ground.robot.robots import robot_named
from mpvi_bt.hands.motion.carry import back_off, come_out, settle, step_back, tuck
from mpvi_bt.hands.motion.follow import around, draw_off
from mpvi_bt.hands.motion.gaze import look_at
from mpvi_bt.hands.motion.hold_out import present
from mpvi_bt.hands.motion.work import Work
from mpvi_bt.hands.policies.repertoire import motion_of
from mpvi_bt.hands.policies.result_views import done_at, fell_beside, views
from mpvi_bt.hands.stance.effort import Effort
from mpvi_bt.hands.stance.grasps import grasps


@dataclass(frozen=True)
class Persistence:
    """How long, and how often, the policy goes on with a prompt."""

    patience_s: float = 2.0  # pause in which the checker can confirm completion [s]; a trigger fires sooner; our choice
    idle_s: float = 3.5  # the same for a robot that only looks [s]; our choice
    past_rad: tuple[float, ...] = (0.4, -0.8, 0.4)  # turns of the base to look past the payload [rad]; our choice
    attempts: int = 4  # attempts at one skill; our choice
    still: float = 1e-3  # a step that changes joints [rad] or speeds [m/s, rad/s] by less moves nothing; our choice
    pause_s: float = 1.0  # what an attempt takes in which nothing moved [s]; a timeout has to end them; our choice
    rounds: int = 3  # attempts at a whole prompt; our choice
    shown: int = 3  # times that a filled container is held out to be seen; our choice
    checks: float = 300.0  # base poses that the searches for a prompt may check at the start; our choice
    earned: float = 6.0 / CONTROL_HZ  # base poses added with every step; planning keeps ahead of playing; our choice


_PERSIST = Persistence()
Performance = Generator[Array, None, SkillCall | None]
_Vain = tuple[tuple[int, ...], str]  # how far it was when an attempt changed nothing, and why that failed
# Backing off mends none of these.
_ANYWHERE = ("unknown_object", "unknown_skill", "not_a_container", "not_held", "hands_full", "not_found", "no_mount")


class ScriptedPolicy:
    """A `mpvi_bt.ground.protocols.Policy` that plans its motions from a `Scene`.

    Attributes:
        name: As given on the command line.
        note: What it is doing or why it gave up, for a person.
        ended: Whether it has come to the end of its prompt, by its own senses: it thinks it done, or has given up.
        gave_up: Whether it will do no more about its prompt: it can't, or it has shown in every way that it is done.
        attempts: Tries of skills so far.
        planning_s: Wall time spent on planning and seeing, measured by `timer`.
        rate_hz: An action a control step.
    """

    name = "scripted"
    rate_hz = float(CONTROL_HZ)

    def __init__(
        self, scene: Scene, skills: Mapping[str, Skill], seed: int = 0, timer: Callable[[], float] | None = None
    ) -> None:
        """Work in what `scene` knows; the same seed plans the same motions.

        Raises:
            UserError: A skill's file names a motion that is not there.
        """
        self._scene = scene
        self._motions = {name: motion_of(skill) for name, skill in skills.items()}
        self._skills, self._seed, self._timer = skills, seed, timer
        self._calls = 0
        self._meant: dict[str, str] = {}
        self._grasped: dict[Side, Array] = {}
        self.note = ""
        self.attempts = 0
        self.planning_s = 0.0
        self.reset()

    @property
    def cameras(self) -> tuple[str, ...]:
        """The cameras that it wants to look through next; most of the time none."""
        return self._work.wanted if self._work is not None else ()

    def reset(self) -> None:
        """Forget the prompt: the next observation starts its clauses from the first one."""
        self._prompt: str | None = None
        self._work: Work | None = None
        self.ended = self.gave_up = False
        self._actions: Actions = iter(())
        self._moves = 0  # steps in which the robot was told to move, since it got the prompt
        self._in_vain: dict[Hashable, _Vain] = {}  # by the words of a skill call

    def close(self) -> None:
        """Break off what is being done, while the world still tells what was taken."""
        self._actions = iter(())

    def infer(self, observation: Mapping[str, Any]) -> Array:
        """The next action as a chunk of one, (1, 23)."""
        felt: Proprioception = observation["proprioception"]
        if not isinstance(robot_named(felt.robot), RobotModel):
            self.note, self.ended, self.gave_up = f"{NO_SKILL}: none here moves the robot {felt.robot}", True, True
            return standing(felt)[None]
        if observation["prompt"] != self._prompt or self._work is None:
            self._prompt = str(observation["prompt"])
            self._calls += 1
            self.note = ""
            self.ended = self.gave_up = False
            rng = np.random.default_rng([self._seed, self._calls])
            meant = {} if self._scene.needs_looks else self._meant  # what is seen is numbered anew for each prompt
            effort = Effort(_PERSIST.checks)
            self._work = Work(self._scene, Motion(felt), rng, effort=effort, meant=meant, grasped=self._grasped)
            self._actions, self._moves, self._in_vain = self._performed(self._work, self._prompt), 0, {}
        work = self._work
        work.motion.felt = felt
        work.images = {camera: observation["images"][camera] for camera in work.wanted}  # more may have been sent
        work.effort.left += _PERSIST.earned
        started, told = self._timer() if self._timer else 0.0, work.motion.action.copy()
        action = next(self._actions, None)
        if self._timer:
            self.planning_s += self._timer() - started
        if action is None:
            action = work.motion.still()
        self._moves += bool(np.abs(action - told).max() > _PERSIST.still)
        return action[None]

    def _performed(self, work: Work, prompt: str) -> Actions:
        """Everything that it does about a prompt; a motion that fails outside of any attempt ends it, with a note."""
        try:
            while (last := (yield from self.perform(work, prompt))) is not None:
                if not (yield from self._finish(work, last)):
                    break
        except MotionFailure as failure:
            self.note = f"{self.note}: {failure.reason}" if self.note else failure.reason
        self.ended = True
        yield from work.motion.wait(_PERSIST.idle_s)  # who is asked now may see that it is done after all
        self.gave_up = True

    def perform(self, work: Work, prompt: str) -> Performance:
        """Everything that it does about a prompt; returns the last skill of one that is done, None of another."""
        calls: list[SkillCall] = []
        for clause in clauses(prompt, self._skills):
            call = match(clause, self._skills)
            if call is None:
                self.note = f"no skill for {shown(clause)}"
                return None
            calls.append(call)
        if not calls:
            return None
        calls = [_with_content(call, calls[k + 1 :]) for k, call in enumerate(calls)]
        done = begin = 0  # so many calls have succeeded once, and so many lie behind what was put away last
        # What was dropped is picked up again; what was put away stays there.
        for again in reversed(range(_PERSIST.rounds)):
            failed = False
            for k, call in enumerate(calls[begin:], begin):
                if (yield from self.do(work, call)):
                    done = max(done, k + 1)
                    begin = k + 1 if call.skill.effects.put is not None else begin
                elif k >= done:  # what was done before may be done still, such as a door that stands open
                    failed = True
                    if again:  # at the last what comes after it is done all the same
                        break
            if not failed:
                return calls[-1]
        return None

    def _finish(self, work: Work, last: SkillCall) -> Generator[Array, None, bool]:
        """Everything is done: carry what is held close, look at it, and show it if nobody says that it is complete.

        Returns whether to do it all again: what was taken has been lost since.
        """
        if not last.skill.hands:
            yield from self._stay(work, last)
        with contextlib.suppress(MotionFailure):  # where it cannot be brought closer it stays
            yield from tuck(work)
        for side in work.held():
            if (name := work.scene.holding(side)) is not None and work.scene.volumes(name):
                with contextlib.suppress(MotionFailure):
                    yield from look_at(work, name)
        self.note, self.ended = "done", True
        return (yield from self._show(work, last))

    def _stay(self, work: Work, last: SkillCall) -> Actions:
        """It is there, and nobody has said so: look past what it carries, and drive up to it again, for ever."""
        self.note, self.ended = "done", True
        while True:
            for turn in _PERSIST.past_rad:
                yield from work.motion.wait(_PERSIST.patience_s)
                with contextlib.suppress(MotionFailure):
                    yield from work.motion.drive(work.motion.felt.base_pose + [0.0, 0.0, turn])
            yield from self.attempt(work, last)

    def _show(self, work: Work, last: SkillCall) -> Generator[Array, None, bool]:
        """Nobody has said that it is complete: look at it from here, then otherwise; hold out what has been filled.

        Returns at once, with true, where it was to be taken and no hand holds anything any more; likewise where it was
        to be put into something, and the views show it beside that.
        """
        if work.scene.between() is None and (names := done_at(work, last)):
            with contextlib.suppress(MotionFailure):
                yield from look_at(work, *names)
        yield from work.motion.wait(_PERSIST.idle_s)
        if last.skill.effects.held is not None and not work.carried():
            return True
        for view in views(work, last):
            with contextlib.suppress(MotionFailure):
                yield from view
            yield from work.motion.wait(_PERSIST.idle_s)
        if fell_beside(work, last):
            return True
        for turn in range(_PERSIST.shown):
            yield from work.motion.wait(_PERSIST.patience_s)
            for side, held in work.held().items():
                if work.scene.volumes(held.name):
                    with contextlib.suppress(MotionFailure):
                        yield from present(work, side, 3 * turn)
                        yield from look_at(work, held.name)
                        yield from work.motion.wait(_PERSIST.patience_s)
                        yield from tuck(work)
        return False

    def do(self, work: Work, call: SkillCall) -> Any:
        """Try a clause; what it wants in hand and is not is picked up first. Returns whether it succeeded."""
        wanted = call.arguments[call.in_hand] if call.in_hand is not None else None
        if wanted is not None and "pick" in self._skills and not self._carries(work, wanted):
            words = {s: w for s, w in (("object", wanted), ("hand", call.arguments.get("hand"))) if w}
            fetch = self._skills["pick" if self._graspable(work, words["object"]) else "lift"]
            self._at(fetch)
            if not (yield from self.attempt(work, SkillCall(fetch, words))):
                return False
        self._at(call.skill)
        return (yield from self.attempt(work, call))

    def _at(self, skill: Skill) -> None:
        """Note what it is at, unless the note tells why that failed last."""
        if self.note.partition(":")[0] != skill.name:
            self.note = skill.name

    def _graspable(self, work: Work, phrase: str) -> bool:
        """Whether one hand is to fetch what a phrase names: it fits between the fingers, or both are not to be had."""
        if "lift" not in self._skills or work.carried():
            return True
        if not (found := self._scene.knowledge().find(phrase)):
            return True
        hand, bearing = work.motion.robot.hand, float(work.motion.felt.base_pose[2])
        return any(grasps(self._scene, hand, e.name, bearing) for e in found)

    def _carries(self, work: Work, phrase: str) -> bool:
        """Whether the robot carries something that a phrase names."""
        held = work.in_hands()
        return any(e.name in held for e in self._scene.knowledge().find(phrase))

    def attempt(self, work: Work, call: SkillCall) -> Any:
        """Try one skill several times from different places; yields actions, returns whether it succeeded.

        An attempt that changed nothing, neither the robot nor what it knows, is not repeated: it would fail alike.
        """
        tried: list[Array] = []
        yield from come_out(work)
        words = call.skill.name, *call.arguments.items()
        for _ in range(_PERSIST.attempts):
            before = self._progress(work, tried)
            vain, why = self._in_vain.get(words, (None, ""))
            if before == vain:
                self.note = why
                return False
            self.attempts += 1
            try:
                perform = self._motions.get(call.skill.name)
                if perform is None:
                    raise MotionFailure("unknown_skill")
                work.refusals.clear()
                yield from perform(work, call.arguments, tried)
                return True
            except MotionFailure as failure:
                self.note = f"{call.skill.name}: {work.explained(failure)}"
                if failure.reason in _ANYWHERE:
                    return False
                yield from self._recover(work)
                if failure.reason == "missed":
                    return False
                if self._progress(work, tried) == before:
                    self._in_vain[words] = before, self.note
                    yield from work.motion.wait(_PERSIST.pause_s)
        return False

    def _progress(self, work: Work, tried: list[Array]) -> tuple[int, ...]:
        """What tells one attempt from the next: moves, views, and base poses that were taken or found not to do."""
        return self._moves, work.views, len(tried) + sum(map(len, work.effort.failed.values()))

    def _recover(self, work: Work) -> Actions:
        """After a failure: open a hand that holds nothing, get it clear, back off, fold; keep what both hands hold.

        Off what its fingers stand around, such as a bar, a hand is drawn back; otherwise it is raised.
        """
        if work.scene.between() is not None:
            with contextlib.suppress(MotionFailure):
                yield from back_off(work)
            return
        held = work.held()
        for side in work.motion.robot.sides:
            if side not in held and work.motion.felt.gripper_command[side] < 0.9:
                yield from work.motion.grip(side, 1.0, GRIP.clear_s)
            if side not in held:
                with contextlib.suppress(MotionFailure):  # where no hand gets clear, folding is tried all the same
                    yield from (draw_off(work, side) if around(work, side) else work.rise(side))
        try:
            yield from settle(work)
            yield from step_back(work)
            if len(work.held()) == 1:  # two hands that are full may be at work on one another
                yield from tuck(work)
        except MotionFailure as failure:
            self.note = f"recovery: {failure}"


def _with_content(call: SkillCall, later: Sequence[SkillCall]) -> SkillCall:
    """A call that opens something, with the word "content": what the first of some later calls takes out of it."""
    opened = call.arguments.get(call.skill.effects.open or "")
    if opened is None:
        return call
    for taking in later:
        taken = taking.arguments.get(taking.skill.effects.held or "")
        if taken is not None and taking.arguments.get("source") == opened:
            return replace(call, arguments={**call.arguments, "content": taken})
    return call
