"""Reads what an endpoint of chat completions sends: an answer, or what is wrong with it."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from mpvi_bt.errors import ModelError

_QUOTED = 200  # characters of what a server says
_MOST_TOKENS = 10**9  # nobody counts further


@dataclass(frozen=True)
class Said:
    """What a model said.

    Attributes:
        text: Of the answer, never empty.
        model: As the server calls it; "" if it does not say.
        tokens_in, tokens_out: As the server counts them; 0 if it does not say.
    """

    text: str
    model: str
    tokens_in: int
    tokens_out: int


def read_answer(text: str, url: str, hide: Callable[[str], str]) -> Said | ModelError:
    """What is in the body of a successful response.

    Args:
        text: The body.
        url: Of the endpoint, for messages.
        hide: Takes secrets out of a text.
    """

    def bad(what: str, reason: str = "bad_answer") -> ModelError:
        return ModelError(reason, f"{url} {what}", tokens=tokens_in + tokens_out)

    tokens_in = tokens_out = 0
    data = _parsed(text)
    if not isinstance(data, dict):
        return bad(f"answers with {_kind(text)}, not with a chat completion; an API's address often ends in /v1.")
    usage = data.get("usage")
    if isinstance(usage, dict):
        tokens_in, tokens_out = _count(usage.get("prompt_tokens")), _count(usage.get("completion_tokens"))
    if data.get("error"):
        return bad(f"broke: {_message(data['error'], hide)}", "server_error")
    choices = data.get("choices")
    choice = choices[0] if isinstance(choices, list) and choices else None
    message = choice.get("message") if isinstance(choice, dict) else None
    if not isinstance(choice, dict) or not isinstance(message, dict):
        return bad("answers with no choice of what was said.")
    finish = choice.get("finish_reason")
    if refusal := message.get("refusal"):
        return bad(f"refuses: {line(hide(str(refusal)))}", "refused")
    if finish == "content_filter":
        return bad("refuses: its content filter stopped the answer.", "refused")
    if finish == "length":
        return bad(f"stopped the answer after {tokens_out} tokens, before its end: raise how many it may take.")
    content = message.get("content")
    if isinstance(content, list):  # some servers answer in parts
        content = "".join(
            part["text"] for part in content if isinstance(part, dict) and isinstance(part.get("text"), str)
        )
    if not isinstance(content, str) or not content.strip():
        return bad("answers with nothing.")
    model = data.get("model")
    name = line(hide(model)) if isinstance(model, str) else ""
    return Said(hide(_whole(content)), name, tokens_in, tokens_out)


def read_error(text: str, hide: Callable[[str], str]) -> tuple[str, str]:
    """Code and message, "" where there is none, of the body of a response that says what went wrong."""
    data = _parsed(text)
    if not isinstance(data, dict):
        return "", line(hide(text)) if _kind(text) == "text" else ""
    error = data.get("error", data)
    code = error.get("code") if isinstance(error, dict) else None
    return (line(hide(code)) if isinstance(code, str) else ""), _message(error, hide)


def line(text: str) -> str:
    """A text on one line, cut, without what would steer a terminal."""
    text = "".join(c if c.isprintable() else " " for c in text[: 4 * _QUOTED])
    text = " ".join(text.split())
    return text if len(text) <= _QUOTED else text[: _QUOTED - 3] + "..."


def _message(error: Any, hide: Callable[[str], str]) -> str:
    """What an error says, in any of the ways that servers have."""
    for key in ("message", "detail", "error"):
        if isinstance(error, dict) and error.get(key):
            error = error[key]
    return line(hide(error if isinstance(error, str) else json.dumps(error)[: 4 * _QUOTED]))


def _parsed(text: str) -> Any:
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return None


def _kind(text: str) -> str:
    """What a text is that is not the JSON that was due."""
    begin = text.lstrip()[:100].lower()
    if begin.startswith(("<!doctype html", "<html", "<?xml", "<")):
        return "a web page"
    if begin.startswith(("data:", "event:", ": ")):
        return "a stream of events"
    if begin.startswith(("{", "[")):
        return "broken JSON"
    return "text" if begin else "nothing"


def _count(value: Any) -> int:
    return min(value, _MOST_TOKENS) if isinstance(value, int) and value > 0 else 0


def _whole(text: str) -> str:
    """Without halves of surrogate pairs, which can't be written to a file."""
    return text.encode("utf-8", "replace").decode()
