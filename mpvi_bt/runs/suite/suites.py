"""Suites, from YAML: tasks, houses, instances, seeds and methods."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

from pydantic import Field

from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import FileProblems, UnknownName, UserError
from mpvi_bt.ground.file_kinds import expect
from mpvi_bt.ground.marked_yaml import Record, SourceMarks, load_marked, validate_data
from mpvi_bt.house.instances.tasks import Name, load_task
from mpvi_bt.house.layout.house_names import check_house_name
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.choices.methods import load_method
from mpvi_bt.runs.suite.suite_houses import MOST, suite_houses

FOLDER = "tasks/suites"
Whole = Annotated[int, Field(ge=0, le=999_999)]


class Suite(Record):
    """Many episodes (tasks/suites/*.yaml): every task with every method, house, instance and seed.

    Attributes:
        about: One line for people.
        methods: Names of methods (tasks/methods/*.yaml), each with a folder of its own for results; none: as episodes
            are by default.
        tasks: Names of tasks.
        houses: Names of houses, or how many are drawn; none: each task is played in its own.
        instances: Start states of each.
        seeds: Seeds of each.
    """

    about: str = ""
    methods: list[Name] = []
    tasks: Annotated[list[str], Field(min_length=1)]
    houses: Annotated[int, Field(strict=True, ge=1, le=MOST)] | Annotated[list[str], Field(max_length=MOST)] = []
    instances: Annotated[list[Whole], Field(min_length=1)]
    seeds: Annotated[list[Whole], Field(min_length=1, default_factory=lambda: [0])]

    def episodes(self, houses: int | Sequence[str] | None = None, **options: Any) -> list[EpisodeConfig]:
        """Every episode, instances running fastest.

        Args:
            houses: Instead of the suite's own, if not None.
            **options: Further fields of `EpisodeConfig`, which override what methods say. With "method" among them the
                others are all that it says, and the suite's own methods are left out. A "house" is the only one.

        Raises:
            UserError: Hidden houses are to be drawn, and there is no secret.
        """
        ways = [{}] if "method" in options else [load_method(name) for name in self.methods] or [{}]
        several = [] if "house" in options else self.houses if houses is None else houses
        places = [{"house": house} for house in suite_houses(several, options.get("split", "public"))] or [{}]
        return [
            EpisodeConfig(task, instance, seed, **{**way, **place, **options})
            for way in ways
            for task in self.tasks
            for place in places
            for seed in self.seeds
            for instance in self.instances
        ]


def load_suite(name: str) -> Suite:
    """The suite of a name, or in a YAML file; its tasks and instances exist.

    Raises:
        UnknownName: No suite has that name.
        UserError: There is no such file.
        FileProblems: Everything that is wrong with the file, or with its tasks' files.
    """
    return check_suite(*load_marked(paths.find_or_file(FOLDER, name, "suite")))


def check_suite(data: Any, marks: SourceMarks) -> Suite:
    """As `load_suite`, of data that is already loaded."""
    expect("suite", data, marks)
    suite = validate_data(data, marks, Suite)
    problems = []
    for key in ("methods", "tasks", "houses", "instances", "seeds"):
        values = named if isinstance(named := getattr(suite, key), list) else []
        for i, value in enumerate(values):
            if value in values[:i]:
                problems.append(marks.problem((key, i), "repeated", f"{value!r} is in {key} twice"))
    if problems:  # a thousand times the same name is not looked up a thousand times
        raise FileProblems(problems)
    for i, method in enumerate(suite.methods):
        try:
            load_method(method)
        except UnknownName as error:
            problems.append(marks.unknown(("methods", i), "method", method, error.known))
    for i, house in enumerate(suite.houses if isinstance(suite.houses, list) else []):
        try:
            check_house_name(house)
        except UnknownName as error:
            problems.append(marks.unknown(("houses", i), "house", house, error.known))
        except UserError as error:
            problems.append(marks.problem(("houses", i), "invalid-value", str(error)))
    for i, task in enumerate(suite.tasks):
        try:
            loaded = load_task(task)
        except UnknownName as error:
            problems.append(marks.unknown(("tasks", i), "task", task, error.known))
            continue
        for j, instance in enumerate(suite.instances):
            try:
                loaded.check_instance(instance)
            except UserError as error:
                problems.append(marks.problem(("instances", j), "out-of-range", str(error)))
    if problems:
        raise FileProblems(problems)
    return suite
