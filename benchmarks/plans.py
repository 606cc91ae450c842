"""How many plans of a language model are valid, and what asking costs: BEHAVIOR's fifty instructions, one by one.

    python -m benchmarks.plans local                           # half an hour on two cores; an exchange is kept at once
    python -m benchmarks.plans local --schema free             # nothing enumerated, for comparison
    python -m benchmarks.plans openai:MODEL@URL --first 10 --exchanges runs/plans/exchanges

An instruction whose task is here is asked about that task's house and things; any other about a house alone. The
recorded plan of the task is never an example. What was asked before with the same exchanges is not asked again, and
counts with what it took then. Prints a line a plan, and then how many were valid at the first answer and in the end,
what was wrong with first answers, and tokens and seconds of a plan.
"""

from __future__ import annotations

import argparse
import statistics
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from mpvi_bt.executive.language.chat import Answer, ChatModel, Message, Schema
from mpvi_bt.executive.plan.answer_form import answer_schema
from mpvi_bt.executive.plan.language_planner import REPAIRS, LanguagePlanner, checked, read_answer
from mpvi_bt.executive.plan.planners import RecordedPlanner
from mpvi_bt.executive.plan.planning_context import PlanningContext
from mpvi_bt.executive.plan.skills import load_skills
from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import ModelError
from mpvi_bt.house.instances.tasks import load_task
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.choices.language_models import Models
from mpvi_bt.runs.choices.planning import ground

_HOUSE = "family_house"  # of instructions whose task is not here


@dataclass
class Noted:
    """Asks a model, and notes what it answers.

    Attributes:
        inner: Who is asked.
        free: Whether nothing is enumerated in the schema.
        most: Answers to one instruction.
        answers: Those to the present one.
        failed_s: What an answer to it took that is none, such as one that was cut off.
    """

    inner: ChatModel
    free: bool
    most: int
    answers: list[Answer] = field(default_factory=list)
    failed_s: float = 0.0

    @property
    def name(self) -> str:
        """The model's."""
        return self.inner.name

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


def main() -> None:
    """Ask, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("planner", help="local, or openai:MODEL[@URL]")
    parser.add_argument("--schema", choices=["enumerated", "free"], default="enumerated")
    parser.add_argument("--first", type=int, default=50, help="how many of the instructions")
    parser.add_argument(
        "--answers", type=int, default=REPAIRS + 1, help="to one instruction at most: 1, to mend nothing"
    )
    parser.add_argument("--exchanges", type=Path, default=Path("runs/plans/exchanges"))
    given = parser.parse_args()
    config = EpisodeConfig("", planner=given.planner, exchanges=given.exchanges)
    model = Noted(Models(config).make(given.planner), given.schema == "free", given.answers)
    skills, recorded = load_skills(), RecordedPlanner().all()
    tasks = {task.plan: task for task in map(load_task, paths.names("tasks"))}
    ends: Counter[str] = Counter()
    wrong: Counter[str] = Counter()
    costs: list[tuple[float, int, int]] = []
    # Those of one house in a row: a server need not read again what is the same.
    houses = {name: task.house for name, task in tasks.items()}
    for plan in sorted(recorded[: given.first], key=lambda plan: houses.get(plan.task_name, _HOUSE)):
        model.answers, model.failed_s = [], 0.0
        task = tasks.get(plan.task_name)
        place: PlanningContext = ground(task.house, task) if task else ground(_HOUSE)
        try:
            LanguagePlanner(model, skills, place, recorded).ask(plan.task_name, plan.instruction)
            end = "valid" if len(model.answers) == 1 else "mended"
        except ModelError as error:
            end = error.reason
        if model.answers:
            data, found = read_answer(model.answers[0].text)
            found = found or checked(data, plan.task_name, plan.instruction, skills, place)[1]
            wrong.update({problem.code for problem in found})
        seconds = model.failed_s + sum(answer.latency_s for answer in model.answers)
        tokens_in, tokens_out = (sum(getattr(a, key) for a in model.answers) for key in ("tokens_in", "tokens_out"))
        costs.append((seconds, tokens_in, tokens_out))
        ends[end] += 1
        print(f"{plan.task_name:45s} {end:15s} {len(model.answers)} answers {seconds:7.1f} s", flush=True)
    taken = ends["valid"] + ends["mended"]
    print(f"\n{given.planner}, schema {given.schema}: {taken} of {ends.total()} plans are valid")
    print("ends:", ", ".join(f"{count} {end}" for end, count in ends.most_common()))
    print("wrong with first answers:", ", ".join(f"{code} in {n}" for code, n in wrong.most_common()) or "nothing")
    for name, column in zip(("seconds", "tokens asked", "tokens answered"), zip(*costs, strict=True), strict=True):
        print(f"{name} a plan: median {statistics.median(column):.1f}, mean {statistics.fmean(column):.1f}")


if __name__ == "__main__":
    main()
