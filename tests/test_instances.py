"""Every instance of every task begins as its :init says, and as it began before; hidden ones need a secret."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from mpvi_bt.executive.plan.knowledge import KnowledgeBase
from mpvi_bt.finding.navigation.footprint import Footprint
from mpvi_bt.finding.navigation.traversability import traversability
from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.collision import Surroundings
from mpvi_bt.hands.robots.fetch import FETCH
from mpvi_bt.hands.robots.r1pro import R1PRO
from mpvi_bt.house.goals.evaluate import early, unmet
from mpvi_bt.house.goals.predicates import truth_in
from mpvi_bt.house.instances import instances
from mpvi_bt.house.instances.instances import _with_room, begin, expanded_problem, faults, settled
from mpvi_bt.house.instances.sampling import Start, sample
from mpvi_bt.house.instances.splits import HIDDEN_SEED, generator, hidden_seed
from mpvi_bt.house.instances.tasks import load_task
from mpvi_bt.house.layout.boards import MovableForm
from mpvi_bt.house.layout.ground import standing_room
from mpvi_bt.house.layout.house import load_house
from mpvi_bt.house.layout.prior_map import prior_map
from mpvi_bt.house.sim.world import SimWorld
from mpvi_bt.house.things.catalogue import load_catalogue
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.episode.prepare import check_episode

HOUSE, CATALOGUE = load_house(), load_catalogue()
TASK = load_task("picking_up_trash")
PROBLEM = expanded_problem(TASK, HOUSE)
SECRET = "a secret that is kept for tests"


@pytest.fixture(autouse=True)
def own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cache of the test's own, empty at first."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.delenv(HIDDEN_SEED, raising=False)
    return tmp_path / "cache" / "mpvi_bt" / "starts"


def poses(world: SimWorld) -> Array:
    """Where everything that can move is, robot included."""
    return np.concatenate([*(world.pose(name).ravel() for name in world.objects), world.robot.save()["q"]])


def count_draws(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """A list that grows with every draw."""
    draws: list[int] = []

    def counted(*given: object) -> Start:
        draws.append(1)
        return sample(*given)  # type: ignore[arg-type]

    monkeypatch.setattr(instances, "sample", counted)
    return draws


@pytest.mark.rare
@pytest.mark.slow
@pytest.mark.parametrize("name", paths.names("tasks"))
def test_all_instances_of_a_task_begin_as_they_should(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """After settling :init holds, nothing of the goal does early, all is in reach and clear; it is the same twice."""
    task = load_task(name)
    house = HOUSE if task.house == HOUSE.name else load_house(task.house)
    problem = expanded_problem(task, house)
    starts = []
    for instance in range(task.instances):
        world, start = begin(task, house, CATALOGUE, problem, instance, render=False)
        truth = truth_in(world, start.scene_names)
        assert not unmet(problem, truth)
        assert not early(problem, truth)
        assert not list(faults(world, start, house, problem))
        assert_apart_at_first(start)
        starts.append(np.concatenate([start.base_pose, *(p.T_world.ravel() for p in start.objects.values())]))
        assert all(np.abs(starts[-1] - other).max() > 0.05 for other in starts[:-1])
        if instance % 5:
            continue
        with monkeypatch.context() as watched:
            draws = count_draws(watched)
            again, same = begin(task, house, CATALOGUE, problem, instance, render=False)
        assert not draws, "what was kept is not drawn anew"
        np.testing.assert_array_equal(poses(again), poses(world))
        assert (same.scene_names, same.openings, same.on) == (start.scene_names, start.openings, start.on)


def assert_apart_at_first(start: Start) -> None:
    """No thing is drawn into another one, by the points of its surface."""
    solids, points = {}, {}
    for name, placement in start.objects.items():
        shape = MovableForm(placement.entry, start.openings.get(name, {}))
        solids[name] = Surroundings([solid.moved(placement.T_world) for solid in shape.solids])
        points[name] = shape.points @ placement.T_world[:3, :3].T + placement.T_world[:3, 3]
    for name, p in points.items():
        for other, others in solids.items():
            assert other == name or others.distance(p).min() > 0, f"{name} in {other}"


def test_a_draw_does_not_depend_on_the_cache(own_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A start that was kept gives the very world that drawing it gives; a broken file is drawn over."""
    fresh, _ = begin(TASK, HOUSE, CATALOGUE, PROBLEM, 3, render=False)
    (file,) = own_cache.iterdir()
    whole = file.read_bytes()
    kept, _ = begin(TASK, HOUSE, CATALOGUE, PROBLEM, 3, render=False)
    np.testing.assert_array_equal(poses(kept), poses(fresh))
    data = json.loads(whole)
    data["objects"]["ashcan.n.01_1"][3] = 1e300
    for broken in (b"", whole[: len(whole) // 2], b"[]", b"\xff\xfe", b"[" * 100_000, json.dumps(data).encode()):
        file.write_bytes(broken)
        draws = count_draws(monkeypatch)
        drawn, _ = begin(TASK, HOUSE, CATALOGUE, PROBLEM, 3, render=False)
        assert draws
        np.testing.assert_array_equal(poses(drawn), poses(fresh))
        assert file.read_bytes() == whole


def test_what_a_start_depends_on_is_in_its_files_name(own_cache: Path) -> None:
    """Another binding, problem or instance is kept under another name; of one instance only the newest stays."""
    begin(TASK, HOUSE, CATALOGUE, PROBLEM, 0, render=False)
    (first,) = own_cache.iterdir()
    begin(TASK, HOUSE, CATALOGUE, PROBLEM, 1, render=False)
    assert len(list(own_cache.iterdir())) == 2
    other = TASK.model_copy(update={"bindings": {**TASK.bindings, "can__of__soda.n.01": "candle"}})
    begin(other, HOUSE, CATALOGUE, PROBLEM, 0, render=False)
    assert not first.exists()
    assert len(list(own_cache.iterdir())) == 2


def test_a_cache_that_cannot_be_written_does_no_harm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where nothing can be kept, an instance is drawn every time."""
    file = tmp_path / "file"
    file.write_text("no folder")
    monkeypatch.setattr(paths, "caches", lambda: [file, file / "below"])
    world, _ = begin(TASK, HOUSE, CATALOGUE, PROBLEM, 0, render=False)
    again, _ = begin(TASK, HOUSE, CATALOGUE, PROBLEM, 0, render=False)
    np.testing.assert_array_equal(poses(world), poses(again))


def test_faults_of_a_start_are_told() -> None:
    """A thing that falls out of the house, one that is not where :init has it, and a robot that gets nowhere."""
    start = sample(HOUSE, CATALOGUE, PROBLEM, TASK.bindings, generator("public", TASK.problem, 0, 0))
    names = list(start.objects)

    def moved(name: str, T: Array) -> list[str]:
        objects = {**start.objects, name: replace(start.objects[name], T_world=T)}
        changed = replace(start, objects=objects)
        world, restless = settled(HOUSE, changed, render=False)
        lost = replace(changed, base_pose=np.array([4.33, 4.9, 0.0]))  # in the counter
        assert sum("out of the robot's reach" in line for line in faults(world, lost, HOUSE, PROBLEM)) == len(names)
        return [*(f"{n} does not rest" for n in restless), *faults(world, changed, HOUSE, PROBLEM)]

    assert not moved(names[1], start.objects[names[1]].T_world)
    there = start.objects[names[1]].T_world.copy()
    there[:3, 3] = [20.0, 20.0, 0.0]
    assert f"{names[1]} does not rest" in moved(names[1], there)
    high = start.objects[names[1]].T_world.copy()
    high[:3, 3] = [3.91, 0.3, 1.76]  # at the back of the refrigerator's top
    assert any("does not hold" in line for line in moved(names[1], high))


def test_hidden_instances_need_a_secret(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without one, or with one that could be guessed, they are refused in one line that does not show it."""
    config = EpisodeConfig("picking_up_trash", split="hidden", detector="oracle", checker="oracle")
    with pytest.raises(UserError, match=f"{HIDDEN_SEED}; it is not set"):
        check_episode(config)
    monkeypatch.setenv(HIDDEN_SEED, "hunter2")
    with pytest.raises(UserError, match="7 characters") as caught:
        check_episode(config)
    assert "hunter2" not in str(caught.value)
    assert "\n" not in str(caught.value)
    monkeypatch.setenv(HIDDEN_SEED, SECRET)
    check_episode(config)
    assert hidden_seed() == SECRET


def test_hidden_instances_are_others(monkeypatch: pytest.MonkeyPatch) -> None:
    """They differ from the public ones and with the secret, and are repeatable; their results bear other names."""

    def drawn() -> Array:
        start = sample(HOUSE, CATALOGUE, PROBLEM, TASK.bindings, generator("hidden", TASK.problem, 0, 0))
        return np.concatenate([start.base_pose, *(p.T_world.ravel() for p in start.objects.values())])

    public = sample(HOUSE, CATALOGUE, PROBLEM, TASK.bindings, generator("public", TASK.problem, 0, 0))
    monkeypatch.setenv(HIDDEN_SEED, SECRET)
    first = drawn()
    np.testing.assert_array_equal(drawn(), first)
    monkeypatch.setenv(HIDDEN_SEED, SECRET + "!")
    assert np.abs(drawn() - first).max() > 0.05
    assert np.abs(public.base_pose - first[:3]).max() > 0.05
    names = {EpisodeConfig("picking_up_trash", 3, split=split).name for split in ("public", "hidden")}
    assert names == {"picking_up_trash_3_0", "picking_up_trash_hidden_3_0"}
    assert EpisodeConfig("picking_up_trash", split="hidden").record()["split"] == "hidden"
    assert "split" not in EpisodeConfig("picking_up_trash").record()


def test_a_kept_hidden_start_does_not_tell_its_secret(own_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither the file nor its name holds it."""
    monkeypatch.setenv(HIDDEN_SEED, SECRET)
    begin(TASK, HOUSE, CATALOGUE, PROBLEM, 0, "hidden", render=False)
    (file,) = own_cache.iterdir()
    assert SECRET not in file.name
    assert SECRET not in file.read_text()


def test_a_robot_that_is_not_round_begins_where_it_has_room() -> None:
    """In the place of the r1 if it fits there, else nearby; a round robot always begins in the same place."""
    rng, empty = np.random.default_rng(0), cast("SimWorld", SimpleNamespace(knowledge=KnowledgeBase))
    grid = traversability(prior_map(HOUSE), R1PRO.base.radius_m)
    footprint = Footprint(R1PRO.base.radius_m, np.zeros((0, 3)), R1PRO.base.circles)
    cells = np.argwhere(standing_room(prior_map(HOUSE)))
    stayed = 0
    for xy in grid.points(cells[rng.integers(len(cells), size=12)]):
        start = Start({}, np.array([*xy, rng.uniform(-np.pi, np.pi)]), {})
        assert _with_room(FETCH, start, HOUSE, empty) is start
        pose = _with_room(R1PRO, start, HOUSE, empty).base_pose
        assert footprint.room(grid, pose) >= 0
        assert np.abs(pose[:2] - xy).max() <= 0.6 + 1e-9
        if footprint.room(grid, start.base_pose) >= 0:
            stayed += 1
            np.testing.assert_allclose(pose, start.base_pose, atol=1e-9)
    assert 0 < stayed < 12
