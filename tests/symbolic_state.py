"""What is where while a plan is carried out on paper, and which thing a phrase means then: facts of a BDDL problem.

Things are where :init says; what can be opened is closed unless :init says otherwise. Of several things that a phrase
may mean, `backward` says from which end of the problem's list one is taken: a plan must not depend on it.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping

from mpvi_bt.executive.completion import criteria
from mpvi_bt.ground.words.phrases import Vocabulary, read
from mpvi_bt.house.goals.formula import Literal
from mpvi_bt.house.goals.problem import AGENT, BddlProblem

FLOORS = {"floor.n.01", "lawn.n.01", "driveway.n.01"}
SIDES = ("left", "right")


class CannotBe(Exception):
    """What a segment asks for is not possible as things are."""


class SymbolicState:
    """The state of things.

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
        problem: BddlProblem,
        called: Mapping[str, tuple[str, ...]],
        openable: Iterable[str],
        backward: bool = False,
    ) -> None:
        """Begin as :init says.

        Args:
            problem: The problem; of fixtures that a wildcard stands for only those that it names.
            called: Every thing of it to what people call it.
            openable: Synsets of what can be opened.
            backward: Of things that are alike, take the last first.
        """
        self.problem, self.called, self.backward = problem, called, backward
        self.vocabulary = Vocabulary(called)
        self.openable = {thing for thing, synset in problem.objects.items() if synset in set(openable)}
        self.room = problem.agent_room or ""
        self.place = self.room
        self.spot = {self.place}
        self.held: dict[str, str | None] = dict.fromkeys(SIDES)
        self.at: dict[str, tuple[str, str]] = {}
        self.pairs: set[tuple[str, str, str]] = set()
        self.open: set[str] = set()
        self.on: set[str] = set()
        self.covered: set[tuple[str, str]] = set()
        self.cooked: set[str] = set()
        self.frozen: set[str] = set()
        self.burning: set[str] = set()
        self.attached: set[tuple[str, str]] = set()
        self.gone = set(problem.future)
        self.beside: dict[str, str] = {}  # what was laid on a floor, to where the robot stood
        self.moved: Counter[str] = Counter()
        self.used: list[str] = []
        self.sources: dict[str, str] = {}
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
        """Whether a criterion holds, by the rules of the oracle; None where it names nothing that is kept here."""
        if criterion.relation == "at":
            return None
        things = {thing: phrases for thing, phrases in self.called.items() if thing not in self.gone}
        subjects = criteria.named(criterion.subject, things)
        others = criteria.named(criterion.object, things) if criterion.object else []
        if not criteria.named(criterion.subject, self.called) or (criterion.object and not others):
            return None
        if criterion.relation == "cut":
            return not subjects
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
            case "cooked" | "frozen" | "hot":
                return subject in (self.frozen if criterion.relation == "frozen" else self.cooked)
            case "burning":
                return subject in self.burning
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
        if reading is not None and (state := dict(reading.qualities).get("state")) is not None:
            found = [t for t in found if (t in self.open) == (state == "open")]
        if {"other", "another"} & set(words[:2]):
            last = than if than in found else next((t for t in reversed(self.used) if t in found), None)
            found = [t for t in found if t != last]
        if reading is not None and (inner := re.fullmatch(r"(with|without) (.+)", reading.place)):
            wanted = self.vocabulary.named(inner[2])
            found = [t for t in found if any(w in self.on_or_in(t) for w in wanted) == (inner[1] == "with")]
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


KEPT: Mapping[str, Callable[..., bool]] = {
    "inside": SymbolicState.inside,
    "ontop": SymbolicState.ontop,
    "touching": SymbolicState.touching,
    "nextto": lambda run, a, b: bool({("nextto", a, b), ("nextto", b, a)} & run.pairs),
    "under": lambda run, a, b: ("under", a, b) in run.pairs,
    "open": lambda run, a: a in run.open,
    "toggled_on": lambda run, a: a in run.on,
    "cooked": lambda run, a: a in run.cooked,
    "frozen": lambda run, a: a in run.frozen,
    "on_fire": lambda run, a: a in run.burning,
    "attached": lambda run, a, b: (a, b) in run.attached,
    "covered": lambda run, a, b: (a, b) in run.covered,
    "contains": lambda run, a, b: b not in run.gone and run.inside(b, a),
    "real": lambda run, a: a not in run.gone,
    "there": lambda run, a, _: a not in run.gone,
}
