"""Prepares an episode: everything that can be refused is refused before a simulator loads."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from mpvi_bt.executive.behaviors.parameters import Pause, Watch
from mpvi_bt.executive.monitors.calibration import Calibration, load_calibration
from mpvi_bt.executive.plan.later import LaterPlanner
from mpvi_bt.executive.plan.plan_check import plan_problems
from mpvi_bt.executive.plan.planners import Planned, Planner, RecordedPlanner
from mpvi_bt.executive.plan.schema import Plan, check_plan
from mpvi_bt.executive.plan.skills import Skill, load_skills
from mpvi_bt.executive.tree.compile import UNIT_PARAMETERS, Arrange, compile_instruction, compile_plan
from mpvi_bt.executive.tree.lint import check_rooms, lint
from mpvi_bt.executive.tree.spec import NodeSpec, Placed, TreeSpec
from mpvi_bt.executive.tree.substitute import Rules, load_rules
from mpvi_bt.executive.tree.yaml_io import check_tree
from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import FileProblems, UserError
from mpvi_bt.ground.marked_yaml import SourceMarks, load_marked
from mpvi_bt.ground.robot.protocol import Side
from mpvi_bt.ground.robot.robots import sides_of
from mpvi_bt.ground.writing import write_whole
from mpvi_bt.runs.choices.backends import NOBODY, choose, name_of
from mpvi_bt.runs.choices.checkers import check_checker_choice
from mpvi_bt.runs.choices.checkers import doubt as checker_doubt
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.choices.detectors import make_detector
from mpvi_bt.runs.choices.language_models import Models, check_language_choice, language_doubts
from mpvi_bt.runs.choices.lateness import latency_of
from mpvi_bt.runs.choices.named_task import rooms_of, task_of
from mpvi_bt.runs.choices.planning import ground, make_planner, plan_findings, planner_of
from mpvi_bt.runs.choices.policies import check_policy_choice, rate_doubt
from mpvi_bt.runs.choices.simulators import check_simulator_choice
from mpvi_bt.runs.episode.capability_checks import check_hands
from mpvi_bt.runs.episode.capability_checks import doubt as doer_doubt
from mpvi_bt.runs.episode.saved_episode import SavedEpisode

if TYPE_CHECKING:
    from mpvi_bt.house.instances.tasks import Task


@dataclass(frozen=True)
class Prepared:
    """What to run.

    Attributes:
        task: None in a dry run of a tree alone.
        skills: By name.
        spec: The tree, its parameters filled in.
        rules: Of stand-ins, or None.
        models: Language models of the run.
        planned: What the planner made of the instruction, if it was asked.
        saved: Where it was stopped, if it goes on from there.
        planner: Makes a new plan where a unit fails that asks for one, or None.
        calibration: Thresholds of monitors, or None.
        plan: The plan that was given, with the marks of its file; None: none was.
    """

    task: Task | None
    skills: Mapping[str, Skill]
    spec: TreeSpec
    rules: Rules | None
    models: Models
    planned: Planned | None = None
    saved: SavedEpisode | None = None
    planner: Planner | None = None
    calibration: Calibration | None = None
    plan: tuple[Plan, SourceMarks] | None = None

    @property
    def doubt(self) -> str:
        """One line for a person if the tree says that it carries out another instruction than the task's, or ""."""
        own, due = self.spec.instruction, self.task.instruction if self.task else ""
        if not own or not due or own == due:
            return ""
        return f"tree {self.spec.name!r} was made for another instruction than the task's: {own!r}"


