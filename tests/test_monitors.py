"""Laws of the signals of a failing policy and of thresholds that stand on handoffs that went well."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mpvi_bt.executive.monitors.calibration import Calibration, Run, calibrate, fewest_runs, load_calibration
from mpvi_bt.executive.monitors.signals import SIGNALS, Signals
from mpvi_bt.ground.errors import FileProblems, UserError
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import CONTROL_HZ
from tests.layouts import ACTION_SIZE, LAYOUT
from tests.test_latency import BODY


def runs(count: int, seed: int, shift: float = 0.0, length: int = 40) -> list[Run]:
    """Handoffs whose signals are noise about a slope."""
    draws = np.random.default_rng(seed)
    slope = np.linspace(0, 3, length)[:, None]
    return [Run("pick", slope + shift + draws.normal(size=(length, len(SIGNALS)))) for _ in range(count)]


def moving(arm: float) -> Array:
    action = np.zeros(ACTION_SIZE)
    action[LAYOUT.arm["right"]] = arm
    return action


def test_an_arm_that_goes_to_and_fro_turns_back_and_one_that_goes_on_does_not() -> None:
    """Seven of fourteen joints turn at every step but the first two: 30/s x 7/14, less the start of the window."""
    steady, shaking = Signals(BODY), Signals(BODY)
    for step in range(60):
        steady.update(BODY, moving(0.01 * step))
        shaking.update(BODY, moving(0.01 * (step % 2)))
    assert steady.values[0] == 0.0
    assert shaking.values[0] == pytest.approx((60 - 2) * 7 / 14 / 2.0)


def test_what_gets_nowhere_stalls_and_any_progress_ends_it() -> None:
    """Arm, base, torso and fingers each count; less than their least does not."""
    signals = Signals(BODY)
    for _ in range(90):
        signals.update(BODY, moving(0.0))
    assert signals.values[2] == pytest.approx(3.0)
    for moved in (
        dataclasses.replace(BODY, arm={**BODY.arm, "left": BODY.arm["left"] + 0.1}),
        dataclasses.replace(BODY, base_pose=np.array([0.1, 0.0, 0.0])),
        dataclasses.replace(BODY, base_pose=np.array([0.0, 0.0, math.pi])),
        dataclasses.replace(BODY, torso=BODY.torso + 0.1),
        dataclasses.replace(BODY, gripper_width={"left": 0.05, "right": 0.1}),
    ):
        signals = Signals(BODY)
        signals.update(BODY, moving(0.0))
        signals.update(moved, moving(0.0))
        assert signals.values[2] == 0.0
        signals.update(dataclasses.replace(moved, base_velocity=np.ones(3)), moving(0.0))
        assert signals.values[2] == pytest.approx(1 / CONTROL_HZ)


def test_disagreement_is_the_most_of_the_window_and_grips_add_up() -> None:
    """A disagreement is forgotten after two seconds, a lost grasp is not."""
    signals = Signals(BODY)
    signals.update(BODY, moving(0.0), disagreement=0.3, notices=1)
    signals.update(BODY, moving(0.0), notices=1)
    assert (signals.values[1], signals.values[3]) == (0.3, 2.0)
    for _ in range(60):
        signals.update(BODY, moving(0.0))
    assert (signals.values[1], signals.values[3]) == (0.0, 2.0)


@pytest.mark.parametrize("alpha", [0.1, 0.2])
def test_runs_that_go_well_seldom_pass_a_threshold(alpha: float) -> None:
    """Over many calibrations the share of fresh good runs past it is at most alpha; of shifted ones it is most."""
    false: list[float] = []
    true: list[float] = []
    for seed in range(60):
        known, short = calibrate(runs(40, seed), "reactive", "r1", alpha)
        assert not short
        for shift, into in ((0.0, false), (6.0, true)):
            for run in runs(5, 1000 + seed, shift):
                passed = {name for t, row in enumerate(run.samples) for name, _, _ in known.alarms("pick", t, row)}
                into.append(len(passed) / len(SIGNALS))
    assert np.mean(false) <= alpha + 0.02
    assert np.mean(true) > 0.95


@given(st.integers(0, 17))
def test_too_few_runs_are_refused_with_the_number_that_is_needed(count: int) -> None:
    """Ten percent need nine held out and as many to fit: 18."""
    assert fewest_runs(0.1) == 18
    with pytest.raises(UserError, match=f"needs 18 handoffs.*{f'pick {count}' if count else 'none at all'}"):
        calibrate(runs(count, 0), "reactive", "r1", 0.1)


def test_a_skill_with_too_few_runs_is_told_and_never_alarms() -> None:
    """The others are calibrated."""
    few = [Run("wipe", run.samples) for run in runs(3, 1)]
    known, short = calibrate([*runs(20, 0), *few], "reactive", "r1")
    assert short == {"wipe": 3}
    assert known.alarms("wipe", 0, (math.inf,) * 4) == []
    assert len(known.alarms("pick", 10**6, (math.inf,) * 4)) == 4


def test_a_calibration_comes_back_from_its_file_and_only_for_its_policy_and_robot(tmp_path: Path) -> None:
    """The same bytes each time; another policy or robot is refused with both names; broken files with their places."""
    known, _ = calibrate(runs(20, 0), "reactive", "r1")
    file = tmp_path / "reactive.json"
    known.write(file)
    first = file.read_bytes()
    known.write(file)
    assert file.read_bytes() == first
    assert load_calibration(file, "reactive", "r1") == known
    with pytest.raises(UserError, match="policy 'reactive', and this run has 'expert'"):
        load_calibration(file, "expert", "r1")
    with pytest.raises(UserError, match="robot 'r1', and this run has 'fetch'"):
        load_calibration(file, "reactive", "fetch")
    file.write_text(first.decode().replace('"alpha": 0.1', '"alpha": 7'))
    with pytest.raises(FileProblems, match="5:11: should be less than 1, not 7"):
        load_calibration(file, "reactive", "r1")


def test_skills_that_ended_at_once_calibrate() -> None:
    """Handoffs of one sample are handoffs too."""
    known, _ = calibrate(runs(18, 3, length=1), "reactive", "r1")
    assert isinstance(known, Calibration)
    assert all(len(levels) == 1 for levels in known.skills["pick"].thresholds.values())
