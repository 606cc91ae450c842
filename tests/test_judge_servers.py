"""The judge over real sockets: a scripted server for the exact cases, and a real one with a tiny random model.

What no test here can show is whether a model answers rightly: the real server's has random weights.
"""

from __future__ import annotations

import base64
import time
from pathlib import Path
from typing import Any

import pytest
from py_trees.common import Status

from mpvi_bt.executive.completion.judge import LanguageChecker, png
from mpvi_bt.executive.language.exchanges import KeptModel
from mpvi_bt.executive.language.openai import OpenAIModel
from mpvi_bt.executive.ticking.loop import run_episode
from mpvi_bt.executive.trace.explain import explain
from mpvi_bt.executive.trace.explain_text import explanation_text
from mpvi_bt.executive.trace.read import read_trace
from mpvi_bt.ground.protocols import TriggerEvent
from mpvi_bt.ground.robot.protocol import CONTROL_HZ
from mpvi_bt.runs.choices.backends import choose
from mpvi_bt.runs.choices.checkers import make_checker
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.choices.language_models import Models
from mpvi_bt.runs.episode.queries import count_queries, queries_text
from mpvi_bt.runs.recording.recorder import Recorder
from mpvi_bt.testing import KinematicRobot
from tests.bench import HELD, PICK, Bench
from tests.chat_servers import ChatServer, Reply, completion, failure, free_port

pytest.importorskip("openai")

PICTURE = KinematicRobot().look("head")


