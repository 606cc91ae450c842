"""Where the arms would touch: distances to solids, the robot against itself, what a hand holds."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.solids import Array, Solid, box
from mpvi_bt.ground.robot.collision import Body, Load, Surroundings, carries, covering_spheres
from mpvi_bt.ground.robot.protocol import SIDES
from mpvi_bt.hands.robots import r1
from mpvi_bt.hands.robots.r1 import R1

seeds = st.integers(0, 2**32 - 1)
LEFT_LOW, LEFT_HIGH = r1.ARM_LIMITS["left"].T
REACH = box((0.0, 0.0, 0.0), (0.02, 0.02, 0.02))


def solid(rng: np.random.Generator) -> Solid:
    """A random solid of 1 cm to 1 m within 1 m."""
    kind = rng.choice(["box", "cylinder", "sphere"])
    half = rng.uniform(0.005, 0.5, 3)
    if kind == "cylinder":
        half[1] = half[0]
    if kind == "sphere":
        half[:] = half[0]
    T = kin.transform(Rotation.random(rng=rng).as_matrix(), rng.uniform(-1, 1, 3))
    return Solid(kind, half, T)


def nearest(s: Solid, p: Array) -> Array:
    """(3,) the point of a solid nearest to p, a ball being the cylinder around it."""
    x = s.T[:3, :3].T @ (p - s.T[:3, 3])
    if s.kind == "box":
        y = np.clip(x, -s.half_m, s.half_m)
    else:
        r = np.hypot(x[0], x[1])
        y = np.append(x[:2] * min(1.0, s.half_m[0] / max(r, 1e-12)), np.clip(x[2], -s.half_m[2], s.half_m[2]))
    return s.T[:3, :3] @ y + s.T[:3, 3]


def shell(s: Solid, rng: np.random.Generator, n: int = 300) -> Array:
    """(n, 3) random points on the surface of a solid."""
    x = rng.uniform(-1, 1, (n, 3))
    if s.kind == "sphere":
        x /= np.linalg.norm(x, axis=1, keepdims=True)
        return x * s.half_m @ s.T[:3, :3].T + s.T[:3, 3]
    if s.kind == "box":
        x[np.arange(n), rng.integers(3, size=n)] = rng.choice([-1.0, 1.0], n)
    else:
        angle, radius = rng.uniform(-np.pi, np.pi, n), np.sqrt(rng.uniform(0, 1, n))
        ends = rng.random(n) < 0.5
        x[ends, 2] = np.sign(x[ends, 2])
        radius[~ends] = 1.0
        x[:, 0], x[:, 1] = radius * np.cos(angle), radius * np.sin(angle)
    return x * s.half_m @ s.T[:3, :3].T + s.T[:3, 3]


@given(seeds)
def test_distance_is_that_to_the_nearest_point(seed: int) -> None:
    """The distance to all solids at once is the smallest of the distances to each one's nearest point."""
    rng = np.random.default_rng(seed)
    solids = [solid(rng) for _ in range(rng.integers(1, 6))]
    p = rng.uniform(-2, 2, (4, 5, 3))
    found = Surroundings(solids).distance(p)
    expected = [[min(np.linalg.norm(x - nearest(s, x)) for s in solids) for x in row] for row in p]
    np.testing.assert_allclose(found, expected, atol=1e-9)


@given(seeds)
def test_distance_does_not_depend_on_the_frame(seed: int) -> None:
    """Solids seen from another frame are as far from the same points seen from there."""
    rng = np.random.default_rng(seed)
    around = Surroundings([solid(rng) for _ in range(3)])
    T = solid(rng).T
    p = rng.uniform(-2, 2, (7, 3))
    moved = p @ T[:3, :3].T + T[:3, 3]
    np.testing.assert_allclose(around.seen_from(T).distance(p), around.distance(moved), atol=1e-9)


def test_nothing_is_far_away() -> None:
    """Without solids everything is out of reach of any sphere."""
    np.testing.assert_array_equal(Surroundings(()).distance(np.zeros((2, 3))), [9.0, 9.0])


