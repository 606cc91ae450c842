"""A plan carried out on paper: facts of a BDDL problem, changed by each segment, refused where it could not be done.

Skills do what they are for, on the things that their words mean; a segment that names no skill brings about its
criterion, where that is a relation that `symbolic_state` keeps.
"""

from __future__ import annotations

import re
from collections.abc import Callable

from mpvi_bt.executive.completion import criteria
from mpvi_bt.executive.plan.schema import Navigation, Plan
from mpvi_bt.executive.plan.skills import SkillCall
from mpvi_bt.ground.words.phrases import normalize, read
from tests.symbolic_state import FLOORS, SIDES, CannotBe, SymbolicState

ON_ONLY_CLOSED = {"washer.n.03", "microwave.n.02"}
HEATS, COOLS = {"stove.n.01", "oven.n.01", "microwave.n.02"}, {"electric_refrigerator.n.01"}
_CUT = re.compile(
    r"(?:dice|cut|split) (?:an?|the(?: other| last)?|both) (?P<what>.+?) on the (?P<board>.+?)(?: in halves)? "
    r"with the (?P<tool>.+)"
)
_MADE = re.compile(r"the (?P<what>.+) on the (?P<where>.+) is baked")


class SymbolicRun(SymbolicState):
    """A state that plans change.

    Attributes:
        criterion: What is to be so next.
        said: What is to be done.
    """

    criterion = said = ""

    def run(self, plan: Plan, call_of: Callable[[str], SkillCall | None], uncounted: bool = False) -> None:
        """Carry a plan out.

        Args:
            plan: The plan.
            call_of: Description of a segment to the skill that it names.
            uncounted: Criteria may be so before their segments.

        Raises:
            CannotBe: With the number of the segment.
        """
        for number, segment in enumerate(plan.segments, 1):
            try:
                criterion = criteria.parse(segment.completion_criterion)
                before = criterion and self.so(criterion)
                self.criterion, self.said = segment.completion_criterion, segment.description
                if isinstance(segment, Navigation):
                    self._drive(segment)
                    continue
                call = call_of(segment.description)
                if call is None:
                    self._bring_about(segment.description, criterion)
                else:
                    getattr(self, f"_{call.skill.name}")(**call.arguments)
                after = criterion and self.so(criterion)
                if (before and not uncounted) or after is False:
                    raise CannotBe(f"{segment.completion_criterion!r} was {before} before and is {after} after")
            except CannotBe as error:
                raise CannotBe(f"segment {number}, {segment.description!r}: {error}") from None

    def _drive(self, segment: Navigation) -> None:
        phrase = segment.description.removeprefix("go to ")
        room = normalize(segment.room or "")
        if room == normalize(segment.target):
            self.room = next(r for r in self.problem.rooms.values() if normalize(r) == room)
            self.place = self.room
            self.spot = {self.place}
            return
        fixed = self.problem.rooms
        there = [t for t in self.meant(phrase) if normalize(self.room_of(t)) == room and t not in self.held.values()]
        if all(map(self.shut_in, there)):
            raise CannotBe(f"no {phrase!r} is to be seen in the {room}")
        movable = [t for t in there if t not in fixed]
        if movable:
            self.place = min(movable, key=lambda t: self.moved[t])
        else:
            self.place = next((t for t in reversed(self.used) if t in there), there[0])
        self.room = self.room_of(self.place)
        self.spot = {self.place}

    def _free(self, hand: str | None) -> str:
        free = [side for side in SIDES if self.held[side] is None and hand in (None, side)]
        if not free:
            raise CannotBe(f"no hand is free; held: {self.held}")
        return free[-1]

    def _take(self, object: str, source: str | None) -> str:
        sources = self.vocabulary.named(source) if source else []

        def there(thing: str) -> bool:
            loose = thing in near and thing not in self.held.values() and thing not in self.problem.rooms
            return loose and not self.shut_in(thing) and (not source or any(self._of(thing, s) for s in sources))

        near = self.near()
        return self.one(object, there, "in reach and free to take", old=False)

    def _of(self, thing: str, source: str) -> bool:
        support = self.at.get(thing, ("", ""))[1]
        return bool(support) and (support == source or self._of(support, source))

    def _leave(self, thing: str) -> None:
        """It is not where it was; what is on it goes with it, and the robot stays where it is."""
        _, support = self.at.pop(thing, ("", ""))
        self.spot |= {support} if self.problem.objects.get(support, "floor.n.01") not in FLOORS else set()
        self.spot |= {place} if (place := self.beside.pop(thing, None)) is not None else set()
        self.pairs = {p for p in self.pairs if thing not in p}

    def _pick(self, object: str, source: str | None = None, hand: str | None = None) -> None:
        side, thing = self._free(hand), self._take(object, source)
        self._leave(thing)
        self.held[side] = thing
        self.used.append(thing)

    def _lift(self, object: str, source: str | None = None) -> None:
        for side in SIDES:
            self._free(side)
        thing = self._take(object, source)
        self._leave(thing)
        self.held = dict.fromkeys(SIDES, thing)
        self.used.append(thing)

    def _put(self, object: str, hand: str | None, relation: str, where: str | None) -> str:
        """Let go of what is held, in or on a thing."""
        named = self.vocabulary.named(object)
        mine = [t for side, t in self.held.items() if t in named and hand in (None, side)]
        if not mine or mine[0] is None:
            raise CannotBe(f"no {object!r} is held{f' in the {hand} hand' if hand else ''}: {self.held}")
        thing = mine[0]
        near = self.near()
        if where is None:
            floors = [t for t in near if self.problem.objects.get(t) in FLOORS]
            relation, support = ("ontop", floors[0]) if floors else ("room", self.room)
        else:
            support = self.one(where, lambda t: t in near and t != thing, "in reach", than=thing)
            if relation == "inside" and support in self.openable and support not in self.open:
                raise CannotBe(f"{support} is closed")
            if self.shut_in(support):
                raise CannotBe(f"{support} is shut in")
        self._leave(thing)
        self.held = {side: None if t == thing else t for side, t in self.held.items()}
        self.at[thing] = (relation, support)
        if self.problem.objects.get(support) in FLOORS or relation == "room":
            self.beside[thing] = self.place
        self.moved[thing] += 1
        self.used += [thing, support]
        return thing

    def _place_in(self, object: str, container: str, hand: str | None = None) -> None:
        self._put(object, hand, "inside", container)

    def _place_on(self, object: str, surface: str, hand: str | None = None) -> None:
        self._put(object, hand, "ontop", surface)

    def _beside(self, thing: str, target: str) -> None:
        near = self.near()
        other = self.one(target, lambda t: t in near and t != thing, "in reach", than=thing)
        self.pairs.add(("nextto", thing, other))

    def _place_next_to(self, object: str, target: str, surface: str | None = None, hand: str | None = None) -> None:
        near = self.near()
        others = [t for t in self.meant(target) if t in near and t not in self.held.values()]
        relation, support = self.at.get(others[0], ("room", "")) if others else ("room", "")
        if surface is None and relation in ("inside", "ontop"):
            surface = self.called[support][0]
        self._beside(self._put(object, hand, "ontop", surface), target)

    def _place_under(self, object: str, target: str, surface: str | None = None, hand: str | None = None) -> None:
        near = self.near()
        other = self.one(target, lambda t: t in near, "in reach")
        thing = self._put(object, hand, "ontop", surface)
        self.pairs.add(("under", thing, other))
        reading = read(target)
        if reading is not None and (beside := re.fullmatch(r"(?:beside|next to) (.+)", reading.place)):
            self._beside(thing, beside[1])

    def _door(self, object: str, hand: str | None) -> str:
        self._free(hand)
        near = self.near()
        thing = self.one(object, lambda t: t in near and t in self.openable and not self.shut_in(t), "a thing to open")
        self.used.append(thing)
        return thing

    def _open(self, object: str, hand: str | None = None) -> None:
        thing = self._door(object, hand)
        self.open.add(thing)
        self.on.discard(thing)

    def _close(self, object: str, hand: str | None = None) -> None:
        self.open.discard(self._door(object, hand))

    def _press(self, object: str, state: str = "on", hand: str | None = None) -> None:
        self._free(hand)
        near = self.near()
        thing = self.one(object, lambda t: t in near, "in reach")
        if state == "on" and self.problem.objects[thing] in ON_ONLY_CLOSED and thing in self.open:
            raise CannotBe(f"{thing} is open")
        (self.on.add if state == "on" else self.on.discard)(thing)
        if state == "on" and self.problem.objects[thing] == "washer.n.03":
            self.covered = {(t, s) for t, s in self.covered if not self.inside(t, thing)}

    def _push(self, object: str, target: str | None = None, hand: str | None = None) -> None:
        self._free(hand)
        near = self.near()
        thing = self.one(object, lambda t: t in near, "in reach")
        if target is not None:
            (other,) = self.meant(target)
            self.pairs.add(("nextto", thing, other))

    def _pour(
        self, container: str, object: str | None = None, source: str | None = None, hand: str | None = None
    ) -> None:
        held = self._tool(source or "")
        near = self.near()
        into = self.one(container, lambda t: t in near and t != held, "in reach")
        out = self.on_or_in(held)
        if object is not None:
            out &= set(self.vocabulary.named(object))
        onto = " on the " in self.criterion
        for thing in out:
            self.at[thing] = ("ontop" if onto else "inside", into)

    def _tool(self, tool: str) -> str:
        return self.one(tool, lambda t: t in self.held.values(), "held")

    def _wipe(self, target: str, tool: str, object: str | None = None, hand: str | None = None) -> None:
        self._tool(tool)
        near = self.near()
        thing = self.one(target, lambda t: t in near, "in reach")
        self.covered = {(t, s) for t, s in self.covered if t != thing}

    def _spray(self, target: str, tool: str, hand: str | None = None) -> None:
        near = self.near()
        thing = self.one(target, lambda t: t in near, "in reach")
        self.covered.add((thing, self.sources[self._tool(tool)]))
        self.used.append(thing)

    def _mount(self, object: str, target: str, hand: str | None = None) -> None:
        thing = self._put(object, hand, "ontop", target)
        self.attached.add((thing, self.at[thing][1]))

    def _light(self, target: str, tool: str, hand: str | None = None) -> None:
        if (lighter := self._tool(tool)) not in self.on:
            raise CannotBe(f"{lighter} is off")
        near = self.near()
        self.burning.add(self.one(target, lambda t: t in near, "in reach"))

    def _cut(self, **_: str) -> None:
        self._bring_about(self.said, criteria.parse(self.criterion))

    _dice = _cut

    def _wait(self, object: str = "", target: str = "", container: str = "") -> None:
        """What is on a stove or in an oven that is on is cooked then, what is in a closed fridge is frozen.

        What lies on what burns burns, too. What is made in the meantime is made in heat.
        """
        self.burning |= {thing for thing, (_, below) in self.at.items() if below in self.burning}
        for thing in self.at:
            self.cooked |= {thing} if self._in_heat(thing) else set()
            below = self.at[thing][1]
            while below:
                if self.problem.objects.get(below) in COOLS and below not in self.open:
                    self.frozen.add(thing)
                below = self.at.get(below, ("", ""))[1]
        asked = criteria.parse(self.criterion)
        if asked is not None and self.gone & set(criteria.named(asked.subject, self.called)):
            where = criteria.named(asked.object, self.called) if asked.object else []
            if where and not any(map(self._in_heat, where)):
                raise CannotBe(f"no {asked.object!r} is heated")
            self._bring_about(self.said, asked)

    def _in_heat(self, thing: str) -> bool:
        """Whether it is, or is on or in, what heats: on, and not open."""
        while thing:
            if self.problem.objects.get(thing) in HEATS and thing in self.on and thing not in self.open:
                return True
            thing = self.at.get(thing, ("", ""))[1]
        return False

    def _bring_about(self, description: str, criterion: criteria.Criterion | None) -> None:
        """What no skill does: cutting takes a tool and ends what is cut; then the criterion is so."""
        if cut := _CUT.fullmatch(description):
            self._tool(cut["tool"])
            boards = self.vocabulary.named(cut["board"])
            near = self.near()
            there = [t for t in self.meant(cut["what"]) if self.at.get(t, ("", ""))[1] in boards and t in near]
            if not there:
                raise CannotBe(f"no {cut['what']!r} lies on the {cut['board']}")
            self.gone |= set(there if " both " in description else there[:1])
        if made := _MADE.fullmatch(self.criterion):
            for thing in self.gone & set(self.vocabulary.named(made["what"])):
                self.gone.discard(thing)
                self.at[thing] = ("ontop", self.vocabulary.named(made["where"])[0])
        if criterion is None or criterion.relation not in ("inside", "ontop", "nextto", "there"):
            return
        others = criteria.named(criterion.object, self.called)
        for thing in criteria.named(criterion.subject, self.called)[: criterion.count]:
            self.gone.discard(thing)
            if criterion.relation not in ("nextto", "there"):
                self.at[thing] = (criterion.relation, others[0])
