"""The file of a stopped episode, damaged by hand: one clear error, before anything runs."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from mpvi_bt.executive.ticking.dry import EmptyWorld, dry_tree, run_dry
from mpvi_bt.executive.tree.substitute import load_rules
from mpvi_bt.executive.tree.yaml_io import parse_tree
from mpvi_bt.ground.errors import UserError
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.episode.prepare import prepare_saved
from mpvi_bt.runs.episode.saved_episode import Keeper, SavedSettings, load_saved

TREE = """\
tree: t
root:
  repeat: 3
  child:
    sequence: s
    memory: true
    children:
      - attempt: unit
        child: {fail: early}
      - retry: 2
        child: {set: tries, add: 1}
      - timeout: 9
        child: {wait: 1}
      - cooldown: 0.1
        child: {navigate: sofa}
      - {navigate: bed}
"""
RULES = "substitute:\n  - nodes: '*/set'\n    fail: not_yet\n    times: 1\n"


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Of a dry run that was stopped in its second round, behind rules."""
    monkeypatch.chdir(tmp_path)
    Path("rules.yaml").write_text(RULES)
    config = EpisodeConfig("", seed=1, tree="t.yaml", substitute="rules.yaml", saved=tmp_path / "saved.json")
    tree, world = dry_tree(parse_tree(TREE), load_rules("rules.yaml")), EmptyWorld()
    run_dry(tree, stop=Keeper(lambda: tree.ticks >= 220, config, tree, world), world=world)
    return tmp_path / "saved.json"


def resume(file: Path) -> str:
    """Read it and go on; how it ended."""
    prepared = prepare_saved(saved := load_saved(file), saved.episode)
    assert prepared.saved is not None
    return run_dry(dry_tree(prepared.spec, prepared.rules), saved=prepared.saved.run).ending


def test_what_is_whole_goes_on(file: Path) -> None:
    """To the end; it was stopped where the nodes below hold something."""
    nodes = json.loads(file.read_text())["run"]["tree"]["nodes"]
    assert nodes["repeat"]["state"] == {"successes": 1}
    assert nodes["repeat/s"]["state"] == {"current": 3}
    assert resume(file) == "success"


def config(**settings: Any) -> Callable[[Any], Any]:
    """Other settings."""
    return lambda data: data["config"].update(settings)


def state(path: str, **values: Any) -> Callable[[Any], Any]:
    """Another state of a node."""
    return lambda data: data["run"]["tree"]["nodes"][path]["state"].update(values)


def measured(**values: Any) -> Callable[[Any], Any]:
    """What was measured of an episode with a robot."""
    none = {"left": 0.0, "right": 0.0}
    whole = {"steps": 1, "base_m": 0.0, "hand_world_m": none, "hand_base_m": none}
    return lambda data: data.update(dry=False, measurement=whole | values)


