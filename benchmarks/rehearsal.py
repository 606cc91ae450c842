"""Plans with one mistake: how many of those that fail on paper a rehearsal finds, and how many good ones it blames.

    python -m benchmarks.rehearsal
    python -m benchmarks.rehearsal --each 5 --json rehearsal.json

A mutant is a plan on file with one mistake, drawn by --seed: --each of every kind, shared out over the fifty tasks. It
is rehearsed with the facts of its task. The judge is the run on paper of the tests. It has laws of its own for each
skill; words, criteria and goals it reads by the same code. Things that are alike are taken from the first and from the
last: a mutant fails if neither way reaches the goal, and a false alarm blames one that reaches it one way.

The judge lets the robot reach only what lies with the thing that it drove to. Whether it reaches furniture within 1 m
of that depends on where the things lie: then the rehearsal does not say that a plan fails, and is in doubt.

The second table compares both with what a person says of 50 of the mutants, which `judged_by_hand.yaml` has.
"""

from __future__ import annotations

import argparse
import json
import random
import re
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from itertools import chain, combinations
from pathlib import Path

import yaml

from benchmarks.origin import grid
from mpvi_bt.executive.plan.schema import Navigation, Plan, Segment
from mpvi_bt.house.instances.tasks import load_task
from mpvi_bt.runs.choices.rehearsing import make_rehearsal
from tests.symbolic_state import CannotBe
from tests.test_plans50 import SKILLS, TASKS, call_of, plan_of, unmet

BY_HAND = Path(__file__).with_name("judged_by_hand.yaml")
FOUND, DOUBTED = {"impossible", "goal-unmet"}, {"far"}  # codes of a rehearsal
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
        found: What the rehearsal says is impossible or missing, first; "" if it finds nothing.
        doubt: What it doubts; "" for nothing.
    """

    task: str
    kind: str
    change: str
    judged: str
    found: str
    doubt: str

    @property
    def told(self) -> str:
        """What the rehearsal makes of it."""
        return "found" if self.found else "in doubt" if self.doubt else "nothing"


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
        rehearsal = make_rehearsal(SKILLS, load_task(task))
        for m in mutants:
            if m.task == task:
                problems = rehearsal.problems(m.plan)
                found, doubt = (
                    next((problem.message for problem in problems if problem.code in codes), "")
                    for codes in (FOUND, DOUBTED)
                )
                yield Trial(m.task, m.kind, m.change, judged(m), found, doubt)


def table(trials: list[Trial]) -> list[list[str | int]]:
    """A row for each kind, and one for all: mutants, failing, found, doubted, missed, doable, false alarms."""
    return [_row(kind, [t for t in trials if t.kind == kind]) for kind in KINDS] + [_row("all", trials)]


def _row(kind: str, trials: list[Trial]) -> list[str | int]:
    fails, works = [t for t in trials if t.judged], [t for t in trials if not t.judged]
    told, blamed = Counter(t.told for t in fails), sum(t.told != "nothing" for t in works)
    counts = (told[what] for what in ("found", "in doubt", "nothing"))
    return [kind, len(trials), len(fails), *counts, len(works), blamed]


def by_hand(trials: list[Trial]) -> list[list[str | int]]:
    """A row for each verdict of a person: mutants, how many the judge fails, the rehearsal finds, and it doubts."""
    told = {(said["task"], said["change"]): said["verdict"] for said in yaml.safe_load(BY_HAND.read_text("utf-8"))}
    verdicts: dict[str, list[Trial]] = {"fails": [], "works": [], "unsure": []}
    for trial in trials:
        if (verdict := told.pop((trial.task, trial.change), None)) is not None:
            verdicts[verdict].append(trial)
    rows: list[list[str | int]] = []
    for verdict, of in verdicts.items():
        told_of = Counter(t.told for t in of)
        rows.append([verdict, len(of), sum(bool(t.judged) for t in of), told_of["found"], told_of["in doubt"]])
    return rows


HEADS_BY_HAND = ["by hand", "mutants", "the judge fails", "the rehearsal finds", "doubts"]
HEADS = ["mistake", "mutants", "fail", "found", "in doubt", "not found", "work", "false alarms"]


def main() -> None:
    """Draw, rehearse and judge; print what was missed or blamed for nothing, and the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--each", type=int, default=100, help="mutants of each kind")
    parser.add_argument("--seed", type=int, default=0, help="of the draw")
    parser.add_argument("--json", type=Path, help="file for all trials")
    given = parser.parse_args()
    trials = [*tried(drawn(given.each, given.seed))]
    for trial in trials:
        if bool(trial.judged) != bool(trial.found or trial.doubt):
            said = trial.found or trial.doubt
            wrong = f"false alarm: {said}" if said else f"not found: {trial.judged}"
            print(f"{trial.task}: {trial.change}: {wrong}")
    for heads, rows in ((HEADS, table(trials)), (HEADS_BY_HAND, by_hand(trials))):
        print(grid(heads, [[str(cell) for cell in row] for row in rows]))
    if given.json is not None:
        given.json.write_text(json.dumps([asdict(trial) for trial in trials], indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
