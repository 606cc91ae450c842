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

# Our choice: first for few drives; where that takes too long, for any plan. No spaces: words are told apart by them.
_SEARCHES = (
    "let(h,eval_modify_costs(ff(),cost_type=plusone),lazy_wastar([h],preferred=[h],w=1))",
    "let(h,eval_modify_costs(ff(),cost_type=one),lazy_greedy([h],preferred=[h],cost_type=one))",
)
_NO_INVARIANTS = ["--invariant-generation-max-time", "0"]  # they take seconds, and the search does without


NEEDED = ("unified_planning", "up_fast_downward")


def require_installed() -> None:
    """Raise UserError if the libraries are not installed."""
    if any(importlib.util.find_spec(name) is None for name in NEEDED):
        raise UserError(f"the symbolic planner, which plans tasks without a plan on file, needs {install('symbolic')}")


def find_actions(
    actions: Sequence[GroundedAction],
    start: Collection[Atom],
    goal: Collection[Atom],
    never: Collection[Atom],
    limit_s: float,
    tell: Callable[[str], None] = lambda line: None,
) -> list[GroundedAction] | None:
    """Actions that lead from the start to the goal; None: there are none, or the time was too short.

    Args:
        actions: To choose from.
        start: What is so.
        goal: What has to be so at the end.
        never: What must not be so at the end.
        limit_s: Wall time of each of two searches: for few drives, and if that finds none in time for any.
        tell: Is told that the second one was needed.

    Raises:
        UserError: The extra is not installed.
    """
    require_installed()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import unified_planning.shortcuts as up
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
    for search in _SEARCHES:
        options = {"fast_downward_search_config": search, "fast_downward_translate_options": _NO_INVARIANTS}
        with warnings.catch_warnings(), TemporaryDirectory() as folder, contextlib.chdir(folder):  # it writes a file
            warnings.simplefilter("ignore")
            with up.OneshotPlanner(name="fast-downward", params=options) as planner:
                result = planner.solve(problem, timeout=limit_s)
        if result.plan is not None:
            return [actions[int(step.action.name[1:])] for step in result.plan.actions]
        if result.status.name.startswith("UNSOLVABLE"):
            return None
        tell(f"no cheapest plan in {limit_s:g} s: any plan is sought")
    return None
