"""Answers that a server itself calls broken, and servers that cannot do what they are asked, in their own words."""

from __future__ import annotations

from typing import Any

import pytest

from mpvi_bt.executive.completion.judge import LanguageChecker
from mpvi_bt.executive.language.chat import Message
from mpvi_bt.executive.language.openai import OpenAIModel
from mpvi_bt.executive.ticking.loop import run_episode
from mpvi_bt.ground.errors import ModelError
from mpvi_bt.testing import KinematicRobot
from tests.bench import HELD
from tests.chat_servers import ChatServer, Reply, completion, failure
from tests.test_judge_servers import bench

pytest.importorskip("openai")
ASK = [Message("user", "is the cup held")]
SEE = [Message("user", "is the cup held", b"\x89PNG")]
SCHEMA = {"type": "object", "properties": {"plan": {"type": "string"}}}
PICTURE = KinematicRobot().look("head")


@pytest.fixture(autouse=True)
def _environment(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("OPENAI_API_KEY", "OPENAI_BASE_URL"):
        monkeypatch.delenv(name, raising=False)


@pytest.fixture
def server(scripted_chat_server: ChatServer) -> ChatServer:
    return scripted_chat_server


def model(server: ChatServer) -> OpenAIModel:
    return OpenAIModel("m", server.url, retries=0)


def fails(server: ChatServer, messages: list[Message] = ASK, schema: Any = None) -> ModelError:
    with pytest.raises(ModelError) as failed:
        model(server).ask(messages, schema)
    return failed.value


# ------------------------------------------------------------------------------------------------ broken answers


@pytest.mark.parametrize("finish", ["error", "ERROR", "abort", "cancelled", "engine_overloaded", "\x1b[31m", 7])
def test_an_ending_that_no_model_has_is_a_broken_answer(server: ChatServer, finish: Any) -> None:
    """Half an answer is none, however much it looks like one; the ending is told, and of a judge it is no yes."""
    server.answers([completion("yes", finish)])
    failed = fails(server)
    assert failed.reason == "server_error"
    assert str(finish).strip("\x1b") in str(failed)
    assert str(failed).isprintable()
    assert failed.tokens == 14
    judged = LanguageChecker(model(server)).check(HELD, PICTURE)
    assert (judged.complete, judged.fault) == (False, "server_error")


@pytest.mark.parametrize("finish", ["stop", "STOP", "eos_token", "end_turn", None, ""])
def test_endings_of_whole_answers_are_known(server: ChatServer, finish: Any) -> None:
    """Those of other makers and other spellings, and none at all, as of small servers."""
    server.answers([completion("yes", finish)])
    assert model(server).ask(ASK).text == "yes"


@pytest.mark.parametrize(
    ("finish", "reason"), [("MAX_TOKENS", "bad_answer"), ("SAFETY", "refused"), ("content_filter", "refused")]
)
def test_other_endings_keep_their_meaning(server: ChatServer, finish: str, reason: str) -> None:
    """Cut off, or stopped by a filter, whoever spells it."""
    server.answers([completion("yes", finish)])
    assert fails(server).reason == reason


UPSTREAM = [
    {"code": 502, "message": "the provider went away"},
    "the provider went away",
    {"message": "Provider returned error", "metadata": {"raw": '{"error": {"message": "the provider went away"}}'}},
    {"message": "Provider returned error", "metadata": {"raw": "the provider went away", "provider_name": "x"}},
]


@pytest.mark.parametrize("upstream", UPSTREAM, ids=range(4))
@pytest.mark.parametrize("place", ["body", "choice", "message", "alone"])
def test_an_error_within_the_answer_is_told(server: ChatServer, place: str, upstream: Any) -> None:
    """What the server behind a server says survives, and the half answer beside it does not count."""
    body = completion("yes", "stop" if place != "choice" else "error")
    choice = body["choices"][0]
    {"body": body, "choice": choice, "message": choice["message"], "alone": body}[place]["error"] = upstream
    server.answers([body if place != "alone" else {"error": upstream}])
    failed = fails(server)
    assert failed.reason == "server_error"
    assert "the provider went away" in str(failed)


@pytest.mark.parametrize(
    "body",
    [{"object": "error", "message": "no such engine", "code": 5}, {"detail": "no such engine"},
     {"error_code": 1, "error_msg": "no such engine"}, {"choices": [], "message": "no such engine"}],
    ids=str,
)  # fmt: skip
def test_a_message_in_the_place_of_an_answer_is_told(server: ChatServer, body: Any) -> None:
    """Whatever its key is."""
    server.answers([Reply(body)])
    failed = fails(server)
    assert (failed.reason, "no such engine" in str(failed)) == ("server_error", True)


ASIDE: dict[str, dict[str, Any]] = {
    field: {field: "The cup is held. Yes. No?"} for field in ("reasoning_content", "reasoning", "thinking")
}


@pytest.mark.parametrize("field", list(ASIDE))
def test_where_the_text_is_instead_is_told(server: ChatServer, field: str) -> None:
    """A server that takes all that its model says for thinking answers with nothing: the text's field is named."""
    server.answers([completion("", **ASIDE[field])])
    failed = fails(server)
    assert failed.reason == "bad_answer"
    assert f"answers with nothing, but for {field}:" in str(failed)
    server.answers([completion("yes", **ASIDE[field])])
    assert model(server).ask(ASK).text == "yes"


# ------------------------------------------------------------------------------------------- forms and pictures

REFUSALS = [
    failure(500, "response_format is not implemented"),
    failure(500, "failed to parse grammar"),
    failure(501, "not implemented"),
    failure(404, "no endpoints found that support json_schema"),
    failure(404, "This model does not support structured outputs", "model_not_supported"),
    failure(403, "json_schema is not a part of your plan"),
    Reply({"error": {"message": "json mode is not available for this model"}}),
    Reply({"error": {"message": "invalid request", "code": 400}}),
    Reply({"object": "error", "message": "guided_json needs another backend"}),
    completion(None, "error", error={"message": "failed to compile the grammar"}),
]


@pytest.mark.parametrize("refusal", REFUSALS, ids=range(len(REFUSALS)))
def test_who_cannot_do_schemas_is_asked_more_plainly(server: ChatServer, refusal: Any) -> None:
    """However it says so: by 500, 501, 403 or 404, in the body of a success, in the choice."""
    server.answers(lambda asked: refusal if "response_format" in asked else "{}")
    assert model(server).ask(ASK, SCHEMA).text == "{}"
    forms = [asked.get("response_format", {}).get("type") for asked in server.requests]
    assert forms == ["json_schema", "json_object", None]


def test_what_a_server_said_of_forms_is_kept_to(server: ChatServer) -> None:
    """Not so an error that may have been about anything else: the next time it is asked by schema again."""
    for said, later in (("response_format: no", None), ("out of luck", "json_schema")):
        refusal = Reply({"error": said})
        server.answers([refusal, refusal, "{}"])
        asked = model(server)
        asked.ask(ASK, SCHEMA)
        server.answers(["{}"])
        asked.ask(ASK, SCHEMA)
        assert server.requests[-1].get("response_format", {}).get("type") == later


@pytest.mark.parametrize("said", [failure(500, "out of memory"), failure(503, "busy"), failure(429, "no more")])
def test_a_server_that_breaks_at_something_else_is_asked_once(server: ChatServer, said: Reply) -> None:
    """The form is not blamed for what is not said of it."""
    server.answers([said])
    fails(server, schema=SCHEMA)
    assert len(server.requests) == 1


BLIND = [
    failure(500, "image input is not supported - hint: if this is unexpected, you may need to provide the mmproj"),
    failure(500, "image input is not supported"),
    failure(400, "Invalid content type. image_url is only supported by certain models."),
    failure(400, "m is not a multimodal model"),
    failure(400, "At most 0 image(s) may be provided in one request."),
    failure(422, "Failed to deserialize: messages[1]: unknown variant `image_url`, expected `text` at line 1"),
    failure(404, "No endpoints found that support image input"),
    failure(400, "messages[0].content must be a string"),
    failure(400, "this model doesn't accept images"),
    failure(400, "Unsupported content type: image_url"),
    failure(400, "Model does not support images. Please use a model that does."),
    failure(400, "Vision add-on is not loaded, but images were provided for processing"),
    failure(500, "this model is missing data required for image input"),
    failure(400, "Image input is not enabled for this model"),
    failure(500, 'can only concatenate str (not "list") to str'),
    Reply({"error": {"message": "multimodal requests are not supported"}}),
]


@pytest.mark.parametrize("said", BLIND, ids=range(len(BLIND)))
def test_a_model_that_sees_no_pictures_is_told_at_once(server: ChatServer, said: Reply) -> None:
    """As a reason of its own, in the server's words, of whatever status."""
    server.answers([said])
    failed = fails(server, SEE)
    assert failed.reason == "no_pictures"
    assert said.body["error"]["message"][:40] in str(failed)
    assert fails(server).reason != "no_pictures", "it was shown none"


@pytest.mark.parametrize(
    "said",
    ["image too large: 9 MB, not more than 5", "could not decode the image", "no memory", "the image cannot be read",
     "unsupported image format", "this image is not allowed by our policy", "image media type is not supported",
     "images of this size are not supported", "the model is overloaded, no picture was looked at"],
)  # fmt: skip
def test_one_bad_picture_is_no_blindness(server: ChatServer, said: str) -> None:
    """The next one may be seen: the episode goes on."""
    server.answers([failure(400, said)])
    assert fails(server, SEE).reason == "refused"
    assert LanguageChecker(model(server)).check(HELD, PICTURE).fault == "refused"


def test_a_checker_that_sees_no_pictures_ends_the_episode(server: ChatServer) -> None:
    """At the first answer: it is not asked once more, and the episode is no success."""
    server.answers(BLIND[:1])
    made = bench(LanguageChecker(model(server)), 0, 30, 60)
    outcome = run_episode(made.tree, made.world, made.context, max_time_s=60)
    assert outcome.ending == "backend_error"
    assert outcome.failure is not None
    assert outcome.failure.reason == "no_pictures"
    assert "image input is not supported" in outcome.failure.evidence
    assert len(server.requests) == 1
