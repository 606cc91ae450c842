"""A model behind any endpoint that speaks OpenAI's chat completions, by the openai SDK (extra "openai").

Responses are untrusted: bounded in size and time, parsed here, and freed of secrets.
"""

from __future__ import annotations

import base64
import logging
import os
import re
import time
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from mpvi_bt.executive.language.chat import Answer, Message, Schema
from mpvi_bt.executive.language.endpoint import KEY, find_endpoint
from mpvi_bt.executive.language.response import (
    Said,
    line,
    names_blindness,
    names_form,
    read_answer,
    read_error,
    says_loading,
)
from mpvi_bt.executive.language.turns import SHAPES, TOLD, Turn, names_roles, says_nothing, taken_by
from mpvi_bt.ground import proxies
from mpvi_bt.ground.errors import ModelError, UserError
from mpvi_bt.ground.extras import install

TIMEOUT_S = 60.0  # Our choice: a model that thinks takes some ten seconds
CONNECT_S = 5.0
RETRIES = 2  # Our choice: the SDK's. It waits longer each time, or as long as the server asks, two minutes at most
MOST_BYTES = 4 * 2**20  # of a response; a plan takes some kB, and a model that thinks some hundred more

LOADING_S = 120.0  # Our choice: a large model is read from a disk in a minute or two
_LOOK_S = 1.0  # between two looks whether it is loaded

_FORMS = ("json_schema", "json_object", "plain")  # in which an answer is asked for, the most exact first
_log = logging.getLogger(__name__)


