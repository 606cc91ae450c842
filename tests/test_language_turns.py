"""Models whose chat templates take no system role, or no two turns of one role; and servers that load their model."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from typing import Any

import pytest

from mpvi_bt.executive.completion.judge import LanguageChecker
from mpvi_bt.executive.language import openai as module
from mpvi_bt.executive.language.chat import Message
from mpvi_bt.executive.language.openai import OpenAIModel
from mpvi_bt.executive.language.turns import SHAPES, TOLD, Turn, forget
from mpvi_bt.ground.errors import ModelError
from mpvi_bt.testing import KinematicRobot
from tests.bench import HELD
from tests.chat_servers import ChatServer, Reply, completion, failure

pytest.importorskip("openai")

SCHEMA = {"type": "object", "properties": {"plan": {"type": "string"}}}
ASK = [
    Message("system", "Be brief."),
    Message("user", "Is the cup held?"),
    Message("assistant", "No."),
    Message("user", "And now?", b"\x89PNG"),
]
RUNS = [*ASK[:2], Message("user", "Look well.", b"\x89PNG"), Message("user", "Do.")]
SOON = {"retry_after_ms": "1"}
REFUSALS = [
    failure(400, "System role not supported"),
    failure(500, "Value is not callable: System role not supported at row 1, column 70", **SOON),
    failure(400, "Conversation roles must alternate user/assistant/user/assistant/..."),
    failure(500, "jinja2.exceptions.TemplateError: Conversation roles must alternate", **SOON),
    failure(400, "Only user and assistant roles are supported!"),
    failure(400, "Unsupported value: 'messages[0].role' does not support 'system' with this model."),
    failure(400, "Developer instruction is not enabled for models/gemma-3-27b-it"),
    failure(422, "messages[0].role: unknown variant `system`, expected `user` or `assistant`"),
    failure(400, 'messages: Unexpected role "system"'),
    failure(400, "Error rendering prompt with jinja template: Cannot call something that is not a function"),
    failure(500, "Failed to apply chat template", **SOON),
    Reply("Internal Server Error", 500, {"retry-after-ms": "1"}),
    Reply("", 400),
    Reply({"error": {"message": "System role not supported", "code": 400}}),
]


@pytest.fixture(autouse=True)
def _anew(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    for name in ("OPENAI_API_KEY", "OPENAI_BASE_URL"):
        monkeypatch.delenv(name, raising=False)
    forget()
    yield
    forget()


@pytest.fixture
def server(scripted_chat_server: ChatServer) -> ChatServer:
    return scripted_chat_server


def roles(request: Any) -> list[str]:
    return [turn["role"] for turn in request["messages"]]


def strict(refusal: Any, system: bool = False) -> Any:
    """Answers as a template does that wants the user and the assistant in turns, maybe after the system."""

    def answer(request: Any) -> Any:
        said = roles(request)
        said = said[1:] if system and said[0] == "system" else said
        return "{}" if said == (["user", "assistant"] * len(said))[: len(said)] else refusal

    return answer


def model(server: ChatServer, retries: int = 2) -> OpenAIModel:
    return OpenAIModel("m", server.url, retries=retries)


def everything(request: Any) -> list[str]:
    """All that is said in a request, in order."""
    said: list[str] = []
    for turn in request["messages"]:
        content = turn["content"]
        parts = [{"type": "text", "text": content}] if isinstance(content, str) else content
        said += [word for part in parts for word in part.get("text", "PICTURE").split()]
    return said


@pytest.mark.parametrize("refusal", REFUSALS, ids=range(len(REFUSALS)))
@pytest.mark.parametrize("schema", [None, SCHEMA], ids=["plain", "schema"])
def test_a_model_without_a_system_role_is_asked_without_one(server: ChatServer, refusal: Any, schema: Any) -> None:
    """However it says so: the same words in the same order, the system's first, with nothing lost; in no other form."""
    server.answers(strict(refusal))
    assert model(server).ask(ASK, schema).text == "{}"
    first, last = server.requests[0], server.requests[-1]
    assert roles(last) == ["user", "assistant", "user"]
    assert everything(last) == everything(first)
    assert last.get("response_format") == first.get("response_format")


@pytest.mark.parametrize("refusal", REFUSALS, ids=range(len(REFUSALS)))
def test_what_a_model_takes_is_found_out_once(
    server: ChatServer, refusal: Any, caplog: pytest.LogCaptureFixture
) -> None:
    """In this process, whoever asks; of that endpoint and that model alone. It is told once."""
    server.answers(strict(refusal))
    with caplog.at_level(logging.WARNING):
        model(server).ask(ASK)
        before = len(server.requests)
        for _ in range(2):
            model(server).ask(ASK)
    assert [roles(request)[0] for request in server.requests[before:]] == ["user", "user"]
    told = [record.getMessage() for record in caplog.records if "system role" in record.getMessage()]
    assert told == [f"mpvi: openai:m@{server.url}: {TOLD[-1]}"]
    OpenAIModel("another", server.url).ask(ASK)
    assert roles(server.requests[before + 2])[0] == "system"


