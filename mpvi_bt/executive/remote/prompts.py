"""Prompts of whole tasks from a file that the user has, such as comet's `task_mapping.json`, or one's own.

It maps a task, by the name that BEHAVIOR has for it, to its prompt, or to a mapping whose "task" is the prompt.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from mpvi_bt.executive.plan.schema import MOST_OF_PROMPT
from mpvi_bt.ground.errors import FileProblems, Problem, UnknownName, UserError, shown
from mpvi_bt.ground.marked_yaml import SourceMarks, load_marked

_PROMPT = "task"  # its key in comet's file


def check_prompts(given: str, marks: SourceMarks, at: tuple[str, ...]) -> Path:
    """The path of a file of prompts, relative to the folder of the file that names it.

    Args:
        given: Its path.
        marks: Of the file that names it.
        at: Where it is named there.

    Raises:
        FileProblems: There is none, or everything that is wrong with it.
    """
    file = Path(marks.file).parent / Path(given).expanduser()
    try:
        read_prompts(file)
    except FileProblems:
        raise
    except UserError as error:
        raise FileProblems([marks.problem(at, "unreadable", f"prompts: {error}")]) from None
    return file.absolute()


def read_prompts(file: str | Path) -> dict[str, str]:
    """Task to prompt.

    Raises:
        UserError: There is no such file, or it cannot be read.
        FileProblems: Everything that is wrong with it.
    """
    data, marks = load_marked(file)
    if problems := list(_wrong(data, marks)):
        raise FileProblems(problems)
    return {task: entry if isinstance(entry, str) else entry[_PROMPT] for task, entry in data.items()}


def _wrong(data: Any, marks: SourceMarks) -> Iterator[Problem]:
    if not isinstance(data, dict) or not data:
        yield marks.problem((), "wrong-type", f"should map tasks to their prompts, not be {shown(data)}")
        return
    for task, entry in data.items():
        if isinstance(entry, dict) and _PROMPT not in entry:
            yield marks.problem((task,), "missing-key", f"{shown(task)} has no {_PROMPT!r}, which is its prompt")
            continue
        prompt, where = (entry[_PROMPT], (task, _PROMPT)) if isinstance(entry, dict) else (entry, (task,))
        if not isinstance(prompt, str):
            yield marks.problem(
                where, "wrong-type", f"the prompt of {shown(task)} should be a text, not {shown(prompt)}"
            )
        elif not 1 <= len(prompt.strip()) <= MOST_OF_PROMPT:
            yield marks.problem(
                where, "wrong-length", f"the prompt of {shown(task)} should have 1 to {MOST_OF_PROMPT} characters"
            )


def prompt_of(task: str, file: str | Path) -> str:
    """The prompt of a task. Raises UnknownName with the nearest; otherwise as `read_prompts`."""
    prompts = read_prompts(file)
    if task not in prompts:
        raise UnknownName("task", task, prompts, str(file))
    return prompts[task]