def test_a_disc_lies_on_a_face_or_not() -> None:
    """A disc in the middle of a table's top is carried, one over its edge or beyond a round or turned corner is not."""
    square = box((0.0, 0.0, 0.5), (1.0, 1.0, 0.04), np.pi / 4)
    tray = Solid("cylinder", np.array([0.5, 0.5, 0.02]), kin.transform(np.eye(3), (0.0, 0.0, 0.5)))
    top = np.array([0.0, 0.0, 0.52])
    for face in (square, tray):
        assert carries(face, top, 0.3)
        assert not carries(face, top + [0.4, 0.4, 0.0], 0.05)
        assert not carries(face, top + [0.1, 0.0, 0.0], 0.7)
        assert not carries(face, top + [0.0, 0.0, 0.1], 0.1)


@given(seeds)
def test_covering_spheres_cover_the_solid(seed: int) -> None:
    """Every point on what a hand can hold is in a sphere, but for corners of the cells: 1.4 cm at the most."""
    rng = np.random.default_rng(seed)
    s = solid(rng)
    if s.kind != "box":  # round ones are small, or thin as a plate
        s.half_m[:2] = np.minimum(s.half_m[:2], 0.043)
        s.half_m[2] = s.half_m[0] if s.kind == "sphere" else s.half_m[2]
    centers, radii = covering_spheres([s])
    gap = (np.linalg.norm(shell(s, rng)[:, None] - centers, axis=-1) - radii).min(1)
    assert gap.max() < 0.014


@given(seeds)
def test_covering_spheres_stay_near_the_solid(seed: int) -> None:
    """No sphere reaches more than its radius out of the box around the solid."""
    rng = np.random.default_rng(seed)
    s = solid(rng)
    centers, radii = covering_spheres([s])
    local = (centers - s.T[:3, 3]) @ s.T[:3, :3]
    assert (np.abs(local) <= s.half_m + 1e-9).all()
    assert radii.max() <= 0.6 * 0.05 + 1e-9


@given(seeds)
def test_a_load_fits_where_it_stands(seed: int) -> None:
    """Within some room no sphere is larger than that room or than before, none vanishes, and centers stay."""
    rng = np.random.default_rng(seed)
    load = Load([solid(rng)])
    room = rng.uniform(0.0, 0.06, len(load.radii))
    fitted = load.within(room)
    np.testing.assert_array_equal(fitted.centers, load.centers)
    assert (fitted.radii <= np.maximum(room, load.radii / 2)).all()
    assert (fitted.radii <= load.radii).all()
    assert (fitted.radii >= load.radii / 2).all()


def body(torso: Array = r1.TRAVEL_TORSO, around: Surroundings | None = None, **held: Load) -> Body:
    """The robot in its travel posture."""
    loads = {s: held[s] for s in SIDES if s in held}
    return Body(R1, torso, dict(r1.TRAVEL_ARM), loads, around or Surroundings(()))


@pytest.mark.parametrize("lift", [0.0, 0.05, 0.2, 0.4, 0.55])
@pytest.mark.parametrize("pitch", [-0.3, 0.0, 0.7, 1.0, 1.4])
def test_the_travel_posture_is_free_of_itself(lift: float, pitch: float) -> None:
    """Folded hands clear the body by 2.7 cm wherever r1.py says so."""
    if lift < 0.05 and pitch > 1.0:
        return
    torso = np.array([lift, 0.0, pitch, 0.0])
    for side in SIDES:
        _, itself = body(torso).clearance(side, r1.TRAVEL_ARM[side])
        assert itself[0] > 0.027


