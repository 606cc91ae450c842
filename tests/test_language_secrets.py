"""Keys and passwords are in no answer, error, chain, traceback, recording, name or log, whatever a server echoes."""

from __future__ import annotations

import base64
import json
import logging
import os
import subprocess
import sys
import time
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from mpvi_bt.executive.language.budget import Budget, BudgetedModel
from mpvi_bt.executive.language.chat import Message
from mpvi_bt.executive.language.endpoint import find_endpoint
from mpvi_bt.executive.language.exchanges import KeptModel
from mpvi_bt.executive.language.openai import OpenAIModel
from mpvi_bt.executive.language.secrets import HIDDEN, Secrets
from mpvi_bt.ground.errors import ModelError
from tests.chat_servers import ChatServer, Reply, completion, failure, free_port

pytest.importorskip("openai")

KEY = "sk-CANARY/with+signs=0123456789"
PASSWORD = "CANARY pass:word/42"
TOKEN = base64.b64encode(f"me:{PASSWORD}".encode()).decode()
QUOTED = "CANARY%20pass%3Aword%2F42"
ASK = [Message("user", "Is the cup held?")]


def escaped(text: str) -> str:
    """As JSON may have it."""
    return "".join(f"\\u{ord(c):04x}" for c in text)


def hidden(told: str) -> None:
    """Nothing of the canaries is in a text."""
    for secret in ("CANARY", TOKEN, QUOTED, base64.b64encode(KEY.encode()).decode()):
        assert secret not in told, told[max(0, told.find(secret) - 200) :][:400]


@pytest.fixture(params=["key", "password"])
def secret(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch, scripted_chat_server: ChatServer) -> str:
    """What lets us in: a key, or a password in the URL; what the server sees of it."""
    if request.param == "key":
        monkeypatch.setenv("OPENAI_API_KEY", KEY)
        monkeypatch.setenv("OPENAI_BASE_URL", scripted_chat_server.url)
        return f"Bearer {KEY}"
    monkeypatch.delenv("OPENAI_API_KEY", raising=False)
    monkeypatch.setenv("OPENAI_BASE_URL", scripted_chat_server.url.replace("//", f"//me:{QUOTED}@"))
    return f"Basic {TOKEN}"


