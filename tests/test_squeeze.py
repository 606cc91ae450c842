"""What two hands hold between them is told from where they are and where they were told to be."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mpvi_bt.robot import kinematics as kin
from mpvi_bt.robot import r1
from mpvi_bt.robot.model import SIGN
from mpvi_bt.robot.motion import Motion
from mpvi_bt.robot.protocol import SIDES, ActionLayout, Proprioception, Side
from mpvi_bt.robot.r1 import R1
from mpvi_bt.robot.solids import Array
from mpvi_bt.robot.squeeze import squeezes

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


def felt(arm: Mapping[Side, Array], told: Mapping[Side, Array]) -> Proprioception:
    zero = {s: np.zeros(7) for s in SIDES}
    ones = dict.fromkeys(SIDES, 1.0)
    return Proprioception(np.zeros(3), np.zeros(3), TORSO, arm, zero, ones, ones, told)


@given(st.floats(0.025, 0.15))
def test_hands_that_face_each_other_and_are_kept_apart_squeeze(by_m: float) -> None:
    """Whatever keeps them from closing in by more than two centimeters is between them."""
    assert squeezes(felt(facing_hands(0.40), facing_hands(0.40 - by_m)))


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
            motion.felt = replace(motion.felt, torso=action[ActionLayout.TORSO])
            taken[-1] += 1
    assert taken[1] > 1.3 * taken[0]
