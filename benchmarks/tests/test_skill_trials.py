"""Skills in drawn scenes, by simulator truth: one trial of each, as `python -m benchmarks.hands` plays them."""

from __future__ import annotations

import pytest

from benchmarks.hands.policies import POLICIES
from benchmarks.hands.rows import Job
from benchmarks.hands.runner import run_job
from benchmarks.hands.scenes import draw
from benchmarks.hands.trial import play
from mpvi_bt.ground.robot.protocol import SIDES


@pytest.mark.slow
@pytest.mark.parametrize("policy", ["expert", pytest.param("reactive", marks=pytest.mark.render)])
def test_a_thing_changes_hands(policy: str) -> None:
    """Both fingers of the other hand are on it, and the first hand is empty, by simulator truth."""
    row = run_job(Job("hand_over", "any", policy, 0, "tuning"))
    assert row.ok, row.cause


@pytest.mark.slow
@pytest.mark.parametrize("policy", ["expert", pytest.param("reactive", marks=pytest.mark.render)])
def test_a_box_is_lifted_off_the_floor(policy: str) -> None:
    """By friction alone, level, and off everything, by simulator truth."""
    row = run_job(Job("lift", "floor", policy, 0, "tuning"))
    assert row.ok, row.cause


@pytest.mark.rare
@pytest.mark.slow
@pytest.mark.parametrize("policy", ["expert", pytest.param("reactive", marks=pytest.mark.render)])
def test_a_top_is_wiped(policy: str) -> None:
    """All but a twentieth of it was in touch with the tool, which is still in the hand, by simulator truth."""
    row = run_job(Job("wipe", "top", policy, 1, "tuning"))
    assert row.ok, row.cause


@pytest.mark.slow
@pytest.mark.parametrize("policy", ["expert", pytest.param("reactive", marks=pytest.mark.render)])
def test_what_is_in_a_held_vessel_ends_up_in_another(policy: str) -> None:
    """All of it is in the receiver, and the vessel still in the hand, by simulator truth."""
    row = run_job(Job("pour", "floor", policy, 0, "tuning"))
    assert row.ok, row.cause


@pytest.mark.slow
@pytest.mark.render
def test_it_picks_things_up_from_tables_with_either_hand():
    """Of eight fresh scenes most are done, some with each hand, by physics and the simulator's truth."""
    hands = []
    for seed in range(700, 708):
        trial = draw("pick", "table", seed, "tuning")
        world = trial.world(render=True)
        own = POLICIES["learned"].make(world, seed, 0.0)
        if not play(trial, world, own, world.robot).missing:
            hands += [side for side in SIDES if world.pinched(side)]
    assert len(hands) >= 5
    assert set(hands) == set(SIDES)
