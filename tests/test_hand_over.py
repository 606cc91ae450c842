"""Handing over: what ways there are to take a thing out of another hand, and that it really changes hands."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from mpvi_bt.finding.perception.segmentation import SegmentationDetector
from mpvi_bt.finding.scene.handling import InHand
from mpvi_bt.finding.scene.hands import Held
from mpvi_bt.finding.scene.seen import Seen
from mpvi_bt.finding.scene.thing_store import SeenThing
from mpvi_bt.finding.shapes.shape import Shape
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.solids import Solid
from mpvi_bt.ground.robot.collision import Load
from mpvi_bt.hands.robots.r1 import R1
from mpvi_bt.hands.skills.hand_over import takes
from tests.small_house import small_world


def held(half: tuple[float, float, float]) -> Held:
    """A block whose middle is at the tcp, its axes those of the hand."""
    solids = (Solid("box", np.array(half), np.eye(4)),)
    return Held("block", "right", np.eye(4), solids, Load(solids))


@given(st.tuples(st.floats(0.01, 0.04), st.floats(0.01, 0.04), st.floats(0.01, 0.15)))
def test_takes_are_around_the_thing_and_off_the_giving_hand(half: tuple[float, float, float]) -> None:
    """A taking hand's tcp lies on the thing, where its fingers have room; the hands are apart or come from opposite."""
    for T in takes(R1.hand, held(half)):
        closing = int(np.abs(T[:3, 1]).argmax())
        assert 2 * half[closing] <= R1.hand.widest_m
        assert (np.abs(T[:3, 3]) <= np.array(half) + 1e-6).all()
        assert np.linalg.norm(T[:3, 3]) > 0.05 or T[2, 2] < -0.3


def test_what_is_too_wide_every_way_cannot_be_taken() -> None:
    """No finger goes around a block of 12 cm."""
    assert not list(takes(R1.hand, held((0.06, 0.06, 0.06))))


def test_fingers_hold_what_keeps_them_apart_not_what_lies_in_it() -> None:
    """Of a cup and the die in it, which is nearer to the tcp, the cup is held."""
    world = small_world({})
    felt = world.robot.proprioception()
    felt = replace(felt, gripper_width={**felt.gripper_width, "left": 0.07},
                   gripper_command={**felt.gripper_command, "left": -1.0})  # fmt: skip
    seen = Seen(SegmentationDetector({}))
    T = kin.base(felt.base_pose) @ R1.tcp(felt.torso, felt.arm["left"], "left")
    for name, half, off in (("die 1", 0.01, 0.0), ("cup 1", 0.035, 0.04)):
        at = kin.transform(np.eye(3), T[:3, 3] + [0.0, 0.0, off])
        shape = Shape("box", at, (Solid("box", np.full(3, half), at),), 0.0)
        seen.things.put(SeenThing(name, name[:3], shape))
    seen.feel(felt)
    assert seen.holding("left") == "cup 1"


def test_what_was_seen_in_a_hand_moves_with_it() -> None:
    """Points from two pictures, taken with the hand in two places, make one thing, where the hand is now."""
    rng = np.random.default_rng(0)
    block = rng.uniform(-1, 1, (900, 3))
    block[np.arange(900), rng.integers(0, 3, 900)] = rng.choice([-1.0, 1.0], 900)
    block *= [0.03, 0.02, 0.05]
    seen = InHand(width_m=0.04)
    for yaw, half in ((0.0, block[block[:, 0] > 0]), (2.0, block[block[:, 0] <= 0])):
        T = kin.transform(kin.rot_z(yaw), (0.5, 0.1, 0.8))
        seen.take_in(half @ T[:3, :3].T + T[:3, 3], np.array([0.0, 0.0, 1.3]), T)
    now = kin.transform(kin.rot_z(0.7), (0.2, -0.3, 1.0))
    shape = seen.shape(now)
    assert shape is not None
    np.testing.assert_allclose(shape.T[:3, 3], now[:3, 3], atol=0.006)
    np.testing.assert_allclose(sorted(shape.solids[0].half_m), [0.02, 0.03, 0.05], atol=0.006)


@pytest.mark.parametrize("lean", [0.0, 0.2, -0.35, 0.5])
def test_what_hangs_on_a_slant_is_seen_to(lean: float) -> None:
    """Of a bottle that has turned about the fingers one side is seen; its axis is known all the same."""
    rng = np.random.default_rng(0)
    angle, height = rng.uniform(-np.pi / 2, np.pi / 2, 600), rng.uniform(-0.18, 0.06, 600)
    side = np.stack([0.03 * np.cos(angle), 0.03 * np.sin(angle), height], -1)
    tilt = Rotation.from_rotvec([0.0, lean, 0.0]).as_matrix()
    T = kin.transform(kin.rot_z(0.6), (0.5, 0.1, 0.8))
    seen = InHand(width_m=0.04)
    seen.take_in(side @ tilt.T @ T[:3, :3].T + T[:3, 3], np.array([2.0, 0.7, 1.3]), T)
    shape = seen.shape(T)
    assert shape is not None
    up = shape.solids[0].T[:3, 2]
    axis = (T[:3, :3] @ tilt)[:, 2]
    assert np.arccos(min(1.0, abs(float(up @ axis)))) < 0.06
