"""The servers that other tests speak with do what they are told."""

from __future__ import annotations

import json
import urllib.error
import urllib.request
from http.client import IncompleteRead, RemoteDisconnected
from typing import Any

import pytest

from tests.chat_servers import ChatServer, Reply, completion, failure

ASK = {"model": "m", "messages": [{"role": "user", "content": "is the cup held"}]}


def post(url: str, body: Any = ASK) -> Any:
    request = urllib.request.Request(f"{url}/chat/completions", json.dumps(body).encode(), {"X-Word": "here"})
    with urllib.request.urlopen(request, timeout=20) as answer:
        return json.load(answer)


def said(answer: Any) -> str:
    return str(answer["choices"][0]["message"]["content"])


def test_the_script_is_replied_in_order(scripted_chat_server: ChatServer) -> None:
    """Texts, bodies and errors; the last for ever; what was asked is kept."""
    assert said(post(scripted_chat_server.url)) == "yes"
    scripted_chat_server.answers(["no", completion(None, refusal="I won't"), failure(429, retry_after="3")])
    assert said(post(scripted_chat_server.url)) == "no"
    assert post(scripted_chat_server.url)["choices"][0]["message"]["refusal"] == "I won't"
    for _ in range(2):
        with pytest.raises(urllib.error.HTTPError) as error:
            post(scripted_chat_server.url)
        assert (error.value.code, error.value.headers["Retry-After"]) == (429, "3")
    assert scripted_chat_server.requests == [ASK] * 5
    assert {headers["x-word"] for headers in scripted_chat_server.headers} == {"here"}


def test_a_connection_can_break_anywhere(scripted_chat_server: ChatServer) -> None:
    """Before the headers, or within the body."""
    scripted_chat_server.answers([Reply(completion("yes"), cut=0), Reply(completion("yes"), cut=20), "yes"])
    with pytest.raises((RemoteDisconnected, ConnectionResetError)):
        post(scripted_chat_server.url)
    with pytest.raises((IncompleteRead, ConnectionResetError)):
        post(scripted_chat_server.url)
    assert said(post(scripted_chat_server.url)) == "yes"


def test_a_function_answers_by_the_request(scripted_chat_server: ChatServer) -> None:
    """It is given the JSON."""
    scripted_chat_server.answers(lambda request: request["messages"][-1]["content"].upper())
    assert said(post(scripted_chat_server.url)) == "IS THE CUP HELD"
