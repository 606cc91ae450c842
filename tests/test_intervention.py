"""Laws of the nodes that tell a failing handoff and take the robot back: monitor, back_off, a check at once."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from py_trees.common import Status

from mpvi_bt.executive.monitors.alarms import Alarms
from mpvi_bt.executive.monitors.calibration import Calibration, SkillThresholds
from mpvi_bt.executive.monitors.signals import SIGNALS
from mpvi_bt.executive.ticking.saved_run import SavedRun, restore_world, save_run
from mpvi_bt.ground.errors import BackendError, NodeError
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.runs.choices.lateness import LateChecker
from mpvi_bt.runs.disturbances.faulty_policy import FaultyPolicy
from mpvi_bt.testing import StraightNavigator
from tests.bench import HELD, PICK, PLACES, Bench
from tests.layouts import ACTION_SIZE, LAYOUT

WATCHED = "monitor: pick\nchild:\n  " + PICK.replace("\n", "\n  ")


class Shaking:
    """Commands the right arm to and fro, and gets nowhere."""

    name, cameras = "shaking", ()

    def reset(self) -> None:
        pass

    def infer(self, observation: Mapping[str, Any]) -> Array:
        action = np.zeros((2, ACTION_SIZE))
        action[:, LAYOUT.torso] = observation["proprioception"].torso
        action[1, LAYOUT.arm["right"]] = 0.01
        return action


def calibrated(**limits: float) -> Calibration:
    """Thresholds that hold from the first sample on; those not named are never passed."""
    levels: Any = {name: [limits.get(name, 1e9)] for name in SIGNALS}
    pick = SkillThresholds(runs=18, thresholds=levels)
    return Calibration(policy="any", robot="r1", alpha=0.1, skills={"pick": pick})


def watched(calibration: Calibration | None, root: str = WATCHED) -> Bench:
    bench = Bench(root, {HELD: (False,)})
    bench.context.policy = Shaking()
    bench.context.calibration = calibration
    return bench


def test_two_signals_past_their_thresholds_are_an_alarm() -> None:
    """FAILURE with both told, at the first sample at which they are, long before any timeout."""
    bench = watched(calibrated(reversals=1.0, stall=2.0))
    assert bench.run(300) is Status.FAILURE
    assert bench.failure.reason == "alarm"
    assert "reversals" in bench.failure.evidence
    assert "stall" in bench.failure.evidence
    assert 2.0 < bench.world.time_s < 3.0
    (handoff,) = bench.context.log.handoffs
    assert (handoff.skill, handoff.ended, handoff.reason) == ("pick", "failure", "alarm")


def test_one_signal_alone_is_none_unless_one_is_enough() -> None:
    """The number that must agree is the node's."""
    assert watched(calibrated(stall=2.0)).run(300) is Status.RUNNING
    one = WATCHED.replace("monitor: pick", "monitor: pick\nagree: 1")
    assert watched(calibrated(stall=2.0), one).run(300) is Status.FAILURE


def test_one_signal_alone_is_an_alarm_once_it_has_lasted() -> None:
    """So long after it passed its threshold; one that falls back under it begins anew. Odd commands alone are none."""
    lasting = WATCHED.replace("monitor: pick", "monitor: pick\nalone: 3")
    bench = watched(calibrated(stall=2.0), lasting)
    assert bench.run(300) is Status.FAILURE
    assert bench.failure.reason == "alarm"
    assert 5.0 < bench.world.time_s < 6.0
    alarms = Alarms(2, 1.0)
    assert not any(alarms.update(past) for past in (["stall"], ["stall"], [], ["stall"], ["stall"]))
    assert alarms.update(["stall"])
    assert not any(alarms.update(["reversals"]) for _ in range(9))


def test_without_a_calibration_it_only_records() -> None:
    """It says so, never alarms, and has four numbers every half second."""
    bench = watched(None)
    assert bench.run(300) is Status.RUNNING
    assert bench.tree.root.feedback_message == "no alarms: not calibrated for pick"
    bench.tree.root.stop(Status.INVALID)
    (handoff,) = bench.context.log.handoffs
    assert handoff.ended == "interrupted"
    assert np.array(handoff.samples).shape == (20, len(SIGNALS))


