"""Language models are chosen by name and address, and kept within what the run says."""

from __future__ import annotations

import json
import pickle
import socket
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from mpvi_bt.apps.cli import doctor
from mpvi_bt.apps.cli.run import _OF_THIS_RUN
from mpvi_bt.executive.language.chat import Message
from mpvi_bt.executive.language.endpoint import EXPOSED, find_endpoint, split_address
from mpvi_bt.ground.errors import ModelError, UserError
from mpvi_bt.runs.choices.config import EpisodeConfig, SuiteBudget
from mpvi_bt.runs.choices.language_models import Models, check_language_choice, language_doubts
from tests.chat_servers import ChatServer, completion, failure

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


@pytest.mark.rare
@pytest.mark.slow
def test_a_suite_hands_its_budget_to_every_episode(
    scripted_chat_server: ChatServer, tmp_path: Path, mpvi: Callable[..., Any]
) -> None:
    """Their processes count in one file, and what is over is told as a fault that names the budget."""
    (tmp_path / "s.yaml").write_text(
        "tasks: [tidying_bedroom, putting_shoes_on_rack, picking_up_trash]\ninstances: [0]\nseeds: [0]\n"
    )
    options = ["--suite-calls", "2", "--calls", "1", "--workers", "2", "--out", "o"]
    planner = f"openai:tiny@{scripted_chat_server.url}"
    done = mpvi("suite", "run", "s.yaml", "--planner", planner, *options, timeout=600)
    assert done.returncode == 3
    assert "backend failure: over_budget: the budget of the suite is spent: 2 of 2 calls" in done.stderr
    spent = json.loads((tmp_path / "o" / "asked.json").read_text())
    assert spent["calls"] == len(scripted_chat_server.requests) == 2


@pytest.mark.parametrize(
    ("url", "exposed"),
    [("http://gpu.example/v1", True), ("https://gpu.example/v1", False), ("http://localhost:1/v1", False),
     (f"http://{socket.gethostname()}:1/v1", False), ("http://10.255.255.1/v1", True)],
)  # fmt: skip
def test_plain_http_to_another_machine_is_warned_of(
    url: str, exposed: bool, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Once for each endpoint, whoever asks it, before anything is sent; not where nobody is asked. By doctor, too."""
    both = EpisodeConfig("t", checker=f"openai:a@{url}", planner=f"openai:b@{url}")
    said = [f"{url}: {EXPOSED}"] if exposed else []
    assert language_doubts([both, replace(both, task="u")]) == said
    monkeypatch.setenv("OPENAI_BASE_URL", url)
    assert language_doubts([EpisodeConfig("t", checker="openai:a")]) == said
    assert language_doubts([replace(both, offline=True, exchanges=tmp_path), EpisodeConfig("t")]) == []
    assert (EXPOSED in doctor.endpoint()) is exposed


@pytest.mark.rare
def test_the_warning_is_on_the_screen(mpvi: Callable[..., Any], monkeypatch: pytest.MonkeyPatch) -> None:
    """Of `plan`, `run` and `suite run`, whatever becomes of the question."""
    planner = ("--planner", "openai:m@http://no-such-host.invalid/v1")
    for command in (("plan", "tidying_bedroom"), ("run", "tidying_bedroom", "--no-watch")):
        done = mpvi(*command, *planner)
        assert done.returncode == 3
        assert f"mpvi: http://no-such-host.invalid/v1: {EXPOSED}" in done.stderr
        assert done.stderr.index(EXPOSED) < done.stderr.index("asking")


@pytest.mark.rare
def test_no_secret_is_on_the_screen_or_in_files(
    scripted_chat_server: ChatServer, tmp_path: Path, mpvi: Callable[..., Any]
) -> None:
    """Of a whole command, whose server says what it was sent; and no traceback."""
    key = "sk-CANARY-0123456789"
    for reply in (completion(f"yes {key}"), failure(400, key), failure(401, key), completion(None, refusal=key)):
        scripted_chat_server.answers([reply])
        planner = f"openai:tiny@{scripted_chat_server.url}"
        done = mpvi(
            *("plan", "tidying_bedroom", "--planner", planner, "--exchanges", "x", "--out", "plan.json"),
            OPENAI_API_KEY=key,
            OPENAI_LOG="debug",
        )
        assert done.returncode == 3
        assert "mpvi: " in done.stderr
        assert "Traceback" not in done.stderr
        assert "CANARY" not in done.stdout + done.stderr
    assert scripted_chat_server.headers[0]["authorization"] == f"Bearer {key}"
    for path in tmp_path.rglob("*"):
        assert not path.is_file() or "CANARY" not in path.read_text(errors="replace")


def test_resumed_runs_are_asked_as_this_one_says() -> None:
    """Where answers are kept and what they may cost is of the run, not of the episode that it goes on with."""
    from mpvi_bt.apps.cli.run import run

    names = {parameter.name for parameter in run.params}
    assert {"exchanges", "offline", "calls", "tokens"} <= names & set(_OF_THIS_RUN)
