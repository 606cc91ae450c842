"""A plan carried out on paper: facts of a BDDL problem, changed by each segment, refused where it could not be done.

Skills do what they are for, on the things that their words mean; a segment that names no skill brings about its
criterion, where that is a relation that is kept here. Things are where :init says; what can be opened is closed unless
:init says otherwise. Of several things that a phrase may mean, `backward` says from which end of the problem's list
one is taken: a plan must not depend on it.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping

from mpvi_bt.completion import criteria
from mpvi_bt.goals.formula import Literal
from mpvi_bt.goals.problem import AGENT, Problem
from mpvi_bt.perception.phrases import Vocabulary, normalize, read
from mpvi_bt.plan.schema import Navigation, Plan
from mpvi_bt.plan.skills import SkillCall

FLOORS = {"floor.n.01", "lawn.n.01", "driveway.n.01"}
ON_ONLY_CLOSED = {"washer.n.03", "microwave.n.02"}
_CUT = re.compile(
    r"(?:dice|cut|split) (?:an?|the(?: other| last)?|both) (?P<what>.+?) on the (?P<board>.+?)(?: in halves)? "
    r"with the (?P<tool>.+)"
)
_MADE = re.compile(r"the (?P<what>.+) on the (?P<where>.+) is baked")
_SIDES = ("left", "right")


class CannotBe(Exception):
    """What a segment asks for is not possible as things are."""


class SymbolicRun:
    """The state of things while a plan is carried out.

    Attributes:
        place: What the robot has driven to: a thing, or a room.
        spot: The same, and where things lay that it took there.
        held: What each hand holds; a thing in both is held with both.
        at: Thing to ("inside" | "ontop", the other thing), or ("room", a room) where the problem has no floor for it.
        pairs: ("nextto" | "under", thing, other thing).
        open, on: Things that are open, switched on.
        covered: (thing, substance).
        gone: What was cut up; what is of the future and not yet made.
    """

    def __init__(
        self,
        problem: Problem,
        called: Mapping[str, tuple[str, ...]],
        openable: Iterable[str],
        call_of: Callable[[str], SkillCall | None],
        backward: bool = False,
        uncounted: bool = False,
    ) -> None:
        """Begin as :init says.

        Args:
            problem: The problem; of fixtures that a wildcard stands for only those that it names.
            called: Every thing of it to what people call it.
            openable: Synsets of what can be opened.
            call_of: Description of a segment to the skill that it names.
            backward: Of things that are alike, take the last first.
            uncounted: Criteria may be so before their segments.
        """
        self.problem, self.called, self.call_of = problem, called, call_of
        self.backward, self.uncounted = backward, uncounted
        self.vocabulary = Vocabulary(called)
        self.openable = {thing for thing, synset in problem.objects.items() if synset in set(openable)}
        self.room = problem.agent_room or ""
        self.place = self.room
        self.spot = {self.place}
        self.held: dict[str, str | None] = dict.fromkeys(_SIDES)
        self.at: dict[str, tuple[str, str]] = {}
        self.pairs: set[tuple[str, str, str]] = set()
        self.open: set[str] = set()
        self.on: set[str] = set()
        self.covered: set[tuple[str, str]] = set()
        self.gone = set(problem.future)
        self.beside: dict[str, str] = {}  # what was laid on a floor, to where the robot stood
        self.moved: Counter[str] = Counter()
        self.used: list[str] = []
        self.sources: dict[str, str] = {}
        self.criterion = ""  # what is to be so next
        for fact in problem.init:
            if fact.positive and fact.literal.args[0] in problem.objects:
                self._begin(fact.literal.predicate, fact.literal.args)

    def _begin(self, predicate: str, args: tuple[str, ...]) -> None:
        if self.problem.objects[args[0]] == AGENT:
            return
        match predicate:
            case "inside" | "ontop":
                self.at[args[0]] = (predicate, args[1])
            case "filled" | "contains":
                self.at[args[1]] = ("inside", args[0])
            case "nextto" | "under":
                self.pairs.add((predicate, args[0], args[1]))
            case "open":
                self.open.add(args[0])
            case "toggled_on":
                self.on.add(args[0])
            case "covered":
                self.covered.add((args[0], args[1]))
            case "insource":
                self.sources[args[0]] = args[1]

    # What is so

    def truth(self, literal: Literal) -> bool:
        """Whether a literal of the goal holds, of the predicates in `KEPT`."""
        return KEPT[literal.predicate](self, *literal.args)

    def inside(self, thing: str, other: str) -> bool:
        """In it, or on or in something that is."""
        relation, support = self.at.get(thing, ("", ""))
        if relation not in ("inside", "ontop"):
            return False
        return (relation == "inside" and support == other) or self.inside(support, other)

    def ontop(self, thing: str, other: str) -> bool:
        """Directly on it."""
        return self.at.get(thing) == ("ontop", other)

    def touching(self, thing: str, other: str) -> bool:
        """Directly on or in it."""
        return self.at.get(thing, ("", ""))[1] == other

    def so(self, criterion: criteria.Criterion) -> bool | None:
        """Whether a criterion holds, by the rules of the oracle; None where it names nothing of the problem."""
        things = {thing: phrases for thing, phrases in self.called.items() if thing not in self.gone}
        subjects = criteria.named(criterion.subject, things)
        others = criteria.named(criterion.object, things) if criterion.object else []
        if not criteria.named(criterion.subject, self.called) or (criterion.object and not others):
            return None
        count = sum(any(self._holds(criterion, s, o) for o in others or [""] if s != o) for s in subjects)
        return count >= criterion.count

    def _holds(self, criterion: criteria.Criterion, subject: str, other: str) -> bool:
        match criterion.relation:
            case "held":
                return subject in ([self.held[criterion.side]] if criterion.side else self.held.values())
            case "lifted":
                return all(thing == subject for thing in self.held.values())
            case "open" | "closed":
                return subject in self.openable and (subject in self.open) == (criterion.relation == "open")
            case "on" | "off":
                return (subject in self.on) == (criterion.relation == "on")
            case "clean" | "sprayed":
                return any(thing == subject for thing, _ in self.covered) == (criterion.relation == "sprayed")
            case relation:
                return KEPT[relation](self, subject, other)

    # Which thing is meant

    def meant(self, phrase: str, than: str | None = None) -> list[str]:
        """What a phrase may mean, in the order of the problem; "another" is one other `than` this, or the last used."""
        reading = read(phrase)
        found = [t for t in self.vocabulary.named(phrase) if t not in self.gone]
        words = phrase.lower().split()
        if "empty" in words:
            found = [t for t in found if not self.on_or_in(t)]
        if "open" in words:
            found = [t for t in found if t in self.open]
        if {"other", "another"} & set(words[:2]):
            last = than if than in found else next((t for t in reversed(self.used) if t in found), None)
            found = [t for t in found if t != last]
        if reading is not None and (inner := re.fullmatch(r"with (.+)", reading.place)):
            wanted = self.vocabulary.named(inner[1])
            found = [t for t in found if any(w in self.on_or_in(t) for w in wanted)]
        elif reading is not None and reading.place and not re.match(r"(?:beside|next to) ", reading.place):
            raise CannotBe(f"{phrase!r} says where the thing is: not understood here")
        if self.backward:
            found.reverse()
        return found

    def one(
        self, phrase: str, among: Callable[[str], bool], what: str, old: bool = True, than: str | None = None
    ) -> str:
        """The thing that a phrase means among some; of several one that was used before, or if not `old` one untouched.

        Raises CannotBe, which says `what` it should be.
        """
        found = [thing for thing in self.meant(phrase, than) if among(thing)]
        if not found:
            raise CannotBe(f"no {phrase!r} is {what}; the robot is at {self.place}, holds {self.held}")
        if not old:
            return min(found, key=lambda t: (self.moved[t], t != self.place))
        return next((t for t in reversed(self.used) if t in found), self.place if self.place in found else found[0])

    def on_or_in(self, thing: str) -> set[str]:
        """What is directly on it or in it."""
        return {t for t, (_, support) in self.at.items() if support == thing and t not in self.gone}

    def room_of(self, thing: str) -> str:
        """The room that a thing is in."""
        if thing in self.problem.rooms:
            return self.problem.rooms[thing]
        if thing in self.held.values():
            return self.room
        relation, support = self.at.get(thing, ("", ""))
        if relation:
            return support if relation == "room" else self.room_of(support)
        others = [o for _, t, o in self.pairs if t == thing] + [t for t, s in self.covered if s == thing]
        return self.room_of(others[0])

    def near(self) -> set[str]:
        """What is in reach: what was driven to, what it lies with, what is beside it, what is held, and the floor."""
        reached = self.spot | {t for t in self.held.values() if t}
        while True:
            more = {t for t, s in self.beside.items() if s in reached}
            more |= {t for t, (_, support) in self.at.items() if support in reached}
            more |= {self.at[t][1] for t in reached if t in self.at}
            more |= {o for _, t, o in self.pairs if t in reached} | {t for _, t, o in self.pairs if o in reached}
            more = {t for t in more if self.problem.objects.get(t, "floor.n.01") not in FLOORS} - reached - self.gone
            if not more:
                floors = {t for t, s in self.problem.objects.items() if s in FLOORS and self.room_of(t) == self.room}
                return reached | floors
            reached |= more

    def shut_in(self, thing: str) -> bool:
        """Whether it is behind a door or under a lid that is closed."""
        relation, support = self.at.get(thing, ("", ""))
        if relation not in ("inside", "ontop"):
            return False
        closed = relation == "inside" and support in self.openable and support not in self.open
        return closed or self.shut_in(support)

    # What is done

    def run(self, plan: Plan) -> None:
        """Carry a plan out. Raises CannotBe with the number of the segment."""
        for number, segment in enumerate(plan.segments, 1):
            try:
                criterion = criteria.parse(segment.completion_criterion)
                before = criterion and self.so(criterion)
                self.criterion = segment.completion_criterion
                if isinstance(segment, Navigation):
                    self._drive(segment)
                    continue
                call = self.call_of(segment.description)
                if call is None:
                    self._bring_about(segment.description, criterion)
                else:
                    getattr(self, f"_{call.skill.name}")(**call.arguments)
                after = criterion and self.so(criterion)
                if (before and not self.uncounted) or after is False:
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
        if not there:
            raise CannotBe(f"no {phrase!r} in the {room}")
        movable = [t for t in there if t not in fixed]
        if movable:
            self.place = min(movable, key=lambda t: self.moved[t])
        else:
            self.place = next((t for t in reversed(self.used) if t in there), there[0])
        self.room = self.room_of(self.place)
        self.spot = {self.place}

    def _free(self, hand: str | None) -> str:
        free = [side for side in _SIDES if self.held[side] is None and hand in (None, side)]
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
        for side in _SIDES:
            self._free(side)
        thing = self._take(object, source)
        self._leave(thing)
        self.held = dict.fromkeys(_SIDES, thing)
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
        if criterion is None or criterion.relation not in ("inside", "ontop", "nextto"):
            return
        others = criteria.named(criterion.object, self.called)
        for thing in criteria.named(criterion.subject, self.called)[: criterion.count]:
            self.gone.discard(thing)
            if criterion.relation != "nextto":
                self.at[thing] = (criterion.relation, others[0])


KEPT: Mapping[str, Callable[..., bool]] = {
    "inside": SymbolicRun.inside,
    "ontop": SymbolicRun.ontop,
    "touching": SymbolicRun.touching,
    "nextto": lambda run, a, b: bool({("nextto", a, b), ("nextto", b, a)} & run.pairs),
    "under": lambda run, a, b: ("under", a, b) in run.pairs,
    "open": lambda run, a: a in run.open,
    "toggled_on": lambda run, a: a in run.on,
    "covered": lambda run, a, b: (a, b) in run.covered,
    "contains": lambda run, a, b: b not in run.gone and run.inside(b, a),
    "real": lambda run, a: a not in run.gone,
}
