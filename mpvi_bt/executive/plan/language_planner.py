"""The planner that asks a language model (Paper, Subtask Planning) and checks every answer."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from mpvi_bt.executive.language.chat import Answer, ChatModel
from mpvi_bt.executive.language.json_answer import parse_json
from mpvi_bt.executive.language.thinking import spoken
from mpvi_bt.executive.plan.answer_form import answer_schema, read_segment
from mpvi_bt.executive.plan.example_plans import examples
from mpvi_bt.executive.plan.history import History
from mpvi_bt.executive.plan.plan_check import plan_problems
from mpvi_bt.executive.plan.planners import NoPlan, Planned
from mpvi_bt.executive.plan.planning_context import PlanningContext
from mpvi_bt.executive.plan.prompt import checked_instruction, conversation, repair, told
from mpvi_bt.executive.plan.schema import Plan
from mpvi_bt.executive.plan.skills import Skill
from mpvi_bt.ground.errors import FileProblems, ModelError, Problem
from mpvi_bt.ground.marked_yaml import SourceMarks, validate_data
from mpvi_bt.ground.writing import write_whole

Rehearse = Callable[[Plan, SourceMarks | None, History | None], list[Problem]]
REPAIRS = 3  # Our choice: how often a model may mend its plan


class LanguagePlanner:
    """Asks a model for a plan, and for a mended one as long as something is wrong with it, `REPAIRS` times at most.

    An error is sent back as often as that, and so is what its rehearsal finds to be impossible or short of the goal;
    other warnings go with it, and alone once: the robot can go by such a plan. In the middle of an episode a plan that
    is impossible to the last is none.

    Args:
        model: Whom to ask.
        skills: What the robot can do, by name.
        grounding: What is where; None: the model is told nothing of that, and nothing is compared with it.
        recorded: Plans on file, some of which serve as examples; see `mpvi_bt.executive.plan.example_plans`.
        without: Names of those that must not.
        last_answer: File for the last answer where it is no plan; None: it is not kept.
        tell: Is told in a line what is being done.
        rehearse: What carrying a plan out on paper finds, as `Rehearsal.problems`; None: plans are not rehearsed.

    Attributes:
        name: The model's.
    """

    remote = True

    def __init__(
        self,
        model: ChatModel,
        skills: Mapping[str, Skill],
        grounding: PlanningContext | None = None,
        recorded: Sequence[Plan] = (),
        without: Collection[str] = (),
        last_answer: Path | None = None,
        tell: Callable[[str], None] = lambda line: None,
        rehearse: Rehearse | None = None,
    ) -> None:
        self.name = model.name
        self._model, self._skills, self._grounding = model, skills, grounding
        self._recorded, self._without = recorded, without
        self._last_answer, self._tell, self._rehearse = last_answer, tell, rehearse

    def plan(self, task_name: str, instruction: str) -> Plan:
        """The plan alone. Raises as `ask`."""
        return self.ask(task_name, instruction).plan

    def ask(self, task_name: str, instruction: str, history: History | None = None) -> Planned:
        """As `Planner` says; a plan without a name is named by the model.

        Raises:
            UserError: The instruction is none.
            ModelError: The model gave no answer.
            NoPlan: Its answers hold none.
        """
        instruction = checked_instruction(instruction)
        shown = examples(self._recorded, self._skills, instruction, {task_name, *self._without})
        messages = conversation(instruction, self._skills, self._grounding, shown, history.text() if history else "")
        schema = answer_schema(self._grounding, task_name)
        answers: list[Answer] = []
        usable: Planned | None = None  # with warnings
        found: list[Problem] = []
        while len(answers) <= REPAIRS:
            self._tell(_asking(self.name, found))
            mending = repair(spoken(answers[-1].text) or answers[-1].text, found) if answers else []
            try:
                answers.append(self._model.ask([*messages, *mending], schema))
            except ModelError:
                if usable is None:
                    raise
                break
            data, found = read_answer(answers[-1].text)
            if isinstance(data, dict) and data.get("segments") == [] and usable is None:
                if history is not None:
                    raise NoPlan("nothing_left", f"{self.name} finds that nothing is left to do", tuple(answers))
                message = f"{self.name} finds no plan for the instruction{self._keep(answers[-1])}"
                raise NoPlan("refused", message, tuple(answers))
            if not found:
                plan, found = checked(data, task_name, instruction, self._skills, self._grounding, history is None)
                if plan is not None and not any(problem.severity == "error" for problem in found):
                    found += self._rehearse(plan, None, history) if self._rehearse is not None else []
                    wrong = [problem for problem in found if problem.severity != "note"]
                    again = usable is not None
                    if usable is not None and _fails(wrong) and not _fails(usable.doubts):
                        break  # it made things worse
                    usable = Planned(plan, (), tuple(found))
                    if not wrong or (again and not _fails(wrong)):
                        break
                    found = wrong
                    continue
            if usable is not None:
                break  # it made things worse
        if usable is not None and not (history is not None and _stops(usable.doubts)):
            return replace(usable, answers=tuple(answers))
        found = [problem for problem in usable.doubts if problem.severity != "note"] if usable is not None else found
        count = f"{len(found)} problem{'s' * (len(found) > 1)}"
        kept = self._keep(answers[-1])
        head = f"{self.name} gave no valid plan in {len(answers)} answers; {count} in the last{kept}:"
        raise NoPlan("bad_answer", "\n  ".join([head, *told(found)]), tuple(answers))

    def _keep(self, answer: Answer) -> str:
        """Write an answer to its file. Returns a note on the place."""
        if self._last_answer is None:
            return ""
        self._last_answer.parent.mkdir(parents=True, exist_ok=True)
        write_whole(self._last_answer, answer.text.encode("utf-8", "backslashreplace").decode())
        return f", which is in {self._last_answer}"


def _stops(problems: Iterable[Problem]) -> bool:
    return any(problem.code == "impossible" for problem in problems)


def _fails(problems: Iterable[Problem]) -> bool:
    return any(problem.code in ("impossible", "goal-unmet") for problem in problems)


def _asking(name: str, found: Sequence[Problem]) -> str:
    if not found:
        return f"asking {name} for a plan"
    more = f", and {len(found) - 1} more" if len(found) > 1 else ""
    return f"asking {name} to mend its plan: {told(found[:1])[0]}{more}"


def read_answer(text: str) -> tuple[Any, list[Problem]]:
    """The data of an answer as plain JSON, as in a plan's file; or the answer's problems."""
    try:
        data = parse_json(text, _is_plan)
    except ValueError as error:
        return None, [Problem("answer", 0, 0, "syntax", f"the answer cannot be read as a JSON object: {error}")]
    segments = data.get("segments") if isinstance(data, dict) else None
    if isinstance(segments, list):
        data = {**data, "segments": [read_segment(segment) for segment in segments]}
    return data, []


def _is_plan(data: Mapping[str, Any]) -> bool:
    """Whether an object has the form of a plan, however wrong its segments are: those are told and mended."""
    segments = data.get("segments")
    return isinstance(segments, list) and all(isinstance(segment, dict) for segment in segments)


def checked(
    data: Any,
    task_name: str,
    instruction: str,
    skills: Mapping[str, Skill],
    grounding: PlanningContext | None = None,
    begins: bool = True,
) -> tuple[Plan | None, list[Problem]]:
    """The plan from an answer's data, and all problems of it.

    Args:
        data: Of `read_answer`; untrusted.
        task_name, instruction: As of `LanguagePlanner.ask`.
        skills, grounding, begins: As of `plan_problems`.
    """
    if isinstance(data, dict):
        data = {**data, "instruction": instruction, **({"task_name": task_name} if task_name else {})}
    marks = SourceMarks.unplaced(data, "answer")
    try:
        plan = validate_data(data, marks, Plan)
    except FileProblems as error:
        return None, error.problems
    return plan, plan_problems(plan, skills, grounding, marks, begins)
