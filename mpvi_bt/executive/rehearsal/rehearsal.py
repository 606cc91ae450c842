"""A plan is rehearsed: carried out on paper, segment by segment, by the needs and effects of its skills.

A rehearsal tells what is impossible, what changes nothing, and what of the goal is not so at the end. What it does not
know it lets pass: words that nothing is called, and deeds that no skill does; the latter it notes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from itertools import islice

from mpvi_bt.executive.completion import criteria
from mpvi_bt.executive.plan.clauses import clauses, match, nameless
from mpvi_bt.executive.plan.history import History
from mpvi_bt.executive.plan.schema import Navigation, Plan, Segment
from mpvi_bt.executive.plan.skills import Skill
from mpvi_bt.executive.rehearsal.done_so_far import world_so_far
from mpvi_bt.executive.rehearsal.known_start import KnownStart
from mpvi_bt.executive.rehearsal.paper_drive import drive
from mpvi_bt.executive.rehearsal.paper_hands import PaperHands
from mpvi_bt.executive.rehearsal.paper_world import CannotBe
from mpvi_bt.ground.errors import Problem, shown
from mpvi_bt.ground.marked_yaml import MAX_PROBLEMS, SourceMarks


class Rehearsal:
    """Rehearses plans from one start.

    Args:
        skills: By name.
        start: What is known; None: nothing. Then a plan is held to what it says itself.
    """

    def __init__(self, skills: Mapping[str, Skill], start: KnownStart | None = None) -> None:
        self._skills, self._start = skills, start or KnownStart()

    def problems(self, plan: Plan, marks: SourceMarks | None = None, history: History | None = None) -> list[Problem]:
        """What is wrong with a plan: warnings, and notes of what was not rehearsed.

        The first impossible segment ends the rehearsal: nobody knows how things would be after it. Words may mean one
        or another of things that are alike: wrong is what is so whether the first or the last of them is taken first.
        Where things lie on furniture nobody knows: what is impossible only if furniture side by side is out of reach of
        each other is in doubt, with the code "far". In the middle of an episode only what the hands hold is certain:
        what is impossible or missing if all that was done had its effects is in doubt, with the code "doubtful".

        Args:
            plan: A valid plan.
            marks: Of the plan's file, for exact places; None: it has no file.
            history: Of the episode, if the plan is for the rest of one.
        """
        marks = marks or SourceMarks.unplaced(plan.model_dump(mode="json"), f"<{plan.task_name}>")
        if history is not None:
            return self._amid(plan, marks, history)
        apart = replace(self._start, adjoining=frozenset())
        found = self._found(plan, partial(PaperHands, apart), marks)
        far = next((problem for problem in found if problem.code == "impossible"), None)
        if far is None or not self._start.adjoining:
            return found
        found = self._found(plan, partial(PaperHands, self._start), marks)
        if any(problem.pointer == far.pointer for problem in found):
            return found
        return [_doubted(far, "far"), *found]

    def _amid(self, plan: Plan, marks: SourceMarks, history: History) -> list[Problem]:
        """The problems of a plan for the rest of an episode."""
        found = self._found(plan, partial(PaperHands, _by_now(history, self._start.hands)), marks)
        if not self._start.called or any(problem.code == "impossible" for problem in found):
            return found
        so_far = self._found(plan, partial(world_so_far, self._skills, self._start, history), marks)
        return [*found, *(_doubted(p, "doubtful") for p in so_far if p.code in ("impossible", "goal-unmet"))]

    def _found(self, plan: Plan, begin: Callable[[bool], PaperHands], marks: SourceMarks) -> list[Problem]:
        readings: list[tuple[int, list[Problem]]] = []
        for backward in (False, True):
            world = begin(backward)
            found = list(islice(self._problems(plan, world, marks), MAX_PROBLEMS))
            if not any(problem.severity == "warning" for problem in found):
                return found
            readings.append((world.done, found))
        return max(readings, key=lambda reading: reading[0])[1]

    def _problems(self, plan: Plan, world: PaperHands, marks: SourceMarks) -> Iterator[Problem]:
        for i, segment in enumerate(plan.segments):
            world.done, at = i, ("segments", i)
            try:
                driven = isinstance(segment, Navigation)
                criterion = None if driven else criteria.parse(segment.completion_criterion)
                before = criterion and world.so(criterion)
                for idle in self._carry_out(world, segment, criterion):
                    message = f"{_said(segment.description)} changes nothing: {idle}"
                    yield marks.problem((*at, "description"), "pointless", message, severity="warning")
                for message, near, known in () if driven else nameless(segment.description, self._skills):
                    yield marks.problem(
                        (*at, "description"), "no-skill", message, severity="note", nearest=near, known=known
                    )
                if criterion is not None and world.so(criterion) is False:
                    still = "is no longer true" if before else "is not true"
                    message = f"{_said(segment.completion_criterion)} {still} after {_said(segment.description)}"
                    yield marks.problem((*at, "completion_criterion"), "impossible", message, severity="warning")
                    return
            except CannotBe as error:
                message = f"{_said(segment.description)} cannot be done: {error}"
                yield marks.problem((*at, "description"), "impossible", message, severity="warning")
                return
            except _Unknown:
                if i + 1 < len(plan.segments) or world.start.called:
                    message = (
                        f"no skill tells the effects of {_said(segment.description)}; what follows is not rehearsed"
                    )
                    yield marks.problem((*at, "description"), "not-rehearsed", message, severity="note")
                return
        unmet = world.start.unmet(world.truth, world.noun)
        if unmet:
            message = f"the plan does not reach the goal: at its end {'; '.join(unmet)}"
            yield marks.problem(("segments",), "goal-unmet", message, severity="warning")

    def _carry_out(self, world: PaperHands, segment: Segment, criterion: criteria.Criterion | None) -> Iterator[str]:
        """Do what a segment says. Yields why something in it changes nothing."""
        if isinstance(segment, Navigation):
            if (idle := drive(world, segment)) is not None:
                yield idle
            return
        calls = [match(said, self._skills) for said in clauses(segment.description, self._skills)]
        known = all(call is not None and call.skill.effects.slots for call in calls)
        if not known and not world.bring_about(criterion):
            raise _Unknown
        for call in calls:
            if call is not None and (idle := world.do(call, criterion)) is not None:
                yield idle


def _by_now(history: History, hands: tuple[str, ...]) -> KnownStart:
    """What is known in the middle of an episode."""
    held = [thing.name for thing in history.seen if thing.held and thing.inside is None][: len(hands)]
    called = {f"{name} in hand {i}": (name,) for i, name in enumerate(held)}
    return KnownStart(called, held=tuple(called), hands=hands, partial=True)


def _doubted(problem: Problem, code: str) -> Problem:
    return replace(problem, code=code, message=f"perhaps {problem.message}")


def _said(text: str) -> str:
    return shown(text, longest=120)  # Our choice: which hand and which place are at the end


class _Unknown(Exception):
    """Nobody knows what a segment does."""
