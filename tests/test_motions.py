"""Posture and look_around on the kinematic robot."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from py_trees.common import Status

from mpvi_bt.executive.tree.saving import restore, save
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import SIDES
from mpvi_bt.hands.robots import r1
from tests.bench import Bench
from tests.layouts import LAYOUT


def yaw_turned(bench: Bench, ticks: int = 3000) -> float:
    """How far the base turns, over the wrap, until the tree ends [rad]."""
    turned, before = 0.0, bench.world.robot.proprioception().base_pose[2]
    for _ in range(ticks):
        status = bench.tick()
        now = bench.world.robot.proprioception().base_pose[2]
        turned += math.remainder(now - before, math.tau)
        before = now
        if status != Status.RUNNING:
            return turned
    pytest.fail("it never ended")


@settings(max_examples=15)
@given(degrees=st.none() | st.floats(-720, 720))
def test_it_turns_as_far_as_it_is_told_and_rests(degrees: float | None) -> None:
    """The total turn counts over the wrap, either way round, within two degrees; then the base rests."""
    bench = Bench("look_around:" if degrees is None else f"look_around: {degrees!r}")
    wanted = math.radians(360 if degrees is None else degrees)
    assert yaw_turned(bench) == pytest.approx(wanted, abs=math.radians(2))
    assert bench.tree.status == Status.SUCCESS
    assert not bench.base.any()
    assert np.allclose(bench.world.robot.proprioception().base_pose[:2], 0)


def test_it_speeds_up_and_slows_down_gently() -> None:
    """The commanded rate never leaps, so that what a hand holds by friction stays there."""
    bench = Bench("look_around: 90")
    rates = [0.0]
    while bench.tick() == Status.RUNNING:
        rates.append(float(bench.world.robot.proprioception().base_velocity[2]))
        assert bench.tree.root.feedback_message == "turning", "feedback without numbers that change every step"
    assert max(rates) == pytest.approx(0.8)
    assert np.abs(np.diff([*rates, 0.0])).max() < 0.1


def test_a_base_that_does_not_turn_fails_it() -> None:
    """Against a wall it gives up after three seconds and says how much was left."""
    bench = Bench("look_around: 90")
    bench.world.robot.advance = lambda action: None  # type: ignore[method-assign]
    assert bench.run(200) == Status.FAILURE
    assert (bench.failure.reason, bench.failure.evidence) == ("blocked", "the base stopped turning 90 degrees short")
    assert bench.failure.time_s == pytest.approx(3.0, abs=0.1)


def test_a_resumed_turn_is_only_the_rest_of_it() -> None:
    """Stopped in the middle and restored, it does not begin from zero; begun again after its end, it does."""
    first, second = Bench("look_around: 90"), Bench("look_around: 90")
    first.run(40)
    before = float(first.world.robot.proprioception().base_pose[2])
    second.tree.setup(second.context)
    restore(second.tree, save(first.tree))
    assert 0.1 < before < 1.5
    assert before + yaw_turned(second) == pytest.approx(math.pi / 2, abs=0.06)
    assert yaw_turned(second) == pytest.approx(math.pi / 2, abs=0.04)


def test_travel_posture_folds_what_is_empty() -> None:
    """Empty hands end where they travel, the torso upright, and the robot rests."""
    bench = Bench("posture: travel")
    assert bench.run(2000) == Status.SUCCESS
    body = bench.world.robot.proprioception()
    for side in SIDES:
        assert np.abs(body.arm[side] - r1.TRAVEL_ARM[side]).max() < 0.05
    assert np.abs(body.torso - r1.TRAVEL_TORSO).max() < 0.02
    assert not bench.base.any()
    assert bench.context.stopwatch.seconds["motion"] > 0, "planning is not the tree's own time"


def test_a_posture_that_is_not_reached_is_a_failure() -> None:
    """Arms that do not move are told of by name."""
    bench = Bench("posture: travel")
    advance = bench.world.robot.advance

    def stuck(action: Array) -> None:
        action = action.copy()
        action[LAYOUT.arm["left"]] = bench.world.robot.proprioception().arm["left"]
        advance(action)

    bench.world.robot.advance = stuck  # type: ignore[method-assign]
    assert bench.run(2000) == Status.FAILURE
    assert bench.failure.reason == "not_reached"
    assert "the left arm" in bench.failure.evidence


@pytest.mark.parametrize("root", ["posture: travel", "look_around:"])
def test_an_interrupted_motion_holds(root: str) -> None:
    """Cut off in the middle, base and arms rest, and it can begin again."""
    bench = Bench(root)
    bench.run(20)
    assert bench.tree.status == Status.RUNNING
    bench.tree.interrupt()
    before = bench.world.robot.proprioception()
    bench.world.step()
    after = bench.world.robot.proprioception()
    assert np.allclose(before.base_pose, after.base_pose)
    assert all(np.allclose(before.arm[side], after.arm[side]) for side in SIDES)
    assert bench.run(3000) == Status.SUCCESS
