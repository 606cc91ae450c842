"""Rows of actions: a policy of any rate and kind takes the time, and leads to the place, that it was trained for."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mpvi_bt.executive.actions.chunks import RecedingHorizon, TemporalEnsemble
from mpvi_bt.executive.actions.paced import Pace, PacedPolicy
from mpvi_bt.executive.remote.dialect_settings import load_settings
from mpvi_bt.executive.remote.observation import write_observation
from mpvi_bt.executive.remote.openpi import OpenpiPolicy
from mpvi_bt.executive.remote.own_keys import OwnKeys
from mpvi_bt.ground.errors import BadMessage, FileProblems, PolicyError, UserError
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.action_layout import KINDS, ActionKind
from mpvi_bt.ground.robot.action_rows import Resampler, as_absolute, composed, of_kind
from mpvi_bt.ground.robot.base_ramp import BaseRamp
from mpvi_bt.ground.robot.limits import BASE_ACCELERATION
from mpvi_bt.ground.robot.protocol import CONTROL_HZ
from mpvi_bt.ground.robot.robots import robot_named
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.choices.policies import check_policy_choice, for_clients, paced, rate_doubt
from mpvi_bt.runs.disturbances.late_policy import LatePolicy
from mpvi_bt.runs.episode.disturbed import actions_of
from mpvi_bt.testing.doubles import KinematicRobot
from tests.layouts import ACTION_SIZE, BASE, LAYOUT

RATES = st.sampled_from([1.0, 2.0, 5.0, 7.0, 10.0, 12.5, 15.0, 20.0, 25.0, 29.97, 30.0, 50.0, 60.0])
BASE, ELBOW, GRIP = BASE, LAYOUT.arm["right"].start + 3, LAYOUT.gripper["right"]
JOINTS = np.r_[LAYOUT.torso, LAYOUT.arm["left"], LAYOUT.arm["right"]]


class Rows:
    """A policy that answers with the next rows of a list, and gives up after the last."""

    name, cameras = "rows", ()

    def __init__(self, rows: Array, chunk: int = 4, rate_hz: float | None = None, actions: str = "absolute") -> None:
        self.rows, self.chunk, self.at, self.rate_hz, self.actions = rows, chunk, 0, rate_hz, actions
        self.committed: list[Array] = []

    @property
    def gave_up(self) -> bool:
        return self.at >= len(self.rows)

    def reset(self) -> None:
        pass

    def infer(self, observation: Mapping[str, Any]) -> Array:
        self.committed.append(observation.get("committed", np.empty(0)))
        rows = self.rows[self.at : self.at + self.chunk]
        self.at += self.chunk
        return rows.copy()


def played(policy: Any) -> Array:
    """(n, 23) what a robot is told until the policy has given up."""
    robot = KinematicRobot()
    policy = policy if isinstance(policy, PacedPolicy) else PacedPolicy(policy)
    told: list[Array] = []
    while not policy.gave_up:
        body = robot.proprioception()
        seen = {"prompt": "wave", "proprioception": body, "images": {}, "command": robot.action}
        for action in policy.infer(seen):
            robot.act(action)
            robot.advance(robot.action)
            told.append(action)
    return np.array(told)


def wave(steps: int) -> Array:
    """(n, 23) smooth motions of base and joints, a command a control step; the right hand closes for a moment."""
    time_s = np.arange(1, steps + 1)[:, None] / CONTROL_HZ
    told = np.zeros((steps, ACTION_SIZE))
    told[:, BASE] = np.array([0.5, -0.3, 0.8]) * np.sin(time_s * np.array([1.1, 0.7, 1.7]))
    told[:, JOINTS] = 0.3 * np.sin(time_s * np.linspace(0.5, 2.0, len(JOINTS)))
    told[:, list(LAYOUT.gripper.values())] = 1.0
    told[steps // 2 : steps // 2 + 3, GRIP] = -1.0
    return told


def recorded(steps: Array, rate_hz: float) -> Array:
    """(n, 23) rows of a rate that such commands make."""
    first = np.zeros(ACTION_SIZE)
    first[list(LAYOUT.gripper.values())] = 1.0
    return Resampler(LAYOUT).resampled(steps, CONTROL_HZ, rate_hz, first, whole=False)


def place(commands: Array) -> Array:
    """(3,) where a base gets that ramps its velocity as the simulated one does."""
    pose, velocity = np.zeros(3), np.zeros(3)
    for command in commands[:, BASE]:
        limit = BASE_ACCELERATION / CONTROL_HZ
        velocity = velocity + np.clip(command - velocity, -limit, limit)
        yaw = pose[2] + velocity[2] / CONTROL_HZ / 2
        c, s = math.cos(yaw), math.sin(yaw)
        turned = np.array([c * velocity[0] - s * velocity[1], s * velocity[0] + c * velocity[1], velocity[2]])
        pose = pose + turned / CONTROL_HZ
    return pose


@given(rate_hz=RATES, count=st.integers(1, 60), cuts=st.lists(st.integers(1, 59), max_size=4))
def test_rows_take_the_time_of_their_rate(rate_hz: float, count: int, cuts: list[int]) -> None:
    """However n rows come in chunks, n / rate seconds of them are whole control steps, and none is lost or added."""
    rows, resampler = np.zeros((count, ACTION_SIZE)), Resampler(LAYOUT)
    parts = np.split(rows, sorted(cut for cut in cuts if cut < count))
    steps = sum(len(resampler.resampled(part, rate_hz, CONTROL_HZ, rows[0])) for part in parts)
    assert steps == math.floor(count * CONTROL_HZ / Fraction(rate_hz).limit_denominator(1001))


@given(rate_hz=RATES, cuts=st.lists(st.integers(1, 11), max_size=4))
def test_chunks_change_nothing(rate_hz: float, cuts: list[int]) -> None:
    """Rows that come in several chunks are carried out as the same rows in one chunk are."""
    rows = recorded(wave(36), 10.0)
    whole = Resampler(LAYOUT).resampled(rows, rate_hz, CONTROL_HZ, rows[0])
    resampler, parts, before = Resampler(LAYOUT), [], rows[0]
    for part in np.split(rows, sorted(set(cuts))):
        steps = resampler.resampled(part, rate_hz, CONTROL_HZ, before)
        before = steps[-1] if len(steps) else before
        parts.append(steps)
    np.testing.assert_allclose(np.concatenate(parts), whole, atol=1e-9)


@pytest.mark.parametrize("rate_hz", [2.0, 7.0, 10.0, 15.0, 20.0, 30.0])
def test_a_recorded_motion_is_carried_out_in_its_time_to_its_place(rate_hz: float) -> None:
    """Recorded at any rate and played at that rate, 20 s take 20 s, and base, joints and hands get where they were."""
    steps = wave(600)
    told = played(Rows(recorded(steps, rate_hz), 1 if rate_hz == 7.0 else 4, rate_hz))
    assert abs(len(told) - len(steps)) <= math.ceil(CONTROL_HZ / rate_hz) - 1
    told = told[: len(steps)]
    np.testing.assert_allclose(told[-1, JOINTS], steps[-1, JOINTS], atol=0.02)
    assert np.abs(told[:, JOINTS] - steps[:, JOINTS]).max() < 0.3 * 4 / 8 / rate_hz**2 + 0.02
    assert np.hypot(*(place(told) - place(steps))[:2]) < 0.02
    assert told[:, GRIP].min() == -1.0  # the grasp of a tenth of a second


def test_a_policy_that_says_thirty_passes_bit_by_bit() -> None:
    """Absolute rows at the rate of control steps are the commands themselves."""
    steps = wave(50)
    for rate_hz in (None, 30.0):
        assert np.array_equal(played(Rows(steps, 7, rate_hz)), steps)


def test_a_row_ends_at_its_targets_and_holds_its_gripper() -> None:
    """At ten rows a second joints go in thirds, in a line, and a gripper is told with the first of three steps."""
    row = np.zeros((1, ACTION_SIZE))
    row[0, ELBOW], row[0, GRIP] = 0.3, -1.0
    robot = KinematicRobot()
    seen = {"prompt": "", "proprioception": robot.proprioception(), "images": {}, "command": robot.action}
    steps = PacedPolicy(Rows(row, 1, 10.0)).infer(seen)
    np.testing.assert_allclose(steps[:, ELBOW], [0.1, 0.2, 0.3])
    assert steps[:, GRIP].tolist() == [-1.0] * 3


@pytest.mark.parametrize("rate_hz", [2.0, 10.0, 15.0])
def test_a_row_keeps_the_way_of_the_base_though_it_ramps(rate_hz: float) -> None:
    """Velocities that go up within the base's acceleration lead as far as they say, and a stop is a stop."""
    count = round(CONTROL_HZ / rate_hz)
    wanted = np.repeat([[0.3 / rate_hz, 0.0, 0.0], [0.6 / rate_hz, 0.0, 0.0], *np.zeros((4, 3))], count, 0)
    told = BaseRamp().ramped(wanted, [k // count for k in range(len(wanted))], np.zeros(3))
    assert np.abs(np.diff(told, axis=0, prepend=np.zeros((1, 3)))).max(0)[0] <= 1.5 / CONTROL_HZ + 1e-12
    assert told[:, 0].sum() == pytest.approx(wanted[:, 0].sum(), abs=1e-9)
    assert np.abs(told[-count:]).max() < 0.01


def test_composed_velocities_lead_to_the_same_place() -> None:
    """One velocity in place of several, of a base that turns: the pose at the end is the same; the mean's is not."""
    velocities = wave(30)[:, BASE] * np.array([1.0, 1.0, 2.0])
    one = composed(velocities, [1 / CONTROL_HZ] * 30, 1.0)

    def end(held: Array) -> complex:
        way, yaw = 0j, 0.0
        for vx, vy, rate in held:
            for _ in range(100):
                yaw += rate / CONTROL_HZ / 200
                way += complex(math.cos(yaw), math.sin(yaw)) * complex(vx, vy) / CONTROL_HZ / 100
                yaw += rate / CONTROL_HZ / 200
        return way

    assert abs(end(np.tile(one, (30, 1))) - end(velocities)) < 1e-6
    assert abs(end(np.tile(velocities.mean(0), (30, 1))) - end(velocities)) > 1e-4


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("rate_hz", [10.0, 20.0, 30.0, 50.0])
def test_rows_of_all_kinds_say_the_same(kind: ActionKind, rate_hz: float) -> None:
    """The same motion as targets, as changes and as speeds is carried out alike, in chunks too."""
    rows = recorded(wave(120), min(rate_hz, 30.0))
    start = KinematicRobot().action
    robot = robot_named("r1")
    told = of_kind(rows, kind, rate_hz, start, LAYOUT)
    np.testing.assert_allclose(as_absolute(told, kind, rate_hz, start, robot), rows, atol=1e-12)
    expected = played(Rows(rows, 5, rate_hz))
    np.testing.assert_allclose(played(Rows(told, 5, rate_hz, kind)), expected, atol=1e-9)


@pytest.mark.parametrize(("kind", "given"), [("velocity", 40.0), ("delta", 4.0)])
def test_a_joint_that_is_to_go_farther_than_it_can_is_named_in_its_unit(kind: ActionKind, given: float) -> None:
    """Speeds are checked as speeds and changes as changes; the message names kind, joint, unit and what is possible."""
    row = np.zeros((1, ACTION_SIZE))
    row[0, ELBOW] = given
    unit = "rad/s" if kind == "velocity" else "rad in a row of 0.1 s"
    with pytest.raises(PolicyError, match=f"{kind}: right arm joint 4 is to move by {given:g} {unit}; the r1 takes"):
        played(Rows(row, 1, 10.0, kind))


def test_latency_chunks_and_ensembles_count_in_the_rows_of_the_policy() -> None:
    """A horizon is of rows, and what a late policy is told to be committed is in its own rate."""
    rows = recorded(wave(120), 10.0)
    assert len(played(PacedPolicy(RecedingHorizon(Rows(rows, 4, 10.0), 4)))) == 120
    assert len(PacedPolicy(TemporalEnsemble(Rows(rows, 4, 10.0))).infer(seen())) == 3
    inner = Rows(rows, 5, 10.0)
    late = LatePolicy(PacedPolicy(inner), lambda answer: 0.2, "go_on")
    for _ in range(3):
        late.infer(seen())
    assert inner.committed[2].shape == (2, ACTION_SIZE)
    np.testing.assert_allclose(inner.committed[2][-1, JOINTS], rows[9, JOINTS], atol=1e-9)


def seen() -> dict[str, Any]:
    robot = KinematicRobot()
    return {"prompt": "wave", "proprioception": robot.proprioception(), "images": {}, "command": robot.action}


def test_who_says_the_rate_comes_in_one_order(tmp_path: Path) -> None:
    """The option, then what the policy says, then its dataset, then nobody, which is 30; a contradiction is told."""
    (tmp_path / "meta").mkdir()
    (tmp_path / "meta/info.json").write_text(json.dumps({"fps": 15}))

    def pace(policy: Any, option: float | None = None) -> Pace | None:
        made = paced(policy, EpisodeConfig("picking_up_trash", policy="my:Policy", policy_rate=option))
        made.infer(seen())
        return made.pace

    own, silent, taught = Rows(wave(9), 9, 10.0), Rows(wave(9), 9), Rows(wave(9), 9)
    taught.dataset = str(tmp_path)  # type: ignore[attr-defined]
    assert pace(Rows(wave(9), 9, 10.0), 5.0) == Pace(5.0, "absolute", "--policy-rate; the policy says 10", True)
    assert pace(own) == Pace(10.0, "absolute", "the policy")
    assert pace(taught) == Pace(15.0, "absolute", f"the dataset {tmp_path}")
    assert pace(silent) == Pace(30.0, "absolute", "")


def test_a_contradiction_is_in_the_result_at_the_control_rate_too() -> None:
    """Rows of 30 Hz are worth a line only where nobody says so, or somebody else says another rate."""

    def told(own: float | None, option: float | None) -> str | None:
        config = EpisodeConfig("picking_up_trash", policy="my:Policy", policy_rate=option)
        made = paced(Rows(wave(9), 9, own), config)
        made.infer(seen())
        pace = actions_of(made)
        return None if pace is None else pace.said_by

    assert told(50.0, 30.0) == "--policy-rate; the policy says 50"
    assert told(30.0, 30.0) is None
    assert told(30.0, None) is None
    assert told(None, None) == "nobody"


def test_settings_get_the_rate_from_the_dataset_that_they_name(tmp_path: Path) -> None:
    """A settings file names the dataset that its policy was trained on, beside it; no dataset there is a problem."""
    file = tmp_path / "mine.yaml"
    file.write_text("dataset: set\n")
    with pytest.raises(FileProblems, match="no dataset of LeRobot's"):
        load_settings(str(file))
    (tmp_path / "set/meta").mkdir(parents=True)
    (tmp_path / "set/meta/info.json").write_text(json.dumps({"fps": 20}))
    assert (load_settings(str(file)).rate_hz, load_settings(str(file)).rate_from) == (20.0, "the dataset set")
    file.write_text("dataset: set\nrate_hz: 10\n")
    with pytest.raises(FileProblems, match="20 rows a second, and 'rate_hz' says 10"):
        load_settings(str(file))


def test_a_policy_without_a_rate_is_told_of() -> None:
    """What is run at 30 Hz for lack of a rate is said in a line with the option that mends it; else nothing is said."""
    config = EpisodeConfig("picking_up_trash", policy="tests.test_rates:Still")
    assert "runs at 30 Hz" in rate_doubt(config)
    assert "--policy-rate" in rate_doubt(config)
    remote = EpisodeConfig("picking_up_trash", policy="openpi:ws://localhost:1")
    assert "settings mpvi" in rate_doubt(remote)
    for silent in (
        EpisodeConfig("picking_up_trash", policy="tests.test_rates:Rated"),
        EpisodeConfig("picking_up_trash", policy="reactive"),
        EpisodeConfig("picking_up_trash", policy="openpi:ws://localhost:1", policy_settings="openpi_comet"),
        EpisodeConfig("picking_up_trash", policy="tests.test_rates:Still", policy_rate=10.0),
    ):
        assert rate_doubt(silent) == ""


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"policy": "reactive", "policy_rate": 10.0}, "reactive acts once a control step"),
        ({"policy": "expert", "policy_actions": "delta"}, "--policy-actions is of policies of your own"),
        ({"policy": "learned+openpi:ws://a:1", "policy_rate": 10.0}, "of one policy"),
        ({"policy": "tests.test_rates:Still", "policy_rate": 1e6}, "1 to 1000 rows a second"),
    ],
)
def test_a_rate_is_refused_where_it_means_nothing(more: dict[str, Any], said: str) -> None:
    """Policies of the package have a rate of their own; no rate is beyond what anybody means."""
    with pytest.raises(UserError, match=said):
        check_policy_choice(EpisodeConfig("picking_up_trash", **more))


