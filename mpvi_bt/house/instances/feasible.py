"""Goals that no arrangement of the things can meet, by their shapes: found before anything is played."""

from __future__ import annotations

from collections.abc import Mapping

from mpvi_bt.house.goals.formula import Formula, Literal, can_hold, signed
from mpvi_bt.house.things.catalogue import CatalogueEntry
from mpvi_bt.house.things.fitting_inside import no_top, not_inside


def why_impossible(goal: Formula, entries: Mapping[str, CatalogueEntry]) -> str | None:
    """Why a goal cannot be met, in a sentence; None: perhaps it can.

    Args:
        goal: Its alternatives (`or`, `exists`, ...) are weighed: one that can be met is enough.
        entries: BDDL name to what the thing is; others, such as floors, are taken as fit for anything.
    """
    causes: dict[Literal, str | None] = {}

    def possible(literal: Literal) -> bool:
        if literal not in causes:
            causes[literal] = _cause(literal, entries)
        return causes[literal] is None

    if can_hold(goal, possible):
        return None
    wanted = (literal for literal, positive in signed(goal) if positive and causes.get(literal))
    literal = next(wanted)
    return f"{literal} can never be true: {causes[literal]}"


def _cause(literal: Literal, entries: Mapping[str, CatalogueEntry]) -> str | None:
    """Why a literal can never be true; None: perhaps it can."""
    known = [entries.get(name) for name in literal.args]
    match literal.predicate, known:
        case "inside", [thing, container] if thing is not None and container is not None:
            cause = not_inside(thing.description, container.description)
            return cause and f"{container.name!r}: {cause}"
        case "ontop", [_, carrier] if carrier is not None and no_top(carrier.description, carrier.mass_kg is None):
            return f"{carrier.name!r} has no level face to put a thing on"
        case (("contains" | "filled"), [vessel, *_]) if vessel is not None and not _has(vessel, "volumes"):
            return f"{vessel.name!r} has no volume that holds things (`volumes`)"
        case "toggled_on", [switched] if switched is not None and not _has(switched, "switches"):
            return f"{switched.name!r} has no switch"
        case "open", [opened] if opened is not None and not opened.description.jointed:
            return f"{opened.name!r} has nothing that opens: no door, lid or drawer"
        case "attached", [child, parent] if child is not None and parent is not None and not _mates(child, parent):
            return f"no mount of {child.name!r} fits one of {parent.name!r} (`mounts`)"
    return None


def _has(entry: CatalogueEntry, what: str) -> bool:
    return any(getattr(body, what) for body in entry.description.bodies)


def _mates(child: CatalogueEntry, parent: CatalogueEntry) -> bool:
    male = {mount.kind for mount in child.mounts if mount.male}
    return bool(male & {mount.kind for mount in parent.mounts if not mount.male})
