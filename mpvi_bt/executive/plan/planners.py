"""Where plans come from. The default planner reads one from a file and needs no download."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from mpvi_bt.executive.language.chat import Answer
from mpvi_bt.executive.plan.history import History
from mpvi_bt.executive.plan.schema import Plan, load_plan
from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import ModelError, Problem, UnknownName, UserError


@dataclass(frozen=True)
class Planned:
    """A plan and its cost.

    Attributes:
        plan: A valid one, without errors.
        answers: Of a language model, if one was asked.
        doubts: Remaining warnings.
    """

    plan: Plan
    answers: tuple[Answer, ...] = ()
    doubts: tuple[Problem, ...] = ()

    @property
    def latency_s(self) -> float:
        """Total wall time of the answers [s]."""
        return sum(answer.latency_s for answer in self.answers)


class NoPlan(ModelError):
    """A planner's answers have no plan.

    Attributes:
        reason: "bad_answer": no executable plan. "refused": no plan for this instruction. "nothing_left": nothing is
            left to do. "tried_again": the failed units have had their second try.
        answers: What a language model said.
    """

    def __init__(self, reason: str, message: str, answers: tuple[Answer, ...]) -> None:
        self.answers = answers
        super().__init__(reason, message)


class Planner(Protocol):
    """Splits an instruction into segments (the LLM's place in the paper).

    Optional: `remote`, a bool: True if `ask` waits for another process, and is then asked in a thread; `most`, an int:
    how often an episode may ask, by default `mpvi_bt.executive.ticking.replanning.MOST`.

    Attributes:
        name: As given on the command line.
    """

    name: str

    def ask(self, task_name: str, instruction: str, history: History | None = None) -> Planned:
        """A plan for the instruction.

        Args:
            task_name: Name of the plan.
            instruction: What a user said; untrusted.
            history: Of the episode so far; then the plan is for the rest. None before the first tick.

        Raises:
            MpviError: There is no plan; NoPlan with "nothing_left": none is needed.
        """
        ...


class RecordedPlanner:
    """Reads the plan file `<task_name>.json` or `.yaml` from a folder."""

    name = "recorded"

    def __init__(self, folder: str | Path | None = None) -> None:
        """`folder` holds the plans; by default `tasks/plans` of every root is searched."""
        self._folder = folder

    def ask(self, task_name: str, instruction: str = "", history: History | None = None) -> Planned:
        """As `plan`. Raises UserError with a history, too: a recorded plan begins at the start."""
        if history is not None:
            raise UserError("the recorded planner cannot plan the rest of a task; choose --planner openai:MODEL.")
        return Planned(self.plan(task_name, instruction))

    def plan(self, task_name: str, instruction: str = "") -> Plan:
        """The recorded plan of the task; `instruction` replaces the recorded one if it is given.

        Raises:
            UnknownName: No plan is recorded for the task.
            FileProblems: Everything that is wrong with the file.
        """
        files = self._files()
        if task_name not in files:
            raise UnknownName("recorded plan", task_name, files)
        plan = load_plan(files[task_name])
        return plan.model_copy(update={"instruction": instruction}) if instruction else plan

    def all(self) -> list[Plan]:
        """Every recorded plan, by name. Raises FileProblems."""
        return [load_plan(path) for _, path in sorted(self._files().items())]

    def _files(self) -> dict[str, Path]:
        found = paths.files("tasks/plans") if self._folder is None else paths.files_in(Path(self._folder))
        return {path.stem: path for path in reversed(found)}
