"""Laws of latency in simulated time: how it is written, drawn and replayed, and what a late policy's robot does."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mpvi_bt.executive.behaviors.context import Log, Query, Replan
from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.protocols import Policy
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, Proprioception
from mpvi_bt.runs.disturbances.answer_times import TimedPolicy, measured_times
from mpvi_bt.runs.disturbances.late_policy import LatePolicy
from mpvi_bt.runs.disturbances.latency import LONGEST_S, PARTS, Latency, in_steps, read_latencies
from tests.layouts import ACTION_SIZE

BODY = Proprioception(
    base_pose=np.zeros(3),
    base_velocity=np.zeros(3),
    torso=np.full(4, 0.25),
    arm={"left": np.full(7, 0.1), "right": np.full(7, 0.2)},
    arm_velocity={"left": np.zeros(7), "right": np.zeros(7)},
    gripper_width={"left": 0.1, "right": 0.1},
    gripper_command={"left": 1.0, "right": 1.0},
)


class Counting:
    """Its action i of call k commands 100 k + i + 1 everywhere, the base too; it keeps what it is told is committed."""

    name, cameras = "counting", ()

    def __init__(self, length: int) -> None:
        self.length, self.calls = length, 0
        self.committed: list[Array | None] = []

    def reset(self) -> None:
        pass

    def infer(self, observation: Mapping[str, Any]) -> Array:
        self.committed.append(observation.get("committed"))
        chunk = np.repeat(100.0 * self.calls + 1 + np.arange(self.length)[:, None], ACTION_SIZE, 1)
        self.calls += 1
        return chunk


def ask(policy: Policy) -> Array:
    return policy.infer({"prompt": "pick up the cup", "proprioception": BODY, "images": {}})


@given(st.sampled_from(PARTS), st.floats(0, LONGEST_S), st.floats(0, LONGEST_S), st.integers(0, 99), st.integers(0, 9))
def test_a_latency_is_read_as_it_is_written(part: str, a: float, b: float, answer: int, seed: int) -> None:
    """A range comes back; every draw lies in it and is the same each time."""
    low, high = sorted((a, b))
    (latency,) = read_latencies(f"{part}={low!r}..{high!r}").values()
    drawn = latency.of(answer, seed, part)
    assert low <= drawn <= high
    assert drawn == latency.of(answer, seed, part)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("policy=-0.1", "0 to 600 s, not -0.1"),
        ("policy=nan", "0 to 600 s, not nan"),
        ("policy=601", "0 to 600 s"),
        ("policy=soon", "no number of seconds"),
        ("policy", "is not PART=SECONDS"),
        ("", "is not PART=SECONDS"),
        ("policy=1,policy=2", "given twice"),
        ("polcy=1", "Did you mean 'policy'"),
        ("policy=2..1", "the second time is the longer one"),
        ("policy=@nowhere.json", "nowhere.json"),
    ],
)
def test_a_latency_that_cannot_be_is_refused(given: str, said: str) -> None:
    """In one line that says what is wrong."""
    with pytest.raises(UserError, match=said):
        read_latencies(given)


def test_measured_times_come_in_turn(tmp_path: Path) -> None:
    """Of a file that has them by part, and of a bare list; over and over."""
    file = tmp_path / "measured.json"
    file.write_text(json.dumps({"policy": [0.1, 0.3], "checker": [2]}))
    both = read_latencies(f"policy=@{file},checker=@{file}")
    assert [both["policy"].of(i, 0, "policy") for i in range(4)] == [0.1, 0.3, 0.1, 0.3]
    file.write_text("[0.5]")
    assert read_latencies(f"planner=@{file}") == {"planner": Latency(measured_s=(0.5,))}


@pytest.mark.parametrize(
    "content",
    ["{}", '{"policy": []}', '{"policy": [true]}', "[", '{"policy": [-1]}', '["1"]', f'{{"policy": [{"9" * 400}]}}'],
)
def test_a_file_without_times_is_refused(tmp_path: Path, content: str) -> None:
    """What is no list of possible times; the file is named."""
    (tmp_path / "bad.json").write_text(content)
    with pytest.raises(UserError, match=r"--latency: .*bad\.json"):
        read_latencies(f"policy=@{tmp_path / 'bad.json'}")


@pytest.mark.parametrize(("seconds", "steps"), [(0.0, 0), (0.4, 12), (0.401, 13), (1 / 30, 1), (0.001, 1)])
def test_an_answer_is_there_at_the_next_step(seconds: float, steps: int) -> None:
    """A step that has begun is waited for; whole steps are not rounded up."""
    assert in_steps(seconds) == steps


@given(length=st.integers(1, 12), delay=st.integers(0, 20), calls=st.integers(1, 4))
def test_a_holding_robot_waits_and_then_does_all_of_the_chunk(length: int, delay: int, calls: int) -> None:
    """d steps with the base at rest and every target kept, then the chunk unchanged."""
    policy = LatePolicy(Counting(length), lambda call: delay / CONTROL_HZ, "hold")
    target = BODY.arm["left"][0]
    for call in range(calls):
        actions = ask(policy)
        assert len(actions) == delay + length
        assert not actions[:delay, :3].any()
        assert (actions[:delay, 7] == target).all()
        np.testing.assert_array_equal(actions[delay:, 0], 100 * call + 1 + np.arange(length))
        target = actions[-1, 7]
    assert policy.stale_action_ratio == pytest.approx(delay / (delay + length))
    assert policy.effective_control_hz == pytest.approx(CONTROL_HZ * length / (delay + length))


@given(length=st.integers(2, 12), delay=st.integers(0, 6), calls=st.integers(3, 5))
def test_a_robot_that_goes_on_never_waits_where_chunks_are_long_enough(length: int, delay: int, calls: int) -> None:
    """From the second answer on the old chunk covers the wait where d <= H - d; each action is done in its step."""
    inner = Counting(length)
    policy = LatePolicy(inner, lambda call: delay / CONTROL_HZ, "go_on")
    done = [ask(policy) for _ in range(calls)]
    assert (done[0][:delay, 0] == 0).all()
    if delay > length - delay:
        assert policy.stale > delay
        return
    assert policy.stale == delay
    for call, actions in enumerate(done[1:], start=1):
        np.testing.assert_array_equal(actions[:delay, 0] // 100, np.full(delay, call - 1))
        fresh = actions[delay:, 0] - 100 * call - 1
        np.testing.assert_array_equal(fresh, delay + np.arange(len(fresh)))
        np.testing.assert_array_equal(inner.committed[call], actions[:delay])


def test_a_handoff_drops_what_was_kept_back() -> None:
    """After a reset the robot holds where it is: the old chunk was of another prompt."""
    policy = LatePolicy(Counting(10), lambda call: 2 / CONTROL_HZ, "go_on")
    ask(policy)
    policy.reset()
    assert (ask(policy)[:2, 7] == BODY.arm["left"][0]).all()


def test_times_that_a_run_took_can_be_replayed(tmp_path: Path) -> None:
    """What is written of policy, checker and planner is what `--latency` reads, in its order."""
    timed = TimedPolicy(Counting(3))
    for _ in range(2):
        ask(timed)
    log = Log()
    log.queries.append(Query("it is on", "grip", None, True, "", "tree/a", 1.0, latency_s=0.7))
    log.replans.append(Replan("tree/b", None, "", 2.0, latency_s=3.5))
    file = tmp_path / "measured.json"
    file.write_text(json.dumps(measured_times([0.25, 0.5], log, 4.0)))
    read = read_latencies(",".join(f"{part}=@{file}" for part in PARTS))
    assert read["policy"].measured_s == (0.25, 0.5)
    assert read["checker"].measured_s == (0.7,)
    assert read["planner"].measured_s == (4.0, 3.5)
    assert len(timed.took_s) == 2
    assert min(timed.took_s) > 0


def test_a_part_that_gave_no_answer_is_not_in_the_file() -> None:
    """An empty list could not be replayed."""
    assert measured_times([], Log(), None) == {}