FAILURE = {"reason": "timeout", "evidence": "", "path": "a"}
NOTICE = {"kind": "lost", "side": "left", "path": "a", "time_s": 1.0}
QUERY = {"criterion": "c", "event": "e", "camera": None, "complete": True, "reason": "", "path": "a", "time_s": 1.0}
REPLAN = {"path": "a", "segments": 1, "said": "", "time_s": 1.0}


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (config(tree=5), "text, not 5"),
        (config(task=["a"]), "text, not a list"),
        (config(task="no_such_task"), "no_such_task"),
        (config(seed="q"), "whole number, not 'q'"),
        (config(seed=-1), "equal to 0, not -1"),
        (config(instance=-1), "equal to 0, not -1"),
        (config(arguments={"a": 1}), "text, not 1"),
        (config(arguments=[]), "mapping, not a list"),
        (config(colour="red"), "colour"),
        (lambda data: data["config"].pop("seed"), "seed"),
        (lambda data: data.update(config=[]), "mapping, not a list"),
        (lambda data: data.update(dry=False, config=data["config"] | {"task": "picking_up_trash"}), "measurement"),
        (lambda data: data["run"]["world"].update(steps=10**400), "finite number"),
        (lambda data: data["run"]["world"].update(steps=-1), "equal to 0, not -1"),
        (lambda data: data["run"]["world"].update(steps=[]), "whole number, not a list"),
        (lambda data: data["run"]["world"].clear(), "steps"),
        (lambda data: data["run"]["tree"].update(ticks=10**9 + 1), "1000000000"),
        (lambda data: data["run"]["failures"][0].update(time_s="now"), "number, not 'now'"),
        (lambda data: data["run"].update(queries=[{}]), "criterion"),
        (lambda data: data["run"]["tree"]["nodes"]["repeat"].update(feedback=5), "text, not 5"),
        (state("repeat/s", current=-1), "repeat/s: .*'current'"),
        (state("repeat/s", current=5), "repeat/s: .*'current'"),
        (state("repeat/s", current="a"), "repeat/s: .*'current'"),
        (state("repeat", successes="a"), "repeat: .*'successes' should be a whole number from 0.*, not 'a'"),
        (state("repeat", successes=True), "repeat: .*'successes'"),
        (state("repeat/s/retry", failures=[1]), "repeat/s/retry: .*'failures'"),
        (state("repeat/s/retry/set", rounds=-1), "repeat/s/retry/set: .*'rounds'"),
        (state("repeat/s/retry/set", other=[]), "repeat/s/retry/set: "),
        (state("repeat/s/timeout", elapsed_s=-1), "repeat/s/timeout: .*'elapsed_s'"),
        (state("repeat/s/timeout/wait", elapsed_s="long"), "repeat/s/timeout/wait: .*'elapsed_s'"),
        (state("repeat/s/cooldown", since_s=None), "repeat/s/cooldown: .*'since_s'"),
        (state("repeat/s/cooldown/navigate", elapsed_s=10**400), "repeat/s/cooldown/navigate: .*'elapsed_s'"),
        (state("repeat/s/unit", failure={}), "repeat/s/unit: .*a failure has a reason"),
        (lambda data: data["run"]["failures"][0].update(time_s=-1), "equal to 0, not -1"),
        (lambda data: data["run"].update(notices=[{**NOTICE, "kind": "felt"}]), "empty, lost"),
        (lambda data: data["run"].update(notices=[{**NOTICE, "time_s": -1}]), "equal to 0, not -1"),
        (lambda data: data["run"].update(queries=[{**QUERY, "latency_s": -1}]), "equal to 0, not -1"),
        (lambda data: data["run"].update(queries=[{**QUERY, "cost": {"model": "m", "tokens_in": -1}}]), "not -1"),
        (lambda data: data["run"].update(replans=[{**REPLAN, "segments": -1}]), "equal to 0, not -1"),
        (measured(base_m=-1.0), "equal to 0, not -1"),
        (measured(base_m=1e300), "1000000000000, not 1e"),
        (measured(steps=-1), "equal to 0, not -1"),
        (measured(hand_base_m={"left": -0.1, "right": 0.0}), "equal to 0, not -0.1"),
        (measured(hand_world_m={"left": 0.0}), "of both hands"),
        (measured(way=[[1.0]]), "2 items"),
        (state("repeat/s/unit", failure={**FAILURE, "time_s": -1}), "repeat/s/unit: .*a failure has a reason"),
        (state("repeat/s/unit", failure=5), "repeat/s/unit: .*a failure has a reason"),
    ],
)
def test_a_damaged_file_is_one_clear_error(damage: Callable[[Any], Any], said: str, file: Path) -> None:
    """It names the key, or the node, and nothing runs on with what was damaged."""
    data = json.loads(file.read_text())
    damage(data)
    file.write_text(json.dumps(data))
    with pytest.raises(UserError, match=said):
        resume(file)


def test_the_settings_of_an_episode_are_what_it_records() -> None:
    """Every setting that a result tells is one that a saved episode has."""
    full = EpisodeConfig(
        "t",
        split="hidden",
        arguments=(("a", "b"),),
        substitute="rules.yaml",
        tree="t.yaml",
        plan="p.json",
        method="mpvi",
        drive="policy",
        on_failure="retry:2",
        policy_settings="comet.yaml",
        policy_horizon=8,
        policy_ensemble=0.01,
        pregrasp=True,
        pregrasp_hand="left",
        policy_faults="drift",
        latency="policy=0.4",
        while_inferring="go_on",
        unit="monitored",
        calibration="c.json",
        assisted=True,
        sim="maniskill",
        robot="fetch",
        navigator="my_navigator:Mine",
        policy_rate=10.0,
        policy_actions="delta",
        house="generated:1",
    )
    assert SavedSettings(**full.record()).model_dump() == full.record()
