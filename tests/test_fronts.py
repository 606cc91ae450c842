"""Doors and drawers told from points: what a bar says of how a front opens, from points of known fixtures."""

from __future__ import annotations

import numpy as np
import pytest

from mpvi_bt.finding.shapes.fronts import fronts
from mpvi_bt.finding.shapes.moving_parts import Door, moved
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.house.sim.world import SimWorld
from tests.small_house import small_world

EYE, OUTDOORS = np.array([-0.1, 0.25, 1.3]), np.array([-1.7, 0.25, 1.3])
FIXTURES = {
    "refrigerator": "{entry: refrigerator, at: [1.0, 0.0], yaw_deg: 180}",
    "left-hinged cabinet": "{entry: base_cabinet, at: [1.0, 0.0], yaw_deg: 170, shape: {hinge: left}}",
    "two doors": "{entry: base_cabinet, at: [1.0, 0.0], yaw_deg: 190, shape: {size_m: [0.5, 0.9, 0.86], doors: 2}}",
    "oven": "{entry: oven, at: [1.0, 0.0], yaw_deg: 180}",
    "drawers": "{entry: chest_of_drawers, at: [1.0, 0.0], yaw_deg: 175}",
    "boot": "{entry: car, at: [1.1, 0.0], yaw_deg: 180}",
}


def seen(world: SimWorld, noise_m: float = 0.0, eye: Array = EYE) -> Array:
    """(n, 3) points of a thing where rays from the eye first meet its solids, with noise along the rays."""
    solids = world.solids("thing")
    corners = np.stack([s.aabb() for s in solids])
    ahead = (corners[:, 0].min(0) + corners[:, 1].max(0)) / 2 - eye
    ahead /= np.linalg.norm(ahead)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    x, y = np.meshgrid(np.linspace(-0.9, 0.9, 280), np.linspace(-0.8, 0.8, 220))
    rays = ahead + x.reshape(-1, 1) * right + y.reshape(-1, 1) * np.cross(right, ahead)
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    depth = np.full(len(rays), np.inf)
    for solid in solids:  # a cylinder counts as its box
        origin, along = (eye - solid.T[:3, 3]) @ solid.T[:3, :3], rays @ solid.T[:3, :3]
        along = np.where(np.abs(along) < 1e-9, 1e-9, along)
        walls = np.stack([(-solid.half_m - origin) / along, (solid.half_m - origin) / along])
        near, far = walls.min(0).max(1), walls.max(0).min(1)
        depth = np.where((near < far) & (near > 0.05), np.minimum(depth, near), depth)
    hit = np.isfinite(depth)
    depth = depth + np.random.default_rng(0).normal(0.0, noise_m, depth.shape) * np.where(hit, depth, 0.0) ** 2
    return eye + rays[hit] * depth[hit, None]


def matched(door: Door, found: list[Door]) -> Door:
    assert door.bar is not None
    center = door.bar.center
    return min(found, key=lambda d: float(np.linalg.norm(d.bar.center - center)) if d.bar is not None else 9.0)


@pytest.mark.parametrize("noise_m", [0.0, 0.003])
@pytest.mark.parametrize("name", FIXTURES)
def test_closed_fronts_are_told_by_their_bars(name: str, noise_m: float) -> None:
    """Every door is found, of its kind, with its bar to a centimeter and its hinge to a few; nothing else is."""
    world = small_world(thing=FIXTURES[name])
    eye = OUTDOORS if name == "boot" else EYE
    found = fronts(seen(world, noise_m, eye), eye)
    doors = world.doors("thing")
    assert len(found) == len(doors)
    for door in doors:
        like = matched(door, found)
        assert door.bar is not None
        assert like.bar is not None
        assert like.kind == door.kind
        assert np.linalg.norm(like.bar.center - door.bar.center) < 0.02
        assert abs(like.bar.axis @ door.bar.axis) > 0.99
        assert like.bar.outward @ door.bar.outward > 0.99
        assert like.axis @ door.axis > 0.99
        assert like.position < 0.02
        if door.kind == "hinge":
            off = like.origin - door.origin
            assert np.linalg.norm(off - door.axis * (off @ door.axis)) < 0.06


@pytest.mark.parametrize(
    ("name", "body", "fraction", "eye"),
    [
        ("refrigerator", "door", 0.6, (0.1, -1.0, 1.3)),
        ("refrigerator", "door", 0.35, (-0.3, -0.5, 1.3)),
        ("left-hinged cabinet", "door", 0.7, (0.1, 1.0, 1.3)),
        ("drawers", "drawer_3", 0.8, tuple(EYE)),
    ],
)
def test_how_far_a_front_is_open_is_told_from_the_rest(
    name: str, body: str, fraction: float, eye: tuple[float, float, float]
) -> None:
    """An open door is measured against the other faces of its thing, an open drawer against its neighbors."""
    world = small_world(thing=FIXTURES[name])
    world.set_opening("thing", body, fraction)
    world.refresh()
    (door,) = (d for d in world.doors("thing") if d.name == body)
    like = matched(door, fronts(seen(world, eye=np.array(eye)), np.array(eye)))
    assert like.kind == door.kind
    assert abs(like.position - door.position) < (0.1 if door.kind == "hinge" else 0.03)
    assert like.axis @ door.axis > 0.99


@pytest.mark.parametrize("noise_m", [0.0, 0.003])
@pytest.mark.parametrize("y", [-0.6, 1.0])
def test_a_door_that_is_ten_degrees_open_is_not_closed(y: float, noise_m: float) -> None:
    """What a fist has left open is seen from either side not to be closed, and how it turns."""
    world = small_world(thing=FIXTURES["left-hinged cabinet"])
    world.set_opening("thing", "door", 0.09)
    world.refresh()
    (door,) = world.doors("thing")
    eye = np.array([-0.2, y, 1.3])
    (found,) = fronts(seen(world, noise_m, eye), eye)
    assert found.axis @ door.axis > 0.95
    assert found.position > 0.5 * door.position


@pytest.mark.parametrize("name", ["refrigerator", "oven", "drawers"])
def test_a_guessed_front_opens_along_the_true_way(name: str) -> None:
    """The bar that is led along the guessed course stays within two centimeters of where the true door takes it."""
    world = small_world(thing=FIXTURES[name])
    found = fronts(seen(world), EYE)
    for door in world.doors("thing"):
        like = matched(door, found)
        assert door.bar is not None
        for by in (0.1, 0.3) if door.kind == "slide" else (0.4, 1.2):
            true, guessed = (T[:3, :3] @ door.bar.center + T[:3, 3] for T in (moved(door, by), moved(like, by)))
            assert np.linalg.norm(true - guessed) < 0.05


def test_what_has_no_bar_has_no_front() -> None:
    """A plain box and a handful of points show nothing that opens."""
    assert fronts(seen(small_world(thing="{entry: bed, at: [1.4, 0.0]}")), EYE) == []
    assert fronts(np.zeros((20, 3)), EYE) == []
