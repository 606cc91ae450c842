"""The reactive policy: the expert's skills, in the scene that cameras show. docs/reactive.md describes what it does."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from mpvi_bt.executive.plan.clauses import clauses, match
from mpvi_bt.executive.plan.knowledge import contents
from mpvi_bt.executive.plan.skills import Skill, SkillCall
from mpvi_bt.finding.perception.detector import Detector
from mpvi_bt.finding.perception.segmentation import SegmentationDetector
from mpvi_bt.finding.scene.free_space import Standing
from mpvi_bt.finding.scene.seen import Seen
from mpvi_bt.ground.errors import shown
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.motion import Actions, MotionFailure
from mpvi_bt.ground.robot.protocol import SIDES, other
from mpvi_bt.ground.robot.squeeze import squeezes
from mpvi_bt.ground.words.phrases import kinds
from mpvi_bt.hands.motion.door_views import stand_before_open
from mpvi_bt.hands.motion.gaze import look_down, turn_to
from mpvi_bt.hands.motion.view_held import show
from mpvi_bt.hands.motion.work import Work
from mpvi_bt.hands.policies.readings import count, readings
from mpvi_bt.hands.policies.scripted_policy import Performance, ScriptedPolicy
from mpvi_bt.hands.policies.visual_search import look_for, look_from_elsewhere
from mpvi_bt.hands.skills.cut import half_of
from mpvi_bt.hands.skills.spots import is_floor

# Our choice.
_OTHERS = 4  # things that are opened, one after the other, because something was not in the one before
_HANDS_RAD = 0.9  # tilt of the head that sees what folded hands hold
_NAMES = ("object", "container", "surface", "target", "tool", "source")  # slots that name things to look for


class ReactivePolicy(ScriptedPolicy):
    """`mpvi_bt.ground.protocols.Policy` that sees, and knows no simulator."""

    name = "reactive"
    tries = 3  # of a clause. Our choice

    def __init__(
        self, skills: Mapping[str, Skill], seed: int = 0, timer: Callable[[], float] | None = None,
        detector: Detector | None = None, vocabulary: Mapping[str, Iterable[str]] | None = None,
        standing: Standing | None = None,
    ) -> None:  # fmt: skip
        """See through `detector`, by default the picture's labels and a vocabulary: label to phrases.

        `standing` says what stands around that was seen before a prompt, by who drove here; None: nobody tells.
        """
        self._seen = Seen(detector or SegmentationDetector(vocabulary or {}, least_px=1), standing)
        super().__init__(self._seen, skills, seed, timer)

    def infer(self, observation: Mapping[str, Any]) -> Array:
        """The next action as a chunk of one, (1, 23)."""
        self._seen.feel(observation["proprioception"])
        return super().infer(observation)

    def perform(self, work: Work, prompt: str) -> Performance:
        """Do the first clause that can be grounded in view, then the next such one; look around if there is none.

        What is not in the thing that was opened last is looked for in the next one that is called so, before that.
        """
        calls = [c for clause in clauses(prompt, self._skills) if (c := match(clause, self._skills)) is not None]
        if not calls:
            self.note = f"no skill for {shown(prompt)}"
            return None
        named = [p for call in calls for r in readings(call) for p in self._phrases(r, _NAMES)]
        cuts = [(call.skill.effects.cut, call.arguments) for call in calls]
        cut = [half_of(words[slot]) for slot, words in cuts if slot is not None and slot in words]
        self._seen.forget(kinds([*named, *filter(None, map(contents, named)), *cut]))
        if any(call.skill.hands for call in calls):
            yield from self._look_at_hands(work)
        left = [(call, self.tries) for call in calls for _ in range(count(call))]
        opened: SkillCall | None = None
        others = _OTHERS
        while left:
            k = self._first_grounded(left)
            if k is None and opened is not None:
                again, opened = opened, None
                with contextlib.suppress(MotionFailure):
                    yield from stand_before_open(work, work.nearest(again.arguments["object"], ajar=True))
                k = self._first_grounded(left)
                if k is None and others and self._shut(work, again.arguments["object"]):
                    left.insert(0, (again, 1))  # it is not in there: another may be meant
                    others -= 1
                    continue
            if k is None:
                self.note = f"looking for {', '.join(dict.fromkeys(p for c, _ in left for p in self._needed(c)))}"
                yield from look_for(work, lambda: self._first_grounded(left) is not None, self._seen.passable)
                k = self._first_grounded(left)
            if k is None:
                self.note = f"nothing in view for {left[0][0].skill.name}"
                return None
            call, tries = left[k]
            understood = self._grounded(call)
            assert understood is not None
            if (yield from self.do(work, understood)):
                opened = understood if call.skill.effects.open is not None else None
                del left[k]
            elif tries > 1:
                left[k] = (call, tries - 1)
                place = self._last_named(work, understood)
                if place is not None:
                    yield from look_from_elsewhere(work, place, self._seen.passable)
            else:
                return None
        return calls[-1]

    def _shut(self, work: Work, phrase: str) -> bool:
        """Whether the thing that a phrase is now taken to name is shut."""
        with contextlib.suppress(MotionFailure):  # it may be known no more
            return not work.stands_open(work.nearest(phrase))
        return False

    def _phrases(self, call: SkillCall, slots: Iterable[str]) -> list[str]:
        """What a call names in some slots, but for the floor."""
        named = [call.arguments[slot] for slot in slots if slot in call.arguments]
        return [phrase for phrase in named if not is_floor(phrase)]

    def _needed(self, call: SkillCall) -> list[str]:
        """What a call names that has to be known before it can be done: seen, or held."""
        hidden = {*call.skill.unseen, "source"} - {call.in_hand}  # elsewhere a source is only where to look
        return self._phrases(call, [slot for slot in _NAMES if slot not in hidden])

    def _last_named(self, work: Work, call: SkillCall) -> Array | None:
        """Where the last thing is that a call names and no hand holds, (2,): what it was to be done at."""
        for phrase in reversed(self._needed(call)):
            with contextlib.suppress(MotionFailure):  # it may be known no more
                if (name := work.nearest(phrase, ajar=True)) not in work.carried():
                    return work.middle(name)[:2]
        return None

    def _grounded(self, call: SkillCall) -> SkillCall | None:
        """The first reading of a call all of whose things are known; of several, one that is not put away yet.

        What is in a vessel that the robot carries is put away.
        """
        known, several = self._seen.knowledge(), count(call) > 1
        for reading in readings(call):
            found = {p: known.find(p) for p in self._needed(reading)}
            effects, words = reading.skill.effects, reading.arguments
            if effects.beside is not None and (place := words.get(effects.beside[1], "")) in found:
                found[place] = [e for e in found[place] if not e.held]
            if effects.held is not None and (hand := words.get("hand")) in SIDES:
                taken, wanted = self._seen.holding(other(hand)), words[effects.held]
                found[wanted] = [e for e in found[wanted] if e.name != taken]
            things = found.get(words.get("object", ""), [])
            away = bool(things) and all(e.inside and (several or e.held) for e in things)
            if all(found.values()) and not away:
                return reading
        return None

    def _first_grounded(self, left: Sequence[tuple[SkillCall, int]]) -> int | None:
        """Index of the first call that can be grounded."""
        return next((k for k, (call, _) in enumerate(left) if self._grounded(call) is not None), None)

    def _look_at_hands(self, work: Work) -> Actions:
        """See what the hands hold already."""
        felt, motion = work.motion.felt, work.motion
        sides = [side for side in SIDES if felt.holds(side)]
        pressed = squeezes(felt)
        if sides or pressed:
            # What is as large as what both hands press would be cut by the edge of the picture.
            seen = SIDES if pressed else [] if motion.robot.nods else sides
            with contextlib.suppress(MotionFailure):
                if seen:
                    yield from turn_to(work, np.mean([work.hand(side)[:3, 3] for side in seen], axis=0))
                else:
                    yield from look_down(work, _HANDS_RAD)
            yield from work.see("head", *sides)
            for side in sides:
                if not self._seen.recognized(side):
                    with contextlib.suppress(MotionFailure):  # what is not seen is not known
                        yield from show(work, side)
