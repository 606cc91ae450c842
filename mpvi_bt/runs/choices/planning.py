"""Makes the planner of a run, and gathers its context: place, things and robot."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from mpvi_bt.executive.plan.language_planner import LanguagePlanner
from mpvi_bt.executive.plan.plan_check import plan_problems
from mpvi_bt.executive.plan.planners import Planner, RecordedPlanner
from mpvi_bt.executive.plan.planning_context import PlanningContext
from mpvi_bt.executive.plan.schema import Plan
from mpvi_bt.executive.plan.skills import load_skills
from mpvi_bt.executive.rehearsal.done_so_far import world_so_far
from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import Problem, UserError
from mpvi_bt.ground.marked_yaml import MAX_PROBLEMS, SourceMarks
from mpvi_bt.ground.robot.protocol import SIDES, Side
from mpvi_bt.ground.robot.robots import sides_of
from mpvi_bt.runs.choices.backends import NOBODY, choose
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.choices.language_models import Models
from mpvi_bt.runs.choices.named_task import task_named
from mpvi_bt.runs.choices.rehearsing import make_rehearsal, task_start

if TYPE_CHECKING:
    from mpvi_bt.house.instances.tasks import Task


def make_planner(
    config: EpisodeConfig,
    task: Task | None,
    models: Models,
    house: str | None = None,
    tell: Callable[[str], None] = lambda line: None,
) -> Planner:
    """The planner that a run chooses. A language model is not asked yet.

    Args:
        config: Of the run: the planner's name, and where its plans go.
        task: That is planned; its recorded plan is no example. None: an instruction alone.
        models: Of the run.
        house: Name or file of the house that the model is told of; None: the task's, or nothing of any.
        tell: Is told in a line what is being done.

    Raises:
        UserError: There is no such planner or house.
        ModelError: The model cannot be asked.
        FileProblems: Everything that is wrong with a file that the model is told of.
    """
    if config.planner == NOBODY:
        raise UserError(f"planner {NOBODY} makes no plan: choose recorded, or a model such as openai:MODEL or local.")
    choice = choose("planner", config.planner)
    name = planner_of(config, task)
    if name == "recorded":
        return RecordedPlanner()
    if name == "symbolic":
        if task is None:
            raise UserError("the symbolic planner plans by a goal: name a task, or choose a model.")
        from mpvi_bt.runs.symbolic.symbolic_planner import SymbolicPlanner

        if choice.name != name:
            tell("the task has no plan on file: the symbolic planner makes one by its goal")
        known, hands = load_skills(), sides_of(config.robot)
        return SymbolicPlanner(
            task, tell=tell, so_far=lambda history: world_so_far(known, task_start(task, hands), history)
        )
    place = house or (task.house if task else None)
    skills = load_skills()
    grounding = ground(place, task, sides_of(config.robot)) if place else None
    if choice.part is not None:
        made: Planner = choice.make(skills=skills, grounding=grounding, tell=tell)
        return made
    from mpvi_bt.house.instances.tasks import plans_of

    own = {task.plan or "", task.problem, config.task_name, *plans_of(task.problem)} if task else set()
    return LanguagePlanner(
        models.make(config.planner, tell),
        skills,
        grounding,
        RecordedPlanner().all(),
        own,
        config.planned.with_suffix(".answer.txt") if config.planned else None,
        tell,
        make_rehearsal(skills, task, sides_of(config.robot)).problems,
    )


def planner_of(config: EpisodeConfig, task: Task | None) -> str:
    """The name of a run's planner; "symbolic" where a plan on file is wanted, and the task has none."""
    name = choose("planner", config.planner).name
    no_plan = task is not None and task.plan is None and config.plan is None
    return "symbolic" if name == "recorded" and no_plan else name


def plan_of(name: str) -> Plan:
    """A task's plan on file, or else the one that the symbolic planner makes by its goal.

    Args:
        name: Of the task, or its file.

    Raises:
        UserError: There is no such task, or the symbolic planner is not installed.
        FileProblems: Everything that is wrong with a file.
        NoPlan: The planner finds none.
    """
    task, config = task_named(name), EpisodeConfig(name)
    planner = make_planner(config, task, Models(config))
    return planner.ask(task.plan or config.task_name, task.instruction).plan


def plan_findings(
    plan: Plan,
    marks: SourceMarks | None = None,
    task: Task | None = None,
    site: PlanningContext | None = None,
) -> list[Problem]:
    """What is wrong with a plan: its words and form, and if there is no error in them what its rehearsal finds.

    Args:
        plan: A valid plan.
        marks: Of its file; None: it has none.
        task: With whose facts and goal it is rehearsed; None: the task on file of the plan's name, if it has the same
            instruction or the plan has none.
        site: What is where; None: rooms and targets are compared with nothing.
    """
    skills = load_skills()
    marks = marks or SourceMarks.unplaced(plan.model_dump(mode="json"), f"<{plan.task_name}>")
    found = plan_problems(plan, skills, site, marks)
    if any(problem.severity == "error" for problem in found):
        return found
    try:
        rehearsal = make_rehearsal(skills, task or _task_of(plan), site.hands if site else SIDES)
    except (UserError, ModuleNotFoundError):  # its problem or house cannot be read, or the house is not installed
        rehearsal = make_rehearsal(skills)
    found += rehearsal.problems(plan, marks)
    return sorted(found, key=lambda p: (p.line, p.column))[:MAX_PROBLEMS]


def _task_of(plan: Plan) -> Task | None:
    if plan.task_name not in paths.names("tasks"):
        return None
    task = task_named(plan.task_name)
    return task if plan.instruction in ("", task.instruction) else None


def ground(house: str, task: Task | None = None, hands: tuple[Side, ...] = SIDES) -> PlanningContext:
    """Names that a plan may use in a house, and for the things of a task.

    Args:
        house: Name or file.
        task: Whose things are there; None: they are not known.
        hands: Those of the robot.

    Raises:
        UserError: There is no such house.
        FileProblems: Everything that is wrong with its file.
    """
    from mpvi_bt.house.goals.problem import load_problem
    from mpvi_bt.house.layout.house import load_house
    from mpvi_bt.house.things.catalogue import load_catalogue

    place, catalogue = load_house(house), load_catalogue()
    fixtures = place.fixtures.values()
    names = {room.name: room.phrases for room in place.rooms.values()}
    names |= {f.name: (f.name, *f.entry.phrases) for f in fixtures}
    if task is not None:
        names |= {synset: catalogue.entries[name].phrases for synset, name in task.bindings.items()}
        problem = load_problem(task.problem)
        for fact in problem.init:  # marks on a floor are a patch, which is a thing to go to
            if fact.literal.predicate == "covered" and fact.literal.args[0].startswith("floor."):
                kind = problem.objects[fact.literal.args[1]]
                names[kind] = (kind.partition(".")[0],)
    return PlanningContext(
        rooms={room: tuple(f.entry.phrases[0] for f in fixtures if f.room == room) for room in place.rooms},
        names=names,
        things=task is not None,
        hands=hands,
    )
