"""A new plan without a model: what is to come, and then once more what failed."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from mpvi_bt.plan.hands import Hands
from mpvi_bt.plan.history import History
from mpvi_bt.plan.planners import NoPlan, Planned
from mpvi_bt.plan.primitives import primitives, units
from mpvi_bt.plan.schema import Manipulation, Plan
from mpvi_bt.plan.skills import Skill, SkillCall
from mpvi_bt.robot.protocol import SIDES

_OPENS, _CLOSES = "open", "close"  # skills


class LaterPlanner:
    """Puts off what failed: a plan's units that failed are done once more after all the others (implements `Planner`).

    Our choice (the paper's plan advances, and what failed is given up): what barred the way is often gone by then, and
    whoever comes anew stands elsewhere. What a unit needs comes with it: the units around it from where both hands were
    empty to where they are empty again, such as taking a can that was dropped on its way to the bin, and those that
    open and close what was open meanwhile. They keep their order. What fails once more is given up for good.

    Args:
        plan: That the episode began with.
        skills: By name.
        hands: Of the robot.
    """

    name = "recorded"
    most = 200  # as many as a plan may have units

    def __init__(self, plan: Plan, skills: Mapping[str, Skill], hands: tuple[str, ...] = SIDES) -> None:
        self._plan = plan
        self._units = list(units(plan))
        self._calls = {i: primitive.call for i, primitive in primitives(plan, skills).items()}
        self._chores = self._split(hands)

    def ask(self, task_name: str, instruction: str, history: History | None = None) -> Planned:
        """The plan; from where the robot is, if it is under way.

        Raises:
            NoPlan: What failed has been tried again.
        """
        if history is None:
            return Planned(self._plan)
        begun = len(history.units)
        if begun > len(self._units):
            raise NoPlan("tried_again", "it has been tried again", ())
        failed = [i for i, unit in enumerate(history.units) if unit.reason]
        order = [*range(begun, len(self._units)), *self.again(failed)]
        segments = tuple(self._plan.segments[i] for unit in order for i in self._units[unit])
        return Planned(self._plan.model_copy(update={"segments": segments}))

    def again(self, failed: Iterable[int]) -> list[int]:
        """The units to be done for these to succeed, all in the order of the plan; numbers count from 0."""
        wanted = {unit for chore in self._chores if not set(failed).isdisjoint(chore) for unit in chore}
        around: set[int] = set()
        for opens, closes in self._open():
            if any(opens <= unit <= closes for unit in wanted):
                around |= {unit for chore in self._chores if opens in chore or closes in chore for unit in chore}
        return sorted(wanted | around)

    def _split(self, sides: tuple[str, ...]) -> list[range]:
        """The units from one drive with empty hands to the next."""
        hands, starts = Hands(sides), [0]
        for number, unit in enumerate(self._units):
            handled = isinstance(self._plan.segments[unit[0]], Manipulation)
            for i in unit if handled else ():
                hands.take(self._calls[i], i)
            if handled and hands.empty:
                starts.append(number + 1)
        ends = [*starts[1:], len(self._units)]
        return [range(start, end) for start, end in zip(starts, ends, strict=True) if start < end]

    def _open(self) -> Iterable[tuple[int, int]]:
        """The units between which something is open that the plan opens and closes."""
        opened: dict[str, int] = {}
        for number, unit in enumerate(self._units):
            for call in _known(self._calls.get(i) for i in unit):
                thing = call.arguments.get("object", "")
                if call.skill.name == _OPENS:
                    opened.setdefault(thing, number)
                elif call.skill.name == _CLOSES and thing in opened:
                    yield opened.pop(thing), number


def _known(calls: Iterable[SkillCall | None]) -> Sequence[SkillCall]:
    return [call for call in calls if call is not None]
