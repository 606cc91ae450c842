"""The nine tools, as plain functions of what a client sends."""

from __future__ import annotations

import asyncio
import contextlib
import re
from collections.abc import Awaitable, Callable, Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from mpvi_bt.apps.mcp_server.answers import (
    CheckedText,
    Found,
    Preview,
    RunExplanation,
    RunProgress,
    Started,
    StoppedRun,
    TaskLine,
    TaskPlan,
    Tasks,
    TaskScene,
)
from mpvi_bt.apps.mcp_server.run_processes import RunProcess, RunProcesses
from mpvi_bt.executive.behaviors.parameters import Value
from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import FileProblems, UnknownName, UserError

if TYPE_CHECKING:
    from mpvi_bt.executive.tree.spec import TreeSpec

_MOST = 200_000  # characters of a tree
_EVERY_S = 0.5
_LONGEST_S = 50.0  # clients give a call up after a minute

TaskName = Annotated[str, Field(description="Name of a task, as `tasks` lists them.", max_length=100)]
PlanText = Annotated[str | None, Field(description="A plan, as JSON or YAML.", max_length=_MOST)]
TreeText = Annotated[
    str | None, Field(description="A tree as YAML or JSON, or the name of one on file.", max_length=_MOST)
]
Parameters = Annotated[dict[str, Value] | None, Field(description="Values of the tree's own parameters, by name.")]
RunId = Annotated[
    str | None, Field(description="Id of a run, as `run` returned it; left out: the last one.", max_length=20)
]
Report = Callable[[float, float | None, str], Awaitable[None]]


