"""Questions to models and their answers on file: a cache, a recording and its replay in one.

A question is identified by its content: model, messages with pictures, and schema. An exchange is a JSON file named by
the digest of the question; pictures lie beside it under their own digests. Several processes may share a folder.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import json
import logging
import os
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from pydantic import Field, ValidationError, model_validator

from mpvi_bt.executive.language.chat import Answer, ChatModel, Message, Schema
from mpvi_bt.ground.errors import ModelError, UserError, shown
from mpvi_bt.ground.marked_yaml import Record
from mpvi_bt.ground.writing import unwritable, write_whole

FORMAT = 1  # of the files, and of what the digest is made of

# Failures that are answers in their way: to put the question again would bring the same, and cost again.
_FINAL = ("refused", "bad_answer")
# Those that may pass: the question is put again, unless a run is replayed, which went on from them.
_PASSING = ("endpoint_down", "model_timeout", "rate_limited", "server_error", "no_pictures")

_log = logging.getLogger(__name__)


class _Answered(Record):
    """As `Answer`."""

    text: str
    model: str
    latency_s: float = Field(ge=0.0, allow_inf_nan=False)
    tokens_in: int = Field(ge=0)
    tokens_out: int = Field(ge=0)
    tries: int = Field(ge=1)


class _FailedExchange(Record):
    """As `ModelError`."""

    reason: str
    message: str
    latency_s: float = Field(ge=0.0, allow_inf_nan=False)
    tokens: int = Field(ge=0)


class _Exchange(Record):
    """One file."""

    exchange: int = Field(ge=FORMAT, le=FORMAT)
    model: str
    messages: list[dict[str, str]]
    schema_: dict[str, Any] | None = Field(alias="schema")
    answer: _Answered | None = None
    failure: _FailedExchange | None = None

    @model_validator(mode="after")
    def _is_whole(self) -> _Exchange:
        if self.answer is None and self.failure is None:
            raise ValueError("neither an answer nor a failure")
        return self


class KeptModel:
    """A model whose exchanges are kept: an answer on file is reused, without cost.

    It has its original latency, so a repeated run is identical. Two processes that ask the same question at once both
    get the answer that was kept first.

    Args:
        name: Of the model, as given on the command line.
        model: As its server calls it: what questions are known by, wherever it runs.
        folder: Of the files; made when first written to.
        inner: Who is asked what is not on file; None: nobody, a run is replayed.

    Attributes:
        name: Of the model.
    """

    def __init__(self, name: str, model: str, folder: Path, inner: ChatModel | None) -> None:
        self.name, self._model, self._folder, self._inner = name, model, folder, inner

    def ask(self, messages: Sequence[Message], schema: Schema | None = None) -> Answer:
        """As `ChatModel` says.

        Raises:
            ModelError: As the inner one; what failed then, from the file; or nothing is on file ("not_recorded").
            UserError: The folder cannot be written.
        """
        question = _question(self._model, messages, schema)
        path = self._folder / f"{_digest(question)}.json"
        kept = self._read(path)
        if _settled(kept) or (kept is not None and self._inner is None):
            return _told(kept)
        if self._inner is None:
            raise ModelError("not_recorded", f"{self._folder}: {self.name} was never asked {_brief(messages)}.")
        try:
            told: Answer | ModelError = self._inner.ask(messages, schema)
        except ModelError as error:
            if error.reason not in (*_FINAL, *_PASSING):
                raise
            told = error
        return _told(self._keep(path, question, messages, told))

    def _keep(
        self, path: Path, question: dict[str, Any], messages: Sequence[Message], given: Answer | ModelError
    ) -> Answer | ModelError:
        """Write an exchange, unless an answer came first: which of them is on file now."""
        with self._locked():
            first = self._read(path, tell=False)
            if first is not None and _settled(first):
                return first
            for message in messages:
                if message.png is not None:
                    picture = self._folder / f"{hashlib.sha256(message.png).hexdigest()}.png"
                    if not picture.exists():
                        write_whole(picture, message.png)
            if isinstance(given, Answer):
                fields = asdict(given)
                fields.pop("kept")
                told = {"answer": fields}
            else:
                failure = {"reason": given.reason, "message": str(given)}
                told = {"failure": failure | {"latency_s": given.latency_s, "tokens": given.tokens}}
            data = {"exchange": FORMAT, **question, **told}
            write_whole(path, json.dumps(data, indent=1, ensure_ascii=False, allow_nan=False) + "\n")
        return given

    def _read(self, path: Path, tell: bool = True) -> Answer | ModelError | None:
        """The stored exchange; None if there is none or it is unreadable (this is reported)."""
        try:
            data = _Exchange.model_validate_json(path.read_bytes())
        except FileNotFoundError:
            return None
        except (OSError, ValidationError) as error:
            why = error.strerror if isinstance(error, OSError) else "no exchange, or not all of one"
            if self._inner is None:
                raise ModelError("not_recorded", f"{path}: {why}; without --offline it is asked anew.") from None
            if tell:
                _log.warning("mpvi: %s: %s; asking anew", path, why)
            return None
        if data.answer is not None:
            return Answer(**data.answer.model_dump(), kept=True)
        failed = data.failure
        assert failed is not None
        return ModelError(failed.reason, failed.message, failed.latency_s)

    @contextlib.contextmanager
    def _locked(self) -> Iterator[None]:
        """Let one process write at a time. Raises UserError if the folder cannot be written."""
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            handle = os.open(self._folder / ".lock", os.O_RDWR | os.O_CREAT, 0o644)
        except OSError as error:
            raise unwritable(self._folder, error) from None
        try:
            fcntl.flock(handle, fcntl.LOCK_EX)
            yield
        finally:
            os.close(handle)


def check_folder(folder: Path, offline: bool) -> None:
    """Refuse a folder that cannot be of use. Raises UserError."""
    if offline and not folder.is_dir():
        raise UserError(f"{folder}: no such folder; --offline answers from the exchanges of an earlier run.")
    if folder.exists() and not folder.is_dir():
        raise UserError(f"{folder}: is no folder; --exchanges wants one.")


def _question(model: str, messages: Sequence[Message], schema: Schema | None) -> dict[str, Any]:
    """What a question is known by, as JSON values."""
    told = []
    for message in messages:
        entry = {"role": message.role, "text": message.text.encode("utf-8", "replace").decode()}
        if message.png is not None:
            entry["png"] = hashlib.sha256(message.png).hexdigest()
        told.append(entry)
    return {"model": model, "messages": told, "schema": dict(schema) if schema is not None else None}


def _digest(question: dict[str, Any]) -> str:
    text = json.dumps({"format": FORMAT, **question}, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def _settled(kept: Answer | ModelError | None) -> bool:
    """Whether nobody need be asked again."""
    return isinstance(kept, Answer) or (kept is not None and kept.reason in _FINAL)


def _told(kept: Answer | ModelError | None) -> Answer:
    """The answer. Raises what is none."""
    if isinstance(kept, Answer):
        return kept
    assert kept is not None
    raise kept


def _brief(messages: Sequence[Message]) -> str:
    """The last message, for a line."""
    last = messages[-1] if messages else Message("user", "")
    words = " ".join(last.text.split())
    picture = f" with picture {hashlib.sha256(last.png).hexdigest()[:12]}" if last.png is not None else ""
    return f"{shown(words[-56:])}{picture}"