def prepare(
    config: EpisodeConfig, tell: Callable[[str], None] = lambda line: None, given: TreeSpec | Plan | None = None
) -> Prepared:
    """Read and check what a run is made of, and have a plan made if there is none.

    Args:
        config: Its task, tree, plan and rules; "" stands for no task: a tree or a plan alone.
        tell: Is told in a line what takes its time.
        given: The tree or the plan itself, where `config` does not name its file: its name there is as of `named`.

    Raises:
        UserError: One of them does not exist or is wrong, a parameter has no value, nothing is there to run, or it is
            for other hands than the robot has.
        FileProblems: All that is wrong with a file, rooms that the task's house lacks, or rules that fit no node.
        ModelError: A language model is to plan, and makes no plan.
    """
    task = task_of(config) if config.task else None
    skills, arguments = load_skills(), dict(config.arguments)
    models, planned, plan = Models(config), None, None
    arrange = arrangement(config, skills)
    if arguments and config.tree is None:
        raise UserError("only a tree of a file has parameters; name one with --tree.")
    if config.planner == NOBODY:
        _refuse_a_plan(config)
    if config.tree is not None:
        if config.on_failure != "advance":
            raise UserError("the tree of a file says itself what becomes of failures; --on-failure is for plans.")
        if config.drive != "navigator":
            raise UserError("the tree of a file says itself who drives; --drive is for plans.")
        if config.unit is not None:
            raise UserError("the tree of a file has its own units; --unit is for plans.")
        spec = _tree(given if isinstance(given, TreeSpec) else config.tree, task, skills, arguments)
    elif config.plan is not None:
        plan = _plan(given if isinstance(given, Plan) else config.plan, task, skills, sides_of(config.robot))
        spec = compile_plan(plan[0], skills, config.on_failure, config.drive, arrange)
    elif task is not None and config.planner == NOBODY:
        spec = compile_instruction(config.task_name, task.instruction)
    elif task is not None:
        planned = make_planner(config, task, models, tell=tell).ask(task.plan or config.task_name, task.instruction)
        if planned.answers and config.planned is not None:
            config.planned.parent.mkdir(parents=True, exist_ok=True)
            write_whole(config.planned, planned.plan.to_json())
        spec = compile_plan(planned.plan, skills, config.on_failure, config.drive, arrange)
        if problems := check_rooms(spec, rooms_of(task.house)):
            raise FileProblems(problems)
    else:
        raise UserError("there is nothing to run: name a task, a tree or a plan.")
    check_hands(config.robot, spec, skills)
    if planned is not None and (late_s := latency_of(config, "planner")(0)) > 0:
        wait = NodeSpec("wait", Pause(duration=late_s), "")
        spec = replace(spec, root=replace(spec.root, children=(wait, *spec.root.children)))
    rules = None
    if config.substitute is not None:
        rules = load_rules(config.substitute)
        rules.check(spec)
    planner = _replanner(config, task, models, spec, skills, given)
    known = calibration_of(config)
    return Prepared(task, skills, spec, rules, models, planned, planner=planner, calibration=known, plan=plan)


def calibration_of(config: EpisodeConfig) -> Calibration | None:
    """The thresholds of monitors. Raises UserError if they are of another policy or robot, FileProblems if broken."""
    if config.calibration is None:
        return None
    return load_calibration(config.calibration, name_of(config.policy), config.robot)


def check_watched(config: EpisodeConfig, prepared: Collection[Prepared]) -> None:
    """Raise UserError if the calibration file has thresholds for none of the monitored skills."""
    if (known := calibration_of(config)) is None:
        return
    watches = [placed.spec.parameters for ready in prepared for placed in ready.spec.nodes]
    watched = {watch.skill for watch in watches if isinstance(watch, Watch) and watch.skill}
    if not watched & known.skills.keys():
        has, due = ", ".join(known.skills), ", ".join(sorted(watched)) or "none; --unit monitored does"
        raise UserError(f"{config.calibration} has thresholds for {has}; skills that this run watches: {due}.")


def arrangement(config: EpisodeConfig, skills: Mapping[str, Skill]) -> Arrange | None:
    """A function that makes the node of each unit of manipulation, from the tree `config.unit`; None without one.

    Raises:
        UserError: There is no such tree, or it has parameters besides `UNIT_PARAMETERS` without a value.
        FileProblems: Everything that is wrong with it.
    """
    if config.unit is None:
        return None
    data, marks = load_marked(paths.find_or_file("trees", config.unit))
    tree = check_tree(data, marks, skills)
    if wrong := [problem for problem in lint(tree, skills, marks) if problem.severity == "error"]:
        raise FileProblems(wrong)
    if more := sorted({*tree.unbound} - {*UNIT_PARAMETERS}):
        known = ", ".join(UNIT_PARAMETERS)
        raise UserError(f"--unit {config.unit}: its parameter {more[0]!r} has no value; a unit has {known}.")

    def arranged(told: Mapping[str, str]) -> NodeSpec | None:
        arguments = {name: told[name] for name in UNIT_PARAMETERS if name in tree.parameters}
        return check_tree(data, marks, skills, arguments).root if all(arguments.values()) else None

    return arranged


