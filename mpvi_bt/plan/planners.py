"""Where plans come from. The default planner reads one from a file and needs no download."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

from mpvi_bt.errors import UnknownName
from mpvi_bt.plan.schema import Plan, load_plan


class Planner(Protocol):
    """Cuts an instruction into segments (the LLM's place in the paper).

    Attributes:
        name: As given on the command line.
    """

    name: str

    def plan(self, task_name: str, instruction: str) -> Plan:
        """A plan for the instruction. Raises MpviError if there is none to be had."""
        ...


class RecordedPlanner:
    """Hands out the plan file `<task_name>.json` of a folder."""

    name = "recorded"

    def __init__(self, folder: str | Path | None = None) -> None:
        """`folder` holds the plans; by default `tasks/plans` of every root is searched."""
        self._folder = folder

    def plan(self, task_name: str, instruction: str = "") -> Plan:
        """The recorded plan of the task; `instruction` replaces the recorded one if it is given.

        Raises:
            UnknownName: No plan is recorded for the task.
            FileProblems: Everything that is wrong with the file.
        """
        files = {path.stem: path for folder in reversed(self._folders()) for path in sorted(folder.glob("*.json"))}
        if task_name not in files:
            raise UnknownName("recorded plan", task_name, files)
        plan = load_plan(files[task_name])
        return plan.model_copy(update={"instruction": instruction}) if instruction else plan

    def _folders(self) -> list[Path]:
        if self._folder is not None:
            return [Path(self._folder)]
        from mpvi_bt.paths import roots

        return [root / "tasks" / "plans" for root in roots()]