class OpenAIModel:
    """Asks over HTTP; the SDK tries again after 408, 409, 429, 5xx and broken connections.

    Where a schema is wanted, the answer is asked for by JSON Schema; of a server that refuses this, or breaks at it, as
    a JSON object; of one that refuses that, plainly. What a server was found to take is kept to from then on, and so is
    what roles a model takes (`mpvi_bt.executive.language.turns`).

    A proxy that the environment names leads to it, unless it is on this machine.

    Args:
        model: As the server calls it.
        url: Of the endpoint, such as "http://localhost:8000/v1"; "": that of OPENAI_BASE_URL, else the vendor's own.
        timeout_s: For an answer to begin, and again for it to end, at every try.
        retries: How often a question is put again at most.
        environment: Where keys come from.

    Raises:
        ModelError: The extra is not installed ("not_installed"), or there is no key where one is needed.
        UserError: The address is none, or the proxy cannot be used.
    """

    def __init__(
        self,
        model: str,
        url: str = "",
        timeout_s: float = TIMEOUT_S,
        retries: int = RETRIES,
        environment: Mapping[str, str] = os.environ,
    ) -> None:
        try:
            import openai
        except ImportError:
            raise ModelError("not_installed", f"openai:MODEL needs the openai SDK: {install('openai')}") from None
        self.name = f"openai:{model}" + (f"@{url}" if url else "")
        self._model, self._timeout_s = model, timeout_s
        self._endpoint = find_endpoint(url, environment)
        self._hide = self._endpoint.secrets.hide
        self._sdk = openai
        self._form = 0  # where to begin in _FORMS
        self._waits = False  # told that it loads its model
        self._proxy = proxies.proxy_for(self._endpoint.url)
        self._client = openai.OpenAI(
            api_key="unused",  # what is sent is said with every request, so that no client has it
            base_url=self._endpoint.url,
            max_retries=retries,
            http_client=openai.DefaultHttpxClient(
                timeout=openai.Timeout(timeout_s, connect=min(CONNECT_S, timeout_s)),
                transport=_transport(self._proxy),
                follow_redirects=False,  # they would take the key elsewhere
                headers={"Accept-Encoding": "identity"},  # so that what is bounded is what is read
                event_hooks={"response": [self._bound]},
            ),
        )
        self._endpoint.secrets.guard_logs()

    def ask(self, messages: Sequence[Message], schema: Schema | None = None) -> Answer:
        """As `ChatModel` says. Takes (retries + 1) * 2 * timeout_s at most for each request, and the waits between."""
        began = time.monotonic()
        turns = [_spoken(message) for message in messages]
        taken = taken_by(self._endpoint.url, self._model)
        shape: int | None = taken.shape
        unexplained: ModelError | None = None  # why other roles were tried: where they fail as well, they were not it
        while shape is not None:
            sent = shape
            said, tries = self._in_some_form(SHAPES[sent](turns), schema)
            shape = taken.next_shape(turns, sent) if isinstance(said, ModelError) else None
            if isinstance(said, ModelError) and not names_roles(self._told(said)):
                silent = not taken.known and says_nothing(str(said))
                taken.known = taken.known or (silent and shape is None)
                shape = shape if silent else None
                unexplained = unexplained or (said if silent else None)
        latency_s = time.monotonic() - began
        if isinstance(said, ModelError):
            said = unexplained or said
            if any(message.png for message in messages) and self._is_blind(said):
                said = ModelError("no_pictures", f"{self.name} sees no pictures: {said}", tokens=said.tokens)
            said.latency_s = latency_s
            raise said
        if sent > taken.shape:
            _log.warning("mpvi: %s: %s", self.name, TOLD[sent])
        taken.shape, taken.known = max(sent, taken.shape), True
        return Answer(said.text, said.model or self._model, latency_s, said.tokens_in, said.tokens_out, tries=tries)

    def _in_some_form(self, turns: list[Turn], schema: Schema | None) -> tuple[Said | ModelError, int]:
        """One question, its answer asked for in less and less exact forms; as `_post`."""
        forms = _FORMS[self._form :] if schema is not None else _FORMS[-1:]
        known = True  # that it was the forms which did not work
        for form in forms:
            said, tries = self._post(turns, form, schema)
            # A failure may be about the form; it is not if the plain question fails as well.
            if isinstance(said, Said) or form == forms[-1]:
                break
            told = self._told(said)
            refused = said.reason == "refused" or names_form(told)
            if not refused and not (said.reason == "server_error" and tries):
                break
            if names_roles(told) and not names_form(told):
                break
            known = known and refused
        if isinstance(said, Said) and schema is not None and known:
            self._form = max(self._form, _FORMS.index(form))
        return said, tries

    def _told(self, failure: ModelError) -> str:
        """Text of a failure, without our names: a model's name may contain words for its abilities."""
        return re.sub(rf"(?<!\w){re.escape(self._model)}(?!\w)", "", str(failure).replace(self._endpoint.url, ""))

    def _is_blind(self, failure: ModelError) -> bool:
        """Whether a failure says that the model sees no pictures at all."""
        said_so = failure.reason in ("refused", "server_error", "bad_answer", "unknown_model")
        return said_so and names_blindness(self._told(failure))

    def _post(self, turns: list[Turn], form: str, schema: Schema | None) -> tuple[Said | ModelError, int]:
        """One question with all its tries: its result, and the number of tries of a successful response.

        A server that still loads its model is waited for. A failure is returned, with nothing in its chain: the SDK's
        errors have the request in them, and the request the key. After one by the protocol, or of the connection, the
        number is 0.
        """
        asked: dict[str, Any] = {"model": self._model, "messages": turns}
        if form == "json_schema":
            wanted = {"name": "answer", "schema": dict(schema or {}), "strict": True}
            asked["response_format"] = {"type": form, "json_schema": wanted}
        elif form == "json_object":
            asked["response_format"] = {"type": form}
        until = time.monotonic() + LOADING_S
        while True:
            said, tries = self._post_once(asked)
            if isinstance(said, Said) or not says_loading(self._told(said)):
                return said, tries
            if time.monotonic() > until:
                what = f"{self._endpoint.url} still loads its model after {LOADING_S:g} s: ask again once it is there"
                return ModelError("model_timeout", f"{what} ({said})."), tries
            if not self._waits:
                _log.warning("mpvi: %s loads its model: waiting, %g s at most", self._endpoint.url, LOADING_S)
            self._waits = True
            time.sleep(_LOOK_S)

    def _post_once(self, asked: dict[str, Any]) -> tuple[Said | ModelError, int]:
        try:
            answer = self._client.chat.completions.with_raw_response.create(
                **asked, extra_headers={"Authorization": self._endpoint.authorization or self._sdk.omit}
            )
            text = self._hide(answer.http_response.text)
            return read_answer(text, self._endpoint.url, self._hide), answer.retries_taken + 1
        except ModelError as error:
            failure = ModelError(error.reason, str(error))
        except self._sdk.APIStatusError as error:
            failure = self._refusal(error.status_code, read_error(error.response.text, self._hide), error)
        except self._sdk.APITimeoutError as error:
            waited = f"no answer within {self._timeout_s:g} s{_tried(error)}{self._through()}"
            failure = ModelError("model_timeout", f"{self.name}: {waited}.")
        except Exception as error:  # of the connection; or whatever else: its chain may have the key in it
            cause = line(self._hide(str(error.__cause__ or error)))
            why = f": {cause}" if cause else ""
            away = "cannot be reached" if self._proxy else "is not there"
            what = f"{self._endpoint.url} {away}{_tried(error)}{self._through()}{why}."
            failure = ModelError("endpoint_down", what)
        return failure, 0

    def _through(self) -> str:
        """By which proxy it is asked."""
        return f", through {proxies.told(self._proxy)}" if self._proxy else ""

    def _refusal(self, status: int, said: tuple[str, str], error: Exception) -> ModelError:
        """What a status other than success means.

        Args:
            status: Of HTTP.
            said: The server's code and message.
            error: That the SDK made of it.
        """
        code, message = said
        url = self._endpoint.url
        told = f"{self._through()} ({status})" + (f": {message}" if message else "")
        if status == 401 and not self._endpoint.authorization:
            return ModelError("no_key", f"{url} wants a key: set {KEY} (401).")
        if status == 401:  # what servers say to it may have parts of the key
            what = f"key in {KEY}" if self._endpoint.keyed else "password in the endpoint's URL"
            return ModelError("wrong_key", f"{url} does not take the {what} (401).")
        if status == 403:
            return ModelError("wrong_key", f"{url} does not let us in{told}")
        if status == 404 and ("model" in code or "model" in message.lower()):
            return ModelError("unknown_model", f"{url} has no model {self._model!r}{told}")
        if status == 404 or 300 <= status < 400:
            return ModelError("bad_answer", f"{url} has no chat completions{told}; an API's address often ends in /v1.")
        if status == 429:
            return ModelError("rate_limited", f"{url} answers no more for now{_tried(error)}{told}")
        if status == 407:
            return ModelError("endpoint_down", f"{url} cannot be reached{told}; a proxy's password stands in its URL.")
        if status != 501 and (status >= 500 or status in (408, 409)):
            return ModelError("server_error", f"{url} broke{_tried(error)}{told}")
        return ModelError("refused", f"{url} refuses the question{told}")

    def _bound(self, response: Any) -> None:
        """Bound what is read of a response, in size and time. Raises ModelError if it is packed."""
        if response.headers.get("content-encoding", "identity") not in ("identity", ""):
            raise ModelError("bad_answer", f"{self._endpoint.url} sends a compressed answer, which was not requested.")
        response.stream = _bounded(response.stream, time.monotonic() + self._timeout_s, self._endpoint.url)


