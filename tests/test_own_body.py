"""The robot's own parts in a picture, by its joints."""

from __future__ import annotations

import numpy as np
import pytest

from mpvi_bt.finding.perception.segmentation import SegmentationDetector
from mpvi_bt.finding.scene.frames import take
from mpvi_bt.finding.scene.own_body import own_body
from mpvi_bt.house.sim.world import SimWorld
from tests.small_house import run, small_world


def reaching() -> SimWorld:
    """A world with an arm that is seen by the head."""
    world = small_world(render=True)
    world.settle()
    action = world.robot.action
    arm = world.robot.model.layout.arm["right"]
    action[arm] += np.random.default_rng(3).uniform(-0.7, 0.7, len(action[arm]))
    run(world, action, 1.5)
    return world


class Blind:
    """A detector that finds nothing, not even the robot."""

    name = "blind"

    def detect(self, image: object, phrases: object) -> list[object]:
        return []


@pytest.mark.render
@pytest.mark.parametrize("camera", ["head", "right"])
def test_most_of_an_arm_is_told_by_joints_and_nothing_else_is(camera: str) -> None:
    """As the renderer labels it, but for fingers and corners."""
    world = reaching()
    image, felt = world.robot.look(camera), world.robot.proprioception()
    assert image.labels is not None
    true = np.isin(image.labels, [k for k, name in image.names.items() if name == "robot"])
    told = own_body(image.points_world(), felt)

    assert (told & ~true).sum() <= 0.1 * max(true.sum(), 1)
    frame = take(image, felt, Blind(), (), 0, 0.0)  # type: ignore[arg-type]
    assert (frame.robot & told).sum() == told.sum()
    labeled = take(image, felt, SegmentationDetector({}), (), 0, 0.0)
    assert (labeled.robot & true).sum() == true.sum()
