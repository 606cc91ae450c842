"""Skills with held tools, from taking the thing up to what becomes of the world."""

from __future__ import annotations

import pytest

from mpvi_bt.house.sim.world import SimWorld
from tests.small_house import placed, small_world
from tests.test_open import play

TABLE = "{entry: table, at: [1.0, 0.0], yaw_deg: 180}"


def done(world: SimWorld, *prompts: str) -> SimWorld:
    """The world after some prompts, each carried out by the expert."""
    for prompt in prompts:
        said = play(world, prompt, limit_s=150)
        assert said[-1] == "done", (prompt, said)
    return world


@pytest.mark.slow
def test_a_held_lighter_is_turned_on_and_lights_a_newspaper() -> None:
    """The other hand turns it on, held over the paper it sets it alight, and the fire goes over to the firewood."""
    things = {
        "lighter": placed("cigar_lighter", 0.75, 0.3, 0.721),
        "paper": placed("newspaper", 0.85, -0.1, 0.721),
        "wood": placed("firewood", 1.05, -0.1, 0.721),
    }
    world = done(
        small_world(things, base=(-0.3, 0, 0), t=TABLE),
        "pick up the cigar lighter",
        "turn on the cigar lighter",
        "light the newspaper with the cigar lighter",
        "turn off the cigar lighter",
    )
    assert world.heat("paper")[0].on_fire
    assert world.heat("wood")[0].on_fire
    assert not world.toggled_on("lighter")


@pytest.mark.slow
def test_a_plant_is_sprayed() -> None:
    """The bottle is aimed at it, turned on, and off again."""
    things = {"atomizer": placed("insectifuge_atomizer", 0.5, 0.6), "plant": placed("potted_plant", 1.2, -0.5)}
    world = done(
        small_world(things, base=(-0.5, 0, 0)),
        "pick up the atomizer",
        "spray the plant with the atomizer",
    )
    assert world.covered("plant", "insectifuge.n.01")
    assert not world.toggled_on("atomizer")


@pytest.mark.slow
def test_a_camera_is_mounted_on_a_tripod() -> None:
    """It is attached when the hand has gone."""
    things = {
        "camera": placed("digital_camera", 0.6, 0.6, yaw=1.0),
        "tripod": placed("camera_tripod", 1.2, -0.4, yaw=2.0),
    }
    world = done(
        small_world(things, base=(-0.5, 0, 0)),
        "pick up the camera",
        "mount the camera on the tripod",
    )
    assert world.attached("camera", "tripod")
    assert [world.holding(side) for side in world.robot.model.sides] == [None, None]