def test_turns_of_one_role_are_joined_where_roles_must_alternate(server: ChatServer) -> None:
    """The system keeps its own where the template has one; pictures stay between the words around them."""
    server.answers(strict(failure(400, "After the optional system message, roles must alternate"), system=True))
    assert model(server).ask(RUNS).text == "{}"
    first, last = server.requests
    assert roles(first) == ["system", "user", "user", "user"]
    assert roles(last) == ["system", "user"]
    assert [part["type"] for part in last["messages"][1]["content"]] == ["text", "image_url", "text"]
    assert everything(last) == everything(first)


@pytest.mark.parametrize("turns", [[], [{"role": "system", "content": "a"}], [{"role": "user", "content": "a"}] * 3])
def test_any_conversation_has_its_shapes(turns: list[Turn]) -> None:
    """Even one of nobody, or of the system alone; each shape of a shape is itself."""
    for shape in SHAPES:
        assert shape(shape(turns)) == shape(turns)


@pytest.mark.parametrize(
    ("refusal", "asked"),
    [
        (failure(400, "the image is too large"), 1),
        (failure(500, "out of memory"), 1),
        (failure(503, "busy"), 1),
        (failure(429, "no more"), 1),
        (failure(500, "System role not supported"), 2),
        (Reply("Internal Server Error", 500), 2),
    ],
    ids=range(6),
)
def test_another_fault_is_not_blamed_on_roles(server: ChatServer, refusal: Reply, asked: int) -> None:
    """What helped nothing is not taken for what the model takes, and silence is looked into once."""
    server.answers([refusal])
    for again in (False, True):
        with pytest.raises(ModelError):
            model(server, 0).ask(ASK)
        named = "role" in refusal.data.decode()
        assert len(server.requests) == (asked if not again else asked + (2 if named else 1))
    server.answers(["{}"])
    model(server, 0).ask(ASK)
    assert roles(server.requests[-1])[0] == "system"


def test_a_checker_needs_no_system_role(server: ChatServer) -> None:
    """Its rules stand before the question, beside the picture."""
    server.answers(lambda request: "yes" if "system" not in roles(request) else REFUSALS[0])
    assert LanguageChecker(model(server)).check(HELD, KinematicRobot().look("head")).complete
    (text, picture) = server.requests[-1]["messages"][0]["content"]
    assert text["text"].index("You compare one photograph") < text["text"].index(HELD)
    assert picture["type"] == "image_url"


# -------------------------------------------------------------------------------------------- a model that is loaded

LOADING = [
    failure(503, "Loading model", **SOON),
    failure(503, "Model m is currently loading", **SOON),
    failure(503, "the model is not ready", **SOON),
]


@pytest.mark.parametrize("loading", LOADING, ids=range(3))
def test_a_server_that_loads_its_model_is_waited_for(
    server: ChatServer, loading: Reply, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Longer than the tries of any other fault, and said once; the time counts."""
    monkeypatch.setattr(module, "_LOOK_S", 0.01)
    server.answers([loading] * 12 + ["yes"])
    with caplog.at_level(logging.WARNING):
        assert model(server).ask(ASK).text == "yes"
    assert [record.getMessage() for record in caplog.records if "loads its model" in record.getMessage()] == [
        f"mpvi: {server.url} loads its model: waiting, 120 s at most"
    ]


def test_a_server_that_loads_for_ever_is_not(server: ChatServer, monkeypatch: pytest.MonkeyPatch) -> None:
    """The failure says what it waited for, and how long."""
    monkeypatch.setattr(module, "_LOOK_S", 0.01)
    monkeypatch.setattr(module, "LOADING_S", 0.2)
    server.answers(LOADING[:1])
    with pytest.raises(ModelError, match=r"still loads its model after 0.2 s: .*Loading model") as failed:
        model(server, 0).ask(ASK)
    assert failed.value.reason == "model_timeout"
    assert failed.value.latency_s >= 0.2


def test_a_server_that_is_busy_is_not_waited_for(server: ChatServer) -> None:
    """Whatever it says in an answer that is none of loading."""
    server.answers([failure(503, "overloaded"), completion("loading model")])
    with pytest.raises(ModelError):
        model(server, 0).ask(ASK)
    assert len(server.requests) == 1
    assert model(server, 0).ask(ASK).text == "loading model"
