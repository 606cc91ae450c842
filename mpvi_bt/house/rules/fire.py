"""Fire: what can burn and is hot enough burns from then on, and is a source of heat to what is near.

Source: OmniGibson, object_states/on_fire.py.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from mpvi_bt.house.rules.heat import OPEN_PER_S, Heat, Source, Thermal, warmed

BURNS_C = 1000.0
FIRE = Source(at_c=BURNS_C, per_s=OPEN_PER_S, placing="near")


def ignited(heat: Heat, kind: Thermal) -> Heat:
    """Set on fire if it can burn and is hot enough; what burns stays at the temperature of fire."""
    if heat.on_fire or (kind.ignites_c is not None and heat.now_c >= kind.ignites_c):
        return Heat(BURNS_C, max(heat.highest_c, BURNS_C), on_fire=True)
    return heat


def spread(
    heats: Mapping[str, Heat],
    kinds: Mapping[str, Thermal],
    sources: Mapping[str, Sequence[Source]],
    near: Mapping[str, Sequence[str]],
    dt_s: float,
) -> dict[str, Heat]:
    """Every thing's temperature a step later; what burns now warms its neighbors, and what it lights burns next.

    Args:
        heats: Of each thing.
        kinds: Of each thing; one that is missing takes nothing from heat but its temperature.
        sources: That act on each thing now, without those that are on fire.
        near: Things within reach of each thing.
        dt_s: Of the step.
    """
    out: dict[str, Heat] = {}
    for name, heat in heats.items():
        fires = [FIRE for other in near.get(name, ()) if other != name and heats[other].on_fire]
        out[name] = ignited(warmed(heat, [*sources.get(name, ()), *fires], dt_s), kinds.get(name, Thermal()))
    return out
