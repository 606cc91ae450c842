"""The robot's skills as actions on a task's things: what each needs and brings about, written out for each thing."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass

from mpvi_bt.house.goals.formula import Literal
from mpvi_bt.runs.symbolic.told_facts import Atom, ToldFacts

DRIVE_COST, WAIT_COST, HAND_COST = 8, 1, 2  # our choice: a drive takes as long as four motions of a hand
HANDS = ("right", "left")


@dataclass(frozen=True)
class GroundedAction:
    """A skill done to things.

    Attributes:
        skill: Such as "pick"; "go_to" is a drive.
        args: The things, in the order of the skill's words.
        hand: That does it; "" if either may, or both.
        needs, forbids: Atoms that have to be so, and that must not be so.
        adds, drops: Atoms that are so afterwards, and that are not any more.
        cost: More is worse.
    """

    skill: str
    args: tuple[str, ...]
    hand: str = ""
    needs: frozenset[Atom] = frozenset()
    forbids: frozenset[Atom] = frozenset()
    adds: frozenset[Atom] = frozenset()
    drops: frozenset[Atom] = frozenset()
    cost: int = HAND_COST


class Actions:
    """Every action that may be of use for what is wanted.

    Args:
        told: What is known.
        wanted: Literals, and whether each is to be true.
        goal: The same as atoms that are to be so.
    """

    def __init__(self, told: ToldFacts, wanted: dict[Literal, bool], goal: Collection[Atom]) -> None:
        self.told, self.wanted, self.goal = told, wanted, sorted(goal)
        self.start = told.start
        self.placed = {a[1]: (a[2], a[3]) for a in self.start if a[0] == "placed"}
        self.loose = [t for t in told.things if not told.fixed(t)]
        self.made = self._made()
        self.spots = self._spots()
        self.reached = {("at", place) for place in told.things}
        self.pairs = [a for a in wanted if wanted[a] and a.predicate in ("nextto", "under")]

    def all(self) -> list[GroundedAction]:
        """The actions."""
        acts = [*self._drives(), *self._doors(), *self._switches(), *self._marks(), *self._heat(), *self._cuts()]
        for thing, places in self.spots.items():
            for relation, place in places:
                acts += self._takes(thing, relation, place)
                acts += self._puts(thing, relation, place)
        return acts + list(self._beside()) + list(self._mounts())

    def wide(self, place: str) -> bool:
        """Whether things that lie on it may be out of reach of one another: furniture and floors."""
        return self.told.fixed(place)

    def _made(self) -> dict[str, list[tuple[str, ...]]]:
        """What can be cut, to what each cut makes of it; every piece that comes to be, shared out in order."""
        pieces: dict[str, list[str]] = {}
        for thing in self.told.problem.future:
            pieces.setdefault(self.told.problem.objects[thing], []).append(thing)
        for group in pieces.values():
            group.sort(key=lambda t: int(t.rpartition("_")[2]))
        made: dict[str, list[tuple[str, ...]]] = {}
        for thing in self.loose:
            for synset, number in self.told.cut_into(thing) if thing in self.placed else ():
                group = pieces.get(synset, [])
                number = number if len(group) > 1 else 1
                mine = tuple(group[:number])
                if len(group) > number:
                    del group[:number]
                made[thing] = [*made.get(thing, []), mine]
        return made

    def _spots(self) -> dict[str, list[tuple[str, str]]]:
        """Each loose thing to where it may come to lie: where it is, where it is wanted, and what is of use between."""
        spots: dict[str, list[tuple[str, str]]] = {}
        desks = [place for relation, place in dict.fromkeys(self.placed.values()) if self._desk(relation, place)]
        boards = [t for t in self.loose if self._board(t)]
        pans = [t for t in self.loose if self.told.able(t, "fillable") or self.told.able(t, "heatable")]
        for thing in self.loose:
            mine = [self.placed[thing]] if thing in self.placed else []
            mine += [(a[2], a[3]) for a in self.goal if a[0] == "placed" and a[1] == thing]
            if thing in self.made or (thing in self.told.problem.future and not self._was_poured(thing)):
                mine += [("ontop", board) for board in boards if board != thing]
            if self._to_be("cooked", thing) or self._to_be("hot", thing) or self._to_be("frozen", thing):
                mine += self._appliances(thing)
                mine += [
                    ("ontop", pan) for pan in pans if pan != thing and self.wide(self.placed.get(pan, ("", ""))[1])
                ]
            if any(c in pans for _, c in mine) or thing in pans:
                mine += [("ontop", t) for t in self.told.things if self._stove(t)]
            if any(a[0] == "covered" and a[1] == thing for a in self.start):
                mine += [("inside", t) for t in self.told.things if self._washes(t)]
            mine += [("ontop", desk) for desk in desks]
            spots[thing] = [s for s in dict.fromkeys(mine) if s[1] != thing]
        return spots

    def _desk(self, relation: str, place: str) -> bool:
        return relation == "ontop" and self.told.fixed(place) and not self.told.is_floor(place)

    def _board(self, thing: str) -> bool:
        return bool({"board", "block"} & set(self.told.name(thing).split()))

    def _stove(self, thing: str) -> bool:
        source = self.told.entries[thing].source if thing in self.told.entries else None
        return source is not None and self.told.fixed(thing) and source.placing == "near" and source.at_c > 0

    def _appliances(self, thing: str) -> list[tuple[str, str]]:
        return [
            ("inside", t)
            for t, entry in self.told.entries.items()
            if self.told.fixed(t) and entry.source is not None and entry.source.placing == "inside"
        ]

    def _washes(self, thing: str) -> bool:
        return thing in self.told.entries and self.told.entries[thing].washes is not None

    def _was_poured(self, thing: str) -> bool:
        return thing in self.told.problem.poured

    def _to_be(self, predicate: str, thing: str) -> bool:
        return any(so and a.predicate == predicate and thing in a.args for a, so in self.wanted.items())

    def _openable(self, thing: str) -> bool:
        entry = self.told.entries.get(thing)
        return entry is not None and entry.description.jointed

    def _drive(self, target: str, *near: str, needs: frozenset[Atom] = frozenset()) -> GroundedAction:
        there = frozenset(("at", place) for place in near)
        return GroundedAction(
            "go_to", (target,), "", needs, adds=there, drops=frozenset(self.reached - there), cost=DRIVE_COST
        )

    def _drives(self) -> Iterator[GroundedAction]:
        for thing in self.told.things:
            if self.told.fixed(thing):
                yield self._drive(thing, thing)
        for thing, places in self.spots.items():
            for relation, place in places:
                if self.wide(place) and not (relation == "inside" and self._openable(place)):
                    yield self._drive(thing, thing, place, needs=frozenset({("placed", thing, relation, place)}))

    def _takes(self, thing: str, relation: str, place: str) -> Iterator[GroundedAction]:
        lies: Atom = ("placed", thing, relation, place)
        shut = relation == "inside" and self._openable(place)
        inner, both = relation == "inside" or not self.wide(place), self.told.two_hands(thing)
        doors: set[Atom] = {("open", place)} if shut else set()
        ways: list[tuple[set[Atom], set[Atom]]] = [({("at", thing)}, {("at", thing)})]
        if inner:
            ways = [({("at", place)}, set())]
            if relation == "inside" and self.wide(place) and not shut:
                ways.append(({("at", thing)}, {("at", thing)}))
            if not self.told.fixed(place) and not both:
                ways += [({("held", place, hand)}, set()) for hand in HANDS]
        ended = {(pair.predicate, *pair.args) for pair in self.pairs if thing in pair.args}
        for near, gone in ways:
            if both:
                free = {("free", hand) for hand in HANDS}
                held = {("held", thing, "both")}
                yield GroundedAction(
                    "lift",
                    (thing, place),
                    "",
                    frozenset(near | free | doors | {lies}),
                    adds=frozenset(held),
                    drops=frozenset(free | {lies} | gone | ended),
                )
                continue
            for hand in HANDS:
                needs = near | {("free", hand), lies} | doors
                yield GroundedAction(
                    "pick",
                    (thing, place),
                    hand,
                    frozenset(needs),
                    adds=frozenset({("held", thing, hand)}),
                    drops=frozenset({("free", hand), lies} | gone | ended),
                )

    def _holds(self, thing: str) -> Iterator[tuple[str, set[Atom], set[Atom]]]:
        """Each way in which it may be held: the hand's name, what is so then, and what is so after it is let go."""
        if self.told.two_hands(thing):
            yield "", {("held", thing, "both")}, {("free", hand) for hand in HANDS}
        else:
            for hand in HANDS:
                yield hand, {("held", thing, hand)}, {("free", hand)}

    def _puts(self, thing: str, relation: str, place: str) -> Iterator[GroundedAction]:
        skill = "place_in" if relation == "inside" else "place_on"
        doors: set[Atom] = {("open", place)} if relation == "inside" and self._openable(place) else set()
        for hand, held, free in self._holds(thing):
            adds = {("placed", thing, relation, place), *free}
            if self.wide(place) and relation == "ontop":
                adds.add(("at", thing))
            yield GroundedAction(
                skill,
                (thing, place),
                hand,
                frozenset(held | doors | {("at", place)}),
                adds=frozenset(adds),
                drops=frozenset(held),
            )
            if not self.wide(place) and hand:  # into what the other hand holds
                other = HANDS[1 - HANDS.index(hand)]
                yield GroundedAction(
                    skill,
                    (thing, place),
                    hand,
                    frozenset(held | doors | {("held", place, other)}),
                    adds=frozenset(adds),
                    drops=frozenset(held),
                )

    def _doors(self) -> Iterator[GroundedAction]:
        for thing in self.told.things:
            if not self._openable(thing):
                continue
            for hand in HANDS:
                near = {("at", thing), ("free", hand)}
                opened, on = frozenset({("open", thing)}), frozenset({("toggled_on", thing)})
                yield GroundedAction("open", (thing,), hand, frozenset(near), opened, opened, on)
                yield GroundedAction("close", (thing,), hand, frozenset(near) | opened, drops=opened)

    def _switches(self) -> Iterator[GroundedAction]:
        for thing in self.told.things:
            entry = self.told.entries.get(thing)
            if entry is None or not any(body.switches for body in entry.description.bodies):
                continue
            on = frozenset({("toggled_on", thing)})
            shut = frozenset({("open", thing)} if self._openable(thing) and self.told.fixed(thing) else ())
            for hand, other in (HANDS, HANDS[::-1]):
                reach: list[Atom] = [("at", thing), *([] if self.told.fixed(thing) else [("held", thing, other)])]
                for near in reach:
                    needs = frozenset({near, ("free", hand)})
                    yield GroundedAction("press", (thing, "on"), hand, needs, on | shut, on)
                    yield GroundedAction("press", (thing, "off"), hand, needs | on, drops=on)

    def _near(self, thing: str) -> Iterator[frozenset[Atom]]:
        """Each way in which the robot may be at a thing."""
        yield frozenset({("at", thing)})
        for relation, place in self.spots.get(thing, ()):
            if relation == "inside" or not self.wide(place):
                doors = {("open", place)} if self._openable(place) else set()
                yield frozenset({("at", place), ("placed", thing, relation, place), *doors})

    def _marks(self) -> Iterator[GroundedAction]:
        for atom in sorted(a for a in self.start if a[0] == "covered"):
            _, thing, marks = atom
            kind = self.told.problem.objects[marks]
            gone = frozenset({atom})
            for other, entry in self.told.entries.items():
                if entry.washes is not None and not entry.washes.get(kind, ("none",)):
                    needs = frozenset({("toggled_on", other), ("placed", thing, "inside", other), atom})
                    yield GroundedAction("", (thing, other), "", needs, drops=gone, cost=0)
                if entry.removes is not None and not entry.removes.get(kind, ("none",)) and other in self.loose:
                    for hand, held, _ in self._holds(other):
                        for near in self._near(thing):
                            yield GroundedAction("wipe", (thing, other, marks), hand, near | held | {atom}, drops=gone)
        for literal, so in self.wanted.items():
            if not so or literal.predicate != "covered":
                continue
            thing, marks = literal.args
            for other, entry in self.told.entries.items():
                if entry.sprays is not None and entry.sprays.kind == self.told.problem.objects[marks]:
                    for hand, held, _ in self._holds(other):
                        for near in self._near(thing):
                            yield GroundedAction(
                                "spray", (thing, other), hand, near | held, adds=frozenset({("covered", thing, marks)})
                            )

    def _heat(self) -> Iterator[GroundedAction]:
        for thing in self.loose:
            heat = self.told.entries[thing].heat if thing in self.told.entries else None
            if heat is None:
                continue
            for other, entry in self.told.entries.items():
                source = entry.source
                if source is None:
                    continue
                for predicate, least in (("cooked", heat.cooked_c), ("hot", heat.heated_c), ("frozen", None)):
                    cold = predicate == "frozen"
                    if cold != (source.at_c < 0) or not self._to_be(predicate, thing) or not self.told.fixed(other):
                        continue
                    if not cold and (least is None or source.at_c < least):
                        continue
                    adds = frozenset({(predicate, thing)})
                    needs = {("toggled_on", other)} if source.switched else set()
                    forbids = frozenset({("open", other)} if source.shut and self._openable(other) else ())
                    for where in self._at_source(thing, other, source.placing == "near"):
                        yield GroundedAction(
                            "wait",
                            (thing, other, predicate),
                            "",
                            frozenset(needs) | where,
                            forbids,
                            adds,
                            cost=WAIT_COST,
                        )
            if heat.ignites_c is not None and self._to_be("on_fire", thing):
                yield from self._fires(thing)

    def _at_source(self, thing: str, other: str, carried: bool) -> Iterator[frozenset[Atom]]:
        for relation, place in self.spots.get(thing, ()):
            lies = ("placed", thing, relation, place)
            if place == other and not carried:
                yield frozenset({lies})
            for beyond, far in self.spots.get(place, ()):
                if far == other:
                    yield frozenset({lies, ("placed", place, beyond, far)})

    def _fires(self, thing: str) -> Iterator[GroundedAction]:
        burns = frozenset({("on_fire", thing)})
        for other, entry in self.told.entries.items():
            if entry.source is not None and entry.source.at_c > 100 and other in self.loose:
                for hand, held, _ in self._holds(other):
                    for near in self._near(thing):
                        yield GroundedAction(
                            "light", (thing, other), hand, near | held | {("toggled_on", other)}, adds=burns
                        )
        for relation, place in self.spots.get(thing, ()):
            if relation == "ontop":
                needs = frozenset({("placed", thing, relation, place), ("on_fire", place)})
                yield GroundedAction("wait", (thing, place, "on_fire"), "", needs, adds=burns, cost=WAIT_COST)

    def _cuts(self) -> Iterator[GroundedAction]:
        tools = [t for t in self.loose if self.told.able(t, "slicer")]
        for thing, made in self.made.items():
            for pieces in made:
                for tool in tools:
                    for relation, place in self.spots[thing]:
                        if relation != "ontop" or not self._board(place) or not pieces:
                            continue
                        lies = ("placed", thing, relation, place)
                        for hand, held, _ in self._holds(tool):
                            adds: set[Atom] = {("placed", piece, "ontop", place) for piece in pieces}
                            adds |= {("real", piece) for piece in pieces} | {("gone", thing)}
                            yield GroundedAction(
                                "cut",
                                (thing, place, tool, *pieces),
                                hand,
                                frozenset({lies, ("at", place), *held}),
                                adds=frozenset(adds),
                                drops=frozenset({lies}),
                            )

    def _beside(self) -> Iterator[GroundedAction]:
        """Putting things next to or under others, where these are then."""
        for literal in self.pairs:
            other = literal.args[1]
            for thing, target in (literal.args, literal.args[::-1]):
                if self.told.fixed(thing) or (literal.predicate == "under" and target != other):
                    continue
                for hand, held, free in self._holds(thing):
                    skill = "place_under" if literal.predicate == "under" else "place_next_to"
                    so = (literal.predicate, *literal.args)
                    for place, lies in self._floor_of(target):
                        unders = {
                            ("under", thing, u.args[1])
                            for u in self.pairs
                            if u.predicate == "under" and u.args[0] == thing and ("under", target, u.args[1]) in lies
                        }
                        adds = {so, *free, ("placed", thing, "ontop", place)} | unders
                        yield GroundedAction(
                            skill,
                            (thing, target, place),
                            hand,
                            frozenset(held | lies),
                            adds=frozenset(adds),
                            drops=frozenset(held),
                        )

    def _floor_of(self, target: str) -> Iterator[tuple[str, set[Atom]]]:
        """What a thing stands on, and what has to be so for that and for the robot to be there."""
        if self.told.fixed(target):
            room = self.told.problem.rooms[target]
            floors = [t for t in self.told.things if self.told.is_floor(t) and self.told.problem.rooms[t] == room]
            yield (floors[0] if floors else target), {("at", target)}
            return
        for relation, place in self.spots.get(target, ()):
            lies: set[Atom] = {("placed", target, relation, place)}
            if relation == "ontop":
                yield place, lies | {("at", target)}
                for u in self.pairs:
                    if u.predicate == "under" and u.args[0] == target:
                        yield place, lies | {("at", u.args[1]), ("under", *u.args)}

    def _mounts(self) -> Iterator[GroundedAction]:
        for literal, so in self.wanted.items():
            if not so or literal.predicate != "attached":
                continue
            thing, other = literal.args
            for hand, held, free in self._holds(thing):
                for near in self._near(other):
                    yield GroundedAction(
                        "mount",
                        (thing, other),
                        hand,
                        near | held,
                        adds=frozenset({("attached", thing, other), *free}),
                        drops=frozenset(held),
                    )
