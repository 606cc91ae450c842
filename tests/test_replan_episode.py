"""A whole episode, in physics, whose first plan is wrong and whose second is right."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from mpvi_bt.executive.language.scripted_model import ScriptedChatModel
from mpvi_bt.executive.plan.answer_form import answer_text
from mpvi_bt.executive.plan.language_planner import LanguagePlanner
from mpvi_bt.executive.plan.planners import RecordedPlanner
from mpvi_bt.executive.plan.schema import Plan
from mpvi_bt.executive.trace.explain import explain
from mpvi_bt.executive.trace.explain_text import explanation_text
from mpvi_bt.executive.trace.read import read_trace
from mpvi_bt.executive.tree.compile import compile_plan
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.choices.planning import ground
from mpvi_bt.runs.episode.episode import run
from mpvi_bt.runs.episode.prepare import prepare

RIGHT = RecordedPlanner().plan("picking_up_trash")


@pytest.mark.rare
@pytest.mark.slow
def test_a_plan_for_a_thing_that_is_not_there_is_replaced(tmp_path: Path) -> None:
    """It fails at the first drive; the model is told so, plans for what is there, and the goal is reached."""
    first = RIGHT.segments[0].model_copy(update={"target": "piano", "description": "go to the piano"})
    wrong = Plan.model_validate({**RIGHT.model_dump(), "segments": [first, *RIGHT.segments[1:]]})
    config = EpisodeConfig(
        "picking_up_trash", detector="oracle", checker="oracle", on_failure="replan", trace=tmp_path / "t.jsonl"
    )
    ready = prepare(config)
    assert ready.task is not None
    model = ScriptedChatModel([answer_text(RIGHT)], latency_s=1.0)
    planner = LanguagePlanner(model, ready.skills, ground(ready.task.house, ready.task))
    ready = replace(ready, spec=compile_plan(wrong, ready.skills, "replan"), planner=planner)
    result = run(config, prepared=ready)
    assert (result["q_score"]["final"], result["success"]) == (1.0, True)
    (failure,) = result["failures"]
    assert failure["reason"] == "unknown_target"
    (replan,) = result["replans"]
    assert (replan["segments"], replan["said"]) == (len(RIGHT.segments), "")
    assert result["config"]["on_failure"] == "replan"
    asked = model.asked[0][0][-1].text
    assert '"reason": "unknown_target"' in asked
    assert '"go to the piano"' in asked
    assert '"name": "can of soda"' in asked
    trace = read_trace(tmp_path / "t.jsonl")
    assert f"then a new plan of {len(RIGHT.segments)} segments, answered in 1.0 s" in explanation_text(explain(trace))
    names = [child.name for child in trace.tree_at(-1).root.children]
    assert names[:2] == ["1 go to the piano", "2 go to the trash can"]
