"""Methods: names for ways to run an episode, such as the paper's ablations, from YAML (tasks/methods/*.yaml)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal

from pydantic import Field

from mpvi_bt import paths
from mpvi_bt.choices.backends import BACKENDS, choose
from mpvi_bt.errors import FileProblems, UnknownName, UserError
from mpvi_bt.errors import Problem as FileProblem
from mpvi_bt.file_kinds import expect
from mpvi_bt.marked_yaml import Marks, Record, load_marked, validate_data

FOLDER = "tasks/methods"


class Method(Record):
    """One method: every backend, and what else is not as an episode has it by default.

    Attributes:
        about: One line for people.
        planner, map, detector, policy, checker, trigger: Backends, as of `EpisodeConfig`.
        drive, while_asked, on_failure, policy_settings, policy_horizon, policy_ensemble, assisted: Likewise.
        policy_faults, latency, while_inferring, unit, calibration: Likewise.
    """

    about: Annotated[str, Field(min_length=1, max_length=300)]
    planner: str
    map: str
    detector: str
    policy: str
    checker: str
    trigger: str
    drive: Literal["navigator", "policy"] = "navigator"
    while_asked: Literal["go_on", "hold"] = "go_on"
    on_failure: str = "advance"
    policy_settings: str | None = None
    policy_horizon: Annotated[int, Field(ge=1)] | None = None
    policy_ensemble: Annotated[float, Field(ge=0, allow_inf_nan=False)] | None = None
    policy_faults: str | None = None
    latency: str | None = None
    while_inferring: Literal["hold", "go_on"] = "hold"
    unit: str | None = None
    calibration: str | None = None
    assisted: bool = False


def load_method(name: str) -> Mapping[str, Any]:
    """The fields of `EpisodeConfig` that a method sets: its name as "method", and what its file says.

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


def check_method(data: Any, marks: Marks) -> Method:
    """A method from data that is already loaded. Raises FileProblems."""
    expect("method", data, marks)
    method = validate_data(data, marks, Method)
    if problems := list(_problems(method, marks)):
        raise FileProblems(problems)
    return method


def _problems(method: Method, marks: Marks) -> Iterator[FileProblem]:
    """Names that the method takes from elsewhere."""
    from mpvi_bt.disturbances.faults import read_faults
    from mpvi_bt.disturbances.latency import read_latencies
    from mpvi_bt.tree.compile import parse_on_failure

    for kind in BACKENDS:
        given = getattr(method, kind)
        try:
            choose(kind, given)
        except UnknownName as error:
            yield marks.unknown((kind,), "backend", given, error.known)
        except UserError as error:
            yield marks.problem((kind,), "invalid-value", str(error))
    checks = {"on_failure": parse_on_failure, "policy_faults": read_faults, "latency": read_latencies}
    for key, check in checks.items():
        try:
            if (given := getattr(method, key)) is not None:
                check(given)
        except UserError as error:
            yield marks.problem((key,), "invalid-value", str(error))
    known = paths.names("policies")
    if method.policy_settings is not None and method.policy_settings not in known:
        yield marks.unknown(("policy_settings",), "settings", method.policy_settings, known)
