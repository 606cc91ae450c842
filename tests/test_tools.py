"""Tools in a world: what brushes take, what sprayers leave, what mounts hold."""

from __future__ import annotations

import json

import numpy as np
import pytest

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import norm
from mpvi_bt.ground.geometry.solids import bounds, pose
from mpvi_bt.house.sim.world import Placement, SimWorld
from tests.layouts import ACTION_SIZE
from tests.small_house import CATALOGUE, placed, run, small_world

DUST, SPRAY = "dust.n.01", "insectifuge.n.01"
STILL = np.zeros(ACTION_SIZE)


def over(world: SimWorld, entry: str, name: str) -> np.ndarray:
    """A pose in which a thing lies on the middle of another one."""
    low, high = bounds(world.solids(name))
    return pose((*((low + high) / 2)[:2].tolist(), float(high[2]) + 0.001))


def test_a_brush_takes_dust_where_it_goes_and_none_elsewhere() -> None:
    """Over one end of the trumpet it takes what is there; the rest stays, and so does what it does not take."""
    world = small_world({"cornet": placed("cornet", 1.0, 0.0), "brush": placed("scrub_brush", 0.0, 2.0)})
    for kind in (DUST, "rust.n.01"):
        world.mark("cornet", kind)
    before = len(world.save()["marks"]["on"]["cornet"][DUST])
    world.place("brush", over(world, "scrub_brush", "cornet"), fixed=True)
    world.robot.act(STILL)
    world.step()
    left = world.save()["marks"]["on"]["cornet"]
    assert 0 < len(left[DUST]) < before
    assert len(left["rust.n.01"]) == before
    assert world.save()["marks"]["taken"] == {"brush": {DUST: before - len(left[DUST])}}


def test_a_sprayer_marks_what_it_meets_first_while_it_is_on() -> None:
    """The plant before it, not the one behind; nothing while it is off; the same in a world that goes on from there."""
    things = {
        "sprayer": placed("insectifuge_atomizer", 0.5, 0.0, 0.4),
        "near": placed("potted_plant", 1.0, 0.0),
        "far": placed("potted_plant", 1.5, 0.0),
    }
    world, other = small_world(things, base=(-1.5, 0, 0)), small_world(things, base=(-1.5, 0, 0))
    for each in (world, other):
        each.place("sprayer", pose((0.5, 0.0, 0.4)), fixed=True)
    run(world, STILL, 1.0)
    assert not world.covered("near", SPRAY)
    world.turn("sprayer", True)
    run(world, STILL, 1.0)
    assert (world.covered("near", SPRAY), world.covered("far", SPRAY)) == (True, False)
    other.restore(json.loads(json.dumps(world.save())))
    assert other.save()["marks"] == world.save()["marks"]
    for each in (world, other):
        each.robot.act(STILL)
        each.step()
    assert other.save()["marks"]["steps"] == world.save()["marks"]["steps"]


def a_camera_over_a_tripod(turned: float = 0.0) -> SimWorld:
    """It stands on the tripod's head."""
    high = 0.7205
    camera = Placement(CATALOGUE["digital_camera"], pose((1.0, 0.0, high), turned))
    return small_world({"camera": camera, "tripod": placed("camera_tripod", 1.0, 0.0)}, base=(-1.0, 0, 0))


def test_what_comes_to_its_mount_stays_there() -> None:
    """A camera that stands on a tripod as it looks is attached: pushed hard it stays, and in a restored world, too."""
    world = a_camera_over_a_tripod()
    run(world, STILL, 0.3)
    assert world.attached("camera", "tripod")
    assert not world.attached("tripod", "camera")
    other = a_camera_over_a_tripod(turned=1.5)
    other.restore(json.loads(json.dumps(world.save())))
    for each in (world, other):
        assert each.attached("camera", "tripod")
        each.thing("camera").rigid_body.set_linear_velocity([0.0, 0.8, 0.0])
        run(each, STILL, 1.0)
        apart = kin.inverse(each.pose("tripod")) @ each.pose("camera")
        assert norm(apart[:3, 3] - [0.0, 0.0, 0.72]) < 0.01


def test_what_is_turned_off_its_mount_is_not_attached() -> None:
    """Sixty degrees are too many."""
    world = a_camera_over_a_tripod(turned=1.05)
    run(world, STILL, 0.3)
    assert not world.attached("camera", "tripod")


def test_a_mount_gives_way_to_what_tears_hard() -> None:
    """4 cm off it is held by 8 kN, which is too much; 2 cm off by 4 kN, which is not."""
    world = a_camera_over_a_tripod()
    run(world, STILL, 0.3)
    world.place("tripod", world.pose("tripod"), fixed=True)
    mounted = world.pose("camera")
    for off, holds in ((0.02, True), (0.04, False)):
        world.place("camera", kin.transform(mounted[:3, :3], mounted[:3, 3] + [0.0, 0.0, off]), fixed=True)
        world.robot.act(STILL)
        world.step()
        assert world.attached("camera", "tripod") is holds


def test_mud_on_a_floor_is_a_patch_with_a_place() -> None:
    """It has room around it, its marks lie on it, and it is known by its name; the same for the same start."""
    first, again = (small_world({"can": placed("can_of_soda", 0.5, 0.0)}) for _ in range(2))
    for world in (first, again):
        world.mark("floor_hall", "mud.n.03")
    assert first.save()["marks"] == again.save()["marks"]
    (patch,) = first.knowledge().find("mud")
    at = np.array(first.save()["marks"]["on"]["floor_hall"]["mud.n.03"])
    assert ((patch.lowest[:2] <= at[:, :2]) & (at[:, :2] <= patch.highest[:2])).all()
    assert not first.obstacles(patch.center, 0.4)


@pytest.mark.render
def test_marks_vanish_one_by_one() -> None:
    """Where the brush has been, the picture is as it was before the dust; elsewhere it is not."""
    world = small_world({"cornet": placed("cornet", 1.0, 0.0), "brush": placed("scrub_brush", 0.0, 2.0)}, render=True)
    world.settle()
    above = pose((1.0, 0.0, 0.8))
    above[:3, :3] = [[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]
    clean = world.look_from(above).rgb
    world.mark("cornet", DUST)
    dusty = world.look_from(above).rgb
    world.place("brush", over(world, "scrub_brush", "cornet"), fixed=True)
    world._marking.step(world)
    world.place("brush", pose((0.0, 2.0, 0.001)))
    wiped = world.look_from(above).rgb
    assert clean is not None
    assert dusty is not None
    assert wiped is not None
    all_of_it, rest = ((picture != clean).any(-1).sum() for picture in (dusty, wiped))
    assert 0 < rest < all_of_it
