"""Distances, times and the result file."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.human import human_stats
from mpvi_bt.ground.robot.protocol import Proprioception, Side
from mpvi_bt.hands.robots.r1 import R1
from mpvi_bt.house.goals.evaluate import judge, snapshot
from mpvi_bt.house.goals.problem import parse_problem
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.episode.metrics import DIRECTIONS, Measurement, Meter
from mpvi_bt.runs.episode.result import Result, make_result, read_result, write_json, write_result
from mpvi_bt.testing.doubles import KinematicRobot
from tests.fake_episodes import TASK, fake_result

CONFIG = EpisodeConfig("picking_up_trash", 3, 7)
FAILED = fake_result(EpisodeConfig("picking_up_trash", 1))


class Puppet(KinematicRobot):
    """A robot that stands as it is put."""

    def __init__(self) -> None:
        super().__init__()
        self.at = np.zeros(3)
        self.arms: dict[Side, Array] = {"left": np.full(7, 0.3), "right": np.full(7, -0.3)}

    def proprioception(self) -> Proprioception:
        return replace(super().proprioception(), base_pose=self.at.copy(), arm=dict(self.arms))

    def hand(self, side: Side) -> Array:
        """(3,) position of a hand in the base frame [m]."""
        felt = self.proprioception()
        return R1.tcp(felt.torso, felt.arm[side], side)[:3, 3]


class Stage:
    """A world that counts steps."""

    def __init__(self, robot: Any) -> None:
        self.robot, self.steps = robot, 0


def measured(*moves: Any) -> Measurement:
    """What the meter says after moves of a puppet."""
    meter, robot = Meter(), Puppet()
    stage: Any = Stage(robot)
    tree: Any = None
    meter.start(tree, stage)
    meter.step(tree, stage)  # the first tick comes before the first step
    for move in moves:
        move(robot)
        stage.steps += 1
        meter.step(tree, stage)
    return meter.measurement


def drive(x: float, y: float, yaw: float = 0.0) -> Any:
    """A move of the base."""
    return lambda robot: setattr(robot, "at", np.array([x, y, yaw]))


def test_distances_add_up_along_the_way() -> None:
    """There and back is twice the way, not none."""
    m = measured(drive(3, 4), drive(0, 0))
    assert m.base_m == pytest.approx(10)
    assert m.steps == 2
    assert m.time_s == pytest.approx(2 / 30)


def test_driving_moves_hands_in_the_world_but_not_in_the_base_frame() -> None:
    """World distances include the base's way and turns; base-relative ones do not."""
    m = measured(drive(1, 0), drive(1, 0, math.pi))
    radius = math.hypot(*Puppet().hand("left")[:2])
    assert m.base_m == pytest.approx(1)
    assert m.hand_world_m["left"] == pytest.approx(1 + 2 * radius)
    assert m.hand_base_m == pytest.approx({"left": 0, "right": 0}, abs=1e-12)


def test_reaching_counts_for_its_own_hand_only() -> None:
    """One hand's way is not the other's, and is the same in both frames while the base stands."""
    bent = np.full(7, 0.5)
    robot = Puppet()
    before = robot.hand("left")
    robot.arms["left"] = bent
    reach = math.dist(before, robot.hand("left"))
    m = measured(lambda robot: robot.arms.update(left=bent))
    assert reach > 0.05
    assert m.hand_world_m == pytest.approx({"left": reach, "right": 0})
    assert m.hand_base_m == pytest.approx({"left": reach, "right": 0})
    assert m.base_m == 0


def test_a_meter_that_saw_nothing_measures_nothing() -> None:
    """An episode that was over before it began has no way."""
    m = Meter().measurement
    assert (m.steps, m.base_m, m.hand_world_m) == (0, 0.0, {"left": 0.0, "right": 0.0})


def test_human_means_cover_the_fifty_tasks() -> None:
    """Each has positive figures, and the budget is twice the mean time in whole steps."""
    assert len(human_stats()) == 50
    for human in human_stats().values():
        assert min(human.steps, human.base_m, *human.hand_m.values()) > 0
        assert human.time_budget_s * 30 == pytest.approx(math.floor(2 * human.steps))


