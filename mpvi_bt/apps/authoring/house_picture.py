"""Pictures of houses from above: as a task begins there, or furnished only."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.house.instances.instances import begin, expanded_problem
from mpvi_bt.house.instances.tasks import load_task
from mpvi_bt.house.layout.house import House, load_house
from mpvi_bt.house.layout.prior_map import prior_map
from mpvi_bt.house.sim.cutaway import cutaway
from mpvi_bt.house.sim.views import overview
from mpvi_bt.house.sim.world import SimWorld
from mpvi_bt.house.things.catalogue import load_catalogue
from mpvi_bt.runs.recording.labels import Picture
from mpvi_bt.runs.recording.named_house import name_things

_WIDE = (1400, 640)
_HIGH = (1000, 1000)  # of a house that is no wider than it is deep
_FOV_RAD = 0.6
_TILT_RAD = 0.5  # of the camera over a house: one sees floors and things on them, and walls as such


def task_picture(name: str) -> Picture:
    """The house of a task from above, as its first instance begins, with the names of what is in it."""
    task, catalogue = load_task(name), load_catalogue()
    house = load_house(task.house)
    world, start = begin(task, house, catalogue, expanded_problem(task, house), 0)
    things = [
        (start.objects[name].entry.phrases[0], np.concatenate([solid.aabb() for solid in world.solids(name)]))
        for name in world.objects
    ]
    return _named(world, _WIDE, things)


def house_picture(house: House) -> Picture:
    """A house from above with the names of its fixtures; the robot stands where most floor is around it."""
    from scipy import ndimage

    grid = prior_map(house)
    clear = ndimage.distance_transform_edt(np.pad(~grid.occupied, 1))[1:-1, 1:-1]
    row, column = divmod(int(clear.argmax()), clear.shape[1])
    x0, y0, x1, y1 = house.bounds()
    world = SimWorld(house, {}, np.array([*grid.center(row, column), 0.0]))
    return _named(world, _WIDE if x1 - x0 > y1 - y0 else _HIGH, ())


def _named(world: SimWorld, size: tuple[int, int], things: Iterable[tuple[str, Array]]) -> Picture:
    """A picture from above, with names of things and of fixtures."""
    camera = overview(world.house, _FOV_RAD, size[0] / size[1], _TILT_RAD)
    picture = cutaway(world, camera, size, _FOV_RAD)
    fixtures = ((fixture.entry.phrases[0], fixture.extent()) for fixture in world.house.fixtures.values())
    name_things(picture, camera, _FOV_RAD, [*things, *fixtures])
    return picture
