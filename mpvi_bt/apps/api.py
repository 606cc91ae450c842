"""What `import mpvi_bt` offers: the work of the commands, called from Python.

Each function does what the command of its name does, by the same code, and raises where that ends with an error. What
is heavy loads in the functions, so that `mpvi_bt.load_tree` needs no simulator.
"""

from __future__ import annotations

import io
import logging
import sys
import warnings
from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

from mpvi_bt.executive.behaviors.parameters import Value
from mpvi_bt.executive.plan.schema import Plan
from mpvi_bt.executive.tree.spec import TreeSpec
from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import Problem
from mpvi_bt.runs.choices.config import SETTINGS, SHARED, EpisodeConfig
from mpvi_bt.runs.choices.methods import load_method
from mpvi_bt.runs.episode.keywords import checked, listed

if TYPE_CHECKING:
    from mpvi_bt.executive.ticking.loop import Outcome, Subscriber
    from mpvi_bt.executive.tree.compile import Drive
    from mpvi_bt.house.instances.tasks import Task
    from mpvi_bt.runs.choices.setting_keywords import EpisodeKeywords, SuiteKeywords
    from mpvi_bt.runs.episode.result import Result
    from mpvi_bt.runs.report.suite_report import SuiteReport

File = str | PathLike[str]
_LOG = logging.getLogger("mpvi_bt")


def load_tree(tree: File, **arguments: Value) -> TreeSpec:
    """A tree, by name or file, its parameters filled in.

    Args:
        tree: Such as "fetch" or "my_tree.yaml".
        **arguments: Values of its parameters, such as to="sofa".

    Raises:
        UserError: There is no such tree, or no such parameter.
        FileProblems: Everything that is wrong with it, as `mpvi check` tells it; warnings are left out.
    """
    import mpvi_bt.executive.drawing.shown  # noqa: F401  # trees draw themselves
    from mpvi_bt.executive.plan.skills import load_skills
    from mpvi_bt.executive.tree import yaml_io

    return yaml_io.load_tree(paths.find_or_file("trees", str(tree)), load_skills(), arguments)


def load_plan(plan: File) -> Plan:
    """A plan, by name or file. Raises as `load_tree`."""
    from mpvi_bt.executive.plan import schema

    return schema.load_plan(paths.find_or_file("tasks/plans", str(plan)))


def load_task(task: File) -> Task:
    """A task, by name or file. Raises as `load_tree`."""
    from mpvi_bt.house.instances import tasks

    return tasks.load_task(str(task))


def compile_plan(plan: Plan | File, on_failure: str = "advance", drive: Drive = "navigator") -> TreeSpec:
    """The tree of a plan, as `mpvi compile` writes it.

    Args:
        plan: The plan, or its name or file.
        on_failure: After a failed unit: "advance", "retry:N" or "replan".
        drive: Who drives: "navigator" or "policy".

    Raises:
        UserError: There is no such plan or setting.
        FileProblems: Everything that is wrong with the plan.
    """
    import mpvi_bt.executive.drawing.shown  # noqa: F401
    from mpvi_bt.executive.plan.skills import load_skills
    from mpvi_bt.executive.tree import compile as compiler

    loaded = plan if isinstance(plan, Plan) else load_plan(plan)
    return compiler.compile_plan(loaded, load_skills(), on_failure, drive)


def check(*files: File, task: File | None = None) -> list[Problem]:
    """Every problem of files, of whatever kind, and of those below folders; none, if all is well.

    Args:
        *files: Files, folders, or names of trees.
        task: Check rooms, and what to drive to, against this task's house and things.

    Raises:
        UserError: There is no such task.
    """
    from mpvi_bt.apps.authoring.checking import check_files

    return check_files(map(str, files), None if task is None else str(task)).problems


@listed(SETTINGS)
def run(
    task: File,
    *,
    method: str | None = None,
    tree: TreeSpec | File | None = None,
    plan: Plan | File | None = None,
    arguments: Mapping[str, Value] | None = None,
    out: File | None = None,
    subscribers: Sequence[Subscriber] = (),
    **settings: Unpack[EpisodeKeywords],
) -> Result:
    """Run one episode, as `mpvi run` does.

    Args:
        task: Name or file of the task.
        method: Name or file of a method; what is given beside it overrides it.
        tree: Run this one instead of a plan's.
        plan: Compile this one instead of the task's own.
        arguments: Parameters of a tree that is named.
        out: Folder for result and trace; None: nothing is written.
        subscribers: Who watches, tick by tick.
        **settings: Fields of `mpvi_bt.EpisodeConfig`, such as policy="reactive", instance=3 or video="trash.mp4".

    Returns:
        The result. Its `ended` is "interrupted" after Ctrl-C, "backend_error" where a policy's server or a language
        model failed.

    Raises:
        UserError: Something that was named does not exist or is wrong.
        FileProblems: Everything that is wrong with a file, or with `settings`.
        BackendError: Pictures are needed and the machine can draw none, or a language model makes no plan.
        NodeError: A behavior raised.
    """
    from mpvi_bt.runs.episode.episode import run as run_episode
    from mpvi_bt.runs.episode.prepare import check_watched, doubts, prepare_episode
    from mpvi_bt.runs.episode.result import Result, write_result

    config, given = _asked("mpvi_bt.run", task, method, tree, plan, arguments, settings)
    folder = None if out is None else Path(out)
    if folder is not None:
        config = config.kept_in(folder)
    prepared = prepare_episode(config, _LOG.info, given)
    check_watched(config, [prepared])
    for doubt in doubts(config, prepared):
        warnings.warn(doubt, stacklevel=2)
    result = Result.model_validate(run_episode(config, subscribers, prepared))
    if folder is not None:
        write_result(folder / f"{config.name}.json", result)
    return result


