"""Plans of a language model: how many have a valid form, how many can be carried out, how many reach the goal.

    python -m benchmarks.plans local --sample 10 --rehearse         # ten of the tasks, drawn by --seed
    python -m benchmarks.plans local --schema free --no-examples    # nothing enumerated, no worked examples
    python -m benchmarks.plans openai:MODEL@URL --exchanges runs/plans/exchanges --json plans.json

A model gets a task's instruction as a user says it, and the names in the task's house. It never sees a plan on file
of that task. Three levels are counted, of first answers and of those in the end:

- form: the plan has no error;
- rehearsed: carried out on paper, it has no findings but what of the goal is missing;
- goal: on paper it reaches the task's goal. A segment that changes nothing is a finding, and yet the goal may be
  reached.

With --rehearse the model is told the findings of a rehearsal and may mend its plan; without it only what is wrong with
words and form. An answer is kept at once, and no question is asked twice with the same exchanges: what was cut off goes
on where it was. Seconds and tokens of answers on file are those of their first time.
"""

from __future__ import annotations

import argparse
import json
import random
import statistics
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

from mpvi_bt.executive.language.chat import Answer, ChatModel, Message, Schema
from mpvi_bt.executive.plan.answer_form import answer_schema
from mpvi_bt.executive.plan.example_plans import examples
from mpvi_bt.executive.plan.language_planner import REPAIRS, LanguagePlanner, checked, read_answer
from mpvi_bt.executive.plan.planners import RecordedPlanner
from mpvi_bt.executive.plan.schema import Plan
from mpvi_bt.executive.plan.skills import load_skills
from mpvi_bt.executive.rehearsal.rehearsal import Rehearsal
from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import ModelError, Problem
from mpvi_bt.house.instances.tasks import Task, load_task, plans_of
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.choices.language_models import Models
from mpvi_bt.runs.choices.planning import ground
from mpvi_bt.runs.choices.rehearsing import make_rehearsal

LEVELS = ("form", "rehearsed", "goal")
PAPER = ("impossible", "pointless", "not-rehearsed", "goal-unmet")  # codes of a rehearsal


@dataclass
class Noted:
    """Asks a model, and notes its answers.

    Attributes:
        inner: The model.
        free: Whether nothing is enumerated in the schema.
        most: Answers to one instruction.
        answers: Those to the present one.
        failed_s: Seconds of an answer to it that failed, such as one that was cut off.
        name: The model's.
    """

    inner: ChatModel
    free: bool
    most: int
    answers: list[Answer] = field(default_factory=list)
    failed_s: float = 0.0
    name: str = field(init=False)

    def __post_init__(self) -> None:
        self.name = self.inner.name

    def ask(self, messages: Sequence[Message], schema: Schema | None = None) -> Answer:
        """As `ChatModel` says. Raises ModelError, too, once there were enough answers."""
        if len(self.answers) >= self.most:
            raise ModelError("over_budget", "no more answers are asked for")
        try:
            self.answers.append(self.inner.ask(messages, answer_schema() if self.free else schema))
        except ModelError as error:
            self.failed_s = error.latency_s
            raise
        return self.answers[-1]


@dataclass(frozen=True)
class Row:
    """What came of one instruction.

    Attributes:
        task: Its name.
        first: The levels that the first answer has, of `LEVELS`.
        last: Those of the plan in the end.
        found: Codes of what is wrong with the plan in the end, or with the first answer where there is none.
        end: "plan", or the reason why there is none.
        answers: How many.
        seconds: All answers together, those that failed too.
        tokens_in: Read by the model.
        tokens_out: Said by it.
    """

    task: str
    first: tuple[str, ...]
    last: tuple[str, ...]
    found: tuple[str, ...]
    end: str
    answers: int
    seconds: float
    tokens_in: int
    tokens_out: int


def levels(plan: Plan | None, found: Sequence[Problem], rehearsal: Rehearsal) -> tuple[tuple[str, ...], list[Problem]]:
    """The levels that a plan has, and everything that is wrong with it.

    Args:
        plan: None: the answer is no plan.
        found: What is wrong with its words and form.
        rehearsal: Of the task.
    """
    if plan is None or any(problem.severity == "error" for problem in found):
        return (), list(found)
    on_paper = rehearsal.problems(plan)
    codes = {problem.code for problem in on_paper}
    has = {"form": True, "rehearsed": codes <= {"goal-unmet"}, "goal": codes <= {"pointless"}}
    return tuple(level for level in LEVELS if has[level]), [*found, *on_paper]