def test_the_travel_posture_is_within_its_radius() -> None:
    """With folded hands the arms stay in a radius of 0.31 m and a half width of 0.26 m."""
    rings = [box((0.33 * np.cos(a), 0.33 * np.sin(a), 1.0), (0.04, 0.06, 2.0), a) for a in np.arange(0, 6.3, 0.1)]
    walls = [box((0.0, y, 1.0), (2.0, 0.04, 2.0)) for y in (-0.28, 0.28)]
    for solids in (rings, walls):
        robot = body(around=Surroundings(solids))
        assert all(robot.free(s, r1.TRAVEL_ARM[s])[0] for s in SIDES)


@pytest.mark.parametrize("lift", [0.1, 0.3, 0.55])
def test_an_arm_keeps_clear_of_the_carriage_wherever_the_lift_is(lift: float) -> None:
    """No posture in which the forearm or the hand is within what rides on the column counts as free of the robot."""
    torso = np.array([lift, 0.0, 0.0, 0.0])
    carriage = Surroundings([box((-0.10, 0.0, r1.WAIST_M + lift - 0.03), (0.12, 0.16, 0.10))])  # as of the URDF
    q = np.random.default_rng(0).uniform(LEFT_LOW, LEFT_HIGH, (20_000, 7))
    body = Body(R1, torso, {"left": r1.TRAVEL_ARM["left"]})
    centers, radii = body.spheres("left", q)
    beyond = R1.hull.frame > 0
    within = (carriage.distance(centers) < radii)[:, beyond].any(1)
    assert within.any()
    assert not body.free("left", q[within]).any()


@settings(deadline=None)
@given(seeds)
def test_mirrored_robots_are_as_free(seed: int) -> None:
    """Left and right swapped, the robot is as far from itself."""
    rng = np.random.default_rng(seed)
    left, right = (rng.uniform(LEFT_LOW, LEFT_HIGH) for _ in range(2))
    torso = np.array([rng.uniform(0, 0.55), 0.0, rng.uniform(-0.3, 1.4), 0.0])
    ours = Body(R1, torso, {"left": left, "right": r1.mirrored(right, "right")})
    theirs = Body(R1, torso, {"left": right, "right": r1.mirrored(left, "right")})
    np.testing.assert_allclose(
        ours.clearance("left", left)[1], theirs.clearance("right", r1.mirrored(left, "right"))[1], atol=1e-9
    )


@settings(deadline=None)
@given(seeds)
def test_clearances_of_many_are_those_of_each(seed: int) -> None:
    """Postures checked at once are checked as one by one."""
    rng = np.random.default_rng(seed)
    around = Surroundings([solid(rng)])
    q = rng.uniform(LEFT_LOW, LEFT_HIGH, (4, 7))
    robot = body(around=around, left=Load([REACH]), right=Load([REACH]))
    together = np.stack(robot.clearance("left", q))
    single = np.concatenate([np.stack(robot.clearance("left", one)) for one in q], axis=1)
    np.testing.assert_allclose(together, single, atol=1e-9)