def test_normalized_figures_are_human_over_robot() -> None:
    """Twice the human's time is 0.5: higher is better, and the file says so."""
    human = human_stats()["picking_up_trash"]
    result = Result.model_validate(fake_result(CONFIG, steps=round(2 * human.steps)))
    assert result.time.normalized_time == pytest.approx(0.5, abs=1e-4)
    assert result.normalized_agent_distance.base == pytest.approx(human.base_m / result.agent_distance.base)
    assert set(DIRECTIONS) == set(result.directions)
    assert all("better" in words for words in result.directions.values())


def test_the_layout_is_the_evaluators() -> None:
    """The keys that BEHAVIOR's scorers read are where they look for them."""
    data = fake_result(CONFIG)
    assert set(data["agent_distance"]) == set(data["normalized_agent_distance"]) == {"base", "left", "right"}
    assert set(data["time"]) == {"simulator_steps", "simulator_time", "normalized_time"}
    assert data["q_score"] == {"final": 0.5}
    assert (data["task"], data["instance_id"], data["rollout_id"]) == ("picking_up_trash", 3, 7)
    assert CONFIG.name == "picking_up_trash_3_7"
    assert data["privileged"] == ["policy:expert"]


def test_three_scores_are_reported() -> None:
    """What held at the start: nothing in the official q, something in the other q; and the share of conditions."""
    data = fake_result(CONFIG)
    scores = {key: data[key] for key in ("q_score", "goal_fraction", "conditions_met")}
    assert scores == {"q_score": {"final": 0.5}, "goal_fraction": 0.5, "conditions_met": 0.0}
    assert scores.keys() <= set(DIRECTIONS)


def test_a_result_from_before_the_plain_fraction_gets_it_from_its_conditions() -> None:
    """Older files stay valid, and their third score is what their conditions say."""
    data = fake_result(CONFIG)
    del data["conditions_met"]
    data["goal"] = [{"condition": "p", "satisfied": True}, {"condition": "q", "satisfied": False}]
    assert Result.model_validate(data).conditions_met == 0.5
    with pytest.raises(ValidationError):
        Result.model_validate(data | {"goal": 3})


def test_without_wall_times_equal_configs_give_equal_files(monkeypatch: pytest.MonkeyPatch) -> None:
    """Everything that depends on the wall clock is under one key."""
    first = fake_result(CONFIG)
    monkeypatch.setenv("FAKE_SLEEP", "2")
    second = fake_result(CONFIG)
    assert first.pop("wall") != second.pop("wall")
    assert first == second


def test_where_pictures_go_is_no_part_of_the_config() -> None:
    """The same episode filmed is the same episode."""
    assert EpisodeConfig("t", 1, video=Path("a.mp4")).record() == EpisodeConfig("t", 1, picture=Path("b")).record()
    assert EpisodeConfig("t", 1).record() != EpisodeConfig("t", 1, checker="oracle").record()


def test_a_robot_that_stood_still_has_no_ratio() -> None:
    """Infinity is no JSON: null."""
    from mpvi_bt.executive.ticking.goal_report import GoalCondition, GoalReport

    zero: dict[Side, float] = {"left": 0.0, "right": 0.0}
    goal = GoalReport(satisfied=False, q=0.0, fraction=0.0, conditions=(GoalCondition("done", False),))
    result = make_result(CONFIG, TASK, goal, Measurement(0, 0.0, zero, zero), ended="failure")
    assert result.time.normalized_time is None
    assert result.normalized_agent_distance.model_dump() == {"base": None, "left": None, "right": None}
    json.dumps(result.model_dump(mode="json"), allow_nan=False)


def test_results_round_trip_through_their_file(tmp_path: Path) -> None:
    """What is written is what is read."""
    path = tmp_path / "json" / "a.json"
    write_result(path, fake_result(CONFIG))
    result = read_result(path)
    assert result is not None
    write_result(path, result)
    assert read_result(path) == result
    assert [p.name for p in path.parent.iterdir()] == ["a.json"]


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("q_score", {"final": 1.5}),
        ("steps", -1),
        ("steps", "9"),
        ("time", None),
        ("extra", 1),
        ("goal_fraction", math.nan),
    ],
)
def test_what_is_no_result_is_not_written(tmp_path: Path, key: str, value: object) -> None:
    """A result is checked before it reaches the disk."""
    with pytest.raises(ValidationError):
        write_result(tmp_path / "a.json", fake_result(CONFIG) | {key: value})
    assert not list(tmp_path.iterdir())


