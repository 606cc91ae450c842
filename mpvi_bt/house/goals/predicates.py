"""Predicates over the physical state, with the meaning that OmniGibson gives them (reference: bddl, semantics table).

Distances are in metres, in the world frame, z up. Rays see through things ("all hits"), as OmniGibson's do.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from mpvi_bt.ground.errors import UnknownName, UserError
from mpvi_bt.ground.geometry.linear_algebra import norm
from mpvi_bt.ground.geometry.next_to import NEXT_TO_GAP, RAY_M, beside
from mpvi_bt.ground.geometry.rays import crosses, interval, within
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.house.goals.formula import OF_SUBSTANCE, Literal, Truth
from mpvi_bt.house.goals.world_state import WorldState, aabb
from mpvi_bt.house.rules import grains as rule
from mpvi_bt.house.rules import heat

OPEN_FRACTION = 0.05  # of a joint's range

UP, DOWN = np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, -1.0])


def inside(state: WorldState, a: str, b: str) -> bool:
    """The middle of a's bounding box is in b's bounding box and in one of b's container volumes."""
    middle, box = aabb(state, a).mean(0), aabb(state, b)
    if not np.all((box[0] <= middle) & (middle <= box[1])):
        return False
    return any(within(volume, middle) for volume in state.volumes(b))


def touching(state: WorldState, a: str, b: str) -> bool:
    """Physics reports a contact between the two."""
    return state.touching(a, b)


def ontop(state: WorldState, a: str, b: str) -> bool:
    """They touch, and b is met straight down from a's surface but not straight up from it."""
    return resting_on(state, a, b) and not _meets(state, a, b, UP)


def resting_on(state: WorldState, a: str, b: str) -> bool:
    """They touch, and b is met straight down from a's surface.

    Our choice of what a sentence means by "on": unlike `ontop`, so of the lower board of a rack that has another above.
    No literal of a problem is judged by it.
    """
    return state.touching(a, b) and _meets(state, a, b, DOWN)


def under(state: WorldState, a: str, b: str) -> bool:
    """Straight up from a's surface b is met, straight down it is not; and straight up from b, a is not."""
    return _meets(state, a, b, UP) and not _meets(state, a, b, DOWN) and not _meets(state, b, a, UP)


def nextto(state: WorldState, a: str, b: str) -> bool:
    """Their bounding boxes are close for their size, and a horizontal ray from the middle of either meets the other."""
    box_a, box_b = aabb(state, a), aabb(state, b)
    gap = np.maximum(0.0, np.maximum(box_a[0], box_b[0]) - np.minimum(box_a[1], box_b[1]))
    if norm(gap) > NEXT_TO_GAP * np.mean(np.ptp(box_a, axis=0) + np.ptp(box_b, axis=0)):
        return False
    return beside(box_a.mean(0), state.solids(b)) or beside(box_b.mean(0), state.solids(a))


def open_(state: WorldState, a: str) -> bool:
    """Any of its joints is past 5 % of its range."""
    return any(fraction > OPEN_FRACTION for fraction in state.joint_fractions(a))


def toggled_on(state: WorldState, a: str) -> bool:
    """Its switch is on."""
    return state.toggled_on(a)


def cooked(state: WorldState, a: str) -> bool:
    """It was once hot enough."""
    return heat.cooked(*state.heat(a))


def frozen(state: WorldState, a: str) -> bool:
    """It is cold enough now."""
    return heat.frozen(*state.heat(a))


def hot(state: WorldState, a: str) -> bool:
    """It is hot now."""
    return heat.heated(*state.heat(a))


def on_fire(state: WorldState, a: str) -> bool:
    """It burns."""
    return state.heat(a)[0].on_fire


def covered(state: WorldState, a: str, b: str) -> bool:
    """There is at least one mark of a substance on it, or one of its grains touches it."""
    kind = kind_of(b)
    return state.covered(a, kind) or any(state.touching(a, grain) for grain in state.grains(kind))