def test_a_client_may_ask_at_its_own_rate() -> None:
    """A served policy of 30 Hz answers a client of 10 Hz with a row for three of its own; else as it is."""
    make = for_clients("tests.test_rates:Waving", 0)
    assert (make({}).rate_hz, len(make({}).infer(seen()))) == (30.0, 30)  # type: ignore[attr-defined]
    rows = make({}).infer({**seen(), "rate_hz": 10.0})
    np.testing.assert_allclose(rows[:, JOINTS], wave(30)[2::3][:, JOINTS], atol=1e-12)
    told = for_clients("tests.test_rates:Still", 0, rate_hz=5.0, kind="delta")({})
    assert (told.rate_hz, told.actions) == (5.0, "delta")  # type: ignore[attr-defined]


def test_a_client_of_the_executive_may_have_its_own_rate() -> None:
    """At 10 Hz an observation is three ticks, whose commands come as one row; other rates are refused."""
    keys, told = OwnKeys(), wave(3)
    body = KinematicRobot().proprioception()
    message = write_observation({"prompt": "", "proprioception": body, "images": {}})
    assert keys.read({**message, "rate_hz": 10.0}, robot_named("r1")).steps == 3
    (row,) = keys.answer(told, {"rate_hz": 10.0}, robot_named("r1"), told[0])["actions"]
    np.testing.assert_allclose(row[JOINTS], told[-1, JOINTS])
    with pytest.raises(BadMessage, match="must divide 30"):
        keys.read({**message, "rate_hz": 20.0}, robot_named("r1"))


