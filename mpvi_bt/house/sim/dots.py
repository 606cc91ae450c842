"""What cameras see of marks on things: a dot each."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np
import sapien

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.solids import Array, Solid
from mpvi_bt.house.sim.builder import Thing, show
from mpvi_bt.house.states.marks import Marks
from mpvi_bt.house.things.description import Color, Part

_RADIUS_M = 0.006
_LUMP_M = (0.03, 0.03, 0.004)  # half sizes of one on a floor
_COLORS: Mapping[str, Color] = {
    "dust": (0.62, 0.6, 0.56),
    "dirt": (0.36, 0.24, 0.13),
    "mud": (0.25, 0.17, 0.1),
    "debris": (0.3, 0.3, 0.32),
}
_OTHER: Color = (0.45, 0.52, 0.3)


class Dots:
    """The dots of a scene."""

    def __init__(self, scene: sapien.Scene, things: Mapping[str, Thing]) -> None:
        """None is drawn yet. `things` are all that there are in the scene, by name."""
        self._scene, self._things = scene, things
        self._drawn: dict[tuple[str, str], tuple[sapien.Entity, Array]] = {}

    def show(self, marked: Mapping[str, Marks]) -> dict[int, str]:
        """Draw the dots at the current places of things, one dot for each mark.

        Returns:
            Scene ids of dots that are new, to the names of what they are on.
        """
        new = {}
        for name, marks in marked.items():
            for kind, points in marks.points.items():
                entity, drawn = self._drawn.get((name, kind), (None, np.zeros((0, 3))))
                if points is not drawn:
                    if entity is not None:
                        self._scene.remove_entity(entity)
                        del self._drawn[name, kind]
                    if len(points):
                        self._drawn[name, kind] = (self._draw(name, kind, points), points)
                        new[self._drawn[name, kind][0].per_scene_id] = name
        for name, kind in [key for key in self._drawn if not marked.get(key[0], Marks()).count(key[1])]:
            self._scene.remove_entity(self._drawn.pop((name, kind))[0])
        for (name, _), (entity, _) in self._drawn.items():
            entity.set_pose(sapien.Pose(self._things[name].T_world_body()))
        return new

    def _draw(self, name: str, kind: str, points: Array) -> sapien.Entity:
        color = _COLORS.get(kind.partition(".")[0], _OTHER)
        flat = np.array(_LUMP_M) if name.startswith("floor_") else np.full(3, _RADIUS_M)
        form: Literal["cylinder", "sphere"] = "cylinder" if name.startswith("floor_") else "sphere"
        dots = [Part(Solid(form, flat, kin.transform(np.eye(3), point)), color, collides=False) for point in points]
        entity = sapien.Entity()
        entity.name = f"{name}.marks"
        show(entity, dots)
        self._scene.add_entity(entity)
        return entity
