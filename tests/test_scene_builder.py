"""Small worlds for tests, put together by name."""

from __future__ import annotations

import pytest

from mpvi_bt.ground.errors import FileProblems, UnknownName
from mpvi_bt.testing import SceneBuilder


def test_a_scene_is_as_it_was_told() -> None:
    """Things lie where they were put, hands hold and vessels contain what they were given, by simulator truth."""
    world = (
        SceneBuilder()
        .fixture("table_1", "table", at=(1.3, 0.0))
        .thing("cup", "coffee_cup")
        .in_hand("right", "cup")
        .thing("bowl", "mixing_bowl", at=(0.9, 0.8, 0.001))
        .thing("egg", "easter_egg")
        .inside("bowl", "egg")
        .robot_at(0.1, 0.2, 0.3)
        .world()
    )
    assert world.holding("right") == "cup"
    assert list(world.within("bowl")) == ["egg"]
    assert world.robot.proprioception().base_pose == pytest.approx([0.1, 0.2, 0.3], abs=0.01)
    assert "table_1" in world.house.fixtures


def test_a_door_stands_open_as_far_as_it_was_told() -> None:
    """By a fraction of its range."""
    builder = SceneBuilder().fixture("cabinet_1", "wall_cabinet", at=(1.5, 0.0), yaw_deg=180)
    (entry,) = (fixture.entry for fixture in builder.house().fixtures.values())
    body = next(body.name for body in entry.description.bodies if body.joint is not None)
    scene = builder.opened("cabinet_1", body, 0.6).scene()
    assert max(door.position / door.limit for door in scene.doors("cabinet_1")) == pytest.approx(0.6, abs=0.05)


def test_what_is_not_known_is_told_by_its_name() -> None:
    """Of fixtures as in a house file, of things as in the catalogue."""
    with pytest.raises(FileProblems, match="tabel"):
        SceneBuilder().fixture("table_1", "tabel", at=(1.0, 0.0)).house()
    with pytest.raises(UnknownName, match="coffee_cup"):
        SceneBuilder().thing("cup", "cofee_cup")