def sample(tasks: Sequence[str], longest: int, count: int, seed: int) -> list[str]:
    """Names of tasks, drawn from those whose plan on file has so many segments at most.

    Those with the same examples come in a row, most of them first: a local model reads what is the same but once.
    """
    plans = {plan.task_name: plan for plan in RecordedPlanner().all()}
    of = {name: load_task(name) for name in tasks}
    short = [name for name, task in of.items() if task.plan in plans and len(plans[task.plan].segments) <= longest]
    drawn = random.Random(seed).sample(short, min(count, len(short)))
    shown = {
        name: tuple(
            p.task_name for p in examples([*plans.values()], load_skills(), of[name].instruction, _own(of[name]))
        )
        for name in drawn
    }
    often = Counter(shown.values())
    return sorted(drawn, key=lambda name: (of[name].house, -often[shown[name]], shown[name], name))


def main(arguments: Sequence[str]) -> None:
    """Ask, and print a line a task and the table."""
    given = _parser().parse_args(arguments)
    config = EpisodeConfig("", planner=given.planner, exchanges=given.exchanges)
    model = Noted(Models(config).make(given.planner), given.schema == "free", given.answers)
    rows = []
    names = sample(paths.names("tasks"), given.longest, given.sample, given.seed)
    for i, name in enumerate(names):
        rows.append(asked(load_task(name), model, given.examples, given.rehearse))
        row = rows[-1]
        came_to = f"first {_last(row.first):10s} end {_last(row.last):10s} {row.answers} answers {row.seconds:7.1f} s"
        print(f"{i + 1:2d}/{len(names)} {name:45s} {came_to} {' '.join(row.found)}", flush=True)
        if given.json is not None:
            given.json.write_text(json.dumps({"given": arguments, "rows": [asdict(row) for row in rows]}, indent=1))
    print(_summary(rows))


def asked(task: Task, model: Noted, shown: bool, rehearse: bool) -> Row:
    """Ask for the plan of one task."""
    model.answers, model.failed_s = [], 0.0
    name = task.plan or task.problem
    skills, place = load_skills(), ground(task.house, task)
    rehearsal = make_rehearsal(skills, task)
    recorded = RecordedPlanner().all() if shown else []
    told = rehearsal.problems if rehearse else None
    plan, doubts, end = None, [], "plan"
    try:
        planner = LanguagePlanner(model, skills, place, recorded, _own(task), rehearse=told)
        planned = planner.ask(name, task.instruction)
        plan, doubts = planned.plan, [p for p in planned.doubts if p.code not in PAPER]
    except ModelError as error:
        end = error.reason
    first: tuple[str, ...] = ()
    found: list[Problem] = []
    if model.answers:
        data, problems = read_answer(model.answers[0].text)
        begun, problems = (None, problems) if problems else checked(data, name, task.instruction, skills, place)
        first, found = levels(begun, problems, rehearsal)
    last, found = levels(plan, doubts, rehearsal) if plan is not None else ((), found)
    tokens_in, tokens_out = (sum(getattr(a, key) for a in model.answers) for key in ("tokens_in", "tokens_out"))
    seconds = round(model.failed_s + sum(answer.latency_s for answer in model.answers), 1)
    codes = tuple(dict.fromkeys(problem.code for problem in found))
    return Row(name, first, last, codes, end, len(model.answers), seconds, tokens_in, tokens_out)


def _own(task: Task) -> set[str]:
    """Names of plans that would tell the answer."""
    return {task.plan or "", task.problem, *plans_of(task.problem)}


def _summary(rows: Sequence[Row]) -> str:
    lines = []
    for when in ("first", "last"):
        counts = Counter(level for row in rows for level in getattr(row, when))
        lines.append(f"{when} answers: " + ", ".join(f"{level} {counts[level]}/{len(rows)}" for level in LEVELS))
    wrong = Counter(code for row in rows for code in row.found)
    lines.append("wrong: " + (", ".join(f"{code} in {n}" for code, n in wrong.most_common()) or "nothing"))
    for key in ("answers", "seconds", "tokens_in", "tokens_out"):
        values = [getattr(row, key) for row in rows]
        lines.append(f"{key} a plan: median {statistics.median(values):.1f}, mean {statistics.fmean(values):.1f}")
    return "\n".join(["", *lines])


def _last(has: tuple[str, ...]) -> str:
    return has[-1] if has else "-"


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("planner", help="local, local:FILE.gguf, or openai:MODEL[@URL]")
    parser.add_argument("--schema", choices=["enumerated", "free"], default="enumerated")
    parser.add_argument("--no-examples", dest="examples", action="store_false", help="show no plans of other tasks")
    parser.add_argument("--rehearse", action="store_true", help="tell the model what a rehearsal finds")
    parser.add_argument("--sample", type=int, default=50, help="how many tasks")
    parser.add_argument("--seed", type=int, default=0, help="of the draw")
    parser.add_argument("--longest", type=int, default=200, help="most segments of a drawn task's plan on file")
    parser.add_argument(
        "--answers", type=int, default=REPAIRS + 1, help="to one instruction at most: 1, to mend nothing"
    )
    parser.add_argument("--exchanges", type=Path, default=Path("runs/plans/exchanges"))
    parser.add_argument("--json", type=Path, help="file for all rows, written after each of them")
    return parser


if __name__ == "__main__":
    main(sys.argv[1:])