def test_a_success_at_the_tick_of_an_alarm_stands() -> None:
    """The child is ticked first; what ends it, ends it."""
    bench = Bench(WATCHED)
    bench.world.robot.between_m["right"] = 0.05
    bench.context.calibration = calibrated(**dict.fromkeys(SIGNALS, -1.0))
    assert bench.tick() is Status.FAILURE
    done = Bench("monitor: pick\nchild: {succeed: done}")
    done.context.calibration = calibrated(**dict.fromkeys(SIGNALS, -1.0))
    assert done.tick() is Status.SUCCESS
    assert [h.ended for h in done.context.log.handoffs] == ["success"]


def test_backing_off_takes_the_arms_back_to_where_the_handoff_began() -> None:
    """Through the same targets, the last one first; fingers and base stay."""
    bench = Bench("back_off:")
    targets = np.linspace(0, 1, 40)[:, None] * np.ones(ACTION_SIZE)
    bench.context.trail.extend(targets)
    fingers = bench.world.robot.action[[14, 22]].copy()
    commanded = []
    while bench.tick() is Status.RUNNING:
        commanded.append(bench.world.robot.action.copy())
    np.testing.assert_array_equal(np.array(commanded)[:, 7:14], targets[::-1, 7:14])
    np.testing.assert_array_equal(np.array(commanded)[:, [14, 22]], np.tile(fingers, (40, 1)))
    assert not np.array(commanded)[:, :3].any()
    limited = Bench("back_off: 10 steps")
    limited.context.trail.extend(targets)
    assert limited.run() is Status.SUCCESS
    assert len(limited.context.trail) == 30


def test_a_check_at_once_asks_once_and_fails_on_a_no() -> None:
    """In its first tick, whatever the hands do."""
    root = f"check_complete: {HELD}\nat_once: true"
    assert Bench(root).tick() is Status.SUCCESS
    no = Bench(root, {HELD: (False,)})
    assert no.tick() is Status.FAILURE
    assert no.failure.reason == "not_complete"
    assert [q.event for q in no.context.log.queries] == ["asked"]


def test_navigating_elsewhere_tells_the_navigator_to_leave() -> None:
    """Before it starts; one that cannot is just started."""

    class Leaving(StraightNavigator):
        def leave(self) -> None:
            told.append("leave")

        def start(self, target: str, room: str | None) -> None:
            told.append("start")
            super().start(target, room)

    told: list[str] = []
    bench = Bench("navigate: sink\nelsewhere: true")
    bench.context.navigator = Leaving(bench.world.robot, PLACES)
    assert bench.run() is Status.SUCCESS
    assert told == ["leave", "start"]
    assert Bench("navigate: sink\nelsewhere: true").run() is Status.SUCCESS


def test_a_robot_that_breaks_is_not_taken_for_a_dry_run(monkeypatch: pytest.MonkeyPatch) -> None:
    """What it raises at the handoff is the node's failure, not passed over."""
    bench = watched(None)

    def broken() -> None:
        raise BackendError("the connection is lost")

    monkeypatch.setattr(bench.world.robot, "proprioception", broken)
    with pytest.raises(NodeError, match="the connection is lost"):
        bench.tick()


def test_a_saved_run_keeps_what_a_late_checker_and_a_faulty_policy_have_counted() -> None:
    """So that their draws go on where they were."""

    def disturbed() -> Bench:
        bench = Bench(PICK)
        bench.context.policy = FaultyPolicy(Shaking(), {"jitter": 0.01})
        bench.context.checker = LateChecker(bench.context.checker, lambda answer: 0.1 * answer)
        return bench

    before, after = disturbed(), disturbed()
    before.run(100)
    before.context.checker.check(HELD, None)
    saved = SavedRun.model_validate_json(save_run(before.tree, before.world).model_dump_json())
    assert (saved.policy["handoffs"], saved.checker["answers"]) == (1, 1)
    restore_world(saved, after.world, after.context)
    after.tree.setup(after.context)
    again = save_run(after.tree, after.world)
    assert (again.policy, again.checker) == (saved.policy, saved.checker)