def test_a_failed_write_leaves_the_old_file(tmp_path: Path) -> None:
    """Nan is refused, and nothing half-written stays."""
    path = tmp_path / "a.json"
    write_json(path, {"x": 1})
    with pytest.raises(ValueError, match="JSON"):
        write_json(path, {"x": math.nan})
    assert json.loads(path.read_text()) == {"x": 1}
    assert [p.name for p in tmp_path.iterdir()] == ["a.json"]


def edited(**changes: Any) -> Callable[[dict[str, Any]], object]:
    """Other entries."""
    return lambda data: data.update(changes)


@pytest.mark.parametrize("signed", [True, False])
@pytest.mark.parametrize(
    "edit",
    [
        edited(success=True),
        edited(success=True, goal=[{"condition": "inside(can, bin)", "satisfied": True}]),
        edited(goal=[]),
        edited(conditions_met=1.0),
        lambda data: data["goal"][0].update(satisfied=True),
    ],
)
def test_a_result_that_contradicts_itself_is_none(
    tmp_path: Path, edit: Callable[[dict[str, Any]], object], signed: bool
) -> None:
    """q, success and the conditions of the goal say the same, in files of versions without a digest, too."""
    path = tmp_path / "a.json"
    write_result(path, FAILED)
    data = json.loads(path.read_text())
    edit(data)
    path.write_text(json.dumps({**data, **({} if signed else {"digest": None})}))
    assert read_result(path) is None


def test_a_goal_of_exactly_so_many_can_be_missed_by_one_too_many() -> None:
    """All that its best option wants holds, so both scores are 1, as by BEHAVIOR's evaluator; it is no success."""
    wanted = "(forn (1) (?x - cup) (inside ?x sink_1))"
    objects = "cup_1 cup_2 - cup sink_1 - sink"
    problem = parse_problem(f"(define (:objects {objects}) (:init ) (:goal {wanted}))", "cups")
    report = judge(problem, snapshot(problem, lambda literal: False), snapshot(problem, lambda literal: True))
    assert (report.satisfied, report.q, report.fraction) == (False, 1.0, 1.0)
    hands: dict[Side, float] = {"left": 0.0, "right": 0.0}
    result = make_result(CONFIG, TASK, report, Measurement(0, 0.0, hands, hands), ended="failure")
    assert (result.success, result.q) == (False, 1.0)


@given(data=st.data())
def test_a_result_that_was_changed_by_hand_is_none(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    """Any figure but a wall time; how the file is laid out, and wall times, tell nothing."""
    path = tmp_path_factory.getbasetemp() / "edited.json"
    write_result(path, FAILED)
    content = json.loads(path.read_text())
    path.write_text(json.dumps({**dict(reversed(content.items())), "wall": {"total_s": 7.0}}))
    assert read_result(path) is not None
    key = data.draw(st.sampled_from(sorted(content.keys() - {"wall"})))
    old = content[key]
    more: dict[type, Any] = {int: 1, float: 1.0, bool: True, str: "x", list: [old], dict: {"more": 1}}
    grown = {**old, "more": 1} if isinstance(old, dict) else 1 if old is None else old + more[type(old)]
    path.write_text(json.dumps(content | {key: grown}))
    assert read_result(path) is None


@pytest.mark.parametrize("kind", ["pipe", "device", "folder"])
def test_what_is_no_file_is_no_result(tmp_path: Path, kind: str) -> None:
    """A pipe that nobody writes to and a device that never ends are not waited for."""
    path = tmp_path / "a.json"
    {"pipe": lambda: os.mkfifo(path), "device": lambda: path.symlink_to("/dev/zero"), "folder": path.mkdir}[kind]()
    assert read_result(path) is None


@pytest.mark.parametrize("text", ["", "{", "[]", "null", '{"format": 1}', '{"q_score": NaN}'])
def test_what_cannot_be_read_is_no_result(tmp_path: Path, text: str) -> None:
    """A cut or foreign file reads as none, so that its episode runs again."""
    (tmp_path / "a.json").write_text(text)
    assert read_result(tmp_path / "a.json") is None
    assert read_result(tmp_path / "missing.json") is None
