"""Our judgment of goals side by side with that of the `bddl` package, on the same random assignments.

    python -m benchmarks.agreement [assignments a task] [task ...]

An assignment gives every literal of a goal a truth at the start and one at the end. Compared are whether the goal is
true, the official q and the q that credits what held at the start. The package, as released, keeps 20 products and 10
permutations of its options; here both limits are lifted. Where its options then are too many to be listed together, it
lists those of each condition of the goal alone: none of these is negated and all of one condition are equally long, so
the best option of the whole goal is the best of every condition.
"""

from __future__ import annotations

import contextlib
import io
import itertools
import math
import random
import re
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any
from unittest import mock

from mpvi_bt.ground.human import human_stats
from mpvi_bt.house.goals.evaluate import judge, snapshot
from mpvi_bt.house.goals.formula import Literal
from mpvi_bt.house.goals.problem import BddlProblem, activities, load_problem
from mpvi_bt.house.layout.house import load_house

MAX_OPTIONS = 20_000  # that are listed together
ASSIGNMENTS = 1_000
# How many things of a wildcard's synset the rooms of OmniGibson's scenes hold, where our house holds another number.
OMNIGIBSON = {"hiding_Easter_eggs": {"tree.n.01": 26}, "rearranging_kitchen_furniture": {"cabinet.n.01": 2}}

World = Mapping[Literal, bool]
Scores = tuple[bool, float, float]  # the goal is true, official q, q with what held at the start


house = cache(load_house)


def counts_of(task: str) -> dict[str, int]:
    """How many things of each of its wildcards' synsets our house has in their room."""
    return {synset: len(house().fixtures_of(synset, room)) for synset, room in load_problem(task).wildcards.items()}


class Thing:
    """Stands for an object of the simulator: the package takes names for variables."""

    def __init__(self, name: str) -> None:
        self.name = name


class Package:
    """A task's goal, compiled and evaluated by the `bddl` package.

    Attributes:
        options: Of the whole goal; or of each of its conditions, where those of the whole are too many.
        number: Options of the whole goal, as many as it would list.
    """

    def __init__(self, task: str, counts: Mapping[str, int], most: int = MAX_OPTIONS) -> None:
        with _unlimited(), contextlib.redirect_stdout(io.StringIO()):  # it prints what it does not recognize
            from bddl import activity
            from bddl.condition_evaluation import get_ground_state_options

            self._evaluate = activity.evaluate_goal_conditions
            self.world: World = {}
            text = _written_out(activities()[task].read_text(encoding="utf-8"), counts)
            conditions = activity.Conditions(task, 0, "omnigibson", predefined_problem=text)
            scope = {name: Thing(name) for name in activity.get_object_scope(conditions)}
            goal = activity.get_goal_conditions(conditions, self, scope)
            self.goal = goal
            self.number = math.prod(len(condition.flattened_condition_options) for condition in goal)
            whole = self.number <= most
            self.options: list[Any] = [
                get_ground_state_options(part, self, scope, conditions.parsed_objects)
                for part in ([goal] if whole else [[condition] for condition in goal])
            ]
        if not whole:
            literals = [
                body[0] for condition in goal for option in condition.flattened_condition_options for body in option
            ]
            assert "not" not in literals
            assert all(len(set(map(len, part))) == 1 for part in self.options)

    def get_predicate_class(self, word: str) -> type:
        """A predicate that reads its truth from `world`, as the package wants it."""
        from bddl.logic_base import AtomicFormula, BinaryAtomicFormula, UnaryAtomicFormula

        def evaluate(_: AtomicFormula, *things: Thing) -> bool:
            return self.world[Literal(word, tuple(thing.name for thing in things))]

        base = UnaryAtomicFormula if word in _UNARY else BinaryAtomicFormula
        return type(word, (base,), {"STATE_NAME": word, "_evaluate": evaluate, "_sample": None})

    def scores(self, start: World, end: World) -> Scores:
        """As BEHAVIOR's evaluator has them (TaskMetric), and as the package's own reward does."""
        before = self._truths(start)
        after = self._truths(end)
        if self._evaluate(self.goal)[0]:
            return True, 1.0, 1.0
        new = [
            [[now and not then for then, now in zip(*pair, strict=True)] for pair in zip(*part, strict=True)]
            for part in zip(before, after, strict=True)
        ]
        return False, _best(new), _best(after)

    def _truths(self, world: World) -> list[list[list[bool]]]:
        self.world = world
        return [[[literal.evaluate() for literal in option] for option in part] for part in self.options]

    def reach(self, rng: random.Random) -> dict[Literal, bool]:
        """The truths of one option, drawn at random, that make it hold."""
        found = {}
        for part in self.options:
            for literal in rng.choice(part):
                body, positive = (literal.body[1], False) if literal.body[0] == "not" else (literal.body, True)
                found[Literal(body[0], tuple(body[1:]))] = positive
        return found