@pytest.fixture(autouse=True)
def _environment(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("OPENAI_API_KEY", "OPENAI_BASE_URL"):
        monkeypatch.delenv(name, raising=False)


@pytest.fixture
def server(scripted_chat_server: ChatServer) -> ChatServer:
    """Such a server, by a shorter name."""
    return scripted_chat_server


def bench(checker: LanguageChecker, *ticks: int) -> Bench:
    """A pick whose triggers fire at those ticks, counted from 0."""
    made = Bench(PICK)
    made.context.checker = checker
    made.context.triggers.reset = lambda kinds=None: None  # type: ignore[method-assign]
    made.context.triggers.update = lambda: (  # type: ignore[method-assign]
        TriggerEvent("grasp", "right") if made.world.steps in ticks else None
    )
    return made


def test_the_picture_and_the_statement_get_there(server: ChatServer) -> None:
    """As a data URL of PNG beside the words; the answer comes back with what it cost."""
    judged = LanguageChecker(OpenAIModel("tiny", server.url)).check(HELD, PICTURE)
    assert judged.complete
    assert judged.cost is not None
    assert (judged.cost.model, judged.cost.tokens_in, judged.cost.tokens_out) == ("scripted-1", 11, 3)
    text, image = server.requests[0]["messages"][1]["content"]
    assert f'"{HELD}"' in text["text"]
    assert base64.b64decode(image["image_url"]["url"].removeprefix("data:image/png;base64,")) == png(PICTURE.rgb)


@pytest.mark.parametrize(
    ("reply", "fault"),
    [
        (completion("Yes and no."), "bad_answer"),
        (completion("yes " * 2_600_000), "bad_answer"),  # 10 MB
        (completion(None), "bad_answer"),
        (completion("yes", finish="length"), "bad_answer"),
        (completion("yes", refusal="I do not look at pictures"), "refused"),
        (Reply('{"choices": [{"message": {"content": "yes"'), "bad_answer"),
        (Reply("yes"), "bad_answer"),
        (Reply('{"choices": NaN}'), "bad_answer"),
        (Reply('{"a":' * 50_000), "bad_answer"),
        (Reply(b"\xff\xfe\x00 yes"), "bad_answer"),
        (Reply("yes", cut=2), "endpoint_down"),
        (Reply(b"x" * 65536, endless=True), "bad_answer"),
        (failure(400, "the image cannot be read"), "refused"),
        (failure(429, retry_after_ms="1"), "rate_limited"),
        (failure(503, retry_after_ms="1"), "server_error"),
        (Reply(completion("yes"), delay_s=60.0), "model_timeout"),
        (Reply(completion("yes"), drip=(1, 0.05)), "model_timeout"),
    ],
)  # fmt: skip
def test_what_is_no_answer_confirms_nothing_and_is_counted(server: ChatServer, reply: Any, fault: str) -> None:
    """Within the time that it is given; the episode goes on."""
    server.answers([reply])
    timeout_s = 0.5 if fault == "model_timeout" else 60.0
    began = time.monotonic()
    judged = LanguageChecker(OpenAIModel("tiny", server.url, timeout_s, retries=0)).check(HELD, PICTURE)
    assert (judged.complete, judged.fault) == (False, fault)
    assert judged.latency_s <= time.monotonic() - began < 2 * timeout_s + 10.0
    assert "\n" not in judged.reason
    assert len(judged.reason) <= 300


def test_a_server_that_is_away_is_a_no_and_one_that_wants_another_key_ends_the_episode(
    server: ChatServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first may be back by the next question; the second will not."""
    monkeypatch.setenv("OPENAI_API_KEY", "sk-not-to-be-told")
    away = f"http://127.0.0.1:{free_port()}/v1"
    checker = LanguageChecker(OpenAIModel("tiny", away, timeout_s=1.0, retries=0))
    assert checker.check(HELD, PICTURE).fault == "endpoint_down"
    for status, reason in ((401, "wrong_key"), (404, "unknown_model")):
        server.answers([completion("no"), failure(status, "no such", "model_not_found" if status == 404 else None)])
        made = bench(LanguageChecker(OpenAIModel("tiny", server.url, retries=0)), 0, 60)
        outcome = run_episode(made.tree, made.world, made.context, max_time_s=60)
        assert outcome.ending == "backend_error"
        assert outcome.failure is not None
        assert outcome.failure.reason == reason
        assert "\n" not in outcome.failure.evidence
        assert "sk-not" not in outcome.failure.evidence
        assert [q.complete for q in outcome.log.queries] == [False], "what was done is kept"


REFUSALS = [
    failure(400, "the image cannot be read"),
    completion(None, refusal="I do not look at pictures"),
    completion(None, "content_filter"),
    completion("I'm sorry, but I can't assist with that."),
    completion("I\u2019m unable to view images."),
]


@pytest.mark.parametrize("reply", REFUSALS, ids=range(len(REFUSALS)))
def test_a_model_that_refuses_every_question_is_at_fault(server: ChatServer, reply: Any) -> None:
    """However it says so: the episode ends soon, as a fault of the backend that is named, without a "no"."""
    server.answers([reply])
    name = f"openai:tiny@{server.url}"
    made = bench(LanguageChecker(OpenAIModel("tiny", server.url, retries=0)), *range(0, 3000, 30))
    outcome = run_episode(made.tree, made.world, made.context, max_time_s=90)
    assert outcome.ending == "backend_error"
    assert outcome.failure is not None
    assert outcome.failure.reason == "refused"
    assert outcome.failure.evidence.startswith(f"{name} refused each of 3 questions. The last one: ")
    assert len(server.requests) == 3
    assert [(query.said, query.fault) for query in outcome.log.queries] == [("no answer", "refused")] * 2
    counted = count_queries(outcome.log.queries, [True, True], made.tree.spec)
    assert (counted.refused, counted.false_no) == (2, 0)
    assert ", 0 yes, 0 no, 2 refused" in queries_text([counted])


@pytest.mark.parametrize("reply", REFUSALS, ids=range(len(REFUSALS)))
def test_a_model_that_answered_may_refuse(server: ChatServer, reply: Any) -> None:
    """Some pictures are such, others are looked at. What is asked at once fails by the refusal's code, not by a no."""
    server.answers(["no", *[reply] * 5, "yes"])
    made = bench(LanguageChecker(OpenAIModel("tiny", server.url, retries=0)), *range(0, 3000, 30))
    assert run_episode(made.tree, made.world, made.context, max_time_s=90).ending == "success"
    server.answers([reply])
    made = Bench(f"check_complete: {HELD}\nat_once: true")
    made.context.checker = LanguageChecker(OpenAIModel("tiny", server.url, retries=0))
    assert made.run(60) == Status.FAILURE
    assert made.tree.failure is not None
    assert made.tree.failure.reason == "refused"


def test_an_episode_that_ends_with_nothing_but_refusals_is_no_failure_of_the_robot(server: ChatServer) -> None:
    """Even where there were fewer than the checker itself waits for."""
    server.answers(REFUSALS[:1])
    made = bench(LanguageChecker(OpenAIModel("tiny", server.url, retries=0)), 3)
    outcome = run_episode(made.tree, made.world, made.context, max_time_s=5)
    assert outcome.ending == "backend_error"
    assert outcome.failure is not None
    assert "refused every question (1): refused: " in outcome.failure.evidence
    server.answers(["no"])
    made = bench(LanguageChecker(OpenAIModel("tiny", server.url, retries=0)), 3)
    assert run_episode(made.tree, made.world, made.context, max_time_s=5).ending == "time_limit"


def test_an_episode_from_file_ticks_as_the_live_one_did(server: ChatServer, tmp_path: Path) -> None:
    """Every answer falls on the same step, and nobody is asked: the server is gone."""
    server.answers([Reply(completion("no"), delay_s=0.2), Reply(completion("yes"), delay_s=0.1)])
    first = KeptModel("openai:tiny", "tiny", tmp_path, OpenAIModel("tiny", server.url))
    live = bench(LanguageChecker(first), 3, 30)
    live.world.robot.look = different(live)  # type: ignore[method-assign]
    assert live.run(600) == Status.SUCCESS
    server.stop()
    again = bench(LanguageChecker(KeptModel("openai:tiny", "tiny", tmp_path, None)), 3, 30)
    again.world.robot.look = different(again)  # type: ignore[method-assign]
    assert again.run(600) == Status.SUCCESS
    assert again.tree.ticks == live.tree.ticks > 30 + 0.1 * CONTROL_HZ
    pairs = list(zip(live.context.log.queries, again.context.log.queries, strict=True))
    assert [(a.complete, a.time_s, a.latency_s) for a, _ in pairs] == [
        (b.complete, b.time_s, b.latency_s) for _, b in pairs
    ]
    assert [b.cost.kept for _, b in pairs if b.cost] == [True, True]


def different(made: Bench) -> Any:
    """A camera that sees something else at every step, so that no question is asked twice."""
    look = KinematicRobot.look

    def see(camera: str) -> Any:
        image = look(made.world.robot, camera)
        image.rgb[0, 0] = made.world.steps % 256
        return image

    return see


def test_explain_says_why_questions_got_no_answer(server: ChatServer, tmp_path: Path) -> None:
    """Of a run that succeeded as well: how many there were, and the last one's reason."""
    server.answers([failure(500, "first"), failure(500, "out of memory"), "yes"])
    made = bench(LanguageChecker(OpenAIModel("tiny", server.url, retries=0)), 3, 40, 80)
    made.world.robot.look = different(made)  # type: ignore[method-assign]
    outcome = run_episode(made.tree, made.world, made.context, [Recorder(tmp_path / "t.jsonl", {})], max_time_s=60)
    assert outcome.ending == "success"
    explained = explain(read_trace(tmp_path / "t.jsonl"))
    assert [asked.answer.fault for asked in explained.unanswered] == ["server_error", "server_error"]
    text = explanation_text(explained, 500)
    assert "2 questions to the checker got neither yes nor no" in text
    assert "out of memory" in text
    assert "first" not in text
    assert all(len(line) <= 80 for line in explanation_text(explained).splitlines())


def test_what_is_not_on_file_ends_an_offline_episode(tmp_path: Path) -> None:
    """In one line, with what was done until then."""
    (tmp_path / "kept").mkdir()
    checker = LanguageChecker(KeptModel("openai:tiny", "tiny", tmp_path / "kept", None))
    made = bench(checker, 3)
    outcome = run_episode(made.tree, made.world, made.context, max_time_s=10)
    assert (outcome.ending, outcome.failure and outcome.failure.reason) == ("backend_error", "not_recorded")


def test_a_language_model_is_a_checker(server: ChatServer) -> None:
    """A language model by its name and address; it sees, and reads no truth."""
    given = f"openai:tiny@{server.url}"
    backend = choose("checker", given).backend
    assert (backend.sees, backend.privileged) == (True, False)
    checker = make_checker(given, None, {}, 0, Models(EpisodeConfig("t", checker=given)))  # type: ignore[arg-type]
    assert (checker.name, checker.needs_image) == (given, True)
    assert checker.check(HELD, PICTURE).complete


@pytest.mark.rare
@pytest.mark.slow
def test_a_real_server_is_asked_and_its_noise_is_no_yes(real_chat_server: Any) -> None:
    """A tiny random model that sees: it reads the picture and answers noise, which is a no and is counted."""
    checker = LanguageChecker(OpenAIModel(real_chat_server.seeing, real_chat_server.url, 120.0))
    judged = checker.check(HELD, PICTURE)
    assert (judged.complete, judged.fault) == (False, "bad_answer")
    assert judged.cost is not None
    assert judged.cost.tokens_in > 10
    assert judged.latency_s > 0
