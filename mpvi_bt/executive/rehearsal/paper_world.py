"""What is where while a plan is carried out on paper, and which thing a phrase means then.

Of several things that a phrase may mean, `backward` says from which end of the list one is taken.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Mapping

from mpvi_bt.executive.completion import criteria
from mpvi_bt.executive.rehearsal.known_start import KnownStart
from mpvi_bt.ground.words.phrases import Vocabulary, kinds, plural, read

_ORDER = {"other", "another", "next"}


class CannotBe(Exception):
    """What a segment asks for is not possible as things are."""


class PaperWorld:
    """The state of things.

    What no known thing is called is guessed: a thing of that name which may be anywhere, and of which nothing is known.

    Attributes:
        place: What the robot has driven to: a thing, or a room; "" if nobody knows where it is.
        spot: The same, and where things lay that it took there.
        held: What each hand holds; a thing in all hands is held with both.
        doubted: Hands that are empty as far as is known, and may hold something.
        at: Thing to ("inside" | "ontop", the other thing), or ("room", a room) where nobody knows a floor of it.
        pairs: ("nextto" | "under", thing, other thing).
        open, on: Things that are open, switched on.
        covered: (thing, substance).
        gone: What was cut up; what does not exist yet.
        guessed: Things that are not of the start.
        said: Things to what the plan called them last, if that is no plural.
        done: How many segments have been carried out.
    """

    def __init__(self, start: KnownStart, backward: bool = False) -> None:
        """Begin as the start says. `backward`: of things that are alike, take the last first."""
        self.start, self.backward = start, backward
        self.called = dict(start.called)
        self.known = self.vocabulary = Vocabulary(self.called)
        self.guessed: set[str] = set()
        self.said: dict[str, str] = {}
        self.done = 0
        self.room = self.place = start.room
        self.spot = {self.place}
        hands = start.hands[::-1] if backward else start.hands
        self.held: dict[str, str | None] = dict.fromkeys(start.hands)
        self.held |= zip(hands, start.held, strict=False)
        self.doubted = {hand for hand, thing in self.held.items() if thing is None and start.partial}
        self.at: dict[str, tuple[str, str]] = {}
        self.pairs: set[tuple[str, str, str]] = set()
        self.openable, self.open, self.on = set(start.openable), set[str](), set[str]()
        self.covered: set[tuple[str, str]] = set()
        self.cooked, self.frozen, self.burning = set[str](), set[str](), set[str]()
        self.attached: set[tuple[str, str]] = set()
        self.gone = set(start.later)
        self.beside: dict[str, str] = {}  # what was laid on a floor, to where the robot stood
        self.moved: Counter[str] = Counter()
        self.used: list[str] = []
        self.sources: dict[str, str] = {}
        for predicate, args in start.facts:
            self._begin(predicate, args)

    def _begin(self, predicate: str, args: tuple[str, ...]) -> None:
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

    def truth(self, predicate: str, args: tuple[str, ...]) -> bool:
        """Whether a fact holds, of the predicates in `KEPT`."""
        return KEPT[predicate](self, *args)

    def inside(self, thing: str, other: str) -> bool:
        """In it, or on or in something that is."""
        relation, support = self.at.get(thing, ("", ""))
        if relation not in ("inside", "ontop"):
            return False
        return (relation == "inside" and support == other) or self.inside(support, other)

    def so(self, criterion: criteria.Criterion) -> bool | None:
        """Whether a criterion holds, by the rules of the oracle; None where that is not known here."""
        if criterion.relation == "at":
            return None
        things = {thing: phrases for thing, phrases in self.called.items() if thing not in self.gone}
        subjects = criteria.named(criterion.subject, things)
        others = criteria.named(criterion.object, things) if criterion.object else []
        if not criteria.named(criterion.subject, self.called) or (criterion.object and not others):
            return None
        if self.guessed & {*subjects, *others} or self.doubted:
            return None
        if criterion.relation == "cut":
            return not subjects
        count = sum(any(self._holds(criterion, s, o) for o in others or [""] if s != o) for s in subjects)
        return count >= criterion.count

    def _holds(self, criterion: criteria.Criterion, subject: str, other: str) -> bool:
        match criterion.relation:
            case "held":
                return subject in ([self.held.get(criterion.side)] if criterion.side else self.held.values())
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

    def noun(self, thing: str) -> str:
        """What a message calls a thing: as the plan did last, if it did."""
        return self.said.get(thing) or next(iter(self.called.get(thing, ())), thing.replace("_", " "))

    def name(self, thing: str) -> str:
        """The same, with its article."""
        return f"the {self.noun(thing)}"

    def named(self, phrase: str) -> list[str]:
        """All that a phrase may mean, what is gone too."""
        found = self.vocabulary.named(phrase)
        (noun,) = kinds([phrase])
        if plural(noun) != noun:
            self.said |= dict.fromkeys(found, noun)
        return found

    def guess(self, phrase: str) -> str:
        """A thing that is called so, which is new here."""
        thing = f"{phrase} ({len(self.guessed) + 1})"
        self.called[thing] = (re.sub(r"^(?:another|the other|other|the|an?) ", "", phrase.lower()),)
        self.vocabulary = Vocabulary(self.called)
        self.guessed.add(thing)
        return thing

    def meant(self, phrase: str, than: str | None = None) -> list[str]:
        """What a phrase may mean, in the order of the start; "another" is one other `than` this, or the last used."""
        reading = read(phrase)
        found = [t for t in self.named(phrase) if t not in self.gone]
        words = phrase.lower().split()
        if "empty" in words:
            found = [t for t in found if not self.on_or_in(t)] or found
        if reading is not None and (state := dict(reading.qualities).get("state")) is not None:
            found = [t for t in found if (t in self.open) == (state == "open")] or found
        if _ORDER & set(words[:2]) and len(found) > 1:
            last = than if than in found else next((t for t in reversed(self.used) if t in found), None)
            found = [t for t in found if t != last]
        if reading is not None and (inner := re.fullmatch(r"(with|without) (.+)", reading.place)):
            wanted = self.named(inner[2])
            so = [t for t in found if any(w in self.on_or_in(t) for w in wanted) == (inner[1] == "with")]
            found = so or found
        if self.backward:
            found.reverse()
        return found

    def one(
        self, phrase: str, among: Callable[[str], bool], what: str, old: bool = True, than: str | None = None
    ) -> str:
        """The thing that a phrase means among some; of several one that was used before, or if not `old` one untouched.

        Raises CannotBe, with why there is none that does `what` it should.
        """
        found = [thing for thing in self.meant(phrase, than) if among(thing)]
        if not found:
            if self.start.partial or not self.known.named(phrase):
                return self.guess(phrase)
            raise CannotBe(self._why_not(phrase, than, what))
        if not old:
            return min(found, key=lambda t: (self.moved[t], t != self.place))
        return next((t for t in reversed(self.used) if t in found), self.place if self.place in found else found[0])

    def _why_not(self, phrase: str, than: str | None, what: str) -> str:
        found = self.meant(phrase, than)
        if not found:
            yet = "yet" if self.start.later & set(self.named(phrase)) else "any more"
            return f"there is no {phrase!r} {yet}"
        near = self.near()
        for thing in found:
            if self.shut_in(thing) is not None:
                return self.hidden(thing)
            if (side := next((s for s, held in self.held.items() if held == thing), None)) is not None:
                return f"{self.name(thing)} is in the {side} hand"
        if not any(thing in near for thing in found):
            place = f"{'in' if self.place == self.room else 'at'} {self.name(self.place)}"
            return f"no {phrase!r} is in reach, and the robot is {place}: go there first"
        return f"no {phrase!r} {what}"

    def hidden(self, thing: str) -> str:
        """The message for a thing behind a door or under a lid that is closed."""
        return f"{self.name(self.shut_in(thing) or '')} is closed, and {self.name(thing)} is in it: open it first"

    def on_or_in(self, thing: str) -> set[str]:
        """What is directly on it or in it."""
        return {t for t, (_, support) in self.at.items() if support == thing and t not in self.gone}

    def somewhere(self, thing: str) -> bool:
        """Whether nobody knows where it is."""
        if thing in self.start.rooms or thing in self.at or thing in self.held.values():
            return False
        return not any(thing == t for _, t, _ in self.pairs) and not any(thing == s for _, s in self.covered)

    def room_of(self, thing: str) -> str:
        """The room that a thing is in; "" if nobody knows."""
        if thing in self.start.rooms:
            return self.start.rooms[thing]
        if thing in self.held.values():
            return self.room
        relation, support = self.at.get(thing, ("", ""))
        if relation:
            return support if relation == "room" else self.room_of(support)
        others = [o for _, t, o in self.pairs if t == thing] + [t for t, s in self.covered if s == thing]
        return self.room_of(others[0]) if others else ""

    def near(self) -> set[str]:
        """What is in reach: what was driven to, what it lies with, what is beside it, what is held, and the floor.

        So is what may be anywhere, and everything where nobody knows where the robot is.
        """
        if not self.place or self.place in self.guessed:
            return set(self.called) - self.gone
        reached = self._with(self.spot | {t for t in self.held.values() if t})
        reached |= self._with({b for a, b in self.start.adjoining if a in reached} - reached)
        floors = {t for t in self.start.floors if self.room_of(t) == self.room}
        return reached | floors | {t for t in self.called if t not in self.gone and self.somewhere(t)}

    def _with(self, reached: set[str]) -> set[str]:
        """Things, and all that lies with them."""
        while True:
            more = {t for t, s in self.beside.items() if s in reached}
            more |= {t for t, (_, support) in self.at.items() if support in reached}
            more |= {self.at[t][1] for t in reached if t in self.at}
            more |= {o for _, t, o in self.pairs if t in reached} | {t for _, t, o in self.pairs if o in reached}
            more &= self.called.keys() - self.start.floors - reached - self.gone  # rooms are no things
            if not more:
                return reached
            reached = reached | more

    def shut_in(self, thing: str) -> str | None:
        """The door or lid that it is behind or under, closed; None: none is."""
        relation, support = self.at.get(thing, ("", ""))
        if relation not in ("inside", "ontop"):
            return None
        closed = relation == "inside" and support in self.openable and support not in self.open
        return support if closed else self.shut_in(support)


KEPT: Mapping[str, Callable[..., bool]] = {
    "inside": PaperWorld.inside,
    "ontop": lambda world, a, b: world.at.get(a) == ("ontop", b),
    "touching": lambda world, a, b: world.at.get(a, ("", ""))[1] == b,
    "nextto": lambda world, a, b: bool({("nextto", a, b), ("nextto", b, a)} & world.pairs),
    "under": lambda world, a, b: ("under", a, b) in world.pairs,
    "open": lambda world, a: a in world.open,
    "toggled_on": lambda world, a: a in world.on,
    "cooked": lambda world, a: a in world.cooked,
    "frozen": lambda world, a: a in world.frozen,
    "on_fire": lambda world, a: a in world.burning,
    "attached": lambda world, a, b: (a, b) in world.attached,
    "covered": lambda world, a, b: (a, b) in world.covered,
    "contains": lambda world, a, b: b not in world.gone and world.inside(b, a),
    "real": lambda world, a: a not in world.gone,
    "there": lambda world, a, _: a not in world.gone,
}