class Tools:
    """What the tools do.

    Args:
        runs: All runs.
        allow_motion: Whether a run may move the robot; else every run is dry.
    """

    def __init__(self, runs: RunProcesses, allow_motion: bool = False) -> None:
        self._runs, self._allow_motion = runs, allow_motion

    def tasks(self) -> Tasks:
        """Everything to ask of the robot: tasks, the skills for trees, and trees on file."""
        return self._all

    @cached_property
    def _all(self) -> Tasks:
        from mpvi_bt.executive.plan.skills import load_skills
        from mpvi_bt.house.instances.tasks import load_task

        known = {name: load_task(name) for name in paths.names("tasks")}
        return Tasks(
            tasks=[
                TaskLine(name=n, instruction=t.instruction, instances=t.instances, budget_s=t.budget_s)
                for n, t in known.items()
            ],
            skills={name: skill.about for name, skill in load_skills().items()},
            trees=paths.names("trees"),
        )

    def scene(self, task: TaskName) -> TaskScene:
        """Names of rooms, fixtures and things for plans and trees in a task."""
        from mpvi_bt.house.instances.tasks import load_task
        from mpvi_bt.runs.choices.planning import ground

        loaded = load_task(_known(task))
        place = ground(loaded.house, loaded)
        return TaskScene(
            task=task,
            instruction=loaded.instruction,
            house=loaded.house,
            rooms=place.fixtures(),
            targets=place.phrases,
        )

    def plan(self, task: TaskName) -> TaskPlan:
        """The plan of a task, on file or else made by its goal, and the tree compiled from it."""
        from mpvi_bt.apps import api
        from mpvi_bt.executive.tree.writer import dump_tree
        from mpvi_bt.runs.choices.planning import plan_of

        plan = plan_of(_known(task))
        return TaskPlan(task=task, plan=plan.to_json(), tree=dump_tree(api.compile_plan(plan)))

    def check(
        self,
        tree: TreeText = None,
        plan: PlanText = None,
        task: Annotated[str | None, Field(description="Check names against this task, too.", max_length=100)] = None,
        parameters: Parameters = None,
    ) -> CheckedText:
        """Every problem of a tree or a plan, with line, column and what would be valid. Check before you run."""
        from mpvi_bt.apps.authoring.checking import check_files

        _one_of(tree=tree, plan=plan)
        _of_a_tree(tree, parameters)
        text = str(plan if tree is None else tree)
        named = text if tree is not None and _is_name(tree) else "-"
        if named == "-":
            with contextlib.suppress(FileProblems):  # told below
                _refuse_code(text)
                _refuse_kind("plan" if tree is None else "tree", text)
        problems = check_files([named], None if task is None else _known(task), text).problems
        if parameters is not None and not any(problem.severity == "error" for problem in problems):
            try:
                _spec(text, parameters)
            except FileProblems as error:
                problems = [*problems, *error.problems]
        return CheckedText(
            ok=not any(p.severity == "error" or p.code == "impossible" for p in problems),
            problems=[
                Found(line=p.line, column=p.column, code=p.code, severity=p.severity, message=p.message)
                for p in problems
            ],
        )

    def preview(
        self,
        tree: TreeText = None,
        task: Annotated[str | None, Field(description="Draw the tree of its plan.", max_length=100)] = None,
        parameters: Parameters = None,
    ) -> Preview:
        """Draw a tree, or that of a task's plan. {-} is a sequence, {o} a selector, /_/ a parallel, -^- a decorator."""
        from mpvi_bt.apps import api
        from mpvi_bt.executive.drawing.text import ascii_tree
        from mpvi_bt.runs.choices.planning import plan_of

        _one_of(tree=tree, task=task)
        _of_a_tree(tree, parameters)
        spec = _spec(str(tree), parameters) if task is None else api.compile_plan(plan_of(_known(task)))
        takes = {
            name: f"{p.type}, {f'{p.default} by default' if p.default is not None else 'has to be given'}"
            for name, p in spec.parameters.items()
        }
        return Preview(name=spec.name, nodes=len(spec.nodes), parameters=takes, drawing=ascii_tree(spec, width=100))

    def run(
        self,
        task: Annotated[str | None, Field(description="Name of a task; its plan is run.", max_length=100)] = None,
        tree: TreeText = None,
        dry: Annotated[bool, Field(description="Tick the tree with stand-ins: nothing moves.")] = True,
        instance: Annotated[int, Field(ge=0, le=999, description="Start state of the task.")] = 0,
        seed: Annotated[int, Field(ge=0, le=999_999, description="Of all that is drawn by chance.")] = 0,
        policy: Annotated[
            Literal["expert", "reactive"] | None, Field(description="Who moves the arms (expert); with dry=false.")
        ] = None,
        on_failure: Annotated[
            Literal["advance", "replan"] | None,
            Field(description="What becomes of a failed segment of the task's plan (advance); with dry=false."),
        ] = None,
        parameters: Parameters = None,
    ) -> Started:
        """Begin a run and return at once with its id. One run at a time; the robot moves only with dry=false.

        A task alone runs its plan, a tree beside it that tree in its place. A dry run takes a tree without a task.
        """
        self._check_run(task, tree, dry, instance, policy, on_failure)
        _of_a_tree(tree, parameters)
        words = [] if task is None else [task, "--instance", str(instance)]
        words += ["--seed", str(seed), *(["--dry"] if dry else [])]
        words += [] if policy is None else ["--policy", policy]
        words += [] if on_failure is None else ["--on-failure", on_failure]
        for name, value in (parameters or {}).items():
            words += ["--param", f"{name}={str(value).lower() if isinstance(value, bool) else value}"]
        if tree is not None and not (checked := self.check(tree, None, task, parameters or {})).ok:
            raise UserError("; ".join(f"line {p.line}: {p.message}" for p in checked.problems if p.severity == "error"))
        if tree is not None and (unbound := (spec := _spec(tree, parameters)).unbound):
            wanted = ", ".join(f"{name} ({spec.parameters[name].type})" for name in unbound)
            raise UserError(f"tree {spec.name!r} needs values for its parameters: {wanted}")
        if tree is not None and _is_name(tree):
            words, tree = [*words, "--tree", tree], None
        run = self._runs.start(words, f"{task or 'a tree'}{', dry' if dry else ''}", dry, tree)
        return Started(run=run.id, dry=dry, trace=f"mpvi://runs/{run.id}/trace")

    def _check_run(
        self, task: str | None, tree: str | None, dry: bool, instance: int, policy: str | None, on_failure: str | None
    ) -> None:
        """Refuse a request that cannot be run, or only in part. Raises UserError."""
        from mpvi_bt.house.instances.tasks import load_task

        if task is None and (tree is None or not dry):
            raise UserError("run wants a task; only a dry run of a tree does without one")
        if task is not None:
            load_task(_known(task)).check_instance(instance)
        elif instance:
            raise UserError("instance is a start state of a task: name the task")
        if not dry and not self._allow_motion:
            raise UserError("nothing moves here: the server was started without --allow-motion; only dry runs are made")
        for name, value in (("policy", policy), ("on_failure", on_failure)):
            if dry and value is not None:
                raise UserError(f"{name} is for runs that move the robot: leave it out, or set dry=false")
        if on_failure is not None and tree is not None:
            raise UserError("on_failure is for the plan of a task: a tree defines its own handling of failures")

    async def progress(
        self, report: Report, run: RunId = None,
        wait_s: Annotated[float, Field(ge=0, le=_LONGEST_S, description="Wait so long for its end.")] = 0.0,
    ) -> RunProgress:  # fmt: skip
        """The state of a run: tick, simulated time, running nodes, events. With wait_s, it reports meanwhile."""
        found = self._named(run)
        until = asyncio.get_running_loop().time() + wait_s
        last = -1.0
        while True:
            progress = await asyncio.to_thread(found.progress)
            left_s = until - asyncio.get_running_loop().time()
            if progress.state == "ended" or left_s <= 0:
                return progress
            if progress.tick > last:
                last = progress.tick
                await report(last, None, f"{progress.time_s:.1f} s: {', '.join(progress.doing) or progress.state}")
            await asyncio.sleep(min(_EVERY_S, left_s))

    def explain(self, run: RunId = None) -> RunExplanation:
        """Why a run ended, from the root down to the failed leaf; or its state while it runs."""
        from mpvi_bt.executive.trace.explain import explain
        from mpvi_bt.executive.trace.explain_text import explanation_text
        from mpvi_bt.executive.trace.read import read_trace

        found = self._named(run)
        if (trace := found.trace) is None:
            text = "it has not begun" if found.alive else found.said()
        else:
            text = explanation_text(explain(read_trace(trace)))
        return RunExplanation(run=found.id, text=text)

    def stop(self, run: RunId = None) -> StoppedRun:
        """End a run between two ticks: the robot holds still, the goal is scored, and its trace is closed."""
        found = self._named(run)
        self._runs.stop(found)
        return StoppedRun(run=found.id, outcome=found.progress().outcome)

    def trace(self, run: str) -> str:
        """The trace of a run. Raises UserError if there is none yet."""
        if (trace := self._named(run).trace) is None:
            raise UserError(f"run {run} has no trace yet")
        return trace.read_text(encoding="utf-8")

    def _named(self, run: str | None) -> RunProcess:
        return self._runs.last if run is None else self._runs.get(run)


