"""A drive through the whole house: what the pictures of the simulator show, against where things are."""

from __future__ import annotations

import random
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pytest
from scipy import ndimage

from mpvi_bt.executive.plan.knowledge import LIKELY, Entry, KnowledgeBase
from mpvi_bt.finding.perception.segmentation import SegmentationDetector
from mpvi_bt.finding.scene.discovery import Discoveries
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.solids import Array, pose
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, CameraImage
from mpvi_bt.hands.robots import r1
from mpvi_bt.hands.robots.r1 import R1
from mpvi_bt.house.layout.house import load_house
from mpvi_bt.house.layout.prior_map import knowledge, prior_map
from mpvi_bt.house.sim.world import Placement, SimWorld
from mpvi_bt.house.things.catalogue import CatalogueEntry
from tests.layouts import BASE, LAYOUT
from tests.small_house import CATALOGUE, placed, small_world
from tests.test_discovery import Clock, Pose, body, disturbed

pytestmark = [pytest.mark.slow, pytest.mark.render]

HOUSE = load_house("family_house")
MAP = prior_map(HOUSE)
CLEAR_M = ndimage.distance_transform_edt(~MAP.occupied) * MAP.resolution_m
INDOORS = (MAP.rooms >= 0) & (MAP.rooms != MAP.room_names.index("garden"))
ROOM_M = 0.35  # radius that free places on floors have room for


def radius_m(entry: CatalogueEntry) -> float:
    """Of a circle with room for the thing, turned anyhow, and for a little more."""
    boxes = np.stack([part.solid.aabb() for b in entry.description.bodies for part in b.parts])
    return float(np.abs(boxes[..., :2]).max()) * 1.3


FITTING = [entry for entry in CATALOGUE if entry.mass_kg is not None and radius_m(entry) < ROOM_M]
KINDS = random.Random(0).sample(FITTING, 36)  # of which two each can be strewn over one house
TOPS = ("table", "breakfast_table", "coffee_table", "counter", "countertop", "desk", "nightstand", "workbench")
HEAD = r1.CAMERAS["head"]
VISIBLE_PX = 60  # what some picture shows that many pixels of has to be found


def spots(rng: np.random.Generator) -> Iterator[tuple[float, Array]]:
    """Free places for things, with the radius [m] that they have room for: on floors near furniture, and on tops."""
    floor = np.argwhere((CLEAR_M > ROOM_M) & (CLEAR_M < 0.8) & INDOORS)
    tops = [fixture.extent() for fixture in HOUSE.fixtures.values() if fixture.entry.name in TOPS]
    while True:
        yield ROOM_M, np.array([*MAP.center(*floor[rng.integers(len(floor))]), 0.002])
        low, high = tops[rng.integers(len(tops))]
        at = rng.uniform(low[:2], high[:2])
        yield float(np.minimum(at - low[:2], high[:2] - at).min()), np.array([*at, high[2] + 0.002])


def strewn(rng: np.random.Generator) -> dict[str, Placement]:
    """Two of each kind, over the house."""
    objects: dict[str, Placement] = {}
    taken: list[tuple[Array, float]] = []
    free = spots(rng)
    for i, entry in enumerate(KINDS * 2):
        radius = radius_m(entry)
        at = next(p for room, p in free if room > radius and all(np.hypot(*(p - q)[:2]) > radius + r for q, r in taken))
        taken.append((at, radius))
        objects[f"thing_{i}"] = placed(entry.name, *map(float, (*at, rng.uniform(-np.pi, np.pi))))
    return objects


def tour() -> Iterator[Pose]:
    """Base poses all over the house, a meter apart, six headings each."""
    step = round(1.0 / MAP.resolution_m)
    for row, column in np.argwhere((CLEAR_M > 0.35) & INDOORS):
        if row % step == 0 and column % step == 0:
            for k in range(6):
                x, y = MAP.center(int(row), int(column))
                yield float(x), float(y), k * np.pi / 3


@dataclass
class Drive:
    """What a drive through the house shows.

    Attributes:
        pictures: With the base poses that they are from.
        truth: The movable things, by name.
        visible: Names of those that some picture shows enough of.
        vocabulary: What labels are called.
    """

    pictures: list[tuple[Pose, CameraImage]]
    truth: dict[str, Entry]
    visible: set[str]
    vocabulary: dict[str, tuple[str, ...]]


def drive(world: SimWorld) -> Drive:
    """Look at the house as it is now."""
    pictures, visible = [], set()
    for at in tour():
        T = kin.base(np.array(at)) @ R1.head_camera(r1.TRAVEL_TORSO)
        image = world.look_from(T, (HEAD.width, HEAD.height), HEAD.fov_rad)
        pictures.append((at, image))
        assert image.labels is not None
        labels, pixels = np.unique(image.labels, return_counts=True)
        visible |= {image.names.get(label, "") for label in labels[pixels >= VISIBLE_PX].tolist()}
    known = world.knowledge()
    truth = {entry.name: entry for entry in known if entry.kind == "object"}
    return Drive(pictures, truth, visible & set(truth), {e.name: e.phrases for e in known if e.kind != "room"})


@pytest.fixture(scope="module")
def drives() -> tuple[Drive, Drive]:
    """Before and after a third of the things was moved."""
    rng = np.random.default_rng(0)
    world = SimWorld(HOUSE, strewn(rng), np.array([-3.0, 3.0, 0.0]), render=True)
    world.settle()
    before = drive(world)
    for name, placement in list(strewn(rng).items())[::3]:
        world.place(name, placement.T_world)
    world.settle()
    return before, drive(world)


