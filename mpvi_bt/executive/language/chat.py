"""The interface to language models: messages in, an answer out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Protocol

Schema = Mapping[str, Any]


@dataclass(frozen=True)
class Message:
    """One message of a conversation.

    Attributes:
        role: Its author.
        text: Its content.
        png: A picture beside the text, as the bytes of a PNG file; only a user's message may have one.
    """

    role: Literal["system", "user", "assistant"]
    text: str
    png: bytes | None = None


@dataclass(frozen=True)
class Answer:
    """A model's answer and its cost.

    Attributes:
        text: Unchanged and untrusted; of bounded size.
        model: Name of the model, as the server reports it.
        latency_s: Wall time from the question to the answer, retries included; of an answer on file, the original time.
        tokens_in: Of the question, as the server counts them; 0 if it does not.
        tokens_out: Of the answer, likewise.
        tries: Number of requests until there was an answer.
        kept: Whether it came from the exchanges on file, without cost.
    """

    text: str
    model: str
    latency_s: float = 0.0
    tokens_in: int = 0
    tokens_out: int = 0
    tries: int = 1
    kept: bool = False


class ChatModel(Protocol):
    """A language model, perhaps with vision. Thread-safe.

    Attributes:
        name: As given on the command line, such as "openai:gpt-5".
    """

    name: str

    def ask(self, messages: Sequence[Message], schema: Schema | None = None) -> Answer:
        """Wait for the model's answer.

        Args:
            messages: The conversation so far; the last one is answered.
            schema: JSON Schema of the answer. A server without this feature is asked for JSON, or for plain text, so
                the caller has to parse and check the answer.

        Raises:
            ModelError: There is no answer, or a malformed one.
        """
        ...
