"""What an episode is about to run, with everything refused that can be refused before a simulator loads."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from mpvi_bt import paths
from mpvi_bt.errors import FileProblems, UserError
from mpvi_bt.marked_yaml import Marks, load_marked
from mpvi_bt.plan.planners import RecordedPlanner
from mpvi_bt.plan.schema import load_plan
from mpvi_bt.plan.skills import Skill, load_skills
from mpvi_bt.sim.house import load_house
from mpvi_bt.suite.backends import choose
from mpvi_bt.suite.checkers import check_checker_choice
from mpvi_bt.suite.config import EpisodeConfig
from mpvi_bt.suite.detectors import make_detector
from mpvi_bt.suite.policies import check_policy_choice
from mpvi_bt.suite.saved import SavedEpisode
from mpvi_bt.suite.tasks import Task, load_task
from mpvi_bt.tree.compile import compile_plan
from mpvi_bt.tree.lint import check_rooms, lint
from mpvi_bt.tree.spec import TreeSpec
from mpvi_bt.tree.substitute import Rules, load_rules
from mpvi_bt.tree.yaml_io import check_tree


@dataclass(frozen=True)
class Prepared:
    """What to run.

    Attributes:
        task: None in a dry run of a tree alone.
        skills: By name.
        spec: The tree, its parameters filled in.
        rules: Of stand-ins, or None.
        saved: Where it was stopped, if it goes on from there.
    """

    task: Task | None
    skills: Mapping[str, Skill]
    spec: TreeSpec
    rules: Rules | None
    saved: SavedEpisode | None = None

    @property
    def doubt(self) -> str:
        """One line for a person if the tree says that it carries out another instruction than the task's, or ""."""
        own, due = self.spec.instruction, self.task.instruction if self.task else ""
        if not own or not due or own == due:
            return ""
        return f"tree {self.spec.name!r} was made for another instruction than the task's: {own!r}"


def prepare(
    task: str | None,
    tree: str | None = None,
    plan: str | None = None,
    arguments: Mapping[str, str] | None = None,
    substitute: str | None = None,
) -> Prepared:
    """Read and check what an episode is made of.

    Args:
        task: Name or file of a task; None: a tree or a plan alone.
        tree: Name or file of a tree to run instead of compiling a plan.
        plan: Name or file of a plan instead of the task's own.
        arguments: Values of the tree's parameters.
        substitute: File of substitution rules.

    Raises:
        UserError: One of them does not exist or is wrong, a parameter has no value, or nothing is there to run.
        FileProblems: All that is wrong with a file, rooms that the task's house lacks, or rules that fit no node.
    """
    loaded = load_task(task) if task else None
    marks = Marks("")
    skills = load_skills()
    if arguments and tree is None:
        raise UserError("only a tree of a file has parameters; name one with --tree.")
    if tree is not None:
        data, marks = load_marked(paths.find_or_file("trees", tree))
        spec = check_tree(data, marks, skills, arguments)
        if wrong := [problem for problem in lint(spec, skills, marks) if problem.severity == "error"]:
            raise FileProblems(wrong)
        if spec.unbound:
            wanted = " ".join(f"--param {name}={spec.parameters[name].type.upper()}" for name in spec.unbound)
            raise UserError(f"tree {spec.name!r} needs values for its parameters: {wanted}")
    elif plan is not None:
        spec = compile_plan(load_plan(paths.find_or_file("tasks/plans", plan)), skills)
    elif loaded is not None:
        spec = compile_plan(RecordedPlanner().plan(loaded.plan, loaded.instruction), skills)
    else:
        raise UserError("there is nothing to run: name a task, a tree or a plan.")
    if loaded is not None and (problems := check_rooms(spec, load_house(loaded.house).rooms, marks)):
        raise FileProblems(problems)
    rules = None
    if substitute is not None:
        rules = load_rules(substitute)
        rules.check(spec)
    return Prepared(loaded, skills, spec, rules)


def check_backends(config: EpisodeConfig) -> None:
    """Refuse backends that do not exist or cannot be made. Raises UserError."""
    for kind, name in config.backends.items():
        choose(kind, name)
    check_policy_choice(config)
    check_checker_choice(config)
    make_detector(config.detector, {})
    if config.map == "online" and config.detector == "oracle":
        raise UserError("--map online is built by looking: choose a detector that looks, such as segmentation.")


def prepare_episode(config: EpisodeConfig) -> Prepared:
    """As `prepare`, of an episode; its backends and its instance exist.

    Raises:
        UserError: Something in `config` does not exist or is wrong.
    """
    check_backends(config)
    ready = prepare(config.task, config.tree, config.plan, dict(config.arguments), config.substitute)
    assert ready.task is not None
    ready.task.check_instance(config.instance)
    return ready


def prepare_saved(saved: SavedEpisode) -> Prepared:
    """What goes on from where it was stopped: the task and the rules of its settings, and the very tree.

    Raises:
        UserError: Its task is not there any more, or the like.
        FileProblems: Its tree is none, or its rules do not fit it.
    """
    config = saved.episode
    task = load_task(config.task) if config.task else None
    if task is None and not saved.dry:
        raise UserError("the saved episode names no task.")
    if task is not None and not saved.dry:
        check_backends(config)
        task.check_instance(config.instance)
    spec = saved.spec
    rules = load_rules(config.substitute) if config.substitute else None
    if rules is not None:
        rules.check(spec)
    return Prepared(task, load_skills(), spec, rules, saved)
