"""Looking down with a head that does not tilt, and reaching over what the other hand holds on a slant."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.motion import Actions, Motion
from mpvi_bt.ground.robot.protocol import SIDES, Side
from mpvi_bt.hands.motion.gaze import look_down, turn_to
from mpvi_bt.hands.motion.work import Work
from mpvi_bt.hands.robots.r1pro import R1PRO
from mpvi_bt.hands.skills.drop import reach_over
from mpvi_bt.house.sim.world import SimWorld
from mpvi_bt.house.truth.true_scene import TrueScene
from tests.layouts import LAYOUT
from tests.small_house import placed, small_world

HANDS: dict[Side, Array] = {  # T_base_tcp in which the r1pro carries a bin by its handle, and a can
    "left": kin.transform(kin.hand_rotation((0.19, -0.26, -0.95), (0.79, -0.53, 0.30)), (0.50, 0.50, 0.71)),
    "right": kin.transform(kin.hand_rotation((0.30, 0.0, -0.95), (0.0, 1.0, 0.0)), (0.30, -0.28, 0.72)),
}


@pytest.fixture(scope="module")
def world() -> SimWorld:
    return small_world({"bin": placed("trash_can", -2.0, 0.0), "can": placed("can_of_soda", -2.0, 1.0)}, robot=R1PRO)


def holding(world: SimWorld, held: dict[Side, tuple[str, Array]]) -> Work:
    """A robot whose hands hold things before the body, each at T_base_thing (4, 4)."""
    felt, scene = world.robot.proprioception(), TrueScene(world)
    arm = dict(felt.arm)
    for side, (name, T_base_thing) in held.items():
        T_chest_tcp = kin.inverse(R1PRO.chest(felt.torso)) @ HANDS[side]
        posture = R1PRO.nearest_posture(T_chest_tcp, side, R1PRO.travel_arm[side])
        assert posture is not None
        arm[side] = posture
        world.place(name, kin.base(felt.base_pose) @ T_base_thing)
    scene.holding = lambda side: held[side][0] if side in held else None
    felt = replace(felt, arm=arm, arm_command=arm)
    return Work(scene, Motion(felt), np.random.default_rng(0))


def carry_out(work: Work, actions: Actions) -> list[Array]:
    """Every action at once as told; the torsos on the way."""
    torsos = []
    for action in actions:
        arm = {side: action[LAYOUT.arm[side]].copy() for side in SIDES}
        torsos.append(action[LAYOUT.torso].copy())
        work.motion.felt = replace(work.motion.felt, torso=torsos[-1], arm=arm, arm_command=arm)
    return torsos


def down(torso: Array, p: Array) -> float:
    """How far a point (3,) in the base frame is below the middle of the head's picture [rad]."""
    _, y, z, _ = kin.inverse(R1PRO.head_camera(torso)) @ np.append(p, 1.0)
    return float(np.arctan2(y, z))


def test_what_is_below_the_picture_comes_into_it_as_the_trunk_bends(world: SimWorld) -> None:
    """What a hand holds keeps its place meanwhile; what is in view already bends nothing."""
    edge = R1PRO.cameras["head"].fov_rad / 2
    p = np.array([0.30, 0.28, 0.50])
    work = holding(world, {"left": ("can", kin.transform(np.eye(3), HANDS["left"][:3, 3]))})
    before = work.motion.hand("left")
    assert down(work.motion.torso, p) > edge - 0.2
    torsos = carry_out(work, turn_to(work, (work.base @ np.append(p, 1.0))[:3]))
    assert down(torsos[-1], p) < edge - 0.15
    np.testing.assert_allclose(work.motion.hand("left"), before, atol=2e-3)
    assert not carry_out(work, turn_to(work, (work.base @ np.append(p, 1.0))[:3]))


def test_the_floor_ahead_comes_into_view_as_the_trunk_bends(world: SimWorld) -> None:
    """A look 55 degrees down shows the floor nearer to the base than one ahead, from which it straightens up again."""
    work = holding(world, {})
    foot = np.array([R1PRO.base.corners[:, 0].max() + 0.25, 0.0, 0.0])
    edge = R1PRO.cameras["head"].fov_rad / 2
    assert down(work.motion.torso, foot) > edge
    torsos = carry_out(work, look_down(work, 0.95))
    assert down(torsos[-1], foot) < edge
    torsos = carry_out(work, look_down(work, 0.1))
    assert abs(R1PRO.trunk.posture(torsos[-1])[2]) < 0.1


@pytest.mark.parametrize("slant_rad", [0.0, 0.23])
def test_hands_meet_over_a_container_that_hangs_on_a_slant(world: SimWorld, slant_rad: float) -> None:
    """What is let go of over it is clear of its higher side, and both arms reach so far."""
    handle = np.array([0.0, 0.0, max(s.aabb()[1, 2] for s in world.solids("bin")) - world.pose("bin")[2, 3] - 0.01])
    hangs, grip = kin.rot_z(1.7) @ kin.rot_y(slant_rad), HANDS["left"][:3, 3]
    can = kin.transform(np.eye(3), HANDS["right"][:3, 3])
    work = holding(world, {"left": ("bin", kin.transform(hangs, grip - hangs @ handle)), "right": ("can", can)})
    assert next(reach_over(work, "right", "bin")).shape == (23,)