def _one_of(**given: str | None) -> None:
    """Refuse none or both of two arguments. Raises UserError."""
    if sum(value is not None for value in given.values()) != 1:
        raise UserError(f"give {' or '.join(given)}, one of them")


def _of_a_tree(tree: str | None, parameters: Mapping[str, Value] | None) -> None:
    """Refuse parameters of nothing. Raises UserError."""
    if parameters and tree is None:
        raise UserError("parameters are those of a tree: give the tree, too")


def _spec(tree: str, parameters: Mapping[str, Value] | None) -> TreeSpec:
    """The tree of a name, or in a text. Raises FileProblems, or UserError of a text that brings code."""
    from mpvi_bt.executive.plan.skills import load_skills
    from mpvi_bt.executive.tree.yaml_io import load_tree, parse_tree

    if _is_name(tree):
        return load_tree(paths.find("trees", tree), load_skills(), parameters)
    _refuse_code(tree)
    return parse_tree(tree, "tree", load_skills(), parameters)


def _known(task: str) -> str:
    """The name of a task on file: paths are not for clients. Raises UnknownName."""
    paths.find("tasks", task)
    return task


def _is_name(tree: str) -> bool:
    """Whether it is the name of a tree on file, and not its text. Raises UnknownName: a word that names none."""
    known = paths.names("trees")
    if tree not in known and re.fullmatch(r"[\w.-]*", tree):
        raise UnknownName("tree", tree, known)
    return tree in known


def _refuse_kind(argument: str, text: str) -> None:
    """Raise UserError if a text is of another kind than its argument; FileProblems if it is no YAML."""
    from mpvi_bt.ground.file_kinds import expect
    from mpvi_bt.ground.marked_yaml import parse_marked

    data, marks = parse_marked(text, argument)
    try:
        expect(argument, data, marks)
    except FileProblems as error:
        raise UserError(f"{argument}: {error.problems[0].message}") from None


def _refuse_code(text: str) -> None:
    """Raise UserError if a tree has nodes of its own, as reading it would run code; FileProblems if it is no YAML."""
    from mpvi_bt.ground.marked_yaml import parse_marked

    data, _ = parse_marked(text, "tree")
    if isinstance(data, dict) and "nodes" in data:
        raise UserError("nodes: a tree from a client cannot bring code; name a tree in MPVI_PATH that has these nodes")