def run_dry(
    tree: TreeSpec | File | None = None,
    *,
    plan: Plan | File | None = None,
    task: File = "",
    arguments: Mapping[str, Value] | None = None,
    substitute: File | None = None,
    subscribers: Sequence[Subscriber] = (),
) -> Outcome:
    """Run a tree, the tree of a plan or that of a task, without robot and simulator, as `mpvi run --dry` does.

    Args:
        tree, plan, task: What to run; one of them is enough.
        arguments: Parameters of a tree that is named.
        substitute: File of rules that make nodes fail, wait or raise.
        subscribers: Who watches, tick by tick.

    Raises:
        UserError: Something that was named does not exist or is wrong, or nothing was named.
        FileProblems: Everything that is wrong with a file.
        NodeError: A behavior raised.
    """
    from mpvi_bt.executive.ticking.dry import LIMIT_S, dry_tree
    from mpvi_bt.executive.ticking.dry import run_dry as run_tree
    from mpvi_bt.runs.episode.prepare import prepare

    settings = {} if substitute is None else {"substitute": str(substitute)}
    config, given = _asked("mpvi_bt.run_dry", task, None, tree, plan, arguments, settings)
    prepared = prepare(config, _LOG.info, given)
    budget_s = prepared.task.budget_s if prepared.task else LIMIT_S
    return run_tree(
        dry_tree(prepared.spec, prepared.rules), prepared.skills, subscribers, budget_s, planner=prepared.planner
    )


@listed(SHARED)
def run_suite(
    suite: File,
    *,
    out: File | None = None,
    method: str | None = None,
    tree: File | None = None,
    plan: File | None = None,
    arguments: Mapping[str, Value] | None = None,
    tasks: Sequence[str] = (),
    instances: Sequence[int] = (),
    houses: int | Sequence[str] | None = None,
    workers: int | None = None,
    progress: bool = True,
    **settings: Unpack[SuiteKeywords],
) -> SuiteReport:
    """Run the episodes of a suite that have no result yet, as `mpvi suite run` does.

    Workers are processes that load the calling script anew: call this below `if __name__ == "__main__":`.

    Args:
        suite: Name or file of the suite.
        out: Folder of its results; None: runs/SUITE. What is there is not run again.
        method: Name or file of one method, instead of the suite's.
        tree, plan: Name or file of one to run in every episode.
        arguments: Parameters of that tree.
        tasks, instances: Play only these now.
        houses: Names of houses, or how many are drawn by seeds, instead of the suite's.
        workers: Episodes at work at once; None: one a core.
        progress: Tell on stderr how it goes.
        **settings: Fields of `mpvi_bt.EpisodeConfig` that override what methods say.

    Returns:
        The report: `results` and `faults`, `print` and notebooks show it as text, `write_html` and `write_markdown`
        write it.

    Raises:
        UserError: Something that was named does not exist or is wrong, or the folder holds other results.
        FileProblems: Everything that is wrong with a file, or with `settings`.
        BackendError: Every episode would break alike.
    """
    from mpvi_bt.runs.report.suite_folders import SuiteFolder
    from mpvi_bt.runs.report.suite_report import SuiteReport
    from mpvi_bt.runs.suite.play import Where, play
    from mpvi_bt.runs.suite.progress import SuiteProgress
    from mpvi_bt.runs.suite.store import RUNS, Store
    from mpvi_bt.runs.suite.suites import load_suite

    loaded, title = load_suite(str(suite)), paths.title(suite)
    store = Store(RUNS / title if out is None else Path(out))
    files = {name: str(given) for name, given in (("tree", tree), ("plan", plan)) if given is not None}
    options = checked({**settings, **files, "arguments": _listed(arguments)}, "mpvi_bt.run_suite")
    if method is not None:
        options = {**load_method(method), **options}
    outcome = play(
        title,
        store,
        loaded.episodes(houses, **options),
        lambda pace: SuiteProgress(sys.stderr if progress else io.StringIO(), pace),
        tasks=tasks,
        instances=instances,
        where=Where(workers=workers),
        about=loaded.about,
    )
    return SuiteReport.of([SuiteFolder(title, store, outcome.episodes, outcome.results, outcome.faults, loaded.about)])


def _asked(
    where: str,
    task: File,
    method: str | None,
    tree: TreeSpec | File | None,
    plan: Plan | File | None,
    arguments: Mapping[str, Value] | None,
    settings: Mapping[str, Any],
) -> tuple[EpisodeConfig, TreeSpec | Plan | None]:
    """The request, and the tree or plan that comes from no file."""
    from mpvi_bt.runs.episode.prepare import named

    given = tree if isinstance(tree, TreeSpec) else plan if isinstance(plan, Plan) else None
    told = {
        "tree": named(tree) if isinstance(tree, TreeSpec) else tree and str(tree),
        "plan": named(plan) if isinstance(plan, Plan) else plan and str(plan),
        "arguments": _listed(arguments),
    }
    way = load_method(method) if method is not None else {}
    return EpisodeConfig(**{**way, **checked({**told, **settings, "task": str(task)}, where)}), given


def _listed(arguments: Mapping[str, Value] | None) -> tuple[tuple[str, str], ...]:
    """Parameters of a tree as an episode has them."""
    return tuple((name, _written(value)) for name, value in (arguments or {}).items())


def _written(value: Value) -> str:
    """A value as the command line has it."""
    return str(value).lower() if isinstance(value, bool) else str(value)
