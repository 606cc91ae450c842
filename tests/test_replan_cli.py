"""New plans from the command line to the score, from a server that speaks over HTTP, and again from what was kept."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from mpvi_bt.apps.cli.group import run
from mpvi_bt.executive.plan.answer_form import answer_text
from mpvi_bt.executive.plan.schema import load_plan
from mpvi_bt.executive.trace.read import read_trace
from mpvi_bt.ground import paths
from tests.chat_servers import ChatServer, completion

TRASH = load_plan(paths.find("tasks/plans", "picking_up_trash"))
REST = TRASH.model_copy(update={"segments": TRASH.segments[1:]})
RULES = "substitute:\n  - {nodes: '*/2 */check_complete', fail: no_way, after: 1.0}\n"


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In a folder of its own, with no key."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("OPENAI_API_KEY", raising=False)
    monkeypatch.delenv("OPENAI_BASE_URL", raising=False)


def test_a_dry_run_has_a_new_plan_made_and_made_again_from_file(
    scripted_chat_server: ChatServer, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """Asked once for the plan and once for the rest; offline the same run needs no server."""
    scripted_chat_server.answers([completion(answer_text(TRASH)), completion(answer_text(REST), tokens=(500, 70))])
    (tmp_path / "rules.yaml").write_text(RULES)
    words = ["run", "picking_up_trash", "--dry", "--substitute", "rules.yaml", "--no-watch", "--on-failure", "replan"]
    words += ["--planner", f"openai:m@{scripted_chat_server.url}", "--exchanges", "kept"]
    assert run([*words, "--out", "live", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert [failure["reason"] for failure in result["failures"]] == ["no_way"]
    assert [replan["segments"] for replan in result["replans"]] == [len(REST.segments)]
    assert len(scripted_chat_server.requests) == 2
    asked = scripted_chat_server.requests[1]["messages"][-1]["content"]
    assert '"reason": "no_way"' in asked
    trace = read_trace("live/picking_up_trash_dry.trace.jsonl")
    (replan,) = (replan for tick in trace.ticks for replan in tick.replans)
    assert replan.cost is not None
    assert (replan.cost.tokens_in, replan.cost.tokens_out, replan.cost.kept) == (500, 70, False)
    assert trace.config["on_failure"] == "replan"
    assert run([*words, "--out", "again", "--offline"]) == 0
    assert "replanned" in capsys.readouterr().out
    assert len(scripted_chat_server.requests) == 2
    again = read_trace("again/picking_up_trash_dry.trace.jsonl")
    assert again.tree_at(-1) == trace.tree_at(-1) != trace.tree
    assert again.states(-1).keys() == trace.states(-1).keys()
    assert run(["explain", "again/picking_up_trash_dry.trace.jsonl"]) == 0
    assert f"then a new plan of {len(REST.segments)} segments" in capsys.readouterr().out
    assert run(["replay", "again/picking_up_trash_dry.trace.jsonl", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert [replan["cost"]["kept"] for tick in told for replan in tick["replans"]] == [True]
