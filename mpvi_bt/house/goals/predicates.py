"""Predicates of goals, with the meaning that OmniGibson gives them (bddl's semantics table): which there are, and the
truth of a literal in a state of the world.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from mpvi_bt.ground.errors import UnknownName, UserError
from mpvi_bt.ground.geometry.rays import within
from mpvi_bt.house.goals.formula import OF_SUBSTANCE, Literal, Truth
from mpvi_bt.house.states import grains as rule
from mpvi_bt.house.states import heat
from mpvi_bt.house.states.relations import covered, inside, kind_of, nextto, ontop, open_, touching, under
from mpvi_bt.house.states.world_state import WorldState, aabb


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
