"""What is really so, by the world: for the checker named oracle, and for counting afterwards how often judges erred."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

from mpvi_bt.executive.completion.criteria import Relation
from mpvi_bt.executive.completion.oracle import OracleChecker
from mpvi_bt.executive.ticking.loop import Watcher, World
from mpvi_bt.executive.tree.build import Tree
from mpvi_bt.finding.navigation.goals import HandoffDistances, distance_to
from mpvi_bt.ground.robot.protocol import SIDES, Side
from mpvi_bt.house.goals.predicates import BINARY, UNARY
from mpvi_bt.house.states.relations import resting_on

if TYPE_CHECKING:
    from mpvi_bt.house.sim.world import SimWorld as SimulatedWorld

_AT_M = HandoffDistances().distance_m + HandoffDistances().slack_m  # as far as a base stops that was sent to a thing
_PREDICATES: Mapping[Relation, tuple[str, bool]] = {
    **{
        relation: (relation, False)
        for relation in ("inside", "ontop", "nextto", "under", "open", "cooked", "frozen", "hot", "attached")
    },
    "burning": ("on_fire", False),
    "closed": ("open", True),
    "on": ("toggled_on", False),
    "off": ("toggled_on", True),
}
_BINARY = {**BINARY, "ontop": resting_on}


class TrueState:
    """What the oracle asks, from the world (implements `completion.oracle.CheckedTruth`)."""

    def __init__(self, world: SimulatedWorld) -> None:
        self._world = world

    def held(self, name: str, side: Side | None) -> bool:
        """Whether a hand, or that hand, holds the thing."""
        return any(self._world.holding(s) == name for s in SIDES if side in (None, s))

    def lifted(self, name: str) -> bool:
        """Whether a hand holds it, or nothing but the robot and what lies in it touches it."""
        if not self._world.exists(name):
            return False
        others = set(self._world.things) - {name, *self._world.within(name)}
        return self.held(name, None) or not any(self._world.touching(name, other) for other in others)

    def at(self, phrase: str) -> bool | None:
        """By the distance from its base to the thing's box, or by the room that it is in."""
        base = self._world.knowledge()
        here = self._world.robot.proprioception().base_pose[:2]
        found = base.find(phrase)
        rooms = {e.name: distance_to(e, here) == 0 for e in base if e.kind == "room"}
        near = (rooms.get(e.room or "", True) and distance_to(e, here) <= _AT_M for e in found if not e.held)
        if any(e.kind == "room" for e in found):
            near = (rooms[e.name] for e in found if e.kind == "room")
        return any(near) if found else None

    def so(self, relation: Relation, name: str, other: str) -> bool | None:
        """By BDDL's predicates; "on" is `resting_on`. "clean" is without marks, "sprayed" with any."""
        if relation in ("clean", "sprayed"):
            return self._world.marked(name) is (relation == "sprayed")
        predicate, negated = _PREDICATES.get(relation, ("", False))
        there = all(self._world.exists(thing) for thing in (name, other) if thing)
        if relation in ("there", "cut") or not there:  # what was cut up, or is still to come
            return there if relation != "cut" else not there
        if predicate == "open" and not self._world.joint_fractions(name):
            return False  # what cannot be opened is not closed either
        if predicate == "toggled_on" and not self._world.switches(name):
            return False
        if predicate in UNARY:
            return UNARY[predicate](self._world, name) is not negated
        return _BINARY[predicate](self._world, name, other) if predicate else None


class Audit(Watcher):
    """Notes what was really so whenever a judge answered. It is read after the episode; nothing in a tree sees it.

    The truth is that of the answer's tick: that is when a false yes ends a unit that is not done.

    Args:
        oracle: Who knows.
        earlier: What was noted before the episode was stopped, if it is one that goes on.

    Attributes:
        truths: For each query of the log, whether its criterion was so; None: not known, or not simulated.
    """

    def __init__(self, oracle: OracleChecker, earlier: Iterable[bool | None] = ()) -> None:
        self._oracle = oracle
        self.truths: list[bool | None] = list(earlier)

    def step(self, tree: Tree, world: World) -> None:
        """Look at the answers that are new."""
        queries = tree.context.log.queries
        if len(queries) > len(self.truths):
            self.truths += [self._oracle.decide(query.criterion)[0] for query in queries[len(self.truths) :]]