@settings(deadline=None)
@given(seeds)
def test_free_postures_keep_clear_of_things_and_of_the_robot(seed: int) -> None:
    """`free` says what `clearance` does, for many and for one, whatever the other bodies of the posture were asked."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(LEFT_LOW, LEFT_HIGH, (12, 7))
    robot = body(right=Load([REACH]))
    for load in ({}, robot.held):
        there = robot.amid(Surroundings([solid(rng)]), load)
        around, itself = there.clearance("left", q)
        expected = (around > 0.01) & (itself > 0)
        assert there.free("left", q, 0.01).tolist() == expected.tolist()
        assert [bool(there.free("left", one, 0.01)[0]) for one in q] == expected.tolist()


@pytest.mark.parametrize("side", SIDES)
def test_a_thing_at_the_hand_is_hit(side) -> None:
    """A solid where the hand is takes its freedom; far from it, it does not."""
    at = R1.tcp(r1.TRAVEL_TORSO, r1.TRAVEL_ARM[side], side)[:3, 3]
    for shift, free in ((0.0, False), (3.0, True)):
        around = Surroundings([box((float(at[0]) + shift, float(at[1]), float(at[2])), (0.1, 0.1, 0.1))])
        assert bool(body(around=around).free(side, r1.TRAVEL_ARM[side])[0]) is free


def test_a_grasping_hand_may_touch_between_its_fingers_only() -> None:
    """A thing between the fingers blocks a hand that moves and not one that grasps; one at the elbow blocks both."""
    q, torso = np.array([-0.6, 0.3, 0.0, -1.2, 0.0, -0.3, 0.0]), np.array([0.4, 0.0, 0.0, 0.0])
    tcp = R1.tcp(torso, q, "left")
    thing = Solid("box", np.array([0.01, 0.045, 0.01]), tcp)
    elbow = R1.chest(torso) @ R1.arm_frames(q, "left")[1]
    at_elbow = Solid("box", np.array([0.05, 0.05, 0.05]), elbow @ kin.transform(np.eye(3), (0.0, 0.0, -0.1)))
    robot = Body(R1, torso, {"left": q, "right": r1.TRAVEL_ARM["right"]}, {}, Surroundings([thing]))
    assert not robot.free("left", q)[0]
    assert robot.free("left", q, grasping=True)[0]
    blocked = Body(R1, torso, robot.arms, {}, Surroundings([at_elbow]))
    assert not blocked.free("left", q, grasping=True)[0]


def test_a_held_thing_is_part_of_the_arm() -> None:
    """What a hand holds meets the surroundings with it."""
    q, torso = np.array([-0.6, 0.3, 0.0, -1.2, 0.0, -0.3, 0.0]), np.array([0.4, 0.0, 0.0, 0.0])
    stick = Solid("box", np.array([0.01, 0.01, 0.15]), kin.transform(np.eye(3), (0.0, 0.0, 0.16)))
    end = R1.tcp(torso, q, "left") @ [0.0, 0.0, 0.3, 1.0]
    wall = Surroundings([box((float(end[0]), float(end[1]), float(end[2])), (0.06, 0.06, 0.06))])
    robot = Body(R1, torso, {"left": q, "right": r1.TRAVEL_ARM["right"]}, {"left": Load([stick])}, wall)
    assert not robot.free("left", q)[0]
    assert Body(R1, torso, robot.arms, {}, wall).free("left", q)[0]


def test_hands_meet_each_other_and_what_the_other_holds() -> None:
    """A hand on the other hand's place is not free; nor is one where the other holds something."""
    torso = np.array([0.3, 0.0, 0.0, 0.0])
    T = kin.transform(kin.hand_rotation((1, 0, 0), (0, 1, 0)), (0.45, 0.0, 0.9))
    chest = kin.inverse(R1.chest(torso))
    left = R1.nearest_posture(chest @ T, "left", r1.TRAVEL_ARM["left"])
    right = R1.nearest_posture(chest @ T, "right", r1.TRAVEL_ARM["right"])
    assert left is not None
    assert right is not None
    crossed = Body(R1, torso, {"left": left, "right": right})
    assert not crossed.free("right", right)[0]
    apart = T.copy()
    apart[1, 3] = -0.3
    aside = R1.nearest_posture(chest @ apart, "right", r1.TRAVEL_ARM["right"])
    assert aside is not None
    robot = Body(R1, torso, {"left": left, "right": aside})
    assert robot.free("right", aside)[0]
    plank = Load([Solid("box", np.array([0.01, 0.35, 0.01]))])
    for holder in SIDES:
        assert not Body(R1, torso, robot.arms, {holder: plank}).free("right", aside)[0], holder


def test_a_bent_trunk_meets_a_shelf() -> None:
    """Head and chest count: bent over what stands ahead they are not free, upright they are."""
    shelf = Surroundings([box((0.45, 0.0, 0.9), (0.3, 0.6, 0.05))])
    assert body(np.array([0.3, 0.0, 0.0, 0.0]), shelf).trunk_free()
    assert not body(np.array([0.3, 0.0, 1.2, 0.0]), shelf).trunk_free()
