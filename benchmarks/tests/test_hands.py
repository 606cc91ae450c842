"""Trials of skills: scenes are what they say, success cannot be had by trickery, results survive being killed."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from benchmarks.hands.__main__ import main
from benchmarks.hands.felt import Felt
from benchmarks.hands.pick import lifted, one_hand
from benchmarks.hands.place import fits, put
from benchmarks.hands.rooms import things
from benchmarks.hands.rows import Job, Row, add_row, read_rows
from benchmarks.hands.runner import run_job, run_jobs
from benchmarks.hands.scenes import choose, draw, skills
from benchmarks.hands.table import markdown, table
from benchmarks.hands.trial import Played, Shapes, Trial, play
from mpvi_bt.ground.errors import UnknownName, UserError
from mpvi_bt.ground.geometry.kinematics import wrap
from mpvi_bt.ground.geometry.solids import Array, pose
from mpvi_bt.house.sim.world import SimWorld
from mpvi_bt.testing.scene_builder import one_room
from tests.layouts import BASE, LAYOUT
from tests.small_house import placed

MINE = [(skill, case) for skill in skills() if skill == "pick" or skill.startswith("place") for case in skills()[skill]]
JOB = Job("pick", "floor", "expert", 0, "tuning")


class Scripted:
    """A policy that repeats an action, and says what it is told to after so many steps."""

    name, cameras = "scripted", ()

    def __init__(self, action: Callable[[int], Array], done_at: int = 10**9) -> None:
        self.action, self.done_at, self.steps, self.note = action, done_at, 0, ""

    def reset(self) -> None:
        self.steps = 0

    def infer(self, observation: Mapping[str, Any]) -> Array:
        self.steps += 1
        self.note = "done" if self.steps >= self.done_at else "at work"
        return self.action(self.steps)[None]


def trial(done: Callable[[SimWorld], str], budget_s: float = 12.0) -> Trial:
    return Trial(one_room({}), {"can": placed("can_of_soda", 1.0, 0.0)}, np.zeros(3), "pick up the can", done, budget_s)


def played(scene: Trial, done_at: int = 10**9, action: Callable[[SimWorld, int], Array] | None = None) -> Played:
    world = scene.world(render=False)
    policy = Scripted(lambda k: world.robot.action if action is None else action(world, k), done_at)
    return play(scene, world, policy, world.robot)


def turning(world: SimWorld, step: int) -> Array:
    action = world.robot.action
    action[BASE] = (0, 0, 0.3 if step % 2 else 0.4)
    return action


def test_success_has_to_last() -> None:
    """What is true for a moment only is no success; what stays true is, from when it began."""
    flicker = played(trial(lambda w: "" if w.steps == 30 else "never"), action=turning)
    assert flicker.missing == "never"
    assert flicker.simulated_s == pytest.approx(12.0, abs=0.2)
    lasting = played(trial(lambda w: "" if w.time_s > 2 else "not_yet"), action=turning)
    assert lasting.missing == ""
    assert lasting.simulated_s == pytest.approx(2.0, abs=0.2)


def test_success_that_the_policy_undoes_does_not_count() -> None:
    """A thing that is put down and knocked over again within the five seconds after is not put down."""
    outcome = played(trial(lambda w: "" if 2 < w.time_s < 5 else "toppled"), action=turning)
    assert outcome.missing == "toppled"


def test_a_policy_that_is_done_ends_the_trial() -> None:
    """Success and "done" end it at once; "done" without success ends it as a failure soon after."""
    right = played(trial(lambda w: ""), done_at=30, action=turning)
    assert right.missing == ""
    assert right.steps <= 50
    wrong = played(trial(lambda w: "not_held"), done_at=30, action=turning)
    assert (wrong.missing, wrong.note) == ("not_held", "done")
    assert wrong.steps < 150


def test_a_policy_that_commands_nothing_has_given_up() -> None:
    """Eight seconds without a new command end a trial, long before its budget."""
    assert played(trial(lambda w: "not_held", budget_s=60.0)).steps < 9 * 30


@pytest.mark.parametrize(("skill", "case"), MINE)
@pytest.mark.parametrize("seed", [0, 1])
def test_the_same_seed_draws_the_same_scene(skill: str, case: str, seed: int) -> None:
    """A seed's scene is always the same; another seed's is another."""
    a, b, other = (draw(skill, case, s, "tuning") for s in (seed, seed, seed + 1))
    np.testing.assert_array_equal(a.base, b.base)
    assert (a.prompt, list(a.objects)) == (b.prompt, list(b.objects))
    assert not np.array_equal(a.base, other.base)


@pytest.mark.rare
@pytest.mark.slow
@pytest.mark.parametrize(("skill", "case"), MINE)
@pytest.mark.parametrize("shapes", ["tuning", "held_out"])
def test_scenes_stand_still_and_are_not_done(skill: str, case: str, shapes: Shapes) -> None:
    """Settled, all stands where it was put, the hands hold what they have to, and the work is still to be done."""
    for seed in range(3):
        scene = draw(skill, case, seed, shapes)
        world = scene.world(render=False)
        assert scene.done(world) != ""
        for name, start in scene.objects.items():
            if name not in scene.held.values():
                moved = np.linalg.norm(world.pose(name)[:3, 3] - start.T_world[:3, 3])
                assert moved < 0.01, f"{name} moved {moved:.3f} m in seed {seed}"
        for side, name in scene.held.items():
            assert world.holding(side) == name
        off = world.robot.proprioception().base_pose - scene.base
        assert np.linalg.norm([*off[:2], wrap(off[2])]) < 0.01


def test_shapes_are_graspable_and_the_two_sets_differ() -> None:
    """Every thing has a side, a wall or a handle that a hand of 10 cm can take; no shape is in both sets."""
    for shapes in ("tuning", "held_out"):
        for entry in one_hand(shapes):
            low, high = entry.description.extent()
            assert min((high - low)[:2]) <= 0.086 or entry.description.root.volumes, entry.name
            assert 0.015 <= min(high - low), entry.name
    tuning, held_out = things("tuning"), things("held_out")
    assert not {e.name for e in tuning} & {e.name for e in held_out}
    assert not {(e.family, str(e.shape)) for e in tuning} & {(e.family, str(e.shape)) for e in held_out}
    assert {e.family for e in tuning} == {e.family for e in held_out}


def test_prompts_name_one_thing() -> None:
    """In no scene is there a second thing that the words for the first would fit."""
    for skill, case in MINE:
        for seed in range(4):
            scene = draw(skill, case, seed, "tuning")
            for placement in scene.objects.values():
                words = placement.entry.name.replace("_", " ")
                fits = [p for p in scene.objects.values() if words in p.entry.phrases]
                assert len(fits) == 1, f"{skill}/{case} {seed}: {words}"


def holding_can(assisted: bool = False) -> tuple[Trial, SimWorld]:
    scene = replace(trial(lambda w: ""), held={"right": "can"})
    return scene, scene.world(render=False, assisted=assisted)


def test_only_what_hangs_free_between_both_fingers_is_picked() -> None:
    """A can in hand counts; lying on the floor, balanced on the arm or pressed against a table it does not."""
    done = lifted("can", 0.0, np.array([1.0, 0.0]))
    _, world = holding_can()
    world.step()
    assert done(world) == ""
    assert lifted("can", 0.72, world.pose("can")[:2, 3])(world) == "not_lifted"

    lying = trial(done).world(render=False)
    assert done(lying) == "not_held"
    T = lying.robot.hand_pose_world("right")
    lying.place("can", pose(T[:3, 3] + [0, 0, 0.05]))  # upon the hand
    lying.step()
    assert done(lying) == "not_held"

    grip = world.robot.hand_pose_world("right")[:3, 3]
    shelf = one_room({"table_1": {"entry": "table", "at": [grip[0], grip[1]], "shape": {"size_m": [0.3, 0.3, 0.6]}}})
    wedged = replace(trial(lambda w: ""), house=shelf, held={"right": "can"}).world(render=False)
    bottom = float(min(s.aabb()[0, 2] for s in wedged.solids("can")))
    action = wedged.robot.action
    action[LAYOUT.torso.start] -= bottom - 0.6 + 0.005  # down onto the table
    for _ in range(60):
        wedged.robot.act(action)
        wedged.step()
    wedged.wake()
    wedged.robot.act(action)
    wedged.step()
    assert lifted("can", 0.0, np.array([1.0, 0.0]))(wedged) in ("touching", "not_held")


def test_what_is_still_in_hand_is_not_put() -> None:
    """A thing is put down when the hands are off it, it is where it belongs, and the others stand as they stood."""
    _, world = holding_can()
    world.step()
    assert put("can", lambda w: True, "not_on_it", {})(world) == "in_hand"

    others = {"cup": placed("coffee_cup", 2.0, 0.0)}
    scene = replace(trial(lambda w: ""), objects={"can": placed("can_of_soda", 1.0, 0.0), **others})
    world = scene.world(render=False)
    assert put("can", lambda w: False, "not_on_it", others)(world) == "not_on_it"
    assert put("can", lambda w: True, "not_on_it", others)(world) == ""
    world.place("cup", pose((2.0, 0.3, 0.0)))
    assert put("can", lambda w: True, "not_on_it", others)(world) == "moved"
    lying = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    T = pose((2.0, 0.0, 0.05))
    T[:3, :3] = lying
    world.place("cup", T)
    assert put("can", lambda w: True, "not_on_it", others)(world) == "toppled"


def test_what_a_monitor_feels_of_a_trial() -> None:
    """A sample every half second from the first step on; the stall of a policy that does nothing grows with time."""
    scene = trial(lambda w: "not_held")
    world = scene.world(render=False)
    felt = Felt(world.robot)
    steps = play(scene, world, Scripted(lambda k: world.robot.action), world.robot, [felt.step]).steps
    assert len(felt.samples) == -(-steps // 15)
    assert [stall for _, _, stall, _ in felt.samples[:3]] == pytest.approx([0.0333, 0.5333, 1.0333])
    assert {(reversals, grip) for reversals, _, _, grip in felt.samples} == {(0.0, 0.0)}


def test_rows_survive_a_cut(tmp_path: Path) -> None:
    """A row cut short is forgotten, the next one is whole, and the last word on a job wins."""
    path = tmp_path / "deep" / "rows.jsonl"
    assert read_rows(path) == []
    first, second = (
        Row(JOB, False, "not_held: done"),
        Row(replace(JOB, seed=1), True, objects={"a": "can"}, samples=[[0, 0, 0.5, 1]]),
    )
    add_row(path, first)
    add_row(path, second)
    with path.open("a") as file:
        file.write('{"skill": "pick", "ca')
    assert read_rows(path) == [first, second]
    better = replace(first, ok=True, cause="")
    add_row(path, better)
    assert read_rows(path) == [better, second]
    path.write_text('{"skill": 1}\n')
    with pytest.raises(UserError, match=r"rows\.jsonl:1"):
        read_rows(path)


def test_the_table_counts_by_case_policy_and_setting() -> None:
    """One line for each, with failures by cause; other settings are other lines."""
    rows = [
        Row(JOB, True, simulated_s=8.0, retries=0, realtime=20.0),
        Row(replace(JOB, seed=1), True, simulated_s=10.0, retries=2, realtime=30.0),
        Row(replace(JOB, seed=2), False, "not_held: pick: no_stance", simulated_s=60.0, retries=4, realtime=10.0),
        Row(replace(JOB, assisted=True, perception_cm=2.0), True, simulated_s=5.0),
    ]
    first, second = table(rows)
    assert (first["ok"], first["n"], first["median_s"], first["retries"]) == (2, 3, 9.0, 2.0)
    assert first["failures"] == {"not_held: pick: no_stance": 1}
    assert (second["setting"], second["ok"], second["retries"]) == ("2 cm off, assisted", 1, None)
    assert "| pick | floor | expert |  | 2/3 | 9.0 | 2.00 | 20.0 | 1 not_held: pick: no_stance |" in markdown(rows)


def test_the_table_sums_up_each_skill() -> None:
    """After the cases there is one line for each skill that has several."""
    rows = [Row(JOB, True), Row(replace(JOB, case="table"), False, "not_held"), Row(replace(JOB, skill="push"), True)]
    summed = [(r["skill"], r["case"], r["ok"], r["n"]) for r in table(rows)]
    assert summed == [("pick", "floor", 1, 1), ("pick", "table", 0, 1), ("push", "floor", 1, 1), ("pick", "all", 1, 2)]


def test_unknown_names_are_told_with_the_nearest() -> None:
    """A skill, case or policy that there is not is answered with those that there are, before anything is played."""
    with pytest.raises(UnknownName, match="pick"):
        choose(["pik"], [])
    with pytest.raises(UnknownName, match="clutter"):
        choose(["pick"], ["cluter"])
    for options in (["--policy", "expret"], ["-s", "pik"], ["--seeds", "a-b"]):
        outcome = CliRunner().invoke(main, options)
        assert outcome.exit_code == 2, outcome.output


def test_the_command_lists_and_prints_what_is_there(tmp_path: Path) -> None:
    """--list names every case; --table prints what a file holds, as Markdown or JSON, and plays nothing."""
    out = tmp_path / "rows.jsonl"
    add_row(out, Row(JOB, True, simulated_s=8.0))
    listed = CliRunner().invoke(main, ["--list", "-s", "pick"]).output.split()
    assert listed == [f"pick/{case}" for case in skills()["pick"]]
    shown = CliRunner().invoke(main, ["--table", "--out", str(out)])
    assert "| pick | floor | expert |  | 1/1 |" in shown.output
    as_json = CliRunner().invoke(main, ["--table", "--json", "--out", str(out)])
    assert json.loads(as_json.output)[0]["ok"] == 1


@pytest.mark.rare
@pytest.mark.slow
def test_a_run_plays_what_is_missing_and_only_that(tmp_path: Path) -> None:
    """The expert picks up something from the floor; a second run finds the row and plays nothing."""
    out = tmp_path / "rows.jsonl"
    options = ["-s", "pick", "-c", "floor", "--seeds", "0-1", "--workers", "1", "--out", str(out)]
    first = CliRunner().invoke(main, options)
    assert "2/2 |" in first.output, first.output
    written = out.read_bytes()
    assert CliRunner().invoke(main, options).exit_code == 0
    assert out.read_bytes() == written


@pytest.mark.rare
@pytest.mark.slow
def test_what_raises_or_hangs_is_a_row_that_says_so() -> None:
    """A trial that cannot be drawn and one that takes too long come back as failures; the others go on."""
    broken = replace(JOB, case="nowhere")
    rows = {row.job: row for row in run_jobs([broken, JOB], workers=1)}
    assert rows[broken].cause.startswith("raised: KeyError at scenes.py:")
    assert rows[JOB].ok
    (hung,) = run_jobs([JOB], workers=1, wall_limit_s=0.1)
    assert (hung.ok, hung.code) == (False, "hung")


@pytest.mark.rare
@pytest.mark.slow
def test_the_same_job_has_the_same_outcome() -> None:
    """Two plays of one seed take the same steps."""
    a, b = run_job(JOB), run_job(JOB)
    assert (a.ok, a.steps, a.simulated_s, a.objects) == (b.ok, b.steps, b.simulated_s, b.objects)


def test_what_is_to_go_into_a_bin_goes_through_its_opening() -> None:
    """A bar over the middle of a bin leaves room for a can, not for a plate; a basket takes both."""
    entries = things("tuning")
    bin_, basket, can, plate = (entries[n] for n in ("trash_can", "basket", "can_of_soda", "dessert_plate"))
    assert [fits(can, bin_), fits(plate, bin_), fits(can, basket), fits(plate, basket)] == [True, False, True, True]
