"""Tasks, from YAML: goal, house, and things."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import FileProblems, Problem, UserError
from mpvi_bt.ground.file_kinds import expect
from mpvi_bt.ground.human import human_stats
from mpvi_bt.ground.marked_yaml import Record, SourceMarks, load_marked, validate_data
from mpvi_bt.house.generated.seeded_name import SEEDED, seeded
from mpvi_bt.house.goals.formula import Literal, literals, signed
from mpvi_bt.house.goals.predicates import OF_HEAT, check_known
from mpvi_bt.house.goals.problem import BddlProblem, activities, load_problem
from mpvi_bt.house.instances.feasible import why_impossible
from mpvi_bt.house.instances.words import known_words
from mpvi_bt.house.layout.house import House, load_house
from mpvi_bt.house.layout.start_facts import asked_for, with_all
from mpvi_bt.house.sim.future import future
from mpvi_bt.house.states.grains import SUBSTANCE
from mpvi_bt.house.things.catalogue import Catalogue, load_catalogue

Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_\-]*$", max_length=100)]

HouseName = Annotated[str, Field(pattern=rf"^({SEEDED}|[A-Za-z0-9][A-Za-z0-9_\-]*)$", max_length=100)]


class Task(Record):
    """One task (tasks/*.yaml).

    Attributes:
        instruction: What the robot is told.
        problem: Activity of the `bddl` distribution whose goal scores it.
        house: Where it is: a house of tasks/houses/, or "generated:7" or "generated:flat:7", which a seed draws.
        bindings: Synset of every movable object to its catalogue entry.
        plan: Recorded plan (tasks/plans/); None: one is made by the goal, with the symbolic planner.
        tree: The plan's compiled tree (trees/), for people to read and change; None: it is compiled where it is wanted.
        instances: How many start states there are: 0 to instances - 1.
        time_budget_s: Simulated time after which the episode ends; None: twice the mean human time.
        notes: For people.
    """

    instruction: Annotated[str, Field(min_length=1, max_length=2000)]
    problem: str
    house: HouseName
    bindings: dict[str, Name]
    plan: Name | None = None
    tree: Name | None = None
    instances: Annotated[int, Field(ge=1, le=1000)] = 10
    time_budget_s: Annotated[float, Field(gt=0.0, le=86_400.0, allow_inf_nan=False)] | None = None
    notes: str = ""

    @property
    def budget_s(self) -> float:
        """The time budget [s of simulated time]."""
        if self.time_budget_s is not None:
            return self.time_budget_s
        return human_stats()[self.problem].time_budget_s

    def check_instance(self, instance: int) -> None:
        """Raise UserError unless the task has that instance."""
        if not 0 <= instance < self.instances:
            raise UserError(f"instance {instance} is out of range: the task has instances 0 to {self.instances - 1}.")


def load_task(name: str) -> Task:
    """The task of a name, or in a YAML file.

    Raises:
        UnknownName: No task has that name.
        UserError: There is no such file.
        FileProblems: Everything that is wrong with the file.
    """
    return read_task(paths.find_or_file("tasks", name, "task"))


def plans_of(problem: str) -> set[str]:
    """Names of the plans of all tasks with a problem, whatever else is wrong with the tasks' files."""
    plans = set()
    for path in paths.files("tasks"):
        with suppress(UserError, FileProblems):
            data, _ = load_marked(path)
            if isinstance(data, dict) and data.get("problem") == problem and isinstance(data.get("plan"), str):
                plans.add(data["plan"])
    return plans


def read_task(path: Path) -> Task:
    """As `load_task`, of a file."""
    return check_task(*load_marked(path))


def check_task(data: Any, marks: SourceMarks) -> Task:
    """As `load_task`, of data that is already loaded."""
    expect("task", data, marks)
    task = validate_data(data, marks, Task)
    problems = _check_names(task, marks)
    if not problems:
        problem = load_problem(task.problem, known_words())
        problems = [*_check_bindings(task, problem, load_catalogue(), marks), *_check_playable(task, problem, marks)]
    if problems:
        raise FileProblems(problems)
    return task


def _check_names(task: Task, marks: SourceMarks) -> list[Problem]:
    """Names that the task takes from elsewhere."""
    known = {
        "problem": list(activities()),
        "house": paths.names("tasks/houses"),
        "plan": paths.names("tasks/plans"),
        "tree": paths.names("trees"),
    }
    problems = [
        marks.unknown((key,), key, given, names)
        for key, names in known.items()
        if (given := getattr(task, key)) is not None and given not in names
        if key != "house" or seeded(given) is None
    ]
    if task.time_budget_s is None and task.problem in known["problem"] and task.problem not in human_stats():
        message = f"no human did {task.problem!r}, so time_budget_s must be given"
        problems.append(marks.problem((), "missing-key", message))
    return problems


def _check_bindings(task: Task, problem: BddlProblem, catalogue: Catalogue, marks: SourceMarks) -> list[Problem]:
    """Every movable object's synset, and nothing else, is bound, each to an entry of that synset."""
    wanted = {problem.objects[name] for name in problem.bound}
    problems = []
    for synset, name in task.bindings.items():
        place = ("bindings", synset)
        entry = catalogue.entries.get(name)
        if synset not in wanted:
            problems.append(marks.unknown(place, "movable synset", synset, wanted, key=True))
        elif entry is None:
            fitting = [e.name for e in catalogue if e.synset == synset] or catalogue.entries
            problems.append(marks.unknown(place, "catalogue entry", name, fitting))
        elif entry.synset != synset:
            problems.append(marks.problem(place, "wrong-entry", f"{name} is {entry.synset}, not {synset}"))
    missing = sorted(wanted - task.bindings.keys())
    if missing:
        problems.append(marks.problem(("bindings",), "missing-key", f"no binding for {', '.join(missing)}", key=True))
    return problems


def _check_playable(task: Task, problem: BddlProblem, marks: SourceMarks) -> list[Problem]:
    """The house has the rooms and fixtures that the problem names, starts can be sampled, the goal can be judged."""
    cause = why_unplayable(task, problem, _house(task.house))
    return [] if cause is None else [marks.problem(("problem",), "unplayable", cause)]


def in_house(task: Task, house: str | None) -> Task:
    """The same task in another house.

    Args:
        task: It.
        house: As of `load_house`; None: the task's own.

    Raises:
        UserError: There is no such house, or it lacks what the task needs.
        FileProblems: Everything that is wrong with the house's file.
    """
    if house is None:
        return task
    if cause := why_unplayable(task, load_problem(task.problem, known_words()), load_house(house)):
        raise UserError(f"{task.problem} cannot be played in {house}: {cause}")
    return task.model_copy(update={"house": house})


def why_unplayable(task: Task, problem: BddlProblem, house: House) -> str | None:
    """Why a task cannot be played in a house, in a sentence; None: perhaps it can."""
    what = "no start can be drawn"
    try:
        whole = with_all(problem, house)
        fixtures, _ = asked_for(house, whole)
        what = "the goal cannot be judged"
        for literal in literals(problem.goal):
            check_known(literal)
            if literal.predicate in OF_HEAT:
                _check_heat(literal, task, problem)
        _check_made(task, problem)
        what = "the goal cannot be met"
        _check_shapes(task, whole, house, fixtures)
    except UserError as error:
        return f"{what}: {error}"
    return None


def _check_shapes(task: Task, problem: BddlProblem, house: House, fixtures: Mapping[str, str]) -> None:
    """Raise UserError if the shapes of the task's present and future things make the goal impossible.

    Args:
        task: With its bindings.
        problem: With its wildcards written out.
        house: Of the task.
        fixtures: BDDL name of each fixture to its name in the house; floors among them.
    """
    catalogue = load_catalogue()
    bound = {name: catalogue.entries.get(task.bindings.get(problem.objects[name], "")) for name in problem.bound}
    there = {name: entry for name, entry in bound.items() if entry is not None}
    standing = {name: house.fixtures[own].entry for name, own in fixtures.items() if own in house.fixtures}
    if cause := why_impossible(problem.goal, {**future(catalogue, there), **there, **standing}):
        raise UserError(cause)


def _check_heat(literal: Literal, task: Task, problem: BddlProblem) -> None:
    """Raise UserError where no rule can make a literal true of how warm a thing is, by its catalogue entry."""
    entry = load_catalogue().entries.get(task.bindings.get(problem.objects.get(literal.args[0], ""), ""))
    if entry is None:
        return  # a fixture, or a binding that is told of already
    if entry.heat is None:
        raise UserError(f"no rule makes {literal}: {entry.name!r} says nothing of heat")
    needed = {"cooked": ("cooked_c", entry.heat.cooked_c), "on_fire": ("ignites_c", entry.heat.ignites_c)}
    field, value = needed.get(literal.predicate, ("", 0.0))
    if value is None:
        raise UserError(f"no rule makes {literal}: {entry.name!r} has no heat: {{{field}: ...}}")


def _check_made(task: Task, problem: BddlProblem) -> None:
    """Raise UserError if the goal needs a thing or substance that is neither present nor made by a rule."""
    catalogue = load_catalogue()
    bound = {name: catalogue.entries.get(task.bindings.get(problem.objects[name], "")) for name in problem.bound}
    there = {name: entry for name, entry in bound.items() if entry is not None}
    made = future(catalogue, there)
    kinds = {entry.synset for entry in (*there.values(), *made.values()) if SUBSTANCE in entry.abilities}
    for literal, positive in signed(problem.goal):
        if not positive or literal.predicate not in ("real", "contains", "filled"):
            continue
        wanted = literal.args[-1]
        if wanted in problem.substances:
            if problem.objects[wanted] not in kinds:
                raise UserError(f"no rule makes {literal}: none of the things becomes {problem.objects[wanted]}")
        elif wanted in problem.future and wanted not in made:
            raise UserError(f"no rule makes {literal}: of the things come {', '.join(made) or 'no others'}")


def _house(name: str) -> House:
    """A house as it was last changed, which many tasks are in."""
    if seeded(name) is not None:
        return load_house(name)
    path = paths.find("tasks/houses", name)
    return _of_file(path, path.stat().st_mtime_ns, load_catalogue())


@lru_cache(maxsize=4)
def _of_file(path: Path, changed: int, catalogue: Catalogue) -> House:
    return load_house(path, catalogue)
