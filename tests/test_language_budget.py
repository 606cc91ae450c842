"""Budgets of calls and tokens."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from mpvi_bt.executive.language.budget import Budget, BudgetedModel, Spent
from mpvi_bt.executive.language.chat import Answer, Message
from mpvi_bt.executive.language.exchanges import KeptModel
from mpvi_bt.executive.language.scripted_model import ScriptedChatModel
from mpvi_bt.ground.errors import ModelError

ASK = [Message("user", "Is the cup held?")]


def say(tokens_in: int, tokens_out: int) -> Answer:
    return Answer("yes", "tiny", 0.0, tokens_in, tokens_out)


def over(model: BudgetedModel) -> str:
    with pytest.raises(ModelError) as error:
        model.ask(ASK)
    assert error.value.reason == "over_budget"
    return str(error.value)


def test_calls_are_counted() -> None:
    """So many are made, and then none; it says which budget, which limit and what was used."""
    inner = ScriptedChatModel([say(10, 2)] * 5)
    model = BudgetedModel(inner, [budget := Budget("episode", calls=3)])
    for _ in range(3):
        model.ask(ASK)
    for _ in range(2):
        assert "the budget of the episode is spent: 3 of 3 calls are used (3 calls, 36 tokens)" in over(model)
    assert (len(inner.asked), budget.spent) == (3, Spent(3, 36))


def test_tokens_are_counted() -> None:
    """Of questions and answers; the one that reaches the limit may go over it."""
    model = BudgetedModel(inner := ScriptedChatModel([say(60, 30)] * 5), [Budget("episode", tokens=100)])
    model.ask(ASK)
    model.ask(ASK)
    assert "180 of 100 tokens" in over(model)
    assert len(inner.asked) == 2


def test_no_limit_is_none() -> None:
    """It only counts; nothing may be spent where the limit is none at all."""
    model = BudgetedModel(ScriptedChatModel([say(1, 1)] * 9), [budget := Budget("episode")])
    for _ in range(9):
        model.ask(ASK)
    assert budget.spent == Spent(9, 18)
    assert "0 of 0 calls" in over(BudgetedModel(model, [Budget("suite", calls=0)]))


def test_failures_are_spent() -> None:
    """A call that came to nothing is a call, and what it took counts."""
    model = BudgetedModel(ScriptedChatModel([ModelError("refused", "no", tokens=70)]), [budget := Budget("episode")])
    with pytest.raises(ModelError, match="no"):
        model.ask(ASK)
    assert budget.spent == Spent(1, 70)


def test_where_a_server_does_not_count_tokens_are_guessed() -> None:
    """So that a limit of tokens is one there, too."""
    model = BudgetedModel(ScriptedChatModel([say(0, 0)] * 2), [budget := Budget("episode", tokens=5)])
    model.ask(ASK)
    assert budget.spent.tokens == 5
    over(model)


def test_what_is_on_file_costs_nothing(tmp_path: Path) -> None:
    """Only what is really asked is counted."""
    budget = Budget("episode", calls=1)
    inner = BudgetedModel(ScriptedChatModel([say(10, 2)]), [budget])
    model = KeptModel("scripted", "tiny", tmp_path, inner)
    for _ in range(4):
        model.ask(ASK)
    assert budget.spent == Spent(1, 12)
    with pytest.raises(ModelError, match="spent"):
        model.ask([Message("user", "another")])


def test_a_suites_budget_outlives_its_episodes(tmp_path: Path) -> None:
    """The ledger is counted on by the next, and an episode has its own besides."""
    ledger = tmp_path / "new" / "ledger.json"
    for _ in range(2):
        budgets = [Budget("episode", calls=2), Budget("suite", calls=3, ledger=ledger)]
        model = BudgetedModel(ScriptedChatModel([say(5, 5)] * 9), budgets)
        model.ask(ASK)
    model.ask(ASK)
    assert "episode" in over(model)
    fresh = BudgetedModel(model, [Budget("suite", calls=3, ledger=ledger)])
    assert "the budget of the suite is spent: 3 of 3 calls are used (3 calls, 30 tokens)" in over(fresh)
    assert json.loads(ledger.read_text()) == {"calls": 3, "tokens": 30}


@pytest.mark.parametrize(
    "text", ["", "{", "[]", '{"calls": 1}', '{"calls": "1", "tokens": 2}', '{"calls": -1, "tokens": 0}', "[" * 10_000]
)
def test_a_broken_ledger_stops_spending(tmp_path: Path, text: str) -> None:
    """It names the file: how much was spent is not known."""
    (ledger := tmp_path / "ledger.json").write_text(text)
    inner = ScriptedChatModel(["yes"])
    assert str(ledger) in over(BudgetedModel(inner, [Budget("suite", calls=9, ledger=ledger)]))
    assert not inner.asked


WORKER = """
import sys
from pathlib import Path
from mpvi_bt.ground.errors import ModelError
from mpvi_bt.executive.language.budget import Budget, BudgetedModel
from mpvi_bt.executive.language.chat import Answer, Message
from mpvi_bt.executive.language.scripted_model import ScriptedChatModel
inner = ScriptedChatModel(lambda messages: Answer("yes", "tiny", 0.0, 3, 1))
model = BudgetedModel(inner, [Budget("suite", calls=40, ledger=Path(sys.argv[1]))])
try:
    while True:
        model.ask([Message("user", "?")])
except ModelError:
    print(len(inner.asked))
"""


def test_processes_share_a_budget(tmp_path: Path) -> None:
    """Together they make as many calls as it has, not one more."""
    ledger = tmp_path / "ledger.json"
    command = [sys.executable, "-c", WORKER, str(ledger)]
    workers = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True) for _ in range(3)]
    assert sum(int(worker.communicate(timeout=120)[0]) for worker in workers) == 40
    assert json.loads(ledger.read_text()) == {"calls": 40, "tokens": 160}
