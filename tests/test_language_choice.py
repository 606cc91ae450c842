"""Language models are chosen by name and address, and kept within what the run says."""

from __future__ import annotations

import json
import pickle
from dataclasses import replace
from pathlib import Path

import pytest

from mpvi_bt.errors import ModelError, UserError
from mpvi_bt.language.chat import Message
from mpvi_bt.language.endpoint import find_endpoint, split_address
from mpvi_bt.suite.config import EpisodeConfig, SuiteBudget
from mpvi_bt.suite.language import Models, check_language_choice
from tests.chat_servers import ChatServer

pytest.importorskip("openai")

ASK = [Message("user", "Is the cup held?")]
BASE = "https://api.openai.com/v1"


@pytest.fixture(autouse=True)
def _environment(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("OPENAI_API_KEY", "OPENAI_BASE_URL"):
        monkeypatch.delenv(name, raising=False)


@pytest.mark.parametrize(
    ("address", "model", "url"),
    [
        ("gpt-5", "gpt-5", ""),
        ("llama3:8b@http://localhost:11434/v1", "llama3:8b", "http://localhost:11434/v1"),
        ("@cf/meta/llama@https://gate.example/v1", "@cf/meta/llama", "https://gate.example/v1"),
        ("@cf/meta/llama", "@cf/meta/llama", ""),
        ("/models/tiny@main", "/models/tiny@main", ""),
        ("m@http://[::1]:80/v1", "m", "http://[::1]:80/v1"),
    ],
)
def test_an_address_is_a_model_and_maybe_a_url(address: str, model: str, url: str) -> None:
    """Both may have colons, and the model may have an @."""
    assert split_address(address) == (model, url)


@pytest.mark.parametrize(
    ("address", "says"),
    [
        ("", "say which model"),
        ("@http://localhost/v1", "say which model"),
        (" m", "say which model"),
        ("m\n", "say which model"),
        ("m@localhost:8000", "say m@http://localhost:8000"),
        ("m@10.0.0.1:8000/v1", "say m@http://10.0.0.1:8000/v1"),
        ("m@ws://localhost:8000", "must be like http://localhost:8000/v1, not 'ws://localhost:8000'"),
        ("m@http://", "must be like"),
        ("m@http://localhost:port/v1", "must be like"),
        ("m@http://local host/v1", "must be like"),
        ("m@http://localhost/v1?key=SECRET99", "without"),
        ("m@http://me:SECRET99@localhost/v1", "OPENAI_BASE_URL"),
        ("m@ftp://me:SECRET99@localhost/v1", "must be like"),
    ],
)
def test_what_is_no_address_is_told(address: str, says: str) -> None:
    """In a line that quotes no password."""
    with pytest.raises(UserError, match="openai: ") as error:
        split_address(address)
    assert says in str(error.value)
    assert "SECRET99" not in str(error.value)


def test_a_key_is_needed_by_the_vendor_alone() -> None:
    """Another endpoint, named or set, may want none; its own wants one, however it is named."""
    assert find_endpoint("http://localhost:1/v1/", {}).url == "http://localhost:1/v1"
    assert find_endpoint("http://localhost:1/v1", {}).authorization is None
    assert find_endpoint("", {"OPENAI_BASE_URL": "https://other.example"}).authorization is None
    for url, environment in [
        ("", {}), ("", {"OPENAI_API_KEY": " "}), (BASE, {}), ("https://eu.api.openai.com/v1", {}),
        ("", {"OPENAI_BASE_URL": BASE}), ("", {"OPENAI_BASE_URL": ""}),
    ]:  # fmt: skip
        with pytest.raises(ModelError, match="set OPENAI_API_KEY") as error:
            find_endpoint(url, environment)
        assert error.value.reason == "no_key"
    endpoint = find_endpoint("", {"OPENAI_API_KEY": "sk-12345678"})
    assert (endpoint.url, endpoint.authorization) == (BASE, "Bearer sk-12345678")


@pytest.mark.parametrize("key", ["sk-1234\n5678", "sk 1234", "sk-1234\u2026", "sk-é"])
def test_a_key_that_can_be_none_is_told(key: str) -> None:
    """Without a look at it."""
    with pytest.raises(ModelError) as error:
        find_endpoint("", {"OPENAI_API_KEY": key})
    assert error.value.reason == "wrong_key"
    assert key not in str(error.value)


def test_a_bad_base_url_is_told() -> None:
    """By the name of its variable, and without what may be a password."""
    with pytest.raises(UserError, match="OPENAI_BASE_URL must be like"):
        find_endpoint("", {"OPENAI_BASE_URL": "localhost:8000"})
    with pytest.raises(UserError, match="OPENAI_BASE_URL must be like") as error:
        find_endpoint("", {"OPENAI_BASE_URL": "me:SECRET99@localhost:8000"})
    assert "SECRET99" not in str(error.value)


def config(server: ChatServer, **settings: object) -> EpisodeConfig:
    return EpisodeConfig("t", checker=f"openai:tiny@{server.url}", **settings)  # type: ignore[arg-type]


def test_what_the_config_says_is_put_around_the_model(scripted_chat_server: ChatServer, tmp_path: Path) -> None:
    """Budgets of the episode and its suite, and the exchanges, which cost nothing."""
    ledger = tmp_path / "ledger.json"
    limited = config(scripted_chat_server, calls=2, suite_budget=SuiteBudget(ledger, calls=3), exchanges=tmp_path / "x")
    models = Models(limited)
    planner, checker = models.make(limited.checker), models.make(limited.checker)
    for _ in range(3):
        assert planner.ask(ASK).text == "yes"
    checker.ask([Message("user", "2")])
    with pytest.raises(ModelError, match="episode"):
        checker.ask([Message("user", "3")])
    assert (models.budget.spent.calls, models.budget.spent.tokens) == (2, 28)
    other = Models(replace(limited, task="other"))
    other.make(limited.checker).ask([Message("user", "3")])
    with pytest.raises(ModelError, match="suite"):
        other.make(limited.checker).ask([Message("user", "4")])
    assert json.loads(ledger.read_text())["calls"] == len(scripted_chat_server.requests) == 3


def test_offline_needs_neither_key_nor_endpoint(
    scripted_chat_server: ChatServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nor the SDK; only the folder of an earlier run, wherever its model was."""
    live = config(scripted_chat_server, exchanges=tmp_path)
    Models(live).make(live.checker).ask(ASK)
    monkeypatch.setitem(__import__("sys").modules, "openai", None)
    replayed = replace(live, checker="openai:tiny", offline=True, calls=0)
    check_language_choice(replayed)
    assert Models(replayed).make(replayed.checker).ask(ASK).kept
    with pytest.raises(ModelError) as error:
        Models(replayed).make(replayed.checker).ask([Message("user", "another")])
    assert error.value.reason == "not_recorded"


def test_what_cannot_be_asked_is_refused_before_an_episode(tmp_path: Path) -> None:
    """No key, no folder, no address."""
    for wrong, error, says in [
        (EpisodeConfig("t", planner="openai:gpt-5"), ModelError, "OPENAI_API_KEY"),
        (EpisodeConfig("t", checker="openai:m@http://h/v1", offline=True), UserError, "--exchanges"),
        (EpisodeConfig("t", checker="openai:m", offline=True, exchanges=tmp_path / "no"), UserError, "no such folder"),
        (EpisodeConfig("t", checker="openai:m@nowhere:1"), UserError, "m@http://nowhere:1"),
    ]:  # fmt: skip
        with pytest.raises(error, match=says):
            check_language_choice(wrong)
    check_language_choice(EpisodeConfig("t", offline=True))  # nobody is to be asked


def test_where_answers_are_kept_and_what_they_cost_is_no_part_of_a_result(tmp_path: Path) -> None:
    """A suite goes on with more money, and a replay is the same run."""
    plain = EpisodeConfig("t", checker="openai:m")
    limited = replace(
        plain, exchanges=tmp_path, offline=True, calls=1, tokens=2, suite_budget=SuiteBudget(tmp_path / "l")
    )
    assert plain.record() == limited.record()
    assert pickle.loads(pickle.dumps(limited)) == limited
