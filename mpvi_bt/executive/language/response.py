"""Parses the response of a chat-completions endpoint: an answer, or the fault."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from mpvi_bt.ground.errors import ModelError

_QUOTED = 200  # characters of what a server says
_MOST_TOKENS = 10**9  # nobody counts further
# Why models stop when they have said all, as OpenAI, llama.cpp, TGI, Anthropic and Gemini call it, and when they have
# not. Whatever else a server says is the name of something that went wrong.
_WHOLE = ("", "stop", "eos", "eos_token", "stop_sequence", "stop_token", "end_turn", "tool_calls", "function_call")
_CUT = ("length", "max_tokens", "max_output_tokens", "model_length", "model_context_window_exceeded")
_FILTERED = ("content_filter", "safety", "recitation", "prohibited_content", "blocklist", "spii", "refusal")
_MESSAGE = ("message", "detail", "error", "error_msg", "msg")  # in which errors say what is wrong
_KINDS = {list: "parts of other kinds than text", dict: "an object", bool: "true or false"}
_ASIDE = ("reasoning_content", "reasoning", "thinking")  # what vLLM, DeepSeek, OpenRouter and Ollama call thinking

# How servers say that they do not know a form of answers, whatever the status.
_FORM = re.compile(
    r"response.?format|json.?(?:schema|object|mode)|structured.?(?:output|decoding)|guided.?\w|grammar|\bschema",
    re.IGNORECASE,
)
# How they say that it is not loaded yet: llama.cpp "Loading model", gateways in other words.
_LOADING = re.compile(
    r"\(503\):.*(?:\bloading\b|\bwarming up\b|\bstarting up\b|not (?:yet )?(?:loaded|ready))", re.IGNORECASE
)
# How they say that a model does not see: of pictures and what it cannot, or in words of their own.
_PICTURES = re.compile(r"image|picture|vision|visual|multi.?modal", re.IGNORECASE)
_CANNOT = re.compile(
    r"(?:\b(?:no|not|only|cannot)\b|n't\b|\bun)[^.]{0,60}?(?:support|accept|enabl|allow|load|multi.?modal|vision)",
    re.IGNORECASE,
)
_ONE_PICTURE = re.compile(
    r"format|mime|media|decod|corrupt|truncat|base64|too (?:large|big|small|many)|larger|exceed|\bsize|resolution"
    r"|safety|policy|moderat",
    re.IGNORECASE,
)
_BLIND = re.compile(
    r"mmproj|\b0 image|missing data required for image|variant .?image_url|content must be a (?:valid )?string"
    r"|can only concatenate str \(not .list.\)",
    re.IGNORECASE,
)


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
        kind = _kind(text)
        why = "turn streaming off there" if kind == _STREAM else "an API's address often ends in /v1"
        return bad(f"answers with {kind}, not with a chat completion; {why}.")
    usage = data.get("usage")
    if isinstance(usage, dict):
        tokens_in, tokens_out = _count(usage.get("prompt_tokens")), _count(usage.get("completion_tokens"))
    choices = data.get("choices")
    choice = choices[0] if isinstance(choices, list) and choices and isinstance(choices[0], dict) else {}
    message = choice.get("message")
    broken = [part["error"] for part in (data, choice, message) if isinstance(part, dict) and part.get("error")]
    if not broken and not choice and any(data.get(key) for key in _MESSAGE):
        broken = [data]
    if broken:
        return bad(f"broke: {_message(broken[0], hide)}", "server_error")
    if not isinstance(message, dict):
        return bad("has no choices in its answer.")
    finish = choice.get("finish_reason") or ""
    ending = str(finish).lower()
    if refusal := message.get("refusal"):
        return bad(f"refuses: {line(hide(str(refusal)))}", "refused")
    if ending in _FILTERED:
        return bad("refuses: its content filter stopped the answer.", "refused")
    if ending in _CUT:
        return bad(f"stopped the answer after {tokens_out} tokens, before its end: raise the limit.")
    if ending not in _WHOLE:
        return bad(f"broke the answer off: finish_reason {line(hide(json.dumps(finish)))}.", "server_error")
    content = message.get("content")
    if isinstance(content, list):  # some servers answer in parts
        texts = [part["text"] for part in content if isinstance(part, dict) and isinstance(part.get("text"), str)]
        content = "".join(texts) if texts or not content else content
    if not isinstance(content, str) or not content.strip():
        return bad(_instead(message, content, hide))
    model = data.get("model")
    name = line(hide(model)) if isinstance(model, str) else ""
    return Said(hide(_whole(content)), name, tokens_in, tokens_out)


def _instead(message: dict[str, Any], content: Any, hide: Callable[[str], str]) -> str:
    """What an answer without text has instead."""
    calls = message.get("tool_calls") or message.get("function_call")
    if calls:
        call = calls[0] if isinstance(calls, list) else calls
        call = call.get("function", call) if isinstance(call, dict) else {}
        name = call.get("name") if isinstance(call, dict) else None
        which = f" {line(hide(name))!r}" if isinstance(name, str) else ""
        return f"answers with a call of a tool{which} where text is due, though no tools were offered."
    if content is not None and not isinstance(content, str):
        return (
            f"answers with {_KINDS.get(type(content), 'a number')} where text is due: {line(hide(json.dumps(content)))}"
        )
    aside = next((key for key in _ASIDE if isinstance(message.get(key), str) and message[key].strip()), "")
    where = f", but for {aside}: its server takes all of it for thinking, and should not" if aside else ""
    return f"answers with nothing{where}."


def read_error(text: str, hide: Callable[[str], str]) -> tuple[str, str]:
    """Code and message of an error response; "" for a missing one."""
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


def names_form(told: str) -> bool:
    """Whether a server complains of the form in which it was asked to answer."""
    return _FORM.search(told) is not None


def names_blindness(told: str) -> bool:
    """Whether a server says that its model cannot see pictures at all, not only that one picture is bad."""
    if _BLIND.search(told):
        return True
    return all(pattern.search(told) for pattern in (_PICTURES, _CANNOT)) and not _ONE_PICTURE.search(told)


def says_loading(told: str) -> bool:
    """Whether a server says that its model is not there yet, but will be."""
    return _LOADING.search(told) is not None


def _message(error: Any, hide: Callable[[str], str]) -> str:
    """The message of an error in any server's form; behind a gateway, the inner server's message too."""
    behind = error.get("metadata") if isinstance(error, dict) else None  # as OpenRouter has it
    for key in _MESSAGE:
        if isinstance(error, dict) and error.get(key):
            error = error[key]
    said = line(hide(error if isinstance(error, str) else json.dumps(error)[: 4 * _QUOTED]))
    if isinstance(behind, dict) and (raw := behind.get("raw")):
        inner = _parsed(raw) if isinstance(raw, str) else raw
        said += f": {_message(inner, hide)}" if isinstance(inner, dict) else f": {line(hide(str(raw)))}"
    return said


def _parsed(text: str) -> Any:
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return None


_STREAM = "a stream of events, though none was asked for"


def _kind(text: str) -> str:
    """A name for a text that is not the expected JSON, such as "a web page"."""
    begin = text.lstrip()[:100].lower()
    if begin.startswith(("<!doctype html", "<html", "<?xml", "<")):
        return "a web page"
    if begin.startswith(("data:", "event:", ": ")):
        return _STREAM
    if begin.startswith(("{", "[")):
        return "broken JSON"
    return "text" if begin else "nothing"


def _count(value: Any) -> int:
    return min(value, _MOST_TOKENS) if isinstance(value, int) and value > 0 else 0


def _whole(text: str) -> str:
    """Without halves of surrogate pairs, which can't be written to a file."""
    return text.encode("utf-8", "replace").decode()
