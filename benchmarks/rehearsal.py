"""Plans with one mistake: how many of those that fail on paper a rehearsal finds, and how many good ones it blames.

    python -m benchmarks.rehearsal
    python -m benchmarks.rehearsal --each 5 --json rehearsal.json

A mutant is a plan on file with one mistake, drawn by --seed: --each of every kind, shared out over the fifty tasks. It
is rehearsed with the facts of its task. The judge is the run on paper of the tests. It has laws of its own for each
skill; words, criteria and goals it reads by the same code. Things that are alike are taken from the first and from the
last: a mutant fails if neither way reaches the goal, and a false alarm blames one that reaches it one way.

The judge lets the robot reach only what lies with the thing that it drove to. A rehearsal lets it reach furniture
within 1 m of that, too. What fails for the judge, and is found as soon as the rehearsal takes no furniture for near, is
counted under `near`: nobody knows without playing it.
"""

from __future__ import annotations

import argparse
import json
import random
import re
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from itertools import chain, combinations
from pathlib import Path

from benchmarks.origin import grid
from mpvi_bt.executive.plan.schema import Navigation, Plan, Segment
from mpvi_bt.executive.rehearsal.rehearsal import Rehearsal
from mpvi_bt.house.instances.tasks import load_task
from mpvi_bt.runs.choices.rehearsing import task_start
from tests.symbolic_state import CannotBe
from tests.test_plans50 import SKILLS, TASKS, call_of, plan_of, unmet

FOUND = {"impossible", "goal-unmet"}  # codes of a rehearsal
_SLOTS = ("object", "container", "surface", "target", "source", "tool")
_OTHER = {"left": "right", "right": "left"}
_SIDE = re.compile(r"\b(left|right)(?= (?:hand|gripper)\b)")


@dataclass(frozen=True)
class Mutant:
    """A plan with a mistake.

    Attributes:
        task: Its name.
        kind: Of the mistake.
        change: What was done to the plan, in words.
        segments: All of them.
    """

    task: str
    kind: str
    change: str
    segments: tuple[Segment, ...]

    @property
    def plan(self) -> Plan:
        """The plan on file with these segments."""
        return plan_of(self.task).model_copy(update={"segments": self.segments})


@dataclass(frozen=True)
class Trial:
    """What came of a mutant.

    Attributes:
        task, kind, change: Those of the mutant.
        judged: Why it fails, by the judge; "" if it does not.
        found: What the rehearsal says first; "" if it finds nothing.
        near: Whether it finds something only where no furniture is near another.
    """

    task: str
    kind: str
    change: str
    judged: str
    found: str
    near: bool


Change = tuple[str, tuple[Segment, ...]]


def _left_out(segments: tuple[Segment, ...]) -> Iterator[Change]:
    for i, segment in enumerate(segments):
        yield f"without {i + 1}, {segment.description!r}", segments[:i] + segments[i + 1 :]


def _swapped(segments: tuple[Segment, ...]) -> Iterator[Change]:
    for j in range(len(segments)):
        for i in range(j):
            if segments[i] != segments[j]:
                changed = list(segments)
                changed[i], changed[j] = changed[j], changed[i]
                yield f"{i + 1} and {j + 1} swapped", tuple(changed)


def _other_hand(segments: tuple[Segment, ...]) -> Iterator[Change]:
    for i, segment in enumerate(segments):
        if _SIDE.search(segment.description):
            yield _said(segments, i, _SIDE.pattern, lambda side: _OTHER[side[0]])


def _other_object(segments: tuple[Segment, ...]) -> Iterator[Change]:
    """One name in a segment, where it is driven to or done, instead of another of the same plan."""
    names = dict.fromkeys(name for segment in segments for name in _names(segment))
    for i, segment in enumerate(segments):
        for name in _names(segment):
            for other in names:
                if name not in other and other not in name:
                    yield _said(segments, i, re.escape(name), other)


def _forgotten(segments: tuple[Segment, ...]) -> Iterator[Change]:
    """One or two doors and lids not closed or not opened, or things not switched on or off."""
    calls = {i: call_of(s.description) for i, s in enumerate(segments) if not isinstance(s, Navigation)}
    doors = [i for i, call in calls.items() if call is not None and call.skill.name in ("open", "close", "press")]
    for out in chain(combinations(doors, 1), combinations(doors, 2)):
        said = " and ".join(f"{i + 1}, {segments[i].description!r}" for i in out)
        yield f"without {said}", tuple(segment for i, segment in enumerate(segments) if i not in out)


