"""The planner `symbolic`: from a task's goal and facts to a plan."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from pathlib import Path
from typing import Any

from mpvi_bt.executive.plan.history import History
from mpvi_bt.executive.plan.planners import NoPlan, Planned
from mpvi_bt.executive.plan.schema import Plan
from mpvi_bt.executive.plan.skills import Skill, load_skills
from mpvi_bt.executive.rehearsal.paper_hands import PaperHands
from mpvi_bt.ground.errors import FileProblems, Problem, UserError
from mpvi_bt.ground.marked_yaml import SourceMarks
from mpvi_bt.house.goals.formula import Literal
from mpvi_bt.house.instances.tasks import Task, check_task
from mpvi_bt.runs.symbolic.action_search import NoActions, find_actions, require_installed
from mpvi_bt.runs.symbolic.facts_so_far import facts_so_far
from mpvi_bt.runs.symbolic.goal_choice import IMPOSSIBLE, choose_literals
from mpvi_bt.runs.symbolic.grounded_actions import DRIVE_COST, HANDS
from mpvi_bt.runs.symbolic.grounded_skills import Actions
from mpvi_bt.runs.symbolic.plan_sentences import Sentences
from mpvi_bt.runs.symbolic.reachability import OutOfReach, out_of_reach
from mpvi_bt.runs.symbolic.told_facts import Atom, ToldFacts, told_facts

LIMIT_S = 5  # our choice [s of processor time]
_TERMS = {  # of skills' effects that bring a predicate about, if it is not called so
    "toggled_on": "on", "cooked": "meanwhile", "frozen": "meanwhile", "hot": "meanwhile", "on_fire": "burning",
    "covered": "clean", "real": "cut", "gone": "cut",
}  # fmt: skip


class SymbolicPlanner:
    """Plans a task by its goal: a classical search over what the skills need and bring about.

    It reads what the robot is told, the task's problem and its house, and no state of the simulator.
    """

    name = "symbolic"

    def __init__(
        self,
        task: Task,
        limit_s: int = LIMIT_S,
        tell: Callable[[str], None] = lambda line: None,
        so_far: Callable[[History], PaperHands] | None = None,
    ) -> None:
        """Bind the parts.

        Args:
            task: To plan.
            limit_s: Bounds the search [s of processor time].
            tell: Is told if the cheapest plan would take longer.
            so_far: Says how things are in the middle of an episode; None: then it makes no new plans.

        Raises:
            UserError: The extra is not installed.
        """
        require_installed()
        self._task, self._limit_s, self._tell, self._so_far = task, limit_s, tell, so_far

    def ask(self, task_name: str, instruction: str = "", history: History | None = None) -> Planned:
        """As `Planner.ask`; with a history to the same goal, from what is known then."""
        begun = told = told_facts(self._task)
        full, skills = set[str](), load_skills()
        if history is not None:
            if self._so_far is None:
                raise UserError("this symbolic planner is not told how to know things in the middle of an episode.")
            told = facts_so_far(begun, self._so_far(history), history.seen)
            held = {atom[2] for atom in told.start if atom[0] == "held"}
            full = {*HANDS} if "both" in held else {*held, *(history.full or ())}
        wanted = choose_literals(begun.problem.goal, lambda literal, so: _cost(told, literal, so))
        start = told.start | {("free", hand) for hand in HANDS if hand not in full}
        goal, never = ends(told, wanted, begun.start)
        actions = Actions(told, wanted, goal, skills).all()
        if (lost := out_of_reach(actions, start, goal, never)) is not None:
            raise NoPlan("bad_answer", _why(lost, skills.values()), ())
        try:
            found = find_actions(actions, start, goal, never, self._limit_s, self._tell)
        except NoActions as error:
            raise NoPlan("bad_answer", f"no plan leads to the goal of {task_name}: {error}", ()) from None
        segments = Sentences(told, start, skills).segments([action for action in found if action.skill])
        if not segments:
            raise NoPlan("nothing_left", "the goal is met", ())
        return Planned(Plan(task_name=task_name, instruction=instruction or self._task.instruction, segments=segments))


def lint_task(data: Any, marks: SourceMarks) -> list[Problem]:
    """What there is to say of a task that has no plan on file: that none is found, or could be."""
    task = check_task(data, marks)
    if task.plan is not None:
        return []
    try:
        SymbolicPlanner(task).ask(Path(marks.file).stem)
    except NoPlan as error:
        return [marks.problem(("problem",), "no-plan", f"no plan is on file, and {error}", severity="warning")]
    except FileProblems as error:  # of another file; its own check tells them
        where = f"{error.problems[0].file}:{error.problems[0].line}"
        message = f"no plan is on file, and none can be made until {where} is right"
        return [marks.problem((), "no-plan", message, severity="note")]
    except UserError as error:
        return [marks.problem((), "no-plan", str(error), severity="note")]
    return []


def ends(
    told: ToldFacts, wanted: dict[Literal, bool], begun: Collection[Atom]
) -> tuple[frozenset[Atom], frozenset[Atom]]:
    """What has to be so at the end, and what must not be: the goal, and what courtesy asks.

    Our choice: who opened a fridge closes it, and who turned on a stove turns it off. `begun`: what was so at first.
    """
    goal: set[Atom] = set()
    never: set[Atom] = set()
    for literal, so in wanted.items():
        (goal if so or literal.predicate == "real" else never).add(_atom(told, wanted, literal, so))
    for thing, entry in told.entries.items():
        if told.fixed(thing) and entry.source is not None:
            kept = ("open", thing) if entry.source.at_c < 0 else ("toggled_on", thing)
            if kept not in goal and kept not in begun:
                never.add(kept)
    return frozenset(goal), frozenset(never)


def _atom(told: ToldFacts, wanted: dict[Literal, bool], literal: Literal, so: bool) -> Atom:
    predicate, args = literal.predicate, literal.args
    match predicate:
        case "ontop" | "touching":
            return ("placed", args[0], "ontop", args[1])
        case "contains" | "filled":
            return ("placed", args[1], "inside", args[0])
        case "inside":
            for other, wants in wanted.items():  # what lies on something that is to be inside is inside with it
                rests = other.predicate == "ontop" and other.args[0] == args[0]
                if so and wants and rests and not told.fixed(other.args[1]):
                    return ("placed", other.args[1], "inside", args[1])
            return ("placed", args[0], "inside", args[1])
        case "real":
            return ("real" if so else "gone", *args)
    return (predicate, *args)


def _cost(told: ToldFacts, literal: Literal, so: bool) -> float:
    """What a literal costs, roughly: nothing if it is so, else hands and a drive, more into another room."""
    atom = _atom(told, {}, literal, so)
    if literal.predicate != "real" and (atom in told.start) == so:
        return 0.0
    if literal.predicate == "attached" and not so:
        return IMPOSSIBLE
    rooms = {told.room_of(thing) for thing in literal.args} - {""}
    return DRIVE_COST * max(len(rooms), 1) + 2.0


def _why(lost: OutOfReach, skills: Iterable[Skill]) -> str:
    """Why a condition cannot be met, in words, with the nearest skill."""
    if not lost.so:
        return f"no skill ends {_literal(lost.atom)}"
    if lost.lacks is not None:
        return (
            f"no skill brings {_literal(lost.atom)} about: {lost.skill} needs {_literal(lost.lacks)}, which cannot be"
        )
    predicate = lost.atom[2] if lost.atom[0] == "placed" else lost.atom[0]
    term = _TERMS.get(predicate, predicate)
    nearest = next((skill.name for skill in skills if getattr(skill.effects, term, None)), None)
    return f"no skill brings {_literal(lost.atom)} about" + (f"; the nearest skill is {nearest}" if nearest else "")


def _literal(atom: Atom) -> str:
    if atom[0] == "placed":
        return f"{atom[2]}({atom[1]}, {atom[3]})"
    return f"{atom[0]}({', '.join(atom[1:])})"
