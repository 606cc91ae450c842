"""Writes actions as a plan's segments: in the words of the skills' phrases, each with a state that ends it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from mpvi_bt.executive.plan.clauses import match
from mpvi_bt.executive.plan.schema import Manipulation, Navigation, Segment
from mpvi_bt.executive.plan.skill_effects import RELEASING
from mpvi_bt.executive.plan.skill_phrases import filled
from mpvi_bt.executive.plan.skill_words import effects_words, shown_phrase
from mpvi_bt.executive.plan.skills import Skill
from mpvi_bt.ground.errors import with_article
from mpvi_bt.ground.words.phrases import normalize, plural
from mpvi_bt.runs.symbolic.grounded_actions import GroundedAction
from mpvi_bt.runs.symbolic.told_facts import Atom, ToldFacts

_NUMBERS = ("no", "a", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")
_UNCHANGED = ("pliers", "dice", "scissors")


class Sentences:
    """Words for actions, with the state in which each is done.

    Args:
        told: What things are called.
        start: What is so before the first action.
        skills: By name.
    """

    def __init__(self, told: ToldFacts, start: Iterable[Atom], skills: Mapping[str, Skill]) -> None:
        self.told, self.skills = told, skills
        self.now, self.start, self.used = set(start), set(start), [""]
        self.names = {thing: told.name(thing) for thing in told.problem.objects}

    def segments(self, actions: list[GroundedAction]) -> tuple[Segment, ...]:
        """The segments. Waits for things of one kind are one segment."""
        found: list[Segment] = []
        self.told_apart = self._hands_told(actions)
        here, reached, unit = "", set[str](), list[GroundedAction]()
        for i, action in enumerate(actions):
            thing = action.args[0] if action.skill == "go_to" else self._worked_at(action)
            if action.skill != "go_to" and self._begins(action, unit):
                thing = thing or here
            elif action.skill != "go_to" and self._in_reach(action, thing, reached):
                thing = ""
            if thing:
                here, reached, unit = thing, {thing, *self._below(thing)}, []
                if action.skill != "go_to":
                    found.append(self._drive(GroundedAction("go_to", (thing,))))
            unit.append(action)
            self.now = (self.now - action.drops) | action.adds
            after = actions[i + 1] if i + 1 < len(actions) else None
            if action.skill == "wait" and after is not None and self._same_wait(action, after):
                continue
            found.append(self._drive(action) if action.skill == "go_to" else self._hands(action))
            self.used += action.args
        return tuple(found)

    def _begins(self, action: GroundedAction, unit: list[GroundedAction]) -> bool:
        """Whether an action is better the first of a unit, since only the end of a unit is checked.

        It is so after things were put down, or taken to be carried on, and where what ends it was so before the unit.
        """
        last = next((self.skills[act.skill].effects for act in reversed(unit) if act.skill != "go_to"), None)
        if last is None:
            return False
        effects = self.skills[action.skill].effects
        puts, put = effects.put or effects.poured, last.put or last.poured
        if (put and not puts) or (last.held and not puts and not effects.held):
            return True
        opened = {atom for act in unit for atom in act.adds if atom[0] in ("open", "toggled_on")}
        let_go = {atom[:2] for act in unit for atom in act.drops if atom[0] == "held"}
        return bool(action.drops & opened or {atom[:2] for atom in action.adds if atom[0] == "held"} & let_go)

    def _worked_at(self, action: GroundedAction) -> str:
        """What to stand at for an action: the furniture, or what can be carried and stands on it; "" is anywhere."""
        near = [action.words[slot] for slot in self.skills[action.skill].needs.near if slot in action.words]
        *loose, fixed = "", *near[:1], *self._below(near[0] if near else "")
        if fixed not in self.told.problem.rooms or (len(loose) == 1 and self.told.is_floor(fixed)):
            return ""  # it is in a hand, or underfoot
        return loose[-1] if ("placed", loose[-1], "ontop", fixed) in self.now else fixed

    def _in_reach(self, action: GroundedAction, thing: str, reached: set[str]) -> bool:
        """Whether the robot need not drive to a thing; to let go of something it is enough to be at its furniture."""
        lets_go = any(getattr(self.skills[action.skill].effects, term) for term in RELEASING)
        near = {thing, *self._below(thing)} if lets_go else {thing}
        return not thing or any(place in reached and not self.told.is_floor(place) for place in near)

    def _below(self, thing: str) -> list[str]:
        """What a thing lies on or in, what that lies on or in, and so on."""
        places = {atom[1]: atom[3] for atom in self.now if atom[0] == "placed"}
        found = []
        while thing := places.get(thing, ""):
            found.append(thing)
        return found

    def _hands_told(self, actions: list[GroundedAction]) -> set[GroundedAction]:
        """What is done between two moments with empty hands, if the hands hold alike things on the way."""
        told, since, alike = set[GroundedAction](), list[GroundedAction](), False
        held = {atom for atom in self.now if atom[0] == "held"}
        for action in actions:
            since.append(action)
            held = (held - action.drops) | {atom for atom in action.adds if atom[0] == "held"}
            kinds = [self.names[atom[1]].split()[-1] for atom in held]
            alike |= len(kinds) > len(set(kinds))
            told |= set(since) if alike else set()
            since, alike = (since, alike) if held else ([], False)
        return told

    def _same_wait(self, action: GroundedAction, after: GroundedAction) -> bool:
        return (
            after.skill == "wait"
            and after.args[2] == action.args[2]
            and self.names[after.args[0]] == self.names[action.args[0]]
        )

    def _alike(self, thing: str) -> list[str]:
        """What is called so and is there."""
        gone = {a[1] for a in self.now if a[0] == "gone"}
        future = self.told.problem.future - {a[1] for a in self.now if a[0] == "real"}
        return [t for t, name in self.names.items() if name == self.names[thing] and t not in gone | future]

    def one(self, thing: str) -> str:
        """A thing, so that what is meant can be told: "the cup", "a cup", "another cup", "the bowl with the leeks"."""
        name, alike = self.names[thing], self._alike(thing)
        if len(alike) < 2:
            return f"the {name}"
        mine, others = self._inside(thing), [self._inside(t) for t in alike if t != thing]
        for inner in sorted(mine):
            if all(inner not in other for other in others):
                return f"the {name} with the {inner}"
        for inner in sorted(mine):
            if any(inner not in other for other in others):
                return f"{with_article(name)} with {with_article(inner)}"
        for kind in sorted({self.names[a[1]] for a in self.now if a[0] == "held"}):
            if kind not in mine and any(kind in other for other in others):
                return f"{with_article(name)} without {with_article(kind)}"
        if not mine and any(others):
            return f"the empty {name}"
        return with_article(name)

    def _inside(self, thing: str) -> set[str]:
        return {self.names[a[1]] for a in self.now if a[0] == "placed" and a[3] == thing and a[1] in self.names}

    def _drive(self, action: GroundedAction) -> Navigation:
        (thing,) = action.args
        room = normalize(self._room(thing))
        if self.told.is_floor(thing):
            target, name = room, f"the {room}"
        else:
            target, name = self.names[thing], self._other(thing) or self.one(thing)
        return Navigation(
            type="navigation",
            description=f"go to {name}",
            completion_criterion=f"the robot is at {name}",
            target=target,
            room=room or None,
        )

    def _other(self, thing: str) -> str:
        """What is like the last thing that something was done to, and that stayed where it was: "the other plant"."""
        alike = self._alike(thing)
        last = next((t for t in reversed(self.used) if t in alike), thing)
        done = any(atom[0] == "covered" and atom[1] == last for atom in self.now - self.start)
        if last == thing or not done:
            return ""
        return f"the other {self.names[thing]}" if len(alike) == 2 else f"another {self.names[thing]}"

    def _room(self, thing: str) -> str:
        seen, places = thing, {a[1]: a[3] for a in self.now if a[0] == "placed"}
        places |= {a[2]: a[1] for a in self.start if a[0] == "covered"}
        while seen in places:
            seen = places[seen]
        return self.told.problem.rooms.get(seen, "")

    def _hands(self, action: GroundedAction) -> Manipulation:
        say = getattr(self, f"_{action.skill}", None)
        said, criterion = say(action, *action.args) if say is not None else self._by_file(action)
        return Manipulation(type="manipulation", description=said, completion_criterion=criterion)

    def _by_file(self, action: GroundedAction) -> tuple[str, str]:
        """In the words of the skill's own phrase, and the state that its file tells."""
        skill = self.skills[action.skill]
        words = {slot: self.one(word) if word in self.names else word for slot, word in action.words.items()}
        said = filled(shown_phrase(skill), words) or skill.name
        by_hand = match(said + self._how(action), self.skills)
        if skill.shows:
            ends = filled(skill.shows, {slot: self.names.get(word, word) for slot, word in action.words.items()})
        else:
            ends = filled(effects_words(skill).partition(", ")[0], words)
        return said + (self._how(action) if by_hand is not None and by_hand.skill == skill else ""), ends or said

    def _how(self, action: GroundedAction) -> str:
        """The hand, where it is not left to the robot: it knows best with which one it reaches a thing."""
        return f" with the {action.hand} hand" if action.hand and action in self.told_apart else ""

    def _many(self, things: Iterable[str], relation: str) -> str:
        """Things of one kind and a verb, counted: "two bottles are ..."."""
        found = list(things)
        name = self.names[found[0]]
        if len(found) > 1:
            return f"{_NUMBERS[min(len(found), 10)]} {plural(name)} are {relation}"
        verb = "are" if name in _UNCHANGED else "is"
        return f"{self._a(found[0])} {verb} {relation}"

    def _a(self, thing: str) -> str:
        kinds = [t for t, name in self.names.items() if name == self.names[thing] and t not in self.told.problem.future]
        return f"the {self.names[thing]}" if len(kinds) < 2 else with_article(self.names[thing])

    def _pick(self, action: GroundedAction, thing: str, place: str) -> tuple[str, str]:
        return (
            f"pick up {self._a(thing)}{self._source(action, place)}{self._how(action)}",
            f"{self._a(thing)} is held in {f'the {action.hand}' if self._how(action) else 'a'} gripper",
        )

    def _source(self, action: GroundedAction, place: str) -> str:
        """Where a thing is taken from, in words."""
        if self.told.fixed(place) and not self.told.able(place, "openable"):
            return ""
        return f" from {self._before(action, place)}"

    def _lift(self, action: GroundedAction, thing: str, place: str) -> tuple[str, str]:
        return (
            f"lift {self._a(thing)}{self._source(action, place)} with both hands",
            f"{self._a(thing)} is held with both hands",
        )

    def _place(self, thing: str, place: str, relation: str, preposition: str) -> str:
        name = self.names[place]
        there = [
            a[1]
            for a in sorted(self.now)
            if a[0] == "placed"
            and a[2] == relation
            and self.names[a[3]] == name
            and self.names[a[1]] == self.names[thing]
        ]
        return self._many(there, f"{preposition} {self._a(place)}")

    def _before(self, action: GroundedAction, place: str) -> str:
        """A place in words, as things were before an action."""
        now = self.now
        self.now = (now - action.adds) | action.drops
        where = self.one(place)
        self.now = now
        return where

    def _place_in(self, action: GroundedAction, thing: str, place: str) -> tuple[str, str]:
        where = self._before(action, place)
        return f"put the {self.names[thing]} in {where}{self._how(action)}", self._place(thing, place, "inside", "in")

    def _place_on(self, action: GroundedAction, thing: str, place: str) -> tuple[str, str]:
        where = self._before(action, place)
        return f"put the {self.names[thing]} on {where}{self._how(action)}", self._place(thing, place, "ontop", "on")

    def _pour(self, action: GroundedAction, vessel: str, container: str, *things: str) -> tuple[str, str]:
        said = f"empty {self._before(action, vessel)} into {self._before(action, container)}"
        return said, self._place(things[0], container, "inside", "in")

    def _pair(self, thing: str, target: str) -> tuple[str, str]:
        """The target of a pair, and as a criterion says it."""
        if self.names[thing] == self.names[target]:
            return f"the other {self.names[target]}", f"another {self.names[target]}"
        return self.one(target), self._a(target)

    def _place_next_to(self, action: GroundedAction, thing: str, target: str, place: str) -> tuple[str, str]:
        said, told = self._pair(thing, target)
        if any(a[0] == "under" and a[1] == thing for a in action.adds):
            below = next(a[2] for a in action.adds if a[0] == "under" and a[1] == thing)
            there = [a[1] for a in sorted(self.now) if a[0] == "under" and a[2] == below]
            what = f"put the {self.names[thing]} under {self.one(below)} beside {said}{self._how(action)}"
            return what, self._many(there, f"under {self._a(below)}")
        kind = self.told.problem.objects[place].partition(".")[0]
        surface = kind if self.told.is_floor(place) else self.names[place]
        so = {a[1] for a in self.now if a[0] == "nextto" and a[2] == target}
        there = [t for t in sorted(so) if self.names[t] == self.names[thing]]
        return (
            f"put the {self.names[thing]} on the {surface} next to {said}{self._how(action)}",
            self._many(there or [thing], f"next to {told}"),
        )

    def _place_under(self, action: GroundedAction, thing: str, target: str, place: str) -> tuple[str, str]:
        there = [a[1] for a in sorted(self.now) if a[0] == "under" and a[2] == target]
        return (
            f"put the {self.names[thing]} on the floor under {self.one(target)}{self._how(action)}",
            self._many(there, f"under {self._a(target)}"),
        )

    def _open(self, action: GroundedAction, thing: str) -> tuple[str, str]:
        return self._moved(thing, "open", "closed", [t for t in self._alike(thing) if ("open", t) in self.now])

    def _close(self, action: GroundedAction, thing: str) -> tuple[str, str]:
        return self._moved(thing, "close", "open", [t for t in self._alike(thing) if ("open", t) not in self.now])

    def _moved(self, thing: str, verb: str, was: str, done: list[str]) -> tuple[str, str]:
        """A door that is moved, and all that are alike and so now."""
        which = self.one(thing) if len(done) == 1 else f"the {was} {self.names[thing]}"
        if 1 < len(done) < len(self._alike(thing)):
            which = with_article(f"{was} {self.names[thing]}")
        return f"{verb} {which}", self._many(done, "open" if verb == "open" else "closed")

    def _press(self, action: GroundedAction, thing: str, state: str) -> tuple[str, str]:
        return f"turn {state} {self.one(thing)}", f"{self._a(thing)} is turned {state}"

    def _wipe(self, action: GroundedAction, thing: str, tool: str, marks: str) -> tuple[str, str]:
        what = f"the {self.names[marks]} off the {self.names[thing]}" if self.told.is_floor(thing) else self.one(thing)
        return f"wipe {what} with the {self.names[tool]}", f"{self._a(thing)} is clean"

    def _spray(self, action: GroundedAction, thing: str, tool: str) -> tuple[str, str]:
        done = [t for t in self._alike(thing) if any(a[0] == "covered" and a[1] == t for a in self.now)]
        other = "the other" if len(done) > 1 and len(self._alike(thing)) == 2 else "the"
        return f"spray {other} {self.names[thing]} with the {self.names[tool]}", self._many(done, "sprayed")

    def _light(self, action: GroundedAction, thing: str, tool: str) -> tuple[str, str]:
        return f"light {self.one(thing)} with the {self.names[tool]}", self._burns(thing)

    def _burns(self, thing: str) -> str:
        burning = [t for t in self._alike(thing) if ("on_fire", t) in self.now]
        if len(burning) > 1:
            return f"{_NUMBERS[min(len(burning), 10)]} {plural(self.names[thing])} burn"
        return f"{self._a(thing)} burns"

    def _cut(self, action: GroundedAction, thing: str, place: str, tool: str, *pieces: str) -> tuple[str, str]:
        half = any("half" in self.names[piece].split() for piece in pieces)
        left = [t for t in self._alike(thing) if t != thing]
        what = f"the {self.names[thing]}" if not left else with_article(self.names[thing])
        there = [t for t in self._alike(pieces[0]) if ("real", t) in self.now]
        before = [t for t in self.told.things if self.names[t] == self.names[thing] and ("gone", t) in self.now]
        if len(there) > 1:
            end = f"there are {_NUMBERS[min(len(there), 10)]} {plural(self.names[pieces[0]])}"
        elif not left and (half or len(before) > 1):
            end = f"no {self.names[thing]} is whole"
        else:
            end = f"the {self.names[pieces[0]]} is on the {self.names[place]}"
        return f"{'cut' if half else 'dice'} {what} on the {self.names[place]} with the {self.names[tool]}", end

    def _wait(self, action: GroundedAction, thing: str, place: str, state: str) -> tuple[str, str]:
        done = [t for t in self._alike(thing) if (state, t) in self.now]
        names = plural(self.names[thing]) if len(done) > 1 else self.names[thing]
        verb = "are" if len(done) > 1 else "is"
        if state == "on_fire":
            return f"wait until the {names} {verb} burning", self._burns(thing)
        return f"wait until the {names} {verb} {state}", self._many(done, state)