def _transport(proxy: str) -> Any:
    """Connections through a proxy; "": without one, whatever the environment says. Raises UserError."""
    import httpx2

    try:
        return httpx2.HTTPTransport(proxy=proxy or None)
    except (ImportError, ValueError, httpx2.InvalidURL) as error:  # SOCKS needs a package of its own
        why = line(str(error).replace(proxy, "it"))
        raise UserError(f"{proxies.told(proxy)} cannot be used: {why}") from None


def _bounded(stream: Any, deadline: float, url: str) -> Any:
    """The stream of a response, which ends with a ModelError once it is too large, and with a timeout once late."""
    import httpx2

    class Bounded(httpx2.SyncByteStream):
        def __iter__(self) -> Iterator[bytes]:
            size = 0
            for part in stream:
                size += len(part)
                if size > MOST_BYTES:
                    raise ModelError("bad_answer", f"{url} answers with more than {MOST_BYTES // 2**20} MB.")
                if time.monotonic() > deadline:
                    raise httpx2.ReadTimeout("the answer takes too long")
                yield part

        def close(self) -> None:
            stream.close()

    return Bounded()


def _tried(error: Exception) -> str:
    """How often it was tried, where it was more than once."""
    request = getattr(error, "request", None)
    again = request.headers.get("x-stainless-retry-count", "0") if request is not None else "0"
    return f", tried {int(again) + 1} times" if again.isdigit() and int(again) else ""


def _spoken(message: Message) -> Turn:
    """A message as the protocol has it; the picture as a data URL."""
    text = message.text.encode("utf-8", "replace").decode()  # half a surrogate pair can't be sent
    if message.png is None:
        return {"role": message.role, "content": text}
    url = f"data:image/png;base64,{base64.b64encode(message.png).decode()}"
    parts = [{"type": "text", "text": text}, {"type": "image_url", "image_url": {"url": url}}]
    return {"role": message.role, "content": parts}
