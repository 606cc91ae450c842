"""Things of which a picture shows only a part are known as one thing when more of them is seen."""

from __future__ import annotations

import numpy as np
import pytest

from mpvi_bt.finding.perception.segmentation import SegmentationDetector
from mpvi_bt.finding.scene.seen import Seen
from mpvi_bt.finding.shapes.in_part import in_part
from mpvi_bt.finding.shapes.shape import Shape
from mpvi_bt.ground.geometry.solids import box
from mpvi_bt.house.sim.world import SimWorld
from tests.layouts import LAYOUT
from tests.small_house import run, small_world

pytestmark = pytest.mark.render

HUNG = "{entry: wall_cabinet, at: [1.3, 0.0], yaw_deg: 180, z_m: 1.35}"
OVER, UP = 0.55, 0.0  # tilts of the head: its lower edge in the picture, and all of it [rad]


def look(world: SimWorld, seen: Seen, tilt: float) -> None:
    action = world.robot.action
    action[LAYOUT.torso] = [0.55, 0.0, 0.0, tilt]
    run(world, action, 1.5)
    seen.see({"head": world.robot.look("head")}, world.robot.proprioception())


@pytest.mark.parametrize("opened", [0.0, 0.6])
def test_a_strip_of_a_thing_becomes_the_thing(opened: float) -> None:
    """A wall cabinet whose lower edge was in the picture stays one thing, known up to its top once that is in view.

    Closed it is as tall as it is; of one that stands open the boards that are seen count, and the room between them.
    """
    world = small_world(base=(-0.3, 0.0, 0.0), render=True, thing=HUNG)
    world.set_opening("thing", "door", opened)
    world.settle(0.3)
    seen = Seen(SegmentationDetector({"thing": ("wall cabinet",)}, least_px=1))
    seen.forget(["wall cabinet"])
    look(world, seen, OVER)
    assert len(seen.knowledge().find("wall cabinet")) == 1
    look(world, seen, UP)
    (entry,) = seen.knowledge().find("wall cabinet")
    tops = [solid.aabb()[1, 2] for solid in world.solids("thing")]
    assert abs(entry.highest[2] - max(tops)) < 0.05
    if opened:
        (room,) = seen.volumes(entry.name)
        low, high = room.aabb()
        assert (low > [1.1, -0.3, 1.67]).all(), "above the shelf"
        assert (high < [1.48, 0.3, 2.05]).all()
        assert np.prod(high - low) > 0.6 * 0.28 * 0.56 * 0.32
    else:
        assert np.ptp([entry.lowest[2], entry.highest[2]]) > 0.5


@pytest.mark.parametrize(("deep_m", "part"), [(0.11, True), (0.3, False)])
def test_a_strip_of_the_room_in_a_thing_is_a_part_of_it(deep_m: float, part: bool) -> None:
    """A bowl in hand hides most of the sink that it is to be put into: the room that was seen before is there still."""

    def sink(deep_m: float) -> Shape:
        basin = box((0.0, 0.0, 0.8), (0.52, deep_m, 0.2))
        return Shape("furniture", np.eye(4), (box((0.0, 0.0, 0.9), (0.6, 0.6, 0.04)),), 0.0, (basin,))

    assert in_part(sink(deep_m), sink(0.38)) is part
