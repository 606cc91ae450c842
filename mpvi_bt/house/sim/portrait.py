"""What a thing of the catalogue looks like: its picture alone, on a floor."""

from __future__ import annotations

import numpy as np
import sapien

from mpvi_bt.ground.geometry.linear_algebra import norm
from mpvi_bt.house.sim.builder import show
from mpvi_bt.house.sim.cameras import Cameras
from mpvi_bt.house.sim.shaders import new_scene
from mpvi_bt.house.sim.views import look_at
from mpvi_bt.house.things.catalogue import CatalogueEntry
from mpvi_bt.house.things.description import PartsOfBody

_FLOOR = (0.93, 0.92, 0.9)
_AJAR = 0.45  # of its way: a door or lid, so that one sees what it is, and what is behind
_FOV_RAD = 0.5
_FROM = np.array([1.0, -0.75, 0.7])  # of the camera, from a thing whose front looks along x


def portrait(entry: CatalogueEntry, size: tuple[int, int] = (320, 240)) -> np.ndarray:
    """A picture of a thing, its doors ajar; (height, width, 3) bytes.

    Args:
        entry: Of the catalogue.
        size: Width and height [px].

    Raises:
        NoRenderingDevice: This machine draws none.
    """
    scene = new_scene(render=True)
    corners = []
    for body in entry.description.bodies:
        entity = sapien.Entity()
        frame = body.frame(_AJAR * body.joint.limit if body.joint else 0.0)
        show(entity, body.parts, skin=body.skin)
        entity.set_pose(sapien.Pose(frame))
        scene.add_entity(entity)
        corners += [part.solid.moved(frame).aabb() for part in body.parts]
    boxes = np.stack(corners)
    low, high = boxes[:, 0].min(0), boxes[:, 1].max(0)
    middle, radius = (low + high) / 2, float(norm(high - low)) / 2
    floor = PartsOfBody()
    floor.box((middle[0], middle[1], low[2] - 0.005), (20 * radius, 20 * radius, 0.01), _FLOOR)
    entity = sapien.Entity()
    show(entity, floor.items)
    scene.add_entity(entity)
    away = _FROM / norm(_FROM) * radius / np.sin(_FOV_RAD / 2)
    cameras = Cameras(scene)
    return cameras.look_from(look_at(middle + away, middle), size, _FOV_RAD).rgb