@pytest.fixture
def logs() -> Iterator[Callable[[], str]]:
    """Everything that is logged, at every level, with tracebacks."""
    records: list[str] = []

    class Keeper(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            records.append(f"{self.format(record)} {record.__dict__}")

    root, keeper = logging.getLogger(), Keeper(1)
    level = root.level
    root.addHandler(keeper)
    root.setLevel(1)
    for name in ("openai", "httpx2", "httpcore2"):
        logging.getLogger(name).setLevel(1)
    try:
        yield lambda: "\n".join(records)
    finally:
        root.removeHandler(keeper)
        root.setLevel(level)
        for name in ("openai", "httpx2", "httpcore2"):
            logging.getLogger(name).setLevel(logging.NOTSET)


def told_of(error: BaseException) -> str:
    """All that can be told of an error: chain, frames and the values in them."""
    ours = error.__traceback__.tb_next if error.__traceback__ else None  # below the test, which knows the secret
    shown = traceback.TracebackException(type(error), error, ours, capture_locals=True)
    return "".join([*shown.format(), repr(error), str(vars(error)), repr(error.__context__), repr(error.__cause__)])


def echoes(secret: str) -> dict[str, Any]:
    """What a server may do with what lets us in."""
    echo = {"x-request-id": secret, "x-echo": secret, "retry-after-ms": "1"}
    bodies: dict[str, Any] = {
        str(status): Reply({"error": {"message": f"I got {secret}", "code": secret, "type": secret}}, status, echo)
        for status in (400, 401, 403, 404, 409, 422, 429, 500, 503)
    }
    bodies |= {
        "text": Reply(f"Authorization: {secret}", 500, echo),
        "detail": Reply({"detail": [{"input": {"authorization": secret}}]}, 422),
        "web page": Reply(f"<html>{secret}</html>", 200, echo),
        "redirect": Reply("", 307, {"location": f"http://127.0.0.1:1/?was={secret}"}),
        "junk": Reply(f"data: {secret}", 200, echo),
        "refusal": completion(None, refusal=f"I don't take {secret}"),
        "odd error": {"error": {"message": secret}},
        "escaped": Reply('{"error": {"message": "' + escaped(secret) + '"}}', 400),
        "slashed": Reply('{"error": {"message": "' + secret.replace("/", "\\/") + '"}}', 400),
        "cut": Reply(completion(secret), headers=echo, cut=20),
    }
    return bodies


@pytest.mark.parametrize("echo", list(echoes("")))
def test_errors_tell_no_secret(
    secret: str, echo: str, scripted_chat_server: ChatServer, logs: Callable[[], str], tmp_path: Path
) -> None:
    """Neither they, nor what is logged and kept, whatever part of the answer has it."""
    scripted_chat_server.answers([echoes(secret)[echo]])
    inner = OpenAIModel("tiny", retries=1)
    model = KeptModel("openai:tiny", "tiny", tmp_path, BudgetedModel(inner, [Budget("episode")]))
    with pytest.raises(ModelError) as error:
        model.ask(ASK)
    assert scripted_chat_server.headers[0]["authorization"] == secret
    hidden(told_of(error.value))
    hidden("".join(path.read_text() for path in tmp_path.glob("*.json")))
    assert "HTTP Request" in logs()  # it has really logged
    hidden(logs())


def test_answers_tell_no_secret(
    secret: str, scripted_chat_server: ChatServer, logs: Callable[[], str], tmp_path: Path
) -> None:
    """A model that says what it was sent."""
    said = completion(f"yes, {secret} and {escaped(secret)}")
    body = json.dumps({**said, "model": f"tiny {secret}"}).replace("\\\\u", "\\u")
    scripted_chat_server.answers([Reply(body, headers={"x-request-id": secret})])
    answer = KeptModel("openai:tiny", "tiny", tmp_path, OpenAIModel("tiny")).ask(ASK)
    assert HIDDEN in answer.text
    hidden(repr(answer))
    hidden("".join(path.read_text() for path in tmp_path.glob("*.json")))
    hidden(logs())


SECRET = 'sk-"CANARY/9\\x.key-of-a-test'
ONCE, TWICE = json.dumps(SECRET)[1:-1], json.dumps(json.dumps(SECRET)[1:-1])[1:-1]
UNICODE = escaped(SECRET)


@pytest.mark.parametrize(
    ("spelled", "depth"),
    [
        (ONCE, 1),
        (TWICE, 2),
        (UNICODE, 1),
        (UNICODE.upper().replace("\\U", "\\u"), 1),
        (json.dumps(UNICODE)[1:-1], 2),
        ("".join(escaped(c) if k % 2 else json.dumps(c)[1:-1] for k, c in enumerate(SECRET)), 1),
        (ONCE.replace("/", "\\/"), 1),
    ],
    ids=range(7),
)
def test_a_secret_in_escapes_is_hidden(spelled: str, depth: int) -> None:
    """However JSON may spell it: decoding what is left does not give it back."""
    assert spelled != SECRET
    left = told = Secrets.of([SECRET]).hide(f'{{"about": "a {spelled} b"}}')
    for _ in range(depth):
        told = json.loads(told)["about"] if told.startswith("{") else json.loads(f'"{told}"')
    assert told == f"a {HIDDEN} b"
    hidden(left)


@pytest.mark.parametrize("text", ["\\" * 2**20, "\\u0073" * 2**17, "\\\\s\\\\k" * 2**17])
def test_hiding_takes_linear_time(text: str) -> None:
    """A text of backslashes, as long as an answer may be, is gone through at once."""
    began = time.monotonic()
    assert Secrets.of([SECRET, KEY]).hide(text) == text
    assert time.monotonic() - began < 10.0


def test_a_plan_tells_no_secret(scripted_chat_server: ChatServer, mpvi: Callable[..., Any], tmp_path: Path) -> None:
    """That a server echoes in escapes within the plan's JSON: not on the screen, nor in any file that is written."""
    segment = {"type": "navigation", "completion_criterion": "the robot is at the fridge", "room": "kitchen"}
    plan = {"task_name": "t", "segments": [{**segment, "target": "fridge", "description": "go, @ @"}]}
    text = json.dumps(plan).replace("@", escaped(KEY), 1).replace("@", KEY.replace("/", "\\/"))
    scripted_chat_server.answers([text])
    planner = f"openai:tiny@{scripted_chat_server.url}"
    done = mpvi("plan", "fetch it", "--planner", planner, "--exchanges", "x", "--out", "p.json", OPENAI_API_KEY=KEY)
    assert done.returncode == 0, done.stderr
    assert HIDDEN in (tmp_path / "p.json").read_text()
    dry = mpvi("run", "--dry", "--plan", "p.json", "--no-watch", OPENAI_API_KEY=KEY)
    (trace,) = tmp_path.rglob("*.trace.jsonl")
    page = mpvi("render", str(trace), "--format", "html", "--out", "page.html")
    assert (dry.returncode, page.returncode) == (0, 0), dry.stderr + page.stderr
    told = [path.read_text() for path in tmp_path.rglob("*") if path.is_file()]
    hidden("".join([done.stdout, done.stderr, dry.stdout, dry.stderr, *told]))


def test_models_show_no_secret(secret: str) -> None:
    """Nor do endpoints, as text or as Python shows them."""
    model, endpoint = OpenAIModel("tiny"), find_endpoint()
    hidden(f"{model!r} {model} {model.name} {vars(model)} {endpoint!r} {endpoint} {endpoint.url} {endpoint.secrets}")


def test_a_server_that_is_away_is_told_without_secrets(
    monkeypatch: pytest.MonkeyPatch, logs: Callable[[], str]
) -> None:
    """Its address is quoted, the password in it is not."""
    port = free_port()
    monkeypatch.setenv("OPENAI_BASE_URL", f"http://me:{QUOTED}@127.0.0.1:{port}/v1")
    monkeypatch.setenv("OPENAI_API_KEY", KEY)
    with pytest.raises(ModelError, match=f"127.0.0.1:{port}") as error:
        OpenAIModel("tiny", retries=0).ask(ASK)
    assert error.value.reason == "endpoint_down"
    hidden(told_of(error.value))
    hidden(logs())


@pytest.mark.parametrize("odd", ["\u00e9", "\u2026", " in the middle", "\nX-Other: header"])
def test_keys_that_cannot_be_sent_are_not_quoted(monkeypatch: pytest.MonkeyPatch, odd: str) -> None:
    """Such as one with a line break."""
    monkeypatch.setenv("OPENAI_API_KEY", f"CANARY{odd}CANARY")
    with pytest.raises(ModelError) as error:
        OpenAIModel("tiny")
    assert error.value.reason == "wrong_key"
    hidden(str(error.value))


CODE = """
from mpvi_bt.ground.errors import ModelError
from mpvi_bt.executive.language.chat import Message
from mpvi_bt.executive.language.openai import OpenAIModel
model = OpenAIModel("tiny", retries=1)
for text in ("one", "two"):
    try:
        print(model.ask([Message("user", text)]))
    except ModelError as error:
        print(error.reason, error)
"""


def test_the_sdks_own_logging_tells_no_secret(secret: str, scripted_chat_server: ChatServer) -> None:
    """OPENAI_LOG=debug, as its manual says, and a server that echoes."""
    scripted_chat_server.answers([echoes(secret)["429"], completion(f"yes {secret}"), echoes(secret)["401"]])
    done = subprocess.run(
        [sys.executable, "-c", CODE],
        env={**os.environ, "OPENAI_LOG": "debug"},
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    assert "DEBUG" in done.stderr
    assert "wrong_key" in done.stdout
    assert HIDDEN in done.stdout
    hidden(done.stdout + done.stderr)


def test_short_words_are_no_secrets(scripted_chat_server: ChatServer, monkeypatch: pytest.MonkeyPatch) -> None:
    """A local server's "none" is not cut out of answers."""
    monkeypatch.setenv("OPENAI_API_KEY", "none")
    scripted_chat_server.answers(["none of them"])
    assert OpenAIModel("tiny", scripted_chat_server.url).ask(ASK).text == "none of them"
    assert scripted_chat_server.headers[0]["authorization"] == "Bearer none"


def test_the_longest_is_hidden_first() -> None:
    """So that nothing of it is left."""
    assert Secrets.of(["CANARY00", "CANARY0012"]).hide("CANARY0012 CANARY00") == f"{HIDDEN} {HIDDEN}"
    hidden(repr(Secrets.of([KEY])))


def test_failure_of_helpers_is_seen() -> None:
    """The canary is found where it is."""
    with pytest.raises(AssertionError):
        hidden(f"x {KEY}")
    with pytest.raises(AssertionError):
        hidden(failure(400, KEY).data.decode())
