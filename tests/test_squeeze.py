"""What two hands hold between them is told from where they are and where they were told to be."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.model import SIGN
from mpvi_bt.ground.robot.motion import Motion
from mpvi_bt.ground.robot.protocol import SIDES, Proprioception, Side
from mpvi_bt.ground.robot.squeeze import pressing, squeezes
from mpvi_bt.hands.robots import r1
from mpvi_bt.hands.robots.r1 import R1
from tests.layouts import LAYOUT

TORSO = np.array([0.3, 0.0, 0.25, 0.5])


def facing_hands(apart_m: float, turned_rad: float = 0.0) -> dict[Side, Array]:
    """Postures of the arms: hands that far apart before the chest, each turned away from the other by an angle."""
    arms = {}
    for side in SIDES:
        sign = SIGN[side]
        inward = np.array([np.sin(turned_rad), -sign * np.cos(turned_rad), 0.0])
        T = kin.transform(kin.hand_rotation(inward, np.array([0.0, 0.0, 1.0])), (0.45, sign * apart_m / 2, 0.75))
        q = R1.nearest_posture(kin.inverse(R1.chest(TORSO)) @ T, side, r1.TRAVEL_ARM[side])
        assert q is not None
        arms[side] = q
    return arms


def hanging_hands(apart_m: float) -> dict[Side, Array]:
    """Postures of the arms: fingers that point down that far apart, their flat sides toward each other."""
    arms = {}
    for side in SIDES:
        R = kin.hand_rotation(np.array([0.0, 0.0, -1.0]), np.array([1.0, 0.0, 0.0]))
        T = kin.transform(R, (0.45, SIGN[side] * apart_m / 2, 0.75))
        q = R1.nearest_posture(kin.inverse(R1.chest(TORSO)) @ T, side, r1.TRAVEL_ARM[side])
        assert q is not None
        arms[side] = q
    return arms


def felt(arm: Mapping[Side, Array], told: Mapping[Side, Array]) -> Proprioception:
    zero = {s: np.zeros(7) for s in SIDES}
    ones = dict.fromkeys(SIDES, 1.0)
    return Proprioception(np.zeros(3), np.zeros(3), TORSO, arm, zero, ones, ones, told)


@given(st.floats(0.025, 0.15))
def test_hands_that_face_each_other_and_are_kept_apart_squeeze(by_m: float) -> None:
    """Whatever keeps them from closing in by more than two centimeters is between them."""
    assert squeezes(felt(facing_hands(0.40), facing_hands(0.40 - by_m)))


@given(st.floats(0.025, 0.15))
def test_fingers_that_hang_down_squeeze_with_their_flat_sides(by_m: float) -> None:
    """So a thin sheet is taken, which no tip of a finger that points at it would meet below its edge."""
    assert squeezes(felt(hanging_hands(0.40), hanging_hands(0.40 - by_m)))
    assert not squeezes(felt(hanging_hands(0.40), hanging_hands(0.40)))


@given(st.floats(-0.10, 0.015))
def test_hands_that_are_where_they_were_told_to_be_do_not_squeeze(by_m: float) -> None:
    """A centimeter is the arms' own give; hands that were told to part press nothing."""
    assert not squeezes(felt(facing_hands(0.40), facing_hands(0.40 - by_m)))


@pytest.mark.parametrize("turned", [1.3, 1.55])
def test_hands_that_do_not_face_each_other_do_not_squeeze(turned: float) -> None:
    """Two hands that point ahead may be held up by a wall, but have nothing between them."""
    assert not squeezes(felt(facing_hands(0.40, turned), facing_hands(0.32, turned)))


def test_a_robot_that_does_not_tell_its_commands_is_never_said_to_squeeze() -> None:
    """Without the commands nothing can be told, and nothing is guessed."""
    assert not squeezes(felt(facing_hands(0.40), {}))


def test_what_two_hands_press_is_moved_as_gently_as_what_fingers_hold() -> None:
    """A box that only friction holds turns about the hands when they jerk: standing up takes longer with it."""
    taken = []
    for pressing_m in (0.0, 0.08):
        motion = Motion(felt(facing_hands(0.40), facing_hands(0.40 - pressing_m)))
        taken.append(0)
        for action in motion.stand(TORSO + [0.1, 0.0, -0.2, 0.0]):
            motion.felt = replace(motion.felt, torso=action[LAYOUT.torso])
            taken[-1] += 1
    assert taken[1] > 1.3 * taken[0]


@given(st.floats(0.15, 0.22), st.floats(0.5, 0.9), st.floats(0.0, 1.2))
def test_hands_press_toward_each_other_and_nowhere_else(half: float, height: float, slant: float) -> None:
    """The springs of an arm that is told so push its fingertips along the line between them, with the same force."""
    torso = np.array([0.3, 0.0, 0.25, 0.5])
    arms = {}
    for side in SIDES:
        approach = np.array([0.0, -SIGN[side] * np.cos(slant), -np.sin(slant)])
        T = kin.transform(kin.hand_rotation(approach, np.array([1.0, 0.0, 0.0])), (0.45, SIGN[side] * half, height))
        q = R1.nearest_posture(kin.inverse(R1.chest(torso)) @ T, side, r1.TRAVEL_ARM[side])
        if q is None:
            return
        arms[side] = q
    told, forces = pressing(R1, torso, arms), {}
    for side in SIDES:
        moved = [(R1.tcp(torso, arms[side] + 1e-5 * e, side) - R1.tcp(torso, arms[side], side)) for e in np.eye(7)]
        slope = np.stack([(m @ [0, 0, 0.012, 1.0])[:3] for m in moved], 1) / 1e-5  # (3, 7) of the tips by the joints
        torque = 1e3 * (told[side] - arms[side])
        assert np.abs(torque).max() < 100.0  # what a drive can do
        forces[side] = np.linalg.lstsq(slope.T, torque, rcond=None)[0]
        np.testing.assert_allclose(slope.T @ forces[side], torque, atol=0.5)  # a force, and no twist
        assert abs(forces[side][1]) > 50.0
        np.testing.assert_allclose(forces[side][[0, 2]], 0.0, atol=1.0)
    np.testing.assert_allclose(forces["left"], -forces["right"], atol=1.0)
