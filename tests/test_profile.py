"""Laws of an episode's profile: its table adds up, and its flame graph shows what took the time."""

from __future__ import annotations

import json
import time
from pathlib import Path

import pytest

from mpvi_bt.executive.ticking.loop import Watcher, World, run_episode
from mpvi_bt.executive.tree.build import Tree
from mpvi_bt.runs.recording.profile import DRIVE, MANIPULATE, REST, SETUP, Profile
from mpvi_bt.testing import KinematicWorld, scripted_context
from tests.test_recorders import SKILLS, SPEC

pytest.importorskip("pyinstrument", reason="needs the extra 'profile'")
PLACES = {"trash can": (0.2, 0.0), "can of soda": (0.0, 0.2)}


class Lazy(Watcher):
    """Takes its time."""

    def step(self, tree: Tree, world: World) -> None:
        """Sleep."""
        time.sleep(0.001)


def test_all_of_the_time_is_in_the_table_once(tmp_path: Path) -> None:
    """Its rows are what the robot did; their sum is the time from the profile's beginning to the last tick."""
    tree, world = Tree(SPEC), KinematicWorld()
    began = time.perf_counter()
    profile = Profile(tmp_path / "run.json")
    run_episode(tree, world, scripted_context(world, SKILLS, PLACES, {}), [Lazy(), profile], max_time_s=8.0)
    took_s = time.perf_counter() - began
    assert {SETUP, DRIVE, MANIPULATE} <= profile.seconds.keys()
    rows = {name: sum(row.values()) for name, row in profile.seconds.items()}
    assert all(seconds >= 0 for row in profile.seconds.values() for seconds in row.values())
    assert 0.001 * tree.ticks <= sum(rows.values()) <= took_s
    assert profile.seconds[DRIVE]["navigation"] > 0
    assert profile.seconds[MANIPULATE]["policy"] > 0
    assert profile.seconds[DRIVE][REST] > 0.001  # the watcher's


def test_the_flame_graph_shows_what_took_the_time(tmp_path: Path) -> None:
    """It is of speedscope's format, and the function that slept, a thousandth of the time at once, has most of it."""
    tree, world, file = Tree(SPEC), KinematicWorld(), tmp_path / "run.json"
    run_episode(tree, world, scripted_context(world, SKILLS, PLACES, {}), [Lazy(), Profile(file)], max_time_s=5.0)
    told = json.loads(file.read_text())
    assert told["$schema"] == "https://www.speedscope.app/file-format-schema.json"
    slept = [i for i, f in enumerate(told["shared"]["frames"]) if f["file"] == __file__ and f["name"] == "step"]
    (profile,) = told["profiles"]
    signs = {"O": -1.0, "C": 1.0}
    asleep_s = sum(signs[event["type"]] * event["at"] for event in profile["events"] if event["frame"] in slept)
    assert asleep_s > 0.5 * 0.001 * tree.ticks
