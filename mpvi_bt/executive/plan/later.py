"""A new plan without a model: the remaining segments, then the failed ones once more."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import takewhile

from mpvi_bt.executive.plan.history import History
from mpvi_bt.executive.plan.payloads import Hands
from mpvi_bt.executive.plan.planners import NoPlan, Planned
from mpvi_bt.executive.plan.primitives import primitives, units
from mpvi_bt.executive.plan.schema import Navigation, Plan
from mpvi_bt.executive.plan.skill_effects import SkillEffects
from mpvi_bt.executive.plan.skills import Skill
from mpvi_bt.ground.robot.protocol import SIDES


class LaterPlanner:
    """Tries failed units once more after all others (implements `Planner`).

    Our choice (the paper's plan advances, and failures are final): an obstacle may have gone by then, and the robot
    comes from elsewhere. A unit brings its requirements along: the drive to it; the pick of the object that it puts
    down, and the placing of the one that it picks up; the pick of a bin that it fills; and the opening and closing of
    what was open meanwhile. The order is kept. A second failure is final.

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
        self._held = list(self._holds(hands))

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
        wanted = {self._work(unit) for unit in failed}
        wanted |= {end for held in self._held for end in held if any(held[0] < unit < held[1] for unit in wanted)}
        opened, before = list(self._open()), set[int]()
        while wanted != before:
            before = set(wanted)
            wanted |= {end for held in self._held for end in held if not wanted.isdisjoint(held)}
            wanted |= {end for span in opened for end in span if any(span[0] <= unit <= span[1] for unit in wanted)}
        work = {unit for unit in wanted if unit < len(self._units)}
        return sorted(work | {way for unit in work for way in self._ways(unit)})

    def _drives(self, unit: int) -> bool:
        return isinstance(self._plan.segments[self._units[unit][0]], Navigation)

    def _work(self, unit: int) -> int:
        """The unit that a drive leads to; itself, if it is none or leads to none."""
        later = range(unit, len(self._units))
        return next((other for other in later if not self._drives(other)), unit)

    def _ways(self, unit: int) -> Iterable[int]:
        """The drives right before a unit."""
        return takewhile(self._drives, range(unit - 1, -1, -1))

    def _holds(self, sides: tuple[str, ...]) -> Iterable[tuple[int, int]]:
        """The units between taking and releasing a payload; one never released is held beyond the plan's end."""
        hands, taken = Hands(sides), dict[int, int]()
        for number, unit in enumerate(self._units):
            for i in () if self._drives(number) else unit:
                before = hands.held
                hands.take(self._calls[i], i)
                yield from ((taken[gone], number) for gone in before - hands.held)
                taken[i] = number
        yield from ((taken[kept], len(self._units) + taken[kept]) for kept in hands.held)

    def _open(self) -> Iterable[tuple[int, int]]:
        """The units between opening and closing a thing, for things that the plan closes."""
        opened: dict[str, int] = {}
        for number, unit in enumerate(self._units):
            for call in (self._calls.get(i) for i in unit):
                effects, words = (call.skill.effects, call.arguments) if call else (SkillEffects(), {})
                if effects.open is not None:
                    opened.setdefault(words.get(effects.open, ""), number)
                elif effects.closed is not None and (thing := words.get(effects.closed, "")) in opened:
                    yield opened.pop(thing), number
