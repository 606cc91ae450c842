"""What skills do to a world on paper, by the needs and effects of their files."""

from __future__ import annotations

import re

from mpvi_bt.executive.completion import criteria
from mpvi_bt.executive.plan.skills import SkillCall
from mpvi_bt.executive.rehearsal.paper_world import CannotBe, PaperWorld
from mpvi_bt.ground.words.phrases import read

_SEVERAL = re.compile(r"(?:both|two|three|four|five|six|seven|eight|nine|ten|[2-9]|[1-9]\d)\b", re.IGNORECASE)
_BOTH = re.compile(r"both\b", re.IGNORECASE)
_BESIDE = re.compile(r"(?:beside|next to) (.+)")


class PaperHands(PaperWorld):
    """A world that skills change."""

    def do(self, call: SkillCall, criterion: criteria.Criterion | None) -> str | None:
        """Carry out a skill; its criterion says what is made, where it makes something.

        Returns:
            Why that changes nothing; None if it does, or may.

        Raises:
            CannotBe: What its file says that it needs is not so.
        """
        needs, effects, words = call.skill.needs, call.skill.effects, call.arguments
        hand = words.get("hand")
        hand = hand if hand in self.held else None
        for _ in range(needs.hands):
            self._free(None if effects.passed else hand, needs.hands)
        said = next((slot for slot in needs.held if slot in words), None)
        in_hand = self._in_hand(words[said], hand) if said is not None else None
        if effects.held is not None:
            self._take(words[effects.held], words.get("source"), hand, call.skill.hands)
            return None
        if effects.passed is not None and in_hand is not None:
            return self._pass_on(in_hand, words.get("to_hand"))
        meant: dict[str, str] = {} if said is None or in_hand is None else {said: in_hand}
        pair = effects.put or effects.attached
        for slot in needs.near:
            if slot in words and slot not in meant:
                board = words.get("surface") if slot == effects.cut else None
                meant[slot] = self._reached(words[slot], slot in (effects.open, effects.closed), in_hand, board)
        self._check(call, meant)
        if pair is not None and in_hand is not None:
            self._put(call, in_hand, meant.get(pair[1]))
            return None
        return self._change(call, meant, criterion)

    def _check(self, call: SkillCall, meant: dict[str, str]) -> None:
        needs = call.skill.needs
        for slots, closed in ((needs.open, True), (needs.closed, False)):
            for thing in (meant[slot] for slot in slots if slot in meant):
                if thing in self.openable and (thing not in self.open) == closed:
                    state, deed = ("closed", "open") if closed else ("open", "close")
                    raise CannotBe(f"{self.name(thing)} is {state}: {deed} it first")
        for thing in (meant[slot] for slot in needs.on if slot in meant):
            if thing not in self.on and thing not in self.guessed:
                raise CannotBe(f"{self.name(thing)} is off: turn it on first")

    def lose(self, side: str) -> None:
        """A hand turns out to be empty; where that is which it held, nobody knows."""
        lost = self.held[side]
        self.held = {other: None if held == lost else held for other, held in self.held.items()}

    def grip(self, side: str, thing: str) -> None:
        """A hand turns out to hold a thing."""
        self._leave(thing)
        self.held = {other: None if held == thing else held for other, held in self.held.items()}
        self.held[side] = thing

    # Hands

    def _free(self, hand: str | None, number: int = 1) -> str:
        """A free hand. With two of them both have to be."""
        free = [side for side in self.held if self.held[side] is None and hand in (None, side)]
        if (free and number < 2) or len(free) == len(self.held):
            return free[-1]
        full = [s for s in self.held if self.held[s] is not None and (number > 1 or hand in (None, s))]
        one = "it holds" if hand and number < 2 else "the {} one holds"
        held = " and ".join(f"{one.format(s)} {self.name(self.held[s] or '')}" for s in full)
        if len(full) > len({self.held[s] for s in full}):
            held = f"both hold {self.name(self.held[full[0]] or '')}"
        wanted = "both hands have" if number > 1 else f"the {hand} hand has" if hand else "a hand has"
        raise CannotBe(f"{wanted} to be free, and {held}")

    def _in_hand(self, phrase: str, hand: str | None) -> str:
        """What a phrase means of what is held."""
        held = {side: thing for side, thing in self.held.items() if thing is not None}
        named = self.named(phrase)
        mine = [t for side, t in held.items() if t in named and hand in (None, side)]
        # Words of things that nobody knows may mean each other: a mug may be the cup
        mine = mine or [t for side, t in held.items() if t in self.guessed and hand in (None, side)]
        if mine:
            return mine[0]
        if doubted := [side for side in self.doubted if hand in (None, side)]:
            thing = self.guess(phrase)
            if len(doubted) == 1:
                self.held[doubted[0]] = thing
                self.doubted -= {*doubted}
            return thing
        if not held:
            raise CannotBe(f"nothing is held: pick up {phrase!r} first")
        hands = " and ".join(f"the {side} hand holds {self.name(thing)}" for side, thing in held.items())
        raise CannotBe(f"{f'the {hand} hand does not hold' if hand else 'no hand holds'} {phrase!r}: {hands}")

    def _take(self, phrase: str, source: str | None, hand: str | None, hands: int) -> None:
        if hands < 2 and _SEVERAL.match(phrase):
            raise CannotBe(f"one hand holds one thing: {phrase!r}; say it once for each")
        sides = list(self.held) if hands == 2 else [self._free(hand)]
        near, sources = self.near(), self.named(source) if source else []

        def there(thing: str) -> bool:
            loose = thing in near and thing not in self.held.values() and thing not in self.start.rooms
            known = sources and not self.somewhere(thing)
            return loose and self.shut_in(thing) is None and (not known or any(self._of(thing, s) for s in sources))

        thing = self.one(phrase, there, "can be taken" + (f" from {source!r}" if source else ""), old=False)
        self._leave(thing)
        self.held |= dict.fromkeys(sides, thing)
        self.doubted -= {*sides}
        self.used.append(thing)

    def _of(self, thing: str, source: str) -> bool:
        """Whether it is beside something, or on, in or under it; it may lie in a box that is under a bed."""
        if source in self.guessed or any({thing, source} == {a, b} for _, a, b in self.pairs):
            return True
        support = self.at.get(thing, ("", ""))[1]
        while support not in ("", source) and ("under", support, source) not in self.pairs:
            support = self.at.get(support, ("", ""))[1]
        return bool(support)

    def _leave(self, thing: str) -> None:
        """It is not where it was; what is on it goes with it, and the robot stays where it is."""
        _, support = self.at.pop(thing, ("", ""))
        self.spot |= {support} if support in self.called and support not in self.start.floors else set()
        self.spot |= {place} if (place := self.beside.pop(thing, None)) is not None else set()
        self.pairs = {p for p in self.pairs if thing not in p}

    def _pass_on(self, thing: str, to_hand: str | None) -> str | None:
        if to_hand not in self.held:
            to_hand = next((side for side, held in self.held.items() if held is None), None)
        if to_hand is None or self.held[to_hand] == thing:
            return f"{self.name(thing)} is in that hand already" if to_hand else None
        self._free(to_hand)
        self.held = {side: None if held == thing else held for side, held in self.held.items()}
        self.held[to_hand] = thing
        return None

    # Things

    def _reached(self, phrase: str, door: bool, than: str | None, board: str | None = None) -> str:
        """What a phrase means of what is in reach; of a `door`, what can be opened; what lies on a `board`."""
        near, boards = self.near(), self.named(board) if board else []

        def fits(thing: str) -> bool:
            doors = not door or thing in self.openable or thing in self.guessed
            there = not boards or self.somewhere(thing) or any(self._of(thing, b) for b in boards)
            return thing in near and thing != than and doors and there and self.shut_in(thing) is None

        what = "has a door or a lid" if door else f"is on the {board}" if board else "is in reach"
        thing = self.one(phrase, fits, what, than=than)
        self.used.append(thing)
        return thing

    def _put(self, call: SkillCall, thing: str, other: str | None) -> None:
        """Let go of what is held, in, on, beside or under a thing."""
        effects, words = call.skill.effects, call.arguments
        near = self.near()
        relation, support = "inside" if effects.inside else "ontop", other
        if effects.nextto or effects.under:
            support = None
            surface = words.get("surface")
            if surface is not None:
                support = self.one(surface, lambda t: t in near and t != thing, "is in reach", than=thing)
            elif effects.nextto and other is not None and other not in self.held.values():
                relation, support = self.at.get(other, ("", None))
                support = support if relation in ("inside", "ontop") else None
                relation = relation if relation == "inside" else "ontop"
            if support is None:
                floors = [t for t in near if t in self.start.floors]
                relation, support = ("ontop", floors[0]) if floors else ("room", self.room)
        elif support is None:
            support = self.room
        self._leave(thing)
        self.held = {side: None if held == thing else held for side, held in self.held.items()}
        self.at[thing] = (relation, support)
        if support in self.start.floors or relation == "room":
            self.beside[thing] = self.place
        if other is not None and effects.nextto:
            self.pairs.add(("nextto", thing, other))
        if other is not None and effects.under:
            self.pairs.add(("under", thing, other))
            reading = read(words[effects.under[1]])
            if reading is not None and (beside := _BESIDE.fullmatch(reading.place)):
                by = self.one(beside[1], lambda t: t in near and t != thing, "is in reach", than=thing)
                self.pairs.add(("nextto", thing, by))
        if effects.attached:
            self.attached.add((thing, support))
        self.moved[thing] += 1
        self.used += [thing, support]

    def _change(self, call: SkillCall, meant: dict[str, str], criterion: criteria.Criterion | None) -> str | None:
        """All other effects. Returns why there is none."""
        effects, words = call.skill.effects, call.arguments
        for slot, opens in ((effects.open, True), (effects.closed, False)):
            if slot in meant:
                thing = meant[slot]
                if thing in self.openable and (thing in self.open) == opens:
                    return f"{self.name(thing)} is {'open' if opens else 'closed'} already"
                self.openable.add(thing)
                (self.open.add if opens else self.open.discard)(thing)
                if opens and thing in self.start.closed_only:
                    self.on.discard(thing)
        if effects.on in meant:
            return self._switch(meant[effects.on], words.get("state") != "off")
        if effects.poured is not None:
            self._pour(call, meant, criterion)
        if effects.pushed is not None and effects.pushed[0] in meant and effects.pushed[1] in words:
            near, others = self.near(), self.meant(words[effects.pushed[1]])
            others.sort(key=lambda t: t not in near)
            self.pairs |= {("nextto", meant[effects.pushed[0]], other) for other in others[:1]}
        if effects.clean in meant:
            marked = {(t, s) for t, s in self.covered if t == meant[effects.clean]}
            self.covered -= marked
            if not marked and meant[effects.clean] not in self.guessed:
                return f"{self.name(meant[effects.clean])} is clean already"
        if effects.sprayed in meant:
            tool = next((t for t in meant.values() if t in self.sources), None)
            self.covered |= {(meant[effects.sprayed], self.sources[tool])} if tool is not None else set()
        if effects.burning in meant:
            self.burning.add(meant[effects.burning])
        if effects.cut in meant:
            self.gone |= self._cut(words[effects.cut], meant[effects.cut])
            self.bring_about(criterion)
        if effects.meanwhile is not None:
            return self._pass_time(words.get(effects.meanwhile, ""), criterion)
        return None

    def _cut(self, phrase: str, first: str) -> set[str]:
        """The first, or both of them where that is said, if both lie there."""
        if not _BOTH.match(phrase):
            return {first}
        return {t for t in self.meant(phrase) if self.at.get(t) == self.at.get(first)}

    def _switch(self, thing: str, on: bool) -> str | None:
        if on and thing in self.start.closed_only and thing in self.open:
            raise CannotBe(
                f"{self.name(thing)} is open, and it can be turned on only while it is closed: close it first"
            )
        known = thing not in self.guessed
        if known and (thing in self.on) == on:
            return f"{self.name(thing)} is {'on' if on else 'off'} already"
        (self.on.add if on else self.on.discard)(thing)
        if on and thing in self.start.washes:
            self.covered = {(t, s) for t, s in self.covered if not self.inside(t, thing)}
        return None

    def _pour(self, call: SkillCall, meant: dict[str, str], criterion: criteria.Criterion | None) -> None:
        assert call.skill.effects.poured is not None
        source, target = (meant.get(slot) for slot in call.skill.effects.poured)
        held = next((t for t in meant.values() if t in self.held.values()), source)
        if held is None or target is None:
            return
        out = self.on_or_in(held)
        if "object" in call.arguments and "source" in call.arguments:
            out &= set(self.named(call.arguments["object"])) or out
        onto = criterion is not None and criterion.relation == "ontop"
        for thing in out:
            self.at[thing] = ("ontop" if onto else "inside", target)

    def _pass_time(self, phrase: str, criterion: criteria.Criterion | None) -> str | None:
        """What is on or in what heats is cooked then, what is in a closed fridge frozen; fire spreads."""
        before = [set(self.cooked), set(self.frozen), set(self.burning), set(self.gone)]
        self.burning |= {thing for thing, (_, below) in self.at.items() if below in self.burning}
        for thing in self.at:
            self.cooked |= {thing} if self._heated(thing) else set()
            below = self.at[thing][1]
            while below:
                if below in self.start.cools and below not in self.open:
                    self.frozen.add(thing)
                below = self.at.get(below, ("", ""))[1]
        if criterion is not None and self.gone & set(criteria.named(criterion.subject, self.called)):
            where = criteria.named(criterion.object, self.called) if criterion.object else []
            if where and not any(map(self._heated, where)) and not self.guessed & set(where):
                raise CannotBe(self._cold(where[0]))
            self.bring_about(criterion)
        known = phrase and self.known.named(phrase)
        same = before == [self.cooked, self.frozen, self.burning, self.gone]
        return "nothing is heated, cooled or on fire in the meantime" if same and known else None

    def _cold(self, thing: str) -> str:
        """Why nothing heats a thing."""
        place = thing
        while place and place not in self.start.heats:
            place = self.at.get(place, ("", ""))[1]
        if not place:
            return f"nothing heats {self.name(thing)}: it is not on or in what does"
        return f"{self.name(place)} is {'open: close it' if place in self.on else 'off: turn it on'} first"

    def _heated(self, thing: str) -> bool:
        """Whether it is on or in something that heats it now, or is that itself."""
        while thing:
            shut = self.start.heats.get(thing)
            if shut is not None and thing in self.on and not (shut and thing in self.open):
                return True
            thing = self.at.get(thing, ("", ""))[1]
        return False

    def bring_about(self, criterion: criteria.Criterion | None) -> bool:
        """Make a criterion so where that is said of a place or of what is made; whether it could be."""
        if criterion is None or criterion.relation not in ("inside", "ontop", "nextto", "there", "under"):
            return False
        others = criteria.named(criterion.object, self.called)
        for thing in criteria.named(criterion.subject, self.called)[: criterion.count]:
            self.gone.discard(thing)
            if criterion.relation in ("nextto", "under") and others:
                self.pairs.add((criterion.relation, thing, others[0]))
            elif others:
                self.at[thing] = (criterion.relation, others[0])
        return True
