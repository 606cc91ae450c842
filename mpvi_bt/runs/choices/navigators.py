"""Makes the navigator that a run chooses by its map and its detector."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from mpvi_bt.executive.plan.knowledge import KnowledgeBase
from mpvi_bt.executive.remote.remote_world import RemoteWorld
from mpvi_bt.finding.navigation.camera_mapper import CameraMapper, Circle
from mpvi_bt.finding.navigation.exploring import ExploringNavigator
from mpvi_bt.finding.navigation.footprint import Footprint
from mpvi_bt.finding.navigation.navigator import KnownPlaceNavigator
from mpvi_bt.finding.perception.detector import Detector
from mpvi_bt.finding.scene.discovery import Discoveries
from mpvi_bt.finding.scene.occupancy import Occupancy
from mpvi_bt.finding.scene.visibility import VisibilityMap
from mpvi_bt.ground.protocols import Navigator
from mpvi_bt.ground.robot.robots import robot_named
from mpvi_bt.ground.robot.stow import stow_of
from mpvi_bt.house.layout.house import House
from mpvi_bt.house.layout.prior_map import knowledge as prior_knowledge
from mpvi_bt.house.layout.prior_map import prior_map
from mpvi_bt.house.sim.open_doors import OpenDoors
from mpvi_bt.house.sim.world import SimWorld
from mpvi_bt.runs.choices.backends import choose

_ABOUT_M = 0.06  # the robot itself reaches that far around each circle of arms that reach out farther,
_BEHIND_M = 0.12  # and around what they carry, whose back may never have been seen


def make_navigator(
    chosen: str, map_: str, world: SimWorld, house: House, phrases: Iterable[str], detector: Detector, seed: int = 0
) -> KnownPlaceNavigator:
    """The navigator of a run.

    Args:
        chosen: The detector's name: with "oracle" the simulator says where everything is, all the time.
        map_, world, house, phrases, detector, seed: As of `explorer`.
    """
    if chosen == "oracle":
        doors = OpenDoors(prior_map(house), world)
        stow = stow_of(world.robot, seed, lambda side: world.holding(side) is not None)
        return KnownPlaceNavigator(world.robot, doors, world.knowledge, stow)
    return explorer(world, house, phrases, detector, map_, seed)


def who_drives(given: str, ours: KnownPlaceNavigator, world: SimWorld | RemoteWorld, seed: int) -> Navigator:
    """The navigator of a name, such as "my_navigator:Mine"; `ours`, which it may hand drives to, is "grid".

    Raises:
        UnknownName: There is none of that name.
        UserError: It cannot be made.
    """
    choice = choose("navigator", given)
    if choice.part is None and not choice.backend.factory:
        return ours
    made: Navigator = choice.make(robot=world.robot, ours=ours, seed=seed)
    return made


def explorer(
    world: SimWorld | RemoteWorld,
    house: House | None,
    phrases: Iterable[str],
    detector: Detector,
    map_: str = "prior",
    seed: int = 0,
) -> ExploringNavigator:
    """The navigator for camera-based detectors: movable things must be found first.

    Args:
        world: The robot's, and its clock.
        house: What is known of beforehand with `map_` "prior": walls, rooms and fixtures; None: only "online" will do.
        phrases: What the task is about, looked for all the time.
        detector: Looks.
        map_: "prior", or "online": nothing is known, and the map is built from depth.
        seed: Of how the arms are folded.
    """
    robot = world.robot
    if map_ == "prior":
        assert house is not None
        occupancy = Occupancy.prior(prior_map(house), prior_map(house, loose=False).occupied)
        base = KnowledgeBase({entry.name: entry for entry in prior_knowledge(house)})
    else:
        occupancy = Occupancy.unknown(robot.proprioception().base_pose[:2])
        base = KnowledgeBase()
    discoveries = Discoveries(base, phrases, detector, world)

    own_m = robot_named(robot.proprioception().robot).base.own_m

    def takes_up() -> list[Circle]:
        body = robot.proprioception()
        arms = Footprint.of(own_m, body, ())
        places = zip(arms.places(body.base_pose), arms.loads[:, 2], strict=True)
        own = [(*place, radius + _ABOUT_M) for place, radius in places]
        own += [(*e.center[:2], np.hypot(*(e.highest - e.lowest)[:2]) / 2 + _BEHIND_M) for e in base if e.held]
        x, y, _ = body.base_pose
        return [(float(u), float(v), float(r)) for u, v, r in [(x, y, own_m), *own]]

    mapper = CameraMapper(robot, world, occupancy, VisibilityMap(occupancy.map), discoveries, takes_up)
    return ExploringNavigator(robot, base, mapper, stow_of(robot, seed))