KINDS: dict[str, Callable[[tuple[Segment, ...]], Iterator[Change]]] = {
    "a step left out": _left_out,
    "two swapped": _swapped,
    "the other hand": _other_hand,
    "another object": _other_object,
    "a door or switch forgotten": _forgotten,
}


def _said(segments: tuple[Segment, ...], i: int, pattern: str, other: str | Callable[[re.Match[str]], str]) -> Change:
    """One segment with what a pattern finds said otherwise, in all its words."""
    words = ("description", "completion_criterion", "target")
    told = {key: text for key in words if isinstance(text := getattr(segments[i], key, None), str)}
    changed = segments[i].model_copy(update={key: re.sub(pattern, other, text) for key, text in told.items()})
    text = f"{i + 1}, {segments[i].description!r}, became {changed.description!r}"
    return text, (*segments[:i], changed, *segments[i + 1 :])


def _names(segment: Segment) -> list[str]:
    """What a segment calls the things that it is about, without articles."""
    if isinstance(segment, Navigation):
        return [segment.target]
    call = call_of(segment.description)
    told = [call.arguments[slot] for slot in _SLOTS if slot in call.arguments] if call is not None else []
    return [re.sub(r"^(?:(?:another|both|an?|the)(?: other| last)?) ", "", name) for name in told]


def drawn(each: int, seed: int) -> list[Mutant]:
    """So many mutants of each kind, or all there are, none twice; of each task about as many as of every other."""
    mutants = []
    for kind, changes in KINDS.items():
        rng = random.Random(f"{seed} {kind}")
        left = {task: [*changes(plan_of(task).segments)] for task in rng.sample(TASKS, len(TASKS))}
        for there in left.values():
            rng.shuffle(there)
        chosen: list[Mutant] = []
        while len(chosen) < each and any(left.values()):
            chosen += [Mutant(task, kind, *there.pop()) for task, there in left.items() if there]
        mutants += chosen[:each]
    return mutants


def judged(mutant: Mutant) -> str:
    """Why a mutant fails, whichever of things that are alike is taken first; "" if it works once."""
    why = ""
    for backward in (False, True):
        try:
            missing = unmet(mutant.task, mutant.plan, backward)
            why = why or f"misses the goal: {'; '.join(missing)}"
            if not missing:
                return ""
        except CannotBe as error:
            why = why or str(error)
    return why


def tried(mutants: list[Mutant]) -> Iterator[Trial]:
    """Rehearse and judge mutants, task by task."""
    for task in dict.fromkeys(mutant.task for mutant in mutants):
        start = task_start(load_task(task))
        usual, strict = Rehearsal(SKILLS, start), Rehearsal(SKILLS, replace(start, adjoining=frozenset()))
        for m in mutants:
            if m.task == task:
                found = _found(usual, m)
                near = not found and bool(_found(strict, m))
                yield Trial(m.task, m.kind, m.change, judged(m), found, near)


def _found(rehearsal: Rehearsal, mutant: Mutant) -> str:
    return next((problem.message for problem in rehearsal.problems(mutant.plan) if problem.code in FOUND), "")


def table(trials: list[Trial]) -> list[list[str | int]]:
    """A row for each kind, and one for all: mutants, failing, found, near, missed, doable, false alarms."""
    return [_row(kind, [t for t in trials if t.kind == kind]) for kind in KINDS] + [_row("all", trials)]


def _row(kind: str, trials: list[Trial]) -> list[str | int]:
    fails, works = [t for t in trials if t.judged], [t for t in trials if not t.judged]
    found, near = sum(bool(t.found) for t in fails), sum(t.near for t in fails)
    alarms = sum(bool(t.found) for t in works)
    return [kind, len(trials), len(fails), found, near, len(fails) - found - near, len(works), alarms]


HEADS = ["mistake", "mutants", "fail", "found", "not found: near furniture", "not found: else", "work", "false alarms"]


def main() -> None:
    """Draw, rehearse and judge; print what was missed or blamed for nothing, and the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--each", type=int, default=100, help="mutants of each kind")
    parser.add_argument("--seed", type=int, default=0, help="of the draw")
    parser.add_argument("--json", type=Path, help="file for all trials")
    given = parser.parse_args()
    trials = [*tried(drawn(given.each, given.seed))]
    for trial in trials:
        if bool(trial.judged) != bool(trial.found) and not trial.near:
            wrong = f"false alarm: {trial.found}" if trial.found else f"not found: {trial.judged}"
            print(f"{trial.task}: {trial.change}: {wrong}")
    print(grid(HEADS, [[str(cell) for cell in row] for row in table(trials)]))
    if given.json is not None:
        given.json.write_text(json.dumps([asdict(trial) for trial in trials], indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
