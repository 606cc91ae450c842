"""Where plans come from. The default planner reads one from a file and needs no download."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from mpvi_bt import paths
from mpvi_bt.errors import ModelError, Problem, UnknownName, UserError
from mpvi_bt.language.chat import Answer
from mpvi_bt.plan.history import History
from mpvi_bt.plan.schema import Plan, load_plan


@dataclass(frozen=True)
class Planned:
    """A plan, and what it took.

    Attributes:
        plan: A valid one, without errors.
        answers: Of a language model, if one was asked.
        doubts: Warnings that are left.
    """

    plan: Plan
    answers: tuple[Answer, ...] = ()
    doubts: tuple[Problem, ...] = ()

    @property
    def latency_s(self) -> float:
        """What all the answers took, together [s of wall time]."""
        return sum(answer.latency_s for answer in self.answers)


class NoPlan(ModelError):
    """A planner answered, and its answers hold no plan.

    Attributes:
        reason: "bad_answer": none that can be carried out. "refused": it finds none for the instruction.
            "nothing_left": it finds that nothing is left to do. "tried_again": what failed was put off before.
        answers: What a language model said.
    """

    def __init__(self, reason: str, message: str, answers: tuple[Answer, ...]) -> None:
        self.answers = answers
        super().__init__(reason, message)


class Planner(Protocol):
    """Cuts an instruction into segments (the LLM's place in the paper).

    It may have `remote` besides, a bool: True if `ask` waits for something elsewhere. An episode then asks in a thread.
    And `most`, an int: how often an episode may ask; by default as `mpvi_bt.executive.replanning.MOST` says.

    Attributes:
        name: As given on the command line.
    """

    name: str

    def ask(self, task_name: str, instruction: str, history: History | None = None) -> Planned:
        """A plan for the instruction.

        Args:
            task_name: Name of the plan.
            instruction: What a user said; untrusted.
            history: What has happened so far, if the robot is under way: then what is left is planned.

        Raises:
            MpviError: There is none to be had; NoPlan with "nothing_left": none is needed, as nothing is left to do.
        """
        ...


class RecordedPlanner:
    """Hands out the plan file `<task_name>.json` or `.yaml` of a folder."""

    name = "recorded"

    def __init__(self, folder: str | Path | None = None) -> None:
        """`folder` holds the plans; by default `tasks/plans` of every root is searched."""
        self._folder = folder

    def ask(self, task_name: str, instruction: str = "", history: History | None = None) -> Planned:
        """As `plan`. Raises UserError, too, where the robot is under way: what is on file begins at the beginning."""
        if history is not None:
            raise UserError("the recorded planner can't plan what is left; choose --planner openai:MODEL.")
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
