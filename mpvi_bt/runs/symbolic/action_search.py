"""Finds the cheapest sequence of actions in a time limit: unified-planning with Fast Downward (extra `symbolic`)."""

from __future__ import annotations

import contextlib
import importlib.util
import warnings
from collections.abc import Callable, Collection, Sequence
from tempfile import TemporaryDirectory
from typing import Any

from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.extras import install
from mpvi_bt.runs.symbolic.grounded_actions import GroundedAction
from mpvi_bt.runs.symbolic.told_facts import Atom

# Our choice: for any plan first, then for cheaper and cheaper ones. No spaces: words are told apart by them.
_SEARCH = (
    "let(h,eval_modify_costs(ff(),cost_type=one),let(g,eval_modify_costs(ff(),cost_type=plusone),iterated(["
    "lazy_greedy([h],preferred=[h],cost_type=one),lazy_wastar([g],preferred=[g],w=1)],repeat_last=true)))"
)
_NO_INVARIANTS = ["--invariant-generation-max-time", "0"]  # they take seconds, and the search does without

MOST_ACTIONS = 3000  # our choice: writing them down takes seconds already; the fifty tasks have 400 at most

NEEDED = ("unified_planning", "up_fast_downward")


def require_installed() -> None:
    """Raise UserError if the libraries are not installed."""
    if any(importlib.util.find_spec(name) is None for name in NEEDED):
        raise UserError(f"the symbolic planner, which plans tasks without a plan on file, needs {install('symbolic')}")


class NoActions(Exception):
    """No actions were found; the message says why."""


def find_actions(
    actions: Sequence[GroundedAction],
    start: Collection[Atom],
    goal: Collection[Atom],
    never: Collection[Atom],
    limit_s: int,
    tell: Callable[[str], None] = lambda line: None,
) -> list[GroundedAction]:
    """Actions that lead from the start to the goal: the cheapest that are found in time.

    Args:
        actions: To choose from.
        start: What is so.
        goal: What has to be so at the end.
        never: What must not be so at the end.
        limit_s: Processor time of the search, so that a busy machine finds the same.
        tell: Is told if there may be cheaper ones.

    Raises:
        NoActions: There are none, or none were found in time, or there are too many to choose from.
        UserError: The extra is not installed.
    """
    require_installed()
    if len(actions) > MOST_ACTIONS:
        raise NoActions(f"the task is too large: {len(actions)} actions to choose from, of at most {MOST_ACTIONS}")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import unified_planning.shortcuts as up
        from unified_planning.engines import PlanGenerationResultStatus as Status
    up.get_environment().credits_stream = None
    problem = up.Problem("task")
    used = sorted({*start, *goal, *never, *(a for act in actions for a in (*act.needs, *act.forbids, *act.adds))})
    fluents: dict[Atom, Any] = {atom: up.Fluent(f"f{i}") for i, atom in enumerate(used)}
    for atom, fluent in fluents.items():
        problem.add_fluent(fluent, default_initial_value=atom in start)
    costs: dict[Any, Any] = {}
    for i, action in enumerate(actions):
        made = up.InstantaneousAction(f"a{i}")
        for atom in sorted(action.needs):
            made.add_precondition(fluents[atom])
        for atom in sorted(action.forbids):
            made.add_precondition(up.Not(fluents[atom]))
        for atom in sorted(action.adds):
            made.add_effect(fluents[atom], True)
        for atom in sorted(action.drops - action.adds):
            if atom in fluents:
                made.add_effect(fluents[atom], False)
        problem.add_action(made)
        costs[made] = up.Int(action.cost)
    for atom in sorted(goal):
        problem.add_goal(fluents[atom])
    for atom in sorted(never):
        problem.add_goal(up.Not(fluents[atom]))
    problem.add_quality_metric(up.MinimizeActionCosts(costs))
    options = {
        "fast_downward_anytime_search_config": _SEARCH,
        "fast_downward_translate_options": _NO_INVARIANTS,
        "fast_downward_search_time_limit": f"{limit_s}s",
    }
    with warnings.catch_warnings(), TemporaryDirectory() as folder, contextlib.chdir(folder):  # it writes a file
        warnings.simplefilter("ignore")
        with up.AnytimePlanner(name="fast-downward", params=options) as planner:
            *_, result = planner.get_solutions(problem)
    if result.plan is not None:
        if any("Time limit has been reached" in message.message for message in result.log_messages or ()):
            tell(f"the cheapest plan was not found in {limit_s} s: this is the best one so far")
        return [actions[int(step.action.name[1:])] for step in result.plan.actions]
    if result.status in (Status.UNSOLVABLE_PROVEN, Status.UNSOLVABLE_INCOMPLETELY):
        raise NoActions("no order of actions reaches all conditions of the goal together")
    if result.status is Status.TIMEOUT:
        raise NoActions(f"none was found in {limit_s} s; there may be one")
    raise NoActions(f"the search failed: {result.status.name.lower().replace('_', ' ')}")