def named(given: TreeSpec | Plan) -> str:
    """The displayed name of a tree or plan without a file."""
    return f"<{given.name if isinstance(given, TreeSpec) else given.task_name}>"


def _refuse_a_plan(config: EpisodeConfig) -> None:
    """Raise UserError if a plan is to be followed that nobody makes."""
    for option, given in (("--tree", config.tree), ("--plan", config.plan)):
        if given is not None:
            raise UserError(f"{option} says what to do step by step; with planner {NOBODY} only the policy knows.")
    if config.on_failure != "advance":
        raise UserError(f"--on-failure is for the units of a plan; planner {NOBODY} makes none.")


def _tree(
    given: str | TreeSpec, task: Task | None, skills: Mapping[str, Skill], arguments: Mapping[str, str]
) -> TreeSpec:
    if isinstance(given, TreeSpec):
        spec, marks = given, SourceMarks(named(given))
        if arguments:
            raise UserError(f"the parameters of tree {spec.name!r} are filled in where it is loaded, not here.")
    else:
        data, marks = load_marked(paths.find_or_file("trees", given))
        spec = check_tree(data, marks, skills, arguments)
    if wrong := [problem for problem in lint(spec, skills, marks) if problem.severity == "error"]:
        raise FileProblems(wrong)
    if spec.unbound:
        wanted = " ".join(f"--param {name}={spec.parameters[name].type.upper()}" for name in spec.unbound)
        raise UserError(f"tree {spec.name!r} needs values for its parameters: {wanted}")
    if task is not None and (problems := check_rooms(spec, rooms_of(task.house), marks)):
        raise FileProblems(problems)
    return spec


def _plan(
    given: str | Plan, task: Task | None, skills: Mapping[str, Skill], sides: tuple[Side, ...]
) -> tuple[Plan, SourceMarks]:
    if isinstance(given, Plan):
        plan, marks = given, SourceMarks(named(given))
    else:
        data, marks = load_marked(paths.find_or_file("tasks/plans", given))
        plan = check_plan(data, marks)
    found = plan_problems(plan, skills, ground(task.house, task, sides) if task else None, marks)
    if wrong := [problem for problem in found if problem.severity == "error"]:
        raise FileProblems(wrong)
    return plan, marks


def doubts(config: EpisodeConfig, prepared: Prepared, dry: bool = False) -> list[str]:
    """Warnings about a run that can begin, one a line; of a plan that was given, what its rehearsal finds, too."""
    of_plan = prepared.planned.doubts if prepared.planned else ()
    said = [prepared.doubt, *(f"{p.pointer}: {p.message} [{p.code}]" for p in of_plan)]
    if prepared.plan is not None:
        plan, marks = prepared.plan
        site = ground(prepared.task.house, prepared.task, sides_of(config.robot)) if prepared.task else None
        said += [str(p) for p in plan_findings(plan, marks, prepared.task, site) if p.severity == "warning"]
    if not dry:
        said += [
            make_detector(config.detector, {}, config.seed).note,
            checker_doubt(config),
            rate_doubt(config),
            doer_doubt(config, prepared.spec, prepared.skills),
        ]
    return [line for line in said if line]


def check_backends(config: EpisodeConfig) -> None:
    """Refuse backends that do not exist or cannot be made. Raises UserError, and ModelError of language models."""
    for kind, name in config.backends.items():
        choose(kind, name).check()
    check_language_choice(config)
    check_policy_choice(config)
    check_checker_choice(config)
    check_simulator_choice(config)
    if choose("detector", config.detector).part is None:
        make_detector(config.detector, {})
    if config.map == "online" and config.detector == "oracle":
        raise UserError("--map online is built by looking: choose a detector that looks, such as segmentation.")


