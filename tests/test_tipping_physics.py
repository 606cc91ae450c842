"""Things that are let go of on a slant."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
import sapien
from scipy.spatial.transform import Rotation

from mpvi_bt.house.sim.builder import build_object
from mpvi_bt.house.sim.shaders import PHYSICS_HZ, new_scene
from mpvi_bt.house.things.catalogue import CatalogueEntry, load_catalogue

BOTTLES = [entry for entry in load_catalogue() if entry.family == "bottle"]
APART_M = 0.6
AT_M = 7.1  # as far from the origin as a room may be: there it is worse


@pytest.mark.parametrize("entry", BOTTLES, ids=[entry.name for entry in BOTTLES])
def test_a_bottle_that_is_let_go_of_on_a_slant_comes_to_stand(entry: CatalogueEntry) -> None:
    """The engine adds energy as a rim rolls on a box: hardly damped (0.5/s), some of each kind fall over in 4 s."""
    scene = new_scene(render=False)
    ground = scene.create_actor_builder()
    ground.add_box_collision(sapien.Pose([0.0, 0.0, -0.05]), [15.0, 15.0, 0.05])
    ground.build_static("ground")
    leans = product((0.3, 0.5, 0.7), np.linspace(0.1, 6.0, 16))
    bottles = [
        let_go(scene, entry, share, azimuth, AT_M + APART_M * np.array(divmod(k, 7)))
        for k, (share, azimuth) in enumerate(leans)
    ]
    for _ in range(4 * PHYSICS_HZ):
        scene.step()
    assert [k for k, bottle in enumerate(bottles) if bottle.pose.to_transformation_matrix()[2, 2] < 0.99] == []


def let_go(scene: sapien.Scene, entry: CatalogueEntry, share: float, azimuth: float, xy: np.ndarray) -> sapien.Entity:
    """Put a bottle on a slant on the ground, a share of the angle that it topples at."""
    thing = build_object(scene, entry, "bottle", np.eye(4), render=False)
    entity = thing.entities[entry.description.root.name]
    body = entity.find_component_by_type(sapien.physx.PhysxRigidDynamicComponent)
    foot = float(entry.shape["diameter_m"]) / 2
    lean = share * float(np.arctan2(foot, body.cmass_local_pose.p[2]))
    turn = Rotation.from_rotvec(lean * np.array([-np.sin(azimuth), np.cos(azimuth), 0.0]))
    x, y, z, w = turn.as_quat()
    entity.pose = sapien.Pose([*xy, foot * np.sin(lean) + 5e-4], [w, x, y, z])
    return entity