@pytest.mark.parametrize(
    ("metadata", "given", "rate_hz", "who"),
    [
        ({"fps": 10}, {}, 10.0, "the server"),
        ({"rate_hz": 10, "fps": 20}, {}, 10.0, "the server"),
        ({"rate_hz": 10}, {"rate_hz": 20.0}, 20.0, "the settings; the server says 10"),
        ({}, {}, None, "the settings"),
    ],
)
def test_a_server_tells_its_rate(metadata: dict[str, Any], given: dict[str, Any], rate_hz: float, who: str) -> None:
    """By any of the names that are in use; what the settings say comes first, and both are told where they differ."""
    policy = OpenpiPolicy("localhost:1", load_settings("mpvi").model_copy(update=given))
    policy._hear_rate({**metadata, "actions": "velocity"})
    assert (policy.rate_hz, policy.actions) == (rate_hz, "velocity")
    assert rate_hz is None or policy.rate_from == who
    for wrong in ({"rate_hz": 0}, {"fps": "fast"}, {"actions": "torque"}):
        with pytest.raises(PolicyError, match="in the metadata"):
            policy._hear_rate(wrong)


class Waving(Rows):
    """One that waves for a second, thirty rows a second."""

    def __init__(self) -> None:
        super().__init__(wave(30), 30, 30.0)


class Still(Rows):
    """One that says no rate."""

    rate_hz: float | None = None

    def __init__(self) -> None:
        super().__init__(np.zeros((1, ACTION_SIZE)))


class Rated(Still):
    """One whose class says it."""

    rate_hz = 10.0
