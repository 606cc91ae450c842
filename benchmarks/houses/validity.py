"""What is wrong with a house for a robot that works in it, by solids and a fine grid; how it was made is not known."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mpvi_bt.ground.geometry.solids import Array, Solid, bounds
from mpvi_bt.hands.robots.r1 import BASE_RADIUS_M
from mpvi_bt.house.layout.house import Fixture, House
from mpvi_bt.house.layout.prior_map import prior_map
from mpvi_bt.house.things.description import RigidBody

# All our choice.
CELL_M = 0.025
HEAD_M = 1.75  # what begins above this is out of reach of hands
STAND_M = 0.45  # from the base's edge to the front of what is used, at the most
SIDEWAYS_M = 0.4  # so far beside its middle, or half its width if that is more
OVERLAP_M = 0.002
OPEN = 0.75  # of its range, a door's or drawer's opening for which there is room
STEP_M = 0.05  # between the points of a door that are looked at
SKIN_M = 0.012  # of what they may touch, such as a frame
BEFORE_SWITCH_M = 0.05


@dataclass
class _Ground:
    """Where the base can be: cells of the largest connected part, and their middles [m]."""

    free: NDArray[np.bool_]
    origin_m: Array
    points: Array = field(init=False)

    def __post_init__(self) -> None:
        cells = np.argwhere(self.free)[:, ::-1]
        self.points = self.origin_m + (cells + 0.5) * CELL_M

    def near(self, low: Array, high: Array) -> Array:
        """(n, 2) places of the base between two corners."""
        return self.points[((self.points >= low) & (self.points <= high)).all(1)]


def faults(house: House) -> list[str]:
    """Everything that is wrong, one line each."""
    ground = _ground(house)
    return [*_cut_off(house, ground), *_unused(house, ground), *_overlapping(house), *_stuck(house), *_switches(house)]


def _ground(house: House) -> _Ground:
    grid = prior_map(house, CELL_M)
    room = ndimage.distance_transform_edt(~grid.occupied) * CELL_M > BASE_RADIUS_M + CELL_M
    parts, _ = ndimage.label(room)
    largest = np.bincount(parts[parts > 0]).argmax()
    return _Ground(parts == largest, np.asarray(grid.origin_m))


def _cut_off(house: House, ground: _Ground) -> Iterator[str]:
    """Rooms that the base does not get into, and doorways that it does not get through."""
    for name, room in house.rooms.items():
        x0, y0, x1, y1 = room.rect
        if not len(ground.near(np.array([x0, y0]) + 0.5, np.array([x1, y1]) - 0.5)):
            yield f"the base does not get into {name}"
    for doorway in house.doorways:
        at = np.array(doorway.at)
        if not len(ground.near(at - 0.06, at + 0.06)):
            yield f"the base does not get through the doorway at {doorway.at}"


def _unused(house: House, ground: _Ground) -> Iterator[str]:
    """Furniture that the base does not get in front of; what has no front may be used from any side."""
    for fixture in house.fixtures.values():
        solids = list(fixture.solids())
        if not solids or not any(part.collides for part in fixture.entry.description.root.parts):
            continue
        low, high = bounds(solids)
        if low[2] > HEAD_M or high[2] < 0.05:
            continue
        reach = BASE_RADIUS_M + STAND_M
        around = ground.near(low[:2] - reach, high[:2] + reach)
        near = np.maximum(np.maximum(low[:2] - around, around - high[:2]), 0.0)
        around = around[(near**2).sum(1) < reach**2]
        if fixture.entry.description.jointed:
            T = fixture.T_world_fixture
            local = (around - T[:2, 3]) @ T[:2, :2]
            own = fixture.entry.description.extent()
            wide = max(SIDEWAYS_M, float(own[1, 1] - own[0, 1]) / 2)
            around = around[(local[:, 0] > own[1, 0]) & (np.abs(local[:, 1]) < wide)]
        if not len(around):
            yield f"the base does not get before {fixture.name}"


def _overlapping(house: House) -> Iterator[str]:
    """Fixtures in each other or in walls; round ones count by the boxes around them."""
    solid = [fixture for fixture in house.fixtures.values() if any(True for _ in fixture.solids())]
    standing = [(fixture.name, np.stack([s.aabb() for s in fixture.solids()])) for fixture in solid]
    panels = [(f"a wall of {wall.room}", wall.solid.aabb()[None]) for wall in house.walls]
    for k, (name, mine) in enumerate(standing):
        for other, theirs in (*standing[:k], *panels):
            low = np.maximum(mine[:, None, 0], theirs[None, :, 0])
            high = np.minimum(mine[:, None, 1], theirs[None, :, 1])
            depth = (high - low).min(-1).max()
            if depth > OVERLAP_M:
                yield f"{name} is {depth * 1000:.0f} mm deep in {other}"


def _stuck(house: House) -> Iterator[str]:
    """Doors and drawers that do not open for what else stands there."""
    walls = [wall.solid for wall in house.walls]
    standing = {fixture.name: list(fixture.solids()) for fixture in house.fixtures.values()}
    for fixture in house.fixtures.values():
        description = fixture.entry.description
        others = walls + [s for name, solids in standing.items() if name != fixture.name for s in solids]
        for body in description.bodies:
            if body.joint is None:
                continue
            points = np.concatenate([_points(solid) for solid in _opened(fixture, body)])
            near = [s for s in others if (s.aabb()[0] < points.max(0)).all() and (s.aabb()[1] > points.min(0)).all()]
            if any(_inside(points, solid).any() for solid in near):
                yield f"the {body.name} of {fixture.name} has no room to open"


def _opened(fixture: Fixture, body: RigidBody) -> Iterator[Solid]:
    assert body.joint is not None
    frame = fixture.T_world_fixture @ body.frame(OPEN * body.joint.limit)
    return (part.solid.moved(frame) for part in body.parts if part.collides)


def _points(solid: Solid) -> Array:
    """(n, 3) points all over a solid's box, in the world."""
    axes = [np.linspace(-h, h, max(2, int(np.ceil(2 * h / STEP_M)) + 1)) for h in solid.half_m]
    local = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    return np.asarray(local @ solid.T[:3, :3].T + solid.T[:3, 3])


def _inside(points: Array, solid: Solid) -> NDArray[np.bool_]:
    local = np.abs((points - solid.T[:3, 3]) @ solid.T[:3, :3])
    return np.asarray((local < solid.half_m - SKIN_M).all(1))


def _switches(house: House) -> Iterator[str]:
    """Switches, and so their lights, that something stands before."""
    solids = [s for fixture in house.fixtures.values() for s in fixture.solids()]
    solids += [wall.solid for wall in house.walls]
    for fixture in house.fixtures.values():
        for body in fixture.entry.description.bodies:
            frame = fixture.T_world_fixture @ body.frame()
            for switch in body.switches:
                before = frame[:3, :3] @ (switch.center + BEFORE_SWITCH_M * switch.outward) + frame[:3, 3]
                if any(_inside(before[None], solid)[0] for solid in solids):
                    yield f"something is before the switch of {fixture.name}"