def discoveries(seen: Drive) -> Discoveries:
    """That know the rooms and fixtures, and look for every kind of movable thing."""
    base = KnowledgeBase({entry.name: entry for entry in knowledge(HOUSE)})
    return Discoveries(base, [kind.phrases[0] for kind in KINDS], SegmentationDetector(seen.vocabulary), Clock())


def compared(base: KnowledgeBase, seen: Drive) -> tuple[list[float], list[str]]:
    """How far [m] the entry of each visible thing is from it, and the likely entries that are of none."""
    left = {e.name: e for e in base if e.source != "prior" and e.confidence >= LIKELY}
    errors = []
    for name in sorted(seen.truth, key=lambda name: name not in seen.visible):
        thing = seen.truth[name]
        alike = [e for e in left.values() if set(e.phrases) & set(thing.phrases)]
        gaps = {e.name: float(np.linalg.norm(e.center - thing.center)) for e in alike}
        nearest = min(gaps, key=gaps.__getitem__, default=None)
        if name in seen.visible:
            errors.append(gaps[nearest] if nearest is not None else np.inf)
        if nearest is not None and gaps[nearest] < 0.3:
            del left[nearest]
    return errors, list(left)


@pytest.mark.rare
@pytest.mark.parametrize("noise", [False, True], ids=["exact", "noise"])
def test_every_thing_that_can_be_seen_is_found_once_and_nothing_else(drives: tuple[Drive, Drive], noise: bool) -> None:
    """Each within 10 cm of the truth, with and without noise of depth and odometry."""
    seen, rng = drives[0], np.random.default_rng(1)
    made = discoveries(seen)
    for at, image in seen.pictures:
        made.see(disturbed(image, rng) if noise else image, body(at))
    errors, others = compared(made.knowledge, seen)
    print(f"{len(errors)} things, {1e3 * np.median(errors):.0f} mm off in the median, {1e3 * max(errors):.0f} at most")
    assert len(errors) > 30
    assert max(errors) < 0.10
    assert others == []


@pytest.mark.rare
def test_what_was_moved_meanwhile_is_found_anew_and_not_where_it_was(drives: tuple[Drive, Drive]) -> None:
    """A second drive through the house corrects what the first one told, of things that the first one showed well.

    What was but a few pixels large in its nearest picture is not doubted by another picture from as far.
    """
    made = discoveries(drives[0])
    for seen in drives:
        for at, image in seen.pictures:
            made.see(image, body(at))
    errors, others = compared(made.knowledge, drives[1])
    print(f"{len(errors)} things, {1e3 * np.median(errors):.0f} mm off in the median, {1e3 * max(errors):.0f} at most")
    assert max(errors) < 0.10
    small = [thing.center for name, thing in drives[0].truth.items() if name not in drives[0].visible]
    stale = [made.knowledge.entries[name] for name in others]
    assert [e.name for e in stale if min(float(np.linalg.norm(e.center - at)) for at in small) > 0.10] == []


def test_a_can_is_followed_from_the_hand_to_the_floor() -> None:
    """Seen in the hand, held by touch alone, driven around, dropped, and seen again: one entry, where the can is."""
    world = small_world({"can": placed("can_of_soda", 2.0, 2.0)}, render=True)
    T_base_hand = kin.transform(kin.hand_rotation((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)), (0.55, -0.15, 0.85))
    right = r1.TRAVEL_ARM["right"]
    arm = R1.nearest_posture(kin.inverse(R1.chest(r1.TRAVEL_TORSO)) @ T_base_hand, "right", right)
    assert arm is not None
    action = world.robot.action.copy()
    action[LAYOUT.torso], action[LAYOUT.arm["right"]] = r1.TRAVEL_TORSO, arm
    action[LAYOUT.arm["left"]] = r1.TRAVEL_ARM["left"]
    made = Discoveries(KnowledgeBase(), ["can of soda"], SegmentationDetector({"can": ("can of soda",)}), world)

    def steps(seconds: float, gripper: float, base: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> None:
        action[LAYOUT.gripper["right"]], action[BASE] = gripper, base
        for _ in range(round(seconds * CONTROL_HZ)):
            world.robot.act(action)
            world.step()
            made.feel(world.robot.proprioception())

    def off() -> float:
        (entry,) = made.knowledge.find("can of soda")
        return float(np.linalg.norm(entry.center - world.knowledge().entries["can"].center))

    steps(2.0, gripper=1.0)
    x, y, z = world.robot.hand_pose_world("right")[:3, 3].tolist()
    world.place("can", pose((x, y, z - 0.061)), fixed=True)
    (entry,) = made.see(world.robot.look("head"), world.robot.proprioception())
    before = off()  # the hand hides the lower half
    assert before < 0.05
    steps(1.0, gripper=-1.0)
    world.place("can", world.pose("can"))
    assert entry.held
    steps(2.0, -1.0, (0.2, 0.1, 0.5))
    assert off() == pytest.approx(before, abs=0.005)
    steps(1.5, gripper=1.0)
    assert not entry.held
    for _ in range(3):
        steps(0.7, 1.0, (-0.4, 0.0, 0.0))
        made.see(world.robot.look("head"), world.robot.proprioception())
    assert off() < 0.05