def real(state: WorldState, a: str) -> bool:
    """It is there: things may be cut up or made. Of a substance any grain will do."""
    return state.exists(a) or bool(state.grains(kind_of(a)))


def contains(state: WorldState, a: str, b: str) -> bool:
    """At least one grain of a substance has its middle in one of a's container volumes."""
    return bool(grains_in(state, a, b))


def filled(state: WorldState, a: str, b: str) -> bool:
    """The grains of a substance in a take up more than a fifth of its container volumes."""
    taken = [solid for grain in grains_in(state, a, b) for solid in state.solids(grain)]
    return rule.filled(rule.space_m3(taken), rule.space_m3(state.volumes(a)))


def grains_in(state: WorldState, a: str, b: str) -> list[str]:
    """The grains of a substance, such as "diced__beet.n.01_1", that a thing contains."""
    volumes = state.volumes(a)
    middles = {grain: aabb(state, grain).mean(0) for grain in (state.grains(kind_of(b)) if volumes else ())}
    return [grain for grain, middle in middles.items() if any(within(volume, middle) for volume in volumes)]


def kind_of(name: str) -> str:
    """The synset of a BDDL name: what a substance's instance stands for."""
    return name.rpartition("_")[0]


def attached(state: WorldState, a: str, b: str) -> bool:
    """It is mounted on the other: the child on the parent, never the other way."""
    return state.attached(a, b)


Unary = Callable[[WorldState, str], bool]
Binary = Callable[[WorldState, str, str], bool]
# Predicates of how warm things are or were. What :init says of them is taken as said: all begin as warm as the room.
OF_HEAT = ("cooked", "frozen", "hot", "on_fire")
UNARY: Mapping[str, Unary] = {
    "open": open_,
    "toggled_on": toggled_on,
    "cooked": cooked,
    "frozen": frozen,
    "hot": hot,
    "on_fire": on_fire,
    "real": real,
}
BINARY: Mapping[str, Binary] = {
    "inside": inside,
    "ontop": ontop,
    "under": under,
    "nextto": nextto,
    "touching": touching,
    "covered": covered,
    "contains": contains,
    "filled": filled,
    "attached": attached,
}


def check_known(literal: Literal) -> None:
    """Raise UnknownName if nobody can tell the literal's truth, UserError if it has too few or many arguments."""
    arity = 1 if literal.predicate in UNARY else 2 if literal.predicate in BINARY else 0
    if not arity:
        raise UnknownName("predicate", literal.predicate, [*UNARY, *BINARY], where=str(literal))
    if len(literal.args) != arity:
        raise UserError(f"{literal}: {literal.predicate} takes {arity} argument{'s' * (arity > 1)}")


def truth_in(state: WorldState, names: Mapping[str, str] | None = None) -> Truth:
    """The truth of literals in `state`.

    Args:
        state: Read at each call, so that one function serves a whole episode.
        names: BDDL object to the scene's name, such as "floor.n.01_1" to "floor_kitchen"; others are the same in both.

    Returns:
        A function that is False for a literal about a thing that does not exist, and raises as `check_known`.
    """
    bound = names or {}

    def truth(literal: Literal) -> bool:
        check_known(literal)
        args = [bound.get(arg, arg) for arg in literal.args]
        asked = () if literal.predicate == "real" else args[:1] if literal.predicate in OF_SUBSTANCE else args
        if not all(map(state.exists, asked)):
            return False
        if len(args) == 1:
            return UNARY[literal.predicate](state, args[0])
        return BINARY[literal.predicate](state, args[0], args[1])

    return truth


def _meets(state: WorldState, a: str, b: str, direction: Array) -> bool:
    """Whether a vertical ray that leaves a's surface, over or under the middle of its bounding box, meets b."""
    middle = aabb(state, a).mean(0)
    spans = [span for solid in state.solids(a) if (span := interval(solid, middle, direction)) is not None]
    outermost = max((span[1] for span in spans), default=0.0)  # where it misses a itself, as in a ring: the middle
    return crosses(state.solids(b), middle + outermost * direction, direction, RAY_M)
