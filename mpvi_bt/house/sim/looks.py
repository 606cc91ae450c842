"""Visible effects of heat: flames on burning things, and the looks of cooked and frozen things."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping

import numpy as np
import sapien

from mpvi_bt.ground.geometry.solids import Array, Solid, bounds, pose
from mpvi_bt.house.sim.builder import Thing, paint, show
from mpvi_bt.house.states.heat import cooked, frozen
from mpvi_bt.house.states.temperature import Heat, Thermal
from mpvi_bt.house.things.description import Color, Part

# Our choice: brown over the thing's own color, or white; how much of it.
_TINTS: Mapping[str, tuple[Color, float]] = {"cooked": ((0.23, 0.11, 0.04), 0.6), "frozen": ((0.85, 0.93, 1.0), 0.6)}
_FLAMES: tuple[tuple[float, float, Color], ...] = (  # height [m], diameter [m], color: the lowest first
    (0.02, 0.09, (0.95, 0.35, 0.05)),
    (0.07, 0.06, (1.0, 0.6, 0.1)),
    (0.11, 0.03, (1.0, 0.85, 0.3)),
)
_AWAY = pose((0.0, 0.0, -9.0))  # below the floor, out of every picture


class ThermalLooks:
    """How warm things look; built for cameras only."""

    def __init__(self, scene: sapien.Scene, things: Mapping[str, Thing], kinds: Mapping[str, Thermal]) -> None:
        """Everything looks as it was made.

        Args:
            scene: Where the things are.
            things: By name.
            kinds: What heat does to each thing that is followed.
        """
        self._things = things
        self._flames = {n: _flames(scene, n) for n, kind in kinds.items() if kind.ignites_c is not None}
        self._as_made = {name: _colors(things[name].entities.values()) for name in kinds}
        self._looks = dict.fromkeys(kinds, "")

    @property
    def labels(self) -> dict[int, str]:
        """Scene ids of flames, to the names of what they burn on."""
        return {flames.per_scene_id: name for name, flames in self._flames.items()}

    def show(self, heat: Callable[[str], tuple[Heat, Thermal]]) -> None:
        """Bring what cameras see to how warm things are."""
        for name in self._looks:
            state, kind = heat(name)
            look = "frozen" if frozen(state, kind) else "cooked" if cooked(state, kind) or state.on_fire else ""
            if look != self._looks[name]:
                self._looks[name] = look
                for material, made in self._as_made[name]:
                    color, share = _TINTS.get(look, ((0.0, 0.0, 0.0), 0.0))
                    material.set_base_color([*(made[:3] * (1 - share) + np.power(color, 2.2) * share), 1.0])
            if name in self._flames:
                low, high = bounds(self._things[name].solids())
                top = pose((*((low + high) / 2)[:2].tolist(), float(high[2])))
                self._flames[name].set_pose(sapien.Pose(top if state.on_fire else _AWAY))


def _flames(scene: sapien.Scene, name: str) -> sapien.Entity:
    entity = sapien.Entity()
    entity.name = f"{name}.flames"
    parts = [
        Part(Solid("sphere", np.full(3, wide / 2), pose((0.0, 0.0, z))), color, collides=False)
        for z, wide, color in _FLAMES
    ]
    show(entity, parts, _glowing)
    scene.add_entity(entity)
    entity.set_pose(sapien.Pose(_AWAY))
    return entity


def _glowing(color: Color) -> sapien.render.RenderMaterial:
    material = paint(color)
    material.set_emission([*color, 1.0])
    return material


def _colors(entities: Collection[sapien.Entity]) -> list[tuple[sapien.render.RenderMaterial, Array]]:
    """The materials of some entities, each with the color that it was made with."""
    found = []
    for entity in entities:
        body = entity.find_component_by_type(sapien.render.RenderBodyComponent)
        for shape in body.render_shapes if body is not None else ():
            for part in shape.parts:
                found.append((part.material, np.array(part.material.base_color, float)))
    return found
