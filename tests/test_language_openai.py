"""Models behind chat completions, over real sockets: what is sent, what is read, and everything that can go wrong."""

from __future__ import annotations

import base64
import json
import re
import time
from collections.abc import Callable
from typing import Any

import pytest

from mpvi_bt.executive.language import openai as module
from mpvi_bt.executive.language.chat import Answer, Message
from mpvi_bt.executive.language.openai import OpenAIModel
from mpvi_bt.ground.errors import ModelError
from mpvi_bt.ground.extras import install
from tests.chat_servers import ChatServer, Reply, completion, failure, free_port

pytest.importorskip("openai")

ASK = [Message("system", "Be brief."), Message("user", "Is the cup held?")]
SCHEMA = {"type": "object", "properties": {"held": {"type": "boolean"}}, "required": ["held"]}
PNG = b"\x89PNG\r\n\x1a\n and so on"
SOON = {"retry_after_ms": "1"}


@pytest.fixture(autouse=True)
def _environment(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("OPENAI_API_KEY", "OPENAI_BASE_URL"):
        monkeypatch.delenv(name, raising=False)


@pytest.fixture
def server(scripted_chat_server: ChatServer) -> ChatServer:
    return scripted_chat_server


def model(server: ChatServer, timeout_s: float = 20.0, retries: int = 2) -> OpenAIModel:
    return OpenAIModel("tiny", server.url, timeout_s, retries)


def wrong(ask: Callable[[], Answer]) -> ModelError:
    """The error that asking ends with: on one line, and with nothing in its chain."""
    with pytest.raises(ModelError) as caught:
        ask()
    error = caught.value
    assert "\n" not in str(error)
    assert len(str(error)) < 400
    assert error.__cause__ is None
    assert error.__context__ is None
    return error


def test_messages_and_pictures_are_sent(server: ChatServer) -> None:
    """Texts as they are, a picture as a data URL beside its text; nothing is asked of the answer's form."""
    answer = model(server).ask([*ASK, Message("assistant", "No."), Message("user", "And now?", PNG)])
    (request,) = server.requests
    assert request.keys() == {"model", "messages"}
    assert request["model"] == "tiny"
    assert [m["role"] for m in request["messages"]] == ["system", "user", "assistant", "user"]
    assert [m["content"] for m in request["messages"][:3]] == ["Be brief.", "Is the cup held?", "No."]
    text, picture = request["messages"][3]["content"]
    assert text == {"type": "text", "text": "And now?"}
    kind, _, data = picture["image_url"]["url"].partition(",")
    assert (picture["type"], kind) == ("image_url", "data:image/png;base64")
    assert base64.b64decode(data) == PNG
    assert (answer.text, answer.model, answer.tokens_in, answer.tokens_out) == ("yes", "scripted-1", 11, 3)
    assert (answer.tries, answer.kept) == (1, False)


def test_the_latency_is_measured(server: ChatServer) -> None:
    """From the question to the answer."""
    server.answers([Reply(completion("yes"), delay_s=0.3)])
    assert 0.3 <= model(server).ask(ASK).latency_s < 5.0


def test_a_key_is_sent_where_there_is_one(server: ChatServer, monkeypatch: pytest.MonkeyPatch) -> None:
    """And no header where there is none."""
    model(server).ask(ASK)
    monkeypatch.setenv("OPENAI_API_KEY", " sk-0123456789 \n")
    model(server).ask(ASK)
    monkeypatch.setenv("OPENAI_BASE_URL", server.url.replace("//", "//me:pass%20word@"))
    OpenAIModel("tiny").ask(ASK)
    basic = "Basic " + base64.b64encode(b"me:pass word").decode()
    assert [h.get("authorization") for h in server.headers] == [None, "Bearer sk-0123456789", basic]


def test_a_schema_is_handed_over(server: ChatServer) -> None:
    """To a server that takes one."""
    server.answers(['{"held": true}'])
    asked = model(server)
    for _ in range(2):
        assert asked.ask(ASK, SCHEMA).text == '{"held": true}'
    for request in server.requests:
        assert request["response_format"]["type"] == "json_schema"
        assert request["response_format"]["json_schema"]["schema"] == SCHEMA


@pytest.mark.parametrize(("taken", "status"), [("json_object", 400), ("plain", 422)])
def test_a_server_that_refuses_a_form_is_asked_for_less(server: ChatServer, taken: str, status: int) -> None:
    """For a JSON object, then plainly; what it took is remembered."""

    def form(request: Any) -> str:
        return request.get("response_format", {}).get("type", "plain")

    refused = {"json_object": ["json_schema"], "plain": ["json_schema", "json_object"]}[taken]
    server.answers(lambda request: failure(status, "no such format") if form(request) in refused else "{}")
    asked = model(server)
    for _ in range(2):
        assert asked.ask(ASK, SCHEMA).text == "{}"
    assert [form(request) for request in server.requests] == [*refused, taken, taken]


def test_a_question_that_is_refused_says_nothing_about_forms(server: ChatServer) -> None:
    """Where the plain question is refused as well, the server is asked by schema the next time."""
    server.answers(lambda request: failure(400, "I see no pictures") if len(request["messages"]) > 2 else "{}")
    asked = model(server)
    error = wrong(lambda: asked.ask([*ASK, Message("user", "This?", PNG)], SCHEMA))
    assert (error.reason, "I see no pictures" in str(error)) == ("refused", True)
    asked.ask(ASK, SCHEMA)
    assert server.requests[-1]["response_format"]["type"] == "json_schema"


@pytest.mark.parametrize("status", [408, 429, 500, 502, 503, 529])
def test_what_may_pass_is_tried_again(server: ChatServer, status: int) -> None:
    """And the answer says how often it was."""
    server.answers([failure(status, **SOON), failure(status, **SOON), "yes"])
    answer = model(server).ask(ASK)
    assert (answer.text, answer.tries, len(server.requests)) == ("yes", 3, 3)


def test_a_broken_connection_is_tried_again(server: ChatServer) -> None:
    """Before the headers, and in the middle of an answer."""
    server.answers([Reply(completion("no"), cut=0), Reply(completion("no"), cut=30), "yes"])
    answer = model(server).ask(ASK)
    assert (answer.text, answer.tries) == ("yes", 3)


def test_the_waits_grow_unless_the_server_says_how_long(server: ChatServer) -> None:
    """Half a second and one, less a quarter at most; or Retry-After."""
    server.answers([failure(503), failure(503), failure(503, retry_after="0.1"), "yes"])
    began = time.monotonic()
    assert model(server, retries=3).ask(ASK).tries == 4
    assert 0.75 * 1.5 + 0.1 <= time.monotonic() - began < 10.0


def test_a_server_that_wants_too_long_a_wait_gets_none(server: ChatServer) -> None:
    """More than two minutes are not waited."""
    server.answers([failure(429, "come back tomorrow", retry_after="86400")])
    began = time.monotonic()
    error = wrong(lambda: model(server).ask(ASK))
    assert (error.reason, len(server.requests)) == ("rate_limited", 1)
    assert "come back tomorrow" in str(error)
    assert time.monotonic() - began < 5.0


NO_MODEL = failure(404, "The model `tiny` does not exist", "model_not_found")
OVER = completion("x" * (10 * 2**20))
NESTED = "[" * 200_000


@pytest.mark.parametrize(
    ("reply", "reason", "says"),
    [
        (failure(401, "Incorrect API key provided: sk-a***z"), "no_key", "set OPENAI_API_KEY"),
        (failure(403, "not in your country"), "wrong_key", "not in your country"),
        (NO_MODEL, "unknown_model", "'tiny'"),
        (failure(404, 'model "tiny" not found, try pulling it first'), "unknown_model", "pulling"),
        (failure(404, "Not Found"), "bad_answer", "/v1"),
        (failure(429, "You exceeded your quota", **SOON), "rate_limited", "tried 3 times (429): You ex"),
        (failure(500, "boom", **SOON), "server_error", "boom"),
        (Reply("Internal Server Error", 500, {"retry-after-ms": "1"}), "server_error", "(500): Internal Server Error"),
        (Reply("<html>Bad Gateway</html>", 502, {"retry-after-ms": "1"}), "server_error", "tried 3 times (502)"),
        (Reply({"detail": [{"loc": ["model"]}]}, 422), "refused", "loc"),
        (failure(400, "This model does not support images"), "refused", "does not support images"),
        (failure(413, "too large"), "refused", "too large"),
        (failure(400, "a\x1b[31mb\r\nc" + "d" * 9999), "refused", "a [31mb c"),
        (Reply("", 302, {"location": "https://login.example/"}), "bad_answer", "(302)"),
        (Reply("<!DOCTYPE html><p>Hello"), "bad_answer", "a web page"),
        (Reply('data: {"choices": []}\n\ndata: [DONE]\n\n', headers={"content-type": "text/event-stream"}),
         "bad_answer", "a stream of events, though none was asked for"),
        (Reply(b"\xff\xfe\x00junk"), "bad_answer", "text"),
        (Reply('{"choices": [{"mess'), "bad_answer", "broken JSON"),
        (Reply(NESTED), "bad_answer", "broken JSON"),
        (Reply('{"usage": {"prompt_tokens": 1' + "0" * 5000 + "}}"), "bad_answer", "JSON"),
        (Reply(""), "bad_answer", "nothing"),
        (Reply("null"), "bad_answer", "text"),
        (Reply({}), "bad_answer", "no choice"),
        (Reply({"choices": []}), "bad_answer", "no choice"),
        (Reply({"choices": [None]}), "bad_answer", "no choice"),
        (Reply({"choices": "yes"}), "bad_answer", "no choice"),
        (Reply({"choices": [{"message": "yes"}]}), "bad_answer", "no choice"),
        (completion(None), "bad_answer", "nothing"),
        (completion(" \n"), "bad_answer", "nothing"),
        (completion(5), "bad_answer", "a number where text is due: 5"),
        (completion({"held": True}), "bad_answer", 'an object where text is due: {"held": true}'),
        (completion([{"type": "image_url", "image_url": {}}]), "bad_answer", "parts of other kinds than text"),
        (completion(None, "tool_calls", tool_calls=[{"type": "function", "function": {"name": "plan"}}]),
         "bad_answer", "a call of a tool 'plan' where text is due"),
        (completion("", tool_calls=[5]), "bad_answer", "a call of a tool where text is due"),
        (completion(None, function_call={"name": "plan"}), "bad_answer", "a call of a tool 'plan'"),
        (completion("{", "length", (9, 16)), "bad_answer", "after 16 tokens"),
        (completion(None, "content_filter"), "refused", "content filter"),
        (completion(None, refusal="I can't help with this picture."), "refused", "can't help with this picture"),
        ({"error": {"message": "Provider returned error", "code": 502}}, "server_error", "Provider returned error"),
        (OVER, "bad_answer", "more than 4 MB"),
        (Reply("x" * 65536, endless=True), "bad_answer", "more than 4 MB"),
        (Reply("x" * 65536, 400, endless=True), "bad_answer", "more than 4 MB"),
        (Reply(b"\x1f\x8b", headers={"content-encoding": "gzip"}), "bad_answer", "compressed"),
    ],
    ids=lambda value: None if isinstance(value, Reply | dict) else str(value)[:20],
)  # fmt: skip
def test_what_is_no_answer_has_a_reason(server: ChatServer, reply: Any, reason: str, says: str) -> None:
    """One clear line and a stable code, whatever comes; soon."""
    server.answers([reply])
    began = time.monotonic()
    error = wrong(lambda: model(server).ask(ASK))
    assert error.reason == reason
    assert says in str(error)
    assert "127.0.0.1" in str(error)
    assert time.monotonic() - began < 15.0


def test_a_refused_answer_says_what_it_took(server: ChatServer) -> None:
    """Its tokens are spent all the same."""
    server.answers([completion(None, refusal="no", tokens=(30, 4))])
    error = wrong(lambda: model(server).ask(ASK))
    assert error.tokens == 34
    assert error.latency_s > 0.0


def test_a_wrong_key_is_told_without_what_the_server_says(server: ChatServer, monkeypatch: pytest.MonkeyPatch) -> None:
    """Servers quote parts of it."""
    monkeypatch.setenv("OPENAI_API_KEY", "sk-0123456789")
    server.answers([failure(401, "Incorrect API key provided: sk-0*****789")])
    error = wrong(lambda: model(server).ask(ASK))
    assert (error.reason, len(server.requests)) == ("wrong_key", 1)
    assert "OPENAI_API_KEY" in str(error)
    assert "789" not in str(error)


def test_nobody_listens() -> None:
    """Said with the address and how often it was tried."""
    asked = OpenAIModel("tiny", f"http://127.0.0.1:{(port := free_port())}/v1", retries=1)
    error = wrong(lambda: asked.ask(ASK))
    assert error.reason == "endpoint_down"
    assert f"127.0.0.1:{port}" in str(error)
    assert "tried 2 times" in str(error)
    assert "refused" in str(error)


def test_there_is_no_such_host() -> None:
    """Nor any network, maybe."""
    error = wrong(lambda: OpenAIModel("tiny", "http://no-such-host.invalid/v1", retries=0).ask(ASK))
    assert error.reason == "endpoint_down"


@pytest.mark.parametrize(
    "reply",
    [
        Reply(completion("yes"), delay_s=1.5),
        Reply(completion("yes"), drip=(10, 0.2)),
        Reply(" ", drip=(1, 0.05), endless=True),
    ],
    ids=["late", "drip", "endless"],
)
def test_what_is_slow_has_its_time(server: ChatServer, reply: Reply) -> None:
    """An answer that does not begin, or does not end."""
    server.answers([reply])
    began = time.monotonic()
    error = wrong(lambda: model(server, timeout_s=0.5, retries=0).ask(ASK))
    assert error.reason == "model_timeout"
    assert "0.5 s" in str(error)
    assert error.latency_s >= 0.5
    assert time.monotonic() - began < 5.0


def test_an_answer_that_dies_for_good_is_a_server_that_is_away(server: ChatServer) -> None:
    """In the middle of every try."""
    server.answers([Reply(completion("yes"), cut=40)])
    error = wrong(lambda: model(server, retries=0).ask(ASK))
    assert error.reason == "endpoint_down"


def test_answers_in_parts_are_joined(server: ChatServer) -> None:
    """As some servers send them."""
    server.answers([completion([{"type": "text", "text": "ye"}, {"type": "odd"}, 3, {"type": "text", "text": "s"}])])
    assert model(server).ask(ASK).text == "yes"


@pytest.mark.parametrize(
    "usage", [None, 3, {}, {"prompt_tokens": "7"}, {"prompt_tokens": -1, "completion_tokens": 0.5}]
)
def test_odd_counts_are_none(server: ChatServer, usage: Any) -> None:
    """What a server says of tokens is not believed unless it can be."""
    server.answers([{**completion("yes"), "usage": usage}])
    answer = model(server).ask(ASK)
    assert (answer.tokens_in, answer.tokens_out) == (0, 0)


def test_halves_of_characters_do_no_harm(server: ChatServer) -> None:
    """Neither asked nor answered: the answer can be written to a file."""
    server.answers([Reply(json.dumps(completion("ye\ud800s")).encode())])
    answer = model(server).ask([Message("user", "half \ud83d of it")])
    assert answer.text == "ye?s"
    assert server.requests[0]["messages"][0]["content"] == "half ? of it"


def test_many_threads_ask_at_once(server: ChatServer) -> None:
    """Each gets its own answer."""
    from concurrent.futures import ThreadPoolExecutor

    server.answers(lambda request: request["messages"][-1]["content"])
    asked = model(server)
    with ThreadPoolExecutor(8) as pool:
        texts = list(pool.map(lambda i: asked.ask([Message("user", f"say {i}")]).text, range(40)))
    assert texts == [f"say {i}" for i in range(40)]


def test_without_the_extra_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    """And names the extra."""
    import sys

    monkeypatch.setitem(sys.modules, "openai", None)
    with pytest.raises(ModelError, match=re.escape(install("openai"))) as error:
        OpenAIModel("tiny", "http://localhost:1/v1")
    assert error.value.reason == "not_installed"


@pytest.mark.rare
@pytest.mark.slow
def test_a_real_server_is_spoken_with(real_chat_server: Any) -> None:
    """Transformers' own, with random weights: texts, a picture that it counts, and forms that it does not mind.

    What the answers say means nothing.
    """
    asked = OpenAIModel(real_chat_server.talking, real_chat_server.url, 120.0)
    answers = [asked.ask(ASK), asked.ask(ASK, SCHEMA)]
    seeing = OpenAIModel(real_chat_server.seeing, real_chat_server.url, 120.0)
    blind, shown = seeing.ask(ASK), seeing.ask([ASK[0], Message("user", ASK[1].text, picture())])
    for answer in (*answers, blind, shown):
        assert answer.text
        assert 0 < answer.tokens_in
        assert 0 < answer.tokens_out
        assert answer.latency_s > 0.0
    assert shown.tokens_in == blind.tokens_in + 16  # the patches of the picture
    error = wrong(lambda: OpenAIModel("no/such", real_chat_server.url, 120.0, retries=0).ask(ASK))
    assert error.reason == "server_error"  # that server does not tell unknown models from its own faults


def picture() -> bytes:
    """A PNG."""
    import cv2
    import numpy as np

    return bytes(cv2.imencode(".png", np.full((48, 64, 3), (30, 60, 200), np.uint8))[1])


def test_the_bounds_are_as_documented() -> None:
    """docs/language.md tells them."""
    assert (module.TIMEOUT_S, module.RETRIES, module.MOST_BYTES) == (60.0, 2, 4 * 2**20)
