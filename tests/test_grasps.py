"""Grasp candidates: around the thing, between its sides, above the floor."""

from __future__ import annotations

from typing import cast

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mpvi_bt.finding.scene.scene import Scene
from mpvi_bt.finding.shapes.moving_parts import Bar
from mpvi_bt.ground.geometry.kinematics import hand_rotation
from mpvi_bt.ground.geometry.solids import Array, Solid, box, pose
from mpvi_bt.ground.robot.collision import Surroundings
from mpvi_bt.hands.robots.r1 import R1
from mpvi_bt.hands.stance.grasps import Grasp, grasps
from mpvi_bt.house.sim.builder import Thing
from mpvi_bt.house.sim.world import SimWorld
from mpvi_bt.house.truth.true_scene import TrueScene
from tests.small_house import CATALOGUE, placed, small_world

THINGS = ["can_of_soda", "bottle", "box_of_oatmeal", "carton_of_milk", "candle", "tennis_ball", "trash_can"]
NAMES = [name for name in THINGS if name in CATALOGUE.entries]
WORLD = small_world({name: placed(name, 0.7 * k - 2.5, 2.0) for k, name in enumerate([*NAMES, "bowl", "book"])})


def put(name: str, yaw: float, at: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> None:
    thing(WORLD, name).place(pose(at, yaw))


def thing(world: SimWorld, name: str) -> Thing:
    return world._things[name]


def box_of(solids: list[Solid]) -> Array:
    boxes = np.stack([s.aabb() for s in solids])
    return np.stack([boxes[:, 0].min(0), boxes[:, 1].max(0)])


@pytest.mark.parametrize("name", NAMES)
@settings(deadline=None, max_examples=15)
@given(yaw=st.floats(-3.1, 3.1), bearing=st.floats(-3.1, 3.1))
def test_candidates_are_sound(name: str, yaw: float, bearing: float) -> None:
    """Every candidate is a rigid pose tilted as it says, closes across the thing, and keeps its tips off the floor."""
    put(name, yaw)
    found = grasps(TrueScene(WORLD), R1.hand, name, bearing)
    assert found
    solids = list(WORLD.solids(name))
    around = Surroundings(solids)
    low, high = box_of(solids)
    for grasp in found:
        R, p = grasp.T_world_tcp[:3, :3], grasp.T_world_tcp[:3, 3]
        np.testing.assert_allclose(R.T @ R, np.eye(3), atol=1e-9)
        assert np.linalg.det(R) == pytest.approx(1.0)
        assert -R[2, 2] == pytest.approx(np.cos(grasp.tilt_rad), abs=1e-6)
        if not WORLD.handles(name):
            assert R[2, 1] == pytest.approx(0.0, abs=1e-6)  # it closes sideways
        assert grasp.cost >= 0
        assert (p > low - 0.02).all()
        assert (p < high + 0.02).all()
        if not WORLD.handles(name):
            assert p[2] + 0.016 * R[2, 2] > -1e-6  # the tips
        # the open fingers stand clear of it, and between them there is something of it
        tips = np.array([p + s * grasp.opening_m / 2 * R[:, 1] for s in (1.0, -1.0)])
        assert (around.distance(tips) > 1e-3).all()
        across = np.array([p + s * R[:, 1] for s in np.linspace(-0.04, 0.04, 17)])
        assert around.distance(across).min() < 0.012


@pytest.mark.parametrize("name", [n for n in NAMES if n != "trash_can"])
def test_the_palm_stays_clear(name: str) -> None:
    """No candidate has the thing reach behind the palm, 4 cm behind the tcp."""
    put(name, 0.3)
    for grasp in grasps(TrueScene(WORLD), R1.hand, name, 0.0):
        approach, p = grasp.T_world_tcp[:3, 2], grasp.T_world_tcp[:3, 3]
        palm = p - 0.042 * approach
        spread = np.array([palm + s * grasp.T_world_tcp[:3, 1] for s in (-0.02, 0.0, 0.02)])
        assert (Surroundings(list(WORLD.solids(name))).distance(spread) > 0).all()


def best(found: list[Grasp]) -> Array:
    return min(found, key=lambda g: g.cost).T_world_tcp


@settings(deadline=None, max_examples=25)
@given(st.floats(-3.1, 3.1), st.floats(-2.0, 2.0), st.floats(-2.0, 2.0))
def test_grasps_move_with_the_thing(turn: float, x: float, y: float) -> None:
    """Thing and robot shifted and turned together, the best grasp is shifted and turned with them."""
    put("can_of_soda", 0.0)
    here = best(grasps(TrueScene(WORLD), R1.hand, "can_of_soda", 0.3))
    put("can_of_soda", turn, (x, y, 0.0))
    there = best(grasps(TrueScene(WORLD), R1.hand, "can_of_soda", 0.3 + turn))
    np.testing.assert_allclose(there, pose((x, y, 0.0), turn) @ here, atol=1e-5)


@pytest.mark.rare
@pytest.mark.parametrize("name", NAMES)
@settings(deadline=None, max_examples=3)
@given(yaw=st.floats(-3.1, 3.1), bearing=st.floats(-3.1, 3.1))
def test_off_center_the_hand_is_moved_along_its_closing_axis_only(name: str, yaw: float, bearing: float) -> None:
    """By 12 mm at the most, at a cost, and never so far that a finger comes down on the thing."""
    put(name, yaw)
    if WORLD.handles(name) or WORLD.volumes(name):
        return
    centered = grasps(TrueScene(WORLD), R1.hand, name, bearing)
    around = Surroundings(list(WORLD.solids(name)))
    for grasp in grasps(TrueScene(WORLD), R1.hand, name, bearing, off_center=True):
        R, p = grasp.T_world_tcp[:3, :3], grasp.T_world_tcp[:3, 3]
        origin = [
            g
            for g in centered
            if np.allclose(g.T_world_tcp[:3, :3], R)
            and np.allclose(np.cross(p - g.T_world_tcp[:3, 3], R[:, 1]), 0.0, atol=1e-9)
        ]
        off, cost = min((float(np.linalg.norm(p - g.T_world_tcp[:3, 3])), g.cost) for g in origin)
        assert 0.005 < off < 0.013
        assert grasp.cost > cost
        tips = np.array([p + s * grasp.opening_m / 2 * R[:, 1] for s in (1.0, -1.0)])
        assert (around.distance(tips) > 1e-3).all()


def test_what_is_too_wide_has_no_grasp() -> None:
    """What is broader than the hand opens, without a handle or a rim, has none."""
    assert np.ptp(CATALOGUE["book"].description.extent(), axis=0)[:2].min() > R1.hand.widest_m
    assert grasps(TrueScene(WORLD), R1.hand, "book", 0.0) == []


@settings(deadline=None, max_examples=15)
@given(yaw=st.floats(-3.1, 3.1), bearing=st.floats(-3.1, 3.1))
def test_a_bowl_is_taken_by_its_rim(yaw: float, bearing: float) -> None:
    """Candidates for a bowl have one finger inside it, one outside, the wall between them, and the palm above it."""
    put("bowl", yaw, (0.1, 0.2, 0.0))
    found = grasps(TrueScene(WORLD), R1.hand, "bowl", bearing)
    assert found
    wall = Surroundings(list(WORLD.solids("bowl")))
    (inside,) = WORLD.volumes("bowl")
    for grasp in found:
        R, p = grasp.T_world_tcp[:3, :3], grasp.T_world_tcp[:3, 3]
        assert wall.distance(p[None])[0] == 0.0
        tips = np.array([p + s * grasp.opening_m / 2 * R[:, 1] for s in (1.0, -1.0)])
        assert (wall.distance(tips) > 0.01).all()
        radii = np.sort(np.linalg.norm((tips - inside.T[:3, 3])[:, :2], axis=1))
        assert radii[0] < inside.half_m[0] < radii[1]
        assert wall.distance((p - 0.043 * R[:, 2])[None])[0] > 0.0
        assert p[2] > 0.015


@pytest.mark.parametrize("yaw", np.arange(-3.0, 3.1, 0.5))
def test_a_bin_is_taken_by_its_bar(yaw: float) -> None:
    """Candidates for a thing with a bar close across the bar, at its middle, straight from above before slantwise."""
    put("trash_can", yaw, (0.2, 0.1, 0.0))
    (bar,) = WORLD.handles("trash_can")
    found = grasps(TrueScene(WORLD), R1.hand, "trash_can", 0.0)
    for grasp in found:
        np.testing.assert_allclose(grasp.T_world_tcp[:3, 3], bar.center, atol=1e-6)
        assert abs(grasp.T_world_tcp[:3, 1] @ bar.axis) < 1e-6
        assert abs(grasp.T_world_tcp[:3, 2] @ bar.axis) < 1e-6
    assert min(found, key=lambda g: g.cost).tilt_rad == pytest.approx(0.0, abs=1e-6)


def test_a_lying_bin_is_taken_from_its_open_side() -> None:
    """The bar of a bin on its side is taken from where it stands out, never through the bin or from below."""
    T = pose((0.2, 0.1, 0.14))
    T[:3, :3] = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    thing(WORLD, "trash_can").place(T)
    (bar,) = WORLD.handles("trash_can")
    found = grasps(TrueScene(WORLD), R1.hand, "trash_can", 0.0)
    assert found
    for grasp in found:
        assert grasp.T_world_tcp[:3, 2] @ bar.outward < 0
        assert grasp.T_world_tcp[2, 2] < 0.21


@pytest.mark.parametrize("tilt", np.linspace(0.0, np.pi / 2, 9))
def test_the_lowest_hand_is_clear_of_the_floor(tilt: float) -> None:
    """At the least height of its tilt neither the fingers nor the palm reach below the surface."""
    R = hand_rotation((np.sin(tilt), 0.0, -np.cos(tilt)), (0.0, 1.0, 0.0))
    centers, radii = R1.hand.fingers(0.1)
    corners = np.concatenate([centers - [s * 0.002, 0, 0] for s in (-1, 1)])
    assert (R1.hand.lowest(tilt) + (corners @ R.T)[:, 2] > np.tile(radii, 2) - 1e-3).all()
    palm = np.array([(x, y, z) for x in (-0.025, 0.025) for y in (-0.075, 0.075) for z in (-0.103, -0.043)])
    assert (R1.hand.lowest(tilt) + (palm @ R.T)[:, 2] > 0).all()


def test_a_lying_can_is_taken_across() -> None:
    """A can on its side is taken from above, across its axis: the fingers clear its ends."""
    T = pose((0.0, 0.0, 0.033))
    T[:3, :3] = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    thing(WORLD, "can_of_soda").place(T)
    found = grasps(TrueScene(WORLD), R1.hand, "can_of_soda", 0.4)
    assert found
    for grasp in found:
        assert abs(grasp.T_world_tcp[:3, 1] @ T[:3, 2]) < 1e-6
        assert grasp.T_world_tcp[2, 3] > 0.016 - 1e-6


@settings(deadline=None, max_examples=15)
@given(yaw=st.floats(-3.1, 3.1), bearing=st.floats(-3.1, 3.1), toward=st.floats(-3.1, 3.1))
def test_hands_may_come_from_all_around(yaw: float, bearing: float, toward: float) -> None:
    """Wherever the robot stands now: a round thing is pinched from any side, a narrow box from both of its ends."""
    put("can_of_soda", yaw)
    level = [g for g in grasps(TrueScene(WORLD), R1.hand, "can_of_soda", bearing) if g.tilt_rad > 1.3]
    ahead = np.array([np.cos(toward), np.sin(toward), 0.0])
    assert max(float(g.T_world_tcp[:3, 2] @ ahead) for g in level) > 0.95
    put("box_of_oatmeal", yaw)
    slanted = [g for g in grasps(TrueScene(WORLD), R1.hand, "box_of_oatmeal", bearing) if g.tilt_rad > 1.1]
    along = WORLD.pose("box_of_oatmeal")[:3, 1]
    assert {float(np.sign(g.T_world_tcp[:3, 2] @ along)) for g in slanted} == {-1.0, 1.0}


class Lone:
    """A scene of one thing of given solids, as far as grasps ask about it."""

    def __init__(self, *solids: Solid) -> None:
        self._solids = solids

    def solids(self, name: str) -> list[Solid]:
        return list(self._solids)

    def pose(self, name: str) -> Array:
        return np.eye(4)

    def handles(self, name: str) -> list[Bar]:
        return []

    def volumes(self, name: str) -> list[Solid]:
        return []


def of(*solids: Solid) -> list[Grasp]:
    """Grasps of a thing of these solids from a robot that looks along x."""
    return grasps(cast("Scene", Lone(*solids)), R1.hand, "thing", 0.0)


@pytest.mark.parametrize("length", [0.12, 0.2, 0.3, 0.4])
def test_a_long_box_is_taken_level_by_its_near_end(length: float) -> None:
    """Too deep for the palm to reach its middle, it is taken by its near end where boards leave no room above it.

    Where there is room it is taken from straight above in the middle first.
    """
    found = of(box((0.0, 0.0, 0.07), (length, 0.05, 0.14)))
    level = [g for g in found if g.tilt_rad > 1.3 and g.T_world_tcp[0, 2] > 0.9]
    assert level
    assert all(-length / 2 < g.T_world_tcp[0, 3] < 0 for g in level)
    assert abs(best(found)[0, 3]) < 0.01


@pytest.mark.parametrize("head", [0.09, 0.14, 0.2])
def test_what_is_too_wide_as_a_whole_is_taken_by_a_part(head: float) -> None:
    """A tool whose head is wider than the hand opens is taken by its handle, the open fingers and the palm clear."""
    handle = box((0.0, 0.0, 0.015), (0.26, 0.03, 0.03))
    found = of(handle, box((0.14, 0.0, 0.02), (0.03, head, 0.04)))
    across = [g for g in found if abs(g.T_world_tcp[1, 1]) > 0.99 and abs(g.T_world_tcp[0, 3]) < 0.1]
    assert across
    around = Surroundings([handle, box((0.14, 0.0, 0.02), (0.03, head, 0.04))])
    for grasp in found:
        for centers, radii in (R1.hand.fingers(grasp.opening_m), R1.hand.palm):
            at = centers @ grasp.T_world_tcp[:3, :3].T + grasp.T_world_tcp[:3, 3]
            assert (around.distance(at) > radii - 0.01).all()