_UNARY = {"open", "toggled_on", "cooked", "frozen", "on_fire", "real"}


@contextlib.contextmanager
def _unlimited() -> Iterator[None]:
    from bddl import condition_evaluation

    products = mock.patch.object(condition_evaluation, "truncated_product", itertools.product)
    with products, mock.patch.object(condition_evaluation, "truncated_permutations", itertools.permutations):
        yield


def _written_out(text: str, counts: Mapping[str, int]) -> str:
    """The problem's text with its wildcards' objects named one by one, and the domain that the package has."""

    def named(match: re.Match[str]) -> str:
        synset = match[1]
        first = 1 + len(set(re.findall(rf"{re.escape(synset)}_\d+\b", text)))
        return " ".join(f"{synset}_{n}" for n in range(first, counts.get(synset, 0) + 1))

    return re.sub(r"\(:domain [^)]*\)", "(:domain omnigibson)", re.sub(r"(\S+)_\*", named, text))


def _best(truths: Sequence[Sequence[Sequence[bool]]]) -> float:
    if len(truths) == 1:
        return max(sum(option) / len(option) for option in truths[0])
    return sum(max(map(sum, part)) for part in truths) / sum(len(part[0]) for part in truths)


@dataclass
class Agreement:
    """How often both say the same of a task.

    Attributes:
        task: Its name.
        literals: In its goal.
        options: That the package has.
        assignments: That were compared.
        reached: Of these, those whose end makes the goal true.
        differ: In the truth of the goal, in official q and in q with what held at the start.
        mean_q: Official, over those that do not reach the goal.
        seconds: That the package took.
    """

    task: str
    literals: int
    options: int
    assignments: int
    reached: int = 0
    differ: tuple[int, int, int] = (0, 0, 0)
    mean_q: float = 0.0
    seconds: float = 0.0


def compare(task: str, counts: Mapping[str, int], assignments: int, most: int = MAX_OPTIONS) -> Agreement:
    """Compare both on random assignments; the same ones for the same arguments.

    Each draws how likely a literal is true, at the start and at the end, from 0.1 to 0.9; every third makes an option
    of the goal true at the end. Goals of more than `most` options are listed condition by condition.
    """
    problem: BddlProblem = load_problem(task).expanded(counts)
    literals = list(snapshot(problem, lambda _: False))
    began = time.perf_counter()
    package = Package(task, counts, most)
    took = time.perf_counter() - began
    rng = random.Random(task)
    found = Agreement(task, len(literals), package.number, assignments)
    total = 0.0
    for number in range(assignments):
        start, end = (
            {k: rng.random() < likely for k in literals} for likely in rng.choices((0.1, 0.3, 0.5, 0.7, 0.9), k=2)
        )
        if number % 3 == 0:
            end |= package.reach(rng)
        began = time.perf_counter()
        theirs = package.scores(start, end)
        took += time.perf_counter() - began
        report = judge(problem, start, end)
        ours = (report.satisfied, report.q, report.fraction)
        apart = [abs(a - b) > 1e-9 for a, b in zip(ours, theirs, strict=True)]
        found.differ = (found.differ[0] + apart[0], found.differ[1] + apart[1], found.differ[2] + apart[2])
        found.reached += theirs[0]
        total += 0.0 if theirs[0] else theirs[1]
    found.mean_q = total / max(1, assignments - found.reached)
    found.seconds = took
    return found


def main(args: Sequence[str]) -> None:
    """Print the table of all tasks, or of those that are named."""
    assignments = int(args[0]) if args else ASSIGNMENTS
    print("| task | literals | options | assignments | goal true | differ in truth, q, fraction | mean q | s |")
    print("|---|---|---|---|---|---|---|---|")
    for task in args[1:] or list(human_stats()):
        here = counts_of(task)
        for counts in [here, here | OMNIGIBSON[task]] if task in OMNIGIBSON else [here]:
            a = compare(task, counts, assignments)
            cells = (a.task, a.literals, f"{a.options:,}", a.assignments, a.reached, ", ".join(map(str, a.differ)))
            print(f"| {' | '.join(map(str, cells))} | {a.mean_q:.3f} | {a.seconds:.1f} |", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
