"""Methods: names for ways to run an episode, such as the paper's ablations, from YAML (tasks/methods/*.yaml)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import Field

from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import FileProblems
from mpvi_bt.ground.file_kinds import expect
from mpvi_bt.ground.marked_yaml import SourceMarks, load_marked, validate_data
from mpvi_bt.runs.choices.backends import BACKENDS
from mpvi_bt.runs.choices.config import METHOD
from mpvi_bt.runs.choices.settings import settings_record, value_problems

FOLDER = "tasks/methods"


_REQUIRED = [kind for kind in BACKENDS if kind != "navigator"]  # all of ours drive by the same one


class Method(settings_record(METHOD, required=_REQUIRED)):  # type: ignore[misc]  # mypy knows no derived classes
    """One method: every backend, and what else is not as an episode has it by default (`runs/choices/config.py`).

    Attributes:
        about: One line for people.
    """

    about: Annotated[str, Field(min_length=1, max_length=300)]


def load_method(name: str) -> Mapping[str, Any]:
    """A method's fields of `EpisodeConfig`: its name as "method", and the settings of its file.

    Args:
        name: Of a method, or the file of one.

    Raises:
        UnknownName: No method has that name.
        UserError: There is no such file.
        FileProblems: Everything that is wrong with the file.
    """
    path = paths.find_or_file(FOLDER, name, "method")
    method = check_method(*load_marked(path))
    return {"method": paths.title(path), **method.model_dump(exclude_unset=True, exclude={"about"})}


def check_method(data: Any, marks: SourceMarks) -> Method:
    """A method from data that is already loaded. Raises FileProblems."""
    expect("method", data, marks)
    method = validate_data(data, marks, Method)
    if problems := list(value_problems(method.model_dump(exclude={"about"}), marks)):
        raise FileProblems(problems)
    return method
