"""A house from above, with transparent walls between the camera and a room."""

from __future__ import annotations

import numpy as np
import sapien

from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.house.layout.house import House
from mpvi_bt.house.layout.rooms import Wall
from mpvi_bt.house.sim.builder import show
from mpvi_bt.house.sim.world import SimWorld
from mpvi_bt.house.things.description import Part

_SOLID = 0.25  # of a near wall's color is seen. Our choice: it is there, and does not hide
_LEVEL_M = 0.3  # so near the edge of a room a panel bounds it


def cutaway(world: SimWorld, T_world_camera: Array, size: tuple[int, int], fov_rad: float) -> np.ndarray:
    """A picture from the south, (height, width, 3) bytes; the world's own walls are gone afterwards.

    Args:
        world: What is seen.
        T_world_camera: (4, 4) optical frame to world.
        size: Width and height [px].
        fov_rad: Vertical field of view.

    Raises:
        NoRenderingDevice: This machine draws none.
    """
    for entity in world.scene.entities:
        if entity.name.startswith("wall_"):
            entity.find_component_by_type(sapien.render.RenderBodyComponent).disable()
    near = [wall for wall in world.house.walls if is_near(wall, world.house)]
    _add(world, [wall for wall in world.house.walls if wall not in near])
    open_ = world.look_from(T_world_camera, size, fov_rad).rgb
    _add(world, near)
    closed = world.look_from(T_world_camera, size, fov_rad).rgb
    return np.rint((1 - _SOLID) * open_ + _SOLID * closed).astype(np.uint8)


def is_near(wall: Wall, house: House) -> bool:
    """Whether a room begins behind a panel, seen from the south."""
    low, high = wall.solid.aabb()
    if high[0] - low[0] < high[1] - low[1]:
        return False
    y = (low[1] + high[1]) / 2
    rooms = (room.rect for room in house.rooms.values() if not room.outdoors)
    return any(abs(y - y0) < _LEVEL_M and low[0] < x1 and x0 < high[0] for x0, y0, x1, _ in rooms)


def _add(world: SimWorld, walls: list[Wall]) -> None:
    entity = sapien.Entity()
    show(entity, [Part(wall.solid, wall.color) for wall in walls])
    world.scene.add_entity(entity)