def prepare_episode(
    config: EpisodeConfig, tell: Callable[[str], None] = lambda line: None, given: TreeSpec | Plan | None = None
) -> Prepared:
    """As `prepare`, of an episode; its backends and its instance exist.

    Raises:
        UserError: Something in `config` does not exist or is wrong.
        ModelError: As of `prepare`.
    """
    check_backends(config)
    _check_start(config)
    for doubt in language_doubts([config]):  # before a key is sent
        tell(doubt)
    ready = prepare(config, tell, given)
    _check_replanning(ready)
    return ready


def check_episode(config: EpisodeConfig) -> Prepared | None:
    """Refuse as `prepare_episode`, as far as possible before a planner is asked for a plan.

    Returns:
        What it makes; None where a planner is to be asked first.

    Raises:
        UserError: Something in `config` does not exist or is wrong.
        ModelError: The model cannot be asked.
    """
    if config.tree is None and config.plan is None:
        task = task_of(config)
        if (name := planner_of(config, task)) not in ("recorded", NOBODY):
            check_backends(config)
            _check_start(config)
            if name == "symbolic":
                make_planner(config, task, Models(config))
            return None
    return prepare_episode(config)


def _check_start(config: EpisodeConfig) -> None:
    """Raise UserError unless the task, its instance and its split exist."""
    from mpvi_bt.house.instances.splits import check_split

    task_of(config).check_instance(config.instance)
    check_split(config.split)


def _replanner(
    config: EpisodeConfig,
    task: Task | None,
    models: Models,
    spec: TreeSpec,
    skills: Mapping[str, Skill],
    given: TreeSpec | Plan | None = None,
) -> Planner | None:
    """The planner for new plans; None if the tree never replans or has no plan to start from."""
    if not any(_wants_a_plan(placed) for placed in spec.nodes):
        return None
    if planner_of(config, task) not in ("recorded", NOBODY):
        return make_planner(config, task, models)
    sides = sides_of(config.robot)
    if config.plan is not None:
        plan, _ = _plan(given if isinstance(given, Plan) else config.plan, task, skills, sides)
        return LaterPlanner(plan, skills, sides)
    if task is None or task.plan is None or config.tree is not None:
        return None
    return LaterPlanner(RecordedPlanner().plan(task.plan), skills, sides)


def _check_replanning(ready: Prepared) -> None:
    """Raise UserError if a node wants a new plan where it fails, and nobody makes any."""
    node = next(filter(_wants_a_plan, ready.spec.nodes), None)
    if node is not None and ready.planner is None:
        where = f" ({node.spec.place})" if node.spec.place else ""
        raise UserError(
            f"{node.path!r}{where} wants a new plan where it fails, and a tree of a file has no plan behind it: "
            "choose a planner that makes one, such as --planner symbolic."
        )


def _wants_a_plan(placed: Placed) -> bool:
    return getattr(placed.spec.parameters, "on_failure", "") == "replan"


def prepare_saved(saved: SavedEpisode, config: EpisodeConfig) -> Prepared:
    """Prepares the rest of a saved episode: task and rules from its settings, and the saved tree.

    Args:
        saved: How it stood.
        config: Of the run that goes on: the saved one, with outputs of its own.

    Raises:
        UserError: Its task is not there any more, or the like.
        FileProblems: Its tree is none, or its rules are none.
    """
    task = task_of(config) if config.task else None
    if task is None and not saved.dry:
        raise UserError("the saved episode names no task.")
    if task is not None and not saved.dry:
        check_backends(config)
        task.check_instance(config.instance)
    spec = saved.spec
    rules = load_rules(config.substitute) if config.substitute else None  # may fit what a new plan replaced
    models = Models(config)
    skills = load_skills()
    planner = _replanner(config, task, models, spec, skills)
    ready = Prepared(
        task, skills, spec, rules, models, saved=saved, planner=planner, calibration=calibration_of(config)
    )
    if not saved.dry:
        _check_replanning(ready)
    return ready
