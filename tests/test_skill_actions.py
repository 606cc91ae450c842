"""Laws of the symbolic planner's actions: the needs and effects of skills' files make them, whoever wrote the file."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from mpvi_bt.apps.authoring.skeletons import new_task
from mpvi_bt.executive.plan.planners import NoPlan
from mpvi_bt.ground import paths
from mpvi_bt.house.instances.tasks import load_task
from mpvi_bt.runs.symbolic.symbolic_planner import SymbolicPlanner

pytest.importorskip("unified_planning")
PROBLEM = Path("tasks/problems/tidy.bddl")
BLOW = """\
name: blow_off
about: Blow dust off a thing, without a tool.
phrases: ["blow on {target}"]
needs: {near: [target]}
effects: {clean: target}
triggers: [{event: rest, camera: head}]
timeout_s: 60
"""


@pytest.fixture(autouse=True)
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder of one's own with a new task in it."""
    monkeypatch.setenv("MPVI_PATH", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    new_task("tidy").write(tmp_path)
    Path("skills").mkdir()


def told() -> list[str]:
    """What the plan says."""
    plan = SymbolicPlanner(load_task("tidy")).ask("tidy").plan
    return [f"{segment.description}: {segment.completion_criterion}" for segment in plan.segments]


def test_a_skill_of_ones_own_is_an_action() -> None:
    """In the words of its file: ours need a brush to take dust off."""
    text = PROBLEM.read_text().replace("agent.n.01_1 -", "dust.n.01_1 - dust.n.01\n    agent.n.01_1 -")
    text = text.replace("(:init", "(:init (covered coffee_table.n.01_1 dust.n.01_1)")
    goal = "(not (covered coffee_table.n.01_1 dust.n.01_1))"
    PROBLEM.write_text(text.replace("(inside can__of__soda.n.01_1 ashcan.n.01_1)", goal))
    with pytest.raises(NoPlan, match=r"no skill ends covered\(coffee_table.n.01_1, dust.n.01_1\)"):
        told()
    Path("skills/blow_off.yaml").write_text(BLOW)
    assert told()[-1] == "blow on the coffee table: the coffee table is clean"


def test_what_a_file_needs_is_needed_first() -> None:
    """A bin has no lid; where its skill needs the bin turned on, no plan is left."""
    skill = yaml.safe_load((paths.shipped() / "skills" / "place_in.yaml").read_text())
    assert len(told()) == 4
    Path("skills/place_in.yaml").write_text(yaml.safe_dump({**skill, "needs": {**skill["needs"], "on": ["container"]}}))
    with pytest.raises(NoPlan, match=r"place_in needs toggled_on\(ashcan.n.01_1\), which cannot be"):
        told()


def test_a_skill_without_effects_is_no_action() -> None:
    """Nobody tells what it is good for."""
    skill = yaml.safe_load((paths.shipped() / "skills" / "pick.yaml").read_text())
    Path("skills/pick.yaml").write_text(yaml.safe_dump({**skill, "effects": {}}))
    with pytest.raises(NoPlan, match=r"place_in needs held\(can__of__soda.n.01_1, right\), which cannot be"):
        told()
