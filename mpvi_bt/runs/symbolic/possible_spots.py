"""Where things may come to lie on the way to a goal, so that a planner need not try every place."""

from __future__ import annotations

from collections.abc import Collection

from mpvi_bt.house.goals.formula import Literal
from mpvi_bt.runs.symbolic.told_facts import Atom, ToldFacts

Spot = tuple[str, str]  # "inside" or "ontop", and the place


class PossibleSpots:
    """Places for things.

    Args:
        told: What is known.
        wanted: Literals, and whether each is to be true.
        goal: The same as atoms that are to be so.

    Attributes:
        placed: Thing to its spot at the start.
        loose: Things that can be carried.
        carried: Those that have an entry in the catalogue, with it.
        floor_marks: Marks on floors, each to its floor: the robot drives to them.
        stops: All that it may drive to.
        made: What can be cut, to what each cut makes of it.
        spots: Each loose thing to where it may come to lie.
        pairs: Literals of what is wanted beside or under something.
    """

    def __init__(self, told: ToldFacts, wanted: dict[Literal, bool], goal: Collection[Atom]) -> None:
        self.told, self.wanted, self.goal = told, wanted, sorted(goal)
        self.start = told.start
        self.placed = {a[1]: (a[2], a[3]) for a in sorted(self.start) if a[0] == "placed"}
        self.loose = [t for t in told.things if not told.fixed(t)]
        self.carried = {t: told.entries[t] for t in self.loose if t in told.entries}
        marked = [(a[2], a[1]) for a in sorted(self.start) if a[0] == "covered"]
        self.floor_marks = {marks: thing for marks, thing in marked if thing in told.things and told.is_floor(thing)}
        self.stops = [*told.things, *self.floor_marks]
        self.made = self._made()
        self.pairs = [a for a in wanted if wanted[a] and a.predicate in ("nextto", "under")]
        self.spots = self._spots()

    def wide(self, place: str) -> bool:
        """Whether things that lie on it may be out of reach of one another: furniture and floors."""
        return self.told.fixed(place)

    def floor_by(self, fixed: str) -> str:
        """The floor that furniture stands on."""
        room = self.told.problem.rooms[fixed]
        return next(t for t in self.told.things if self.told.is_floor(t) and self.told.problem.rooms[t] == room)

    def seen(self, relation: str, place: str) -> bool:
        """Whether the robot can drive to what lies there: on furniture, or inside of what has no door."""
        return self.wide(place) and not (relation == "inside" and self.openable(place))

    def near_all(self, relation: str, place: str) -> bool:
        """Whether all that lies there is in reach at once: inside of things, and on what can be carried."""
        return relation == "inside" or not self.wide(place)

    def openable(self, thing: str) -> bool:
        """Whether it has a door or a lid."""
        entry = self.told.entries.get(thing)
        return entry is not None and entry.description.jointed

    def board(self, thing: str) -> bool:
        """Whether things are cut on it."""
        return bool({"board", "block"} & set(self.told.name(thing).split()))

    def to_be(self, predicate: str, thing: str) -> bool:
        """Whether a predicate of the thing is wanted."""
        return any(so and a.predicate == predicate and thing in a.args for a, so in self.wanted.items())

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
        boards = [t for t in self.loose if self.board(t)]
        pans = [t for t in self.loose if self.told.able(t, "heatable")]
        for thing in self.loose:
            mine = [self.placed[thing]] if thing in self.placed else []
            mine += [(a[2], a[3]) for a in self.goal if a[0] == "placed" and a[1] == thing]
            if thing in self.made or (thing in self.told.problem.future and not self._was_poured(thing)):
                mine += [("ontop", board) for board in boards if board != thing]
            if self.to_be("cooked", thing) or self.to_be("hot", thing) or self.to_be("frozen", thing):
                mine += self._appliances(thing)
                mine += [
                    ("inside" if self.told.able(pan, "fillable") else "ontop", pan)
                    for pan in pans
                    if pan != thing and self.wide(self.placed.get(pan, ("", ""))[1])
                ]
            if thing in pans:
                mine += [("ontop", t) for t in self.told.things if self._stove(t)]
            if any(a[0] == "covered" and a[1] == thing for a in self.start):
                mine += [("inside", t) for t in self.told.things if self._washes(t)]
            mine += [("ontop", desk) for desk in desks]
            mine += [("ontop", self.floor_by(t)) for a in self.pairs if thing in a.args for t in a.args if self.wide(t)]
            spots[thing] = [s for s in dict.fromkeys(mine) if s[1] != thing]
        vessels = {place for places in spots.values() for _, place in places}
        for thing in vessels & spots.keys():
            spots[thing] += [("ontop", t) for t in self.told.things if self.told.is_floor(t)]
            spots[thing] = list(dict.fromkeys(spots[thing]))
        return spots

    def _desk(self, relation: str, place: str) -> bool:
        fixed = self.told.fixed(place) and not self.told.is_floor(place)
        return relation == "ontop" and fixed and not self._stove(place)

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
